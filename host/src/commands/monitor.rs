//! `meshband monitor`: live view of a node in the terminal, or of a captured link.

use clap::Args as ClapArgs;
use meshband_host::link::view::View;
use meshband_host::link::{Client, transport};
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
    /// Writes the bytes' meaning at the end as JSON.
    #[arg(long)]
    json: Option<PathBuf>,
}

/// Time between two drawings.
const REDRAW: Duration = Duration::from_millis(200);

/// Shows what the node says until told to stop.
pub fn run(args: Args) -> Result<()> {
    if !(args.patience > 0.0 && args.patience.is_finite()) {
        return Err(Error::invalid("--patience", "must be a positive number of seconds"));
    }
    let (mut client, ticks_per_second) = match (&args.replay, &args.port) {
        (Some(path), _) => (Client::new(transport::replay(path)?), None),
        (None, Some(port)) => {
            let mut client = Client::open(port)?;
            let identity = client.identify()?;
            (client, Some(identity.ticks_per_second))
        }
        (None, None) => return Err(Error::invalid("PORT", "a port or --replay FILE is needed")),
    };
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
    if args.replay.is_some() && view.messages == 0 {
        return Err(Error::invalid("--replay", "holds no intact frame of a node"));
    }
    print!("{}", view.text(client.losses(), ticks_per_second));
    if let Some(path) = args.json {
        let value = serde_json::json!({ "view": view, "losses": client.losses() });
        std::fs::write(&path, format!("{value:#}\n")).map_err(Error::file(&path))?;
    }
    Ok(())
}
