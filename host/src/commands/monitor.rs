//! `meshband monitor`: live view of a node in the terminal, or of a captured link.

use clap::Args as ClapArgs;
use meshband_host::link::view::View;
use meshband_host::link::{Client, report, transport};
use meshband_host::report::write_json;
use meshband_host::{Error, Result};
use std::io::{IsTerminal, Write};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Arguments of `meshband monitor`.
#[derive(ClapArgs)]
pub struct Args {
    /// Serial port, pseudo-terminal or tcp:HOST:PORT.
    #[arg(required_unless_present = "replay")]
    port: Option<String>,
    /// Captured bytes of a link instead of a port.
    #[arg(long, conflicts_with = "port")]
    replay: Option<PathBuf>,
    /// Ends after this many messages.
    #[arg(long)]
    frames: Option<u64>,
    /// Shows the view once, after a mesh-band spectrum has come (or the link has ended), and ends.
    #[arg(long)]
    once: bool,
    /// Ends after this many seconds without any message.
    #[arg(long, default_value_t = 30.0)]
    patience: f64,
    /// Writes the newest of everything, at the end, as JSON.
    #[arg(long)]
    json: Option<PathBuf>,
    /// Writes the same as a report with a picture.
    #[arg(long)]
    report: Option<PathBuf>,
}

/// Time between two drawings.
const REDRAW: Duration = Duration::from_millis(200);

/// Shows what the node says until told to stop.
pub fn run(args: Args) -> Result<()> {
    if !(args.patience > 0.0 && args.patience.is_finite()) {
        return Err(Error::invalid("--patience", "must be a positive number of seconds"));
    }
    let (mut client, identity) = match (&args.replay, &args.port) {
        (Some(path), _) => (Client::new(transport::replay(path)?), None),
        (None, Some(port)) => {
            let mut client = Client::open(port)?;
            let identity = client.identify()?;
            (client, Some(identity))
        }
        (None, None) => return Err(Error::invalid("PORT", "a port or --replay FILE is needed")),
    };
    let ticks_per_second = identity.map(|identity| identity.ticks_per_second);
    let live = std::io::stdout().is_terminal() && args.replay.is_none() && !args.once;
    let mut view = View::default();
    let (mut drawn, mut heard) = (Instant::now(), Instant::now());
    while args.frames.is_none_or(|frames| view.messages < frames) && !(args.once && view.spectrum.is_some()) {
        match client.next_message(REDRAW)? {
            Some(message) => {
                view.take(message);
                heard = Instant::now();
            }
            None if client.has_ended() => break,
            None if heard.elapsed().as_secs_f64() > args.patience => {
                eprintln!("monitor: the node has been silent for {} s", args.patience);
                break;
            }
            None => {}
        }
        if live && drawn.elapsed() >= REDRAW {
            drawn = Instant::now();
            // Home, picture, erase what is left of the former one.
            let picture = view.text(client.losses(), ticks_per_second).replace('\n', "\x1b[K\n");
            print!("\x1b[H{picture}\x1b[J");
            // A terminal that is gone ends the program at the next line anyway.
            let _ = std::io::stdout().flush();
        }
    }
    if let Some(path) = args.replay.as_ref().filter(|_| view.messages == 0) {
        return Err(Error::invalid(path.display(), "holds no intact frame of a node"));
    }
    // The self-test goes on after the start; the newest result, where the node is still there to ask.
    let alive = !client.has_ended() && heard.elapsed() < Duration::from_secs(5);
    let identity = identity.map(|first| if alive { client.identify().unwrap_or(first) } else { first });
    if let Some(identity) = &identity {
        println!("{}", report::self_test(identity));
    }
    print!("{}", view.text(client.losses(), ticks_per_second));
    if let Some(path) = args.json {
        let losses = client.losses();
        write_json(&path, &serde_json::json!({ "identity": identity, "view": view, "losses": losses }))?;
    }
    if let Some(path) = args.report {
        let file = args.replay.map(|path| path.display().to_string());
        let source = file.or(args.port).unwrap_or_default();
        report::of_view(&view, client.losses(), &source, identity.as_ref())?.write(&path)?;
    }
    Ok(())
}
