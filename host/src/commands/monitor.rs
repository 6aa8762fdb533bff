//! `meshband monitor`: live view of a node in the terminal, or of a captured link.

use super::results::Results;
use clap::Args as ClapArgs;
use meshband_host::link::view::View;
use meshband_host::link::{Client, report, transport};
use meshband_host::output::{interrupt, show};
use meshband_host::{Error, Result, remark, say};
use std::io::IsTerminal;
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
    #[command(flatten)]
    results: Results,
}

/// Time between two drawings.
const REDRAW: Duration = Duration::from_millis(200);

/// What a link that ended without any message has to be told of.
const NOTHING_SENT: &str = "the link ended before the node sent any message";

/// Shows what the node says until told to stop.
pub fn run(args: Args) -> Result<()> {
    if !(0.001..=1e6).contains(&args.patience) {
        return Err(Error::invalid("--patience", format!("{} s is not within 0.001 s to 1e6 s", args.patience)));
    }
    let mut files = args.results.announce(&mut args.results.outputs(args.replay.as_deref()))?;
    let (mut client, identity) = match (&args.replay, &args.port) {
        (Some(path), _) => (Client::new(transport::replay(path)?), None),
        (None, Some(port)) => {
            let mut client = Client::open(port)?;
            let identity = client.identify()?;
            (client, Some(identity))
        }
        (None, None) => return Err(Error::invalid("PORT", "a port or --replay FILE is needed")),
    };
    let ticks_per_second = identity.as_ref().map(|identity| identity.ticks_per_second);
    let live = std::io::stdout().is_terminal() && args.replay.is_none() && !args.once;
    let mut view = View::default();
    let (mut drawn, mut heard) = (Instant::now(), Instant::now());
    // Ctrl-C is how a live view ends: what has been heard is still written.
    interrupt::only_ask();
    let enough = |view: &View| {
        let counted = args.frames.is_some_and(|frames| view.messages >= frames);
        counted || (args.once && view.spectrum.is_some()) || interrupt::requested()
    };
    while !enough(&view) {
        match client.next_message(REDRAW)? {
            Some(message) => {
                view.take(message);
                heard = Instant::now();
            }
            None if client.has_ended() => break,
            None if heard.elapsed().as_secs_f64() > args.patience => {
                if view.messages > 0 {
                    remark!("monitor: the node has been silent for {} s", args.patience);
                }
                break;
            }
            None => {}
        }
        if live && drawn.elapsed() >= REDRAW {
            drawn = Instant::now();
            // Home, picture, erase what is left of the former one.
            let picture = view.text(client.losses(), ticks_per_second).replace('\n', "\x1b[K\n");
            show(&format!("\x1b[H{picture}\x1b[J"))?;
        }
    }
    if let Some(path) = args.replay.as_ref().filter(|_| view.messages == 0) {
        let why = client.unreadable().unwrap_or_else(|| "holds no intact frame of a node".to_owned());
        return Err(Error::invalid(path.display(), why));
    }
    // Who ends the wait knows why nothing came.
    let waited = args.frames != Some(0) && !interrupt::requested();
    if let Some(port) = args.port.as_ref().filter(|_| view.messages == 0 && waited) {
        let what = format!(
            "the node answers but sent no message within {} s: it is stopped, or waits for a configuration",
            args.patience
        );
        return Err(Error::invalid(
            format!("port {port}"),
            if client.has_ended() { NOTHING_SENT.into() } else { what },
        ));
    }
    // The self-test goes on after the start; the newest result, where the node is still there to ask.
    let alive = !client.has_ended() && heard.elapsed() < Duration::from_secs(5) && !interrupt::requested();
    let identity = identity.map(|first| if alive { client.identify().unwrap_or(first) } else { first });
    let losses = client.losses();
    let source = args.replay.map(|path| path.display().to_string()).or(args.port).unwrap_or_default();
    files.write(&serde_json::json!({ "identity": identity, "view": view, "losses": losses }), || {
        report::of_view(&view, losses, &source, identity.as_ref())
    })?;
    if let Some(identity) = &identity {
        say!("{}\n{}", report::identity(identity), report::self_test(identity.self_test))?;
    }
    show(&view.text(losses, ticks_per_second))
}
