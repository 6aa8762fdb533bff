//! `meshband monitor`: live view of a node in the terminal, or of a captured link.
//!
//! In a terminal the view is live and everything is captured; elsewhere (a pipe, `--once`, `--frames`) text comes at
//! the end. Both open a lost port again; a port that stays away for the patience ends the command with an error,
//! after what was heard is written.

use clap::Args as ClapArgs;
use meshband_host::link::limit::Limit;
use meshband_host::link::view::View;
use meshband_host::link::{Client, Losses, health, report, text, transport};
use meshband_host::monitor::capture::Capture;
use meshband_host::monitor::link::{Standing, Watched};
use meshband_host::monitor::panel::Panel;
use meshband_host::monitor::terminal::{Limits, live, take_replies};
use meshband_host::output::{Outputs, interrupt, show};
use meshband_host::results::{Announced, Results};
use meshband_host::{Error, Result, remark, say};
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// Arguments of `meshband monitor`.
#[derive(ClapArgs)]
pub struct Args {
    /// Serial port, pseudo-terminal or tcp:HOST:PORT.
    #[arg(required_unless_present = "replay")]
    port: Option<String>,
    /// Captured bytes of a link instead of a port.
    #[arg(long, conflicts_with = "port")]
    replay: Option<PathBuf>,
    /// Keeps every byte of the link in this file (appended); in a terminal monitor-TIME.link where no file is named.
    #[arg(long, value_name = "FILE", conflicts_with = "replay")]
    record: Option<PathBuf>,
    /// Keeps no capture.
    #[arg(long, conflicts_with = "record")]
    no_record: bool,
    /// Ends after this many messages.
    #[arg(long)]
    frames: Option<u64>,
    /// Shows the view once, after a status and a mesh-band spectrum have come (or the patience or the link has
    /// ended), and ends.
    #[arg(long)]
    once: bool,
    /// Without a terminal: ends after this many seconds without any message.
    #[arg(long, default_value_t = 30.0)]
    patience: f64,
    #[command(flatten)]
    results: Results,
}

/// How long a reading waits.
const STEP: Duration = Duration::from_millis(200);

/// What a link that ended without any message has to be told of.
const NOTHING_SENT: &str = "the link ended before the node sent any message";

/// What was heard, and how the hearing ended.
struct Heard {
    view: View,
    losses: Losses,
    /// Why it ended, where that is a fault.
    fault: Option<Error>,
}

/// Shows what the node says until told to stop.
pub fn run(args: Args) -> Result<()> {
    if !(0.001..=1e6).contains(&args.patience) {
        return Err(Error::invalid("--patience", format!("{} s is not within 0.001 s to 1e6 s", args.patience)));
    }
    let mut outputs = args.results.outputs(args.replay.as_deref());
    let mut files = args.results.announce(&mut outputs)?;
    let mut kept = None;
    let (heard, source) = match (&args.replay, &args.port) {
        (Some(path), _) => (replayed(path, &args)?, path.display().to_string()),
        (None, Some(port)) => {
            let in_terminal = std::io::stdout().is_terminal() && !args.once;
            let capture = capture(&args, in_terminal, &mut outputs)?;
            kept = capture.clone().filter(|_| in_terminal);
            let heard =
                if in_terminal { watched_live(port, &args, capture.as_ref())? } else { watched(port, &args, capture)? };
            (heard, port.clone())
        }
        (None, None) => return Err(Error::invalid("PORT", "a port or --replay FILE is needed")),
    };
    if let Some(capture) = kept {
        remark!("monitor: every byte is kept in {}; --no-record keeps none", capture.path().display());
    }
    finish(heard, &source, &mut files)
}

/// Where bytes are kept: where asked, and always beside a live view.
fn capture(args: &Args, in_terminal: bool, outputs: &mut Outputs) -> Result<Option<Capture>> {
    let named = || {
        let now = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
        PathBuf::from(format!("monitor-{now}.link"))
    };
    let path = match &args.record {
        Some(path) => path.clone(),
        None if in_terminal && !args.no_record => named(),
        None => return Ok(None),
    };
    let lock = outputs.appended(&path)?;
    Capture::append(&path, lock).map(Some)
}

/// Writes the files, then shows what was heard; the fault comes last.
fn finish(heard: Heard, source: &str, files: &mut Announced) -> Result<()> {
    let Heard { view, losses, fault } = heard;
    if view.messages == 0
        && let Some(fault) = fault
    {
        return Err(fault);
    }
    files.write(&view.json(losses), || report::of_view(&view, losses, source))?;
    if let Some(identity) = &view.identity {
        say!("{}\n{}", text::identity(identity), report::self_test(view.self_test.unwrap_or(identity.self_test)))?;
    }
    show(&view.text(losses))?;
    fault.map_or(Ok(()), Err)
}

/// A captured link, to its end or as far as asked.
fn replayed(path: &Path, args: &Args) -> Result<Heard> {
    let mut client = Client::new(transport::replay(path)?);
    let mut view = View::default();
    while !enough(args, &view) && !client.has_ended() {
        if let Some(message) = client.next_message(STEP)? {
            view.take(message);
        }
        client.take_replies().into_iter().for_each(|reply| view.take_reply(reply));
    }
    let why = || client.unreadable().unwrap_or_else(|| "holds no intact frame of a node".to_owned());
    let fault = (view.messages == 0).then(|| Error::invalid(path.display(), why()));
    Ok(Heard { view, losses: client.losses(), fault })
}

fn enough(args: &Args, view: &View) -> bool {
    let whole = view.spectrum.is_some() && view.status.is_some();
    counted(args, view) || (args.once && whole) || interrupt::requested()
}

fn counted(args: &Args, view: &View) -> bool {
    args.frames.is_some_and(|frames| view.messages >= frames)
}

/// Asks the node who it is, and for its alarms.
fn introduce(link: &mut Watched, view: &mut View) -> Result<()> {
    let Some(client) = link.client() else { return Ok(()) };
    view.identity = Some(client.identify()?);
    // A node of another schema is still watched: its alarms then have numbers only.
    view.limits = client.configuration().map(|config| Limit::all(&config)).ok();
    Ok(())
}

/// What has come and is in the capture, but was not taken up yet: a replay will show it, too.
fn drain(link: &mut Watched, view: &mut View, args: &Args) {
    while let Some(message) = (!counted(args, view)).then(|| link.waiting_message()).flatten() {
        view.take(message);
    }
    take_replies(link, view);
}

/// The live view.
fn watched_live(port: &str, args: &Args, capture: Option<&Capture>) -> Result<Heard> {
    let mut link = Watched::open(port, capture.cloned())?;
    let mut panel = Panel::default();
    introduce(&mut link, &mut panel.view)?;
    interrupt::only_ask();
    live(&mut link, &mut panel, capture, Limits { messages: args.frames })?;
    let mut view = panel.view;
    drain(&mut link, &mut view, args);
    Ok(Heard { view, losses: link.losses(), fault: None })
}

/// The view without a terminal: silence ends it, a lost link is said and opened again.
fn watched(port: &str, args: &Args, capture: Option<Capture>) -> Result<Heard> {
    let mut link = Watched::open(port, capture)?;
    let mut view = View::default();
    introduce(&mut link, &mut view)?;
    let (begun, mut heard, mut standing) = (Instant::now(), Instant::now(), Standing::Open);
    // Ctrl-C is how such a view ends: what has been heard is still written.
    interrupt::only_ask();
    let mut silent = false;
    while !enough(args, &view) {
        if let Some(message) = link.next_message(STEP) {
            view.take(message);
            heard = Instant::now();
        }
        standing = told(&standing, link.standing());
        take_replies(&mut link, &mut view);
        let never = view.messages == 0 && standing != Standing::Open;
        silent = heard.elapsed().as_secs_f64() > args.patience;
        // A node without a speed sends no mesh bands: what it did say is shown then.
        let waited = args.once && view.status.is_some() && begun.elapsed().as_secs_f64() > args.patience;
        if never || silent || waited {
            break;
        }
    }
    let place = format!("port {port}");
    let fault = match (&standing, silent) {
        (Standing::Lost { .. }, _) if view.messages == 0 => Some(Error::invalid(place, NOTHING_SENT)),
        (Standing::Lost { reason, .. }, true) => {
            let what = format!("lost for {} s ({reason}); what had been heard is kept", args.patience);
            Some(Error::invalid(place, what))
        }
        (Standing::Open, true) if view.messages == 0 => {
            let what = format!(
                "the node answers but sent no message within {} s: it is stopped, or waits for a configuration",
                args.patience
            );
            Some(Error::invalid(place, what))
        }
        (Standing::Open, true) => {
            remark!("monitor: the node has been silent for {} s", args.patience);
            None
        }
        _ => None,
    };
    // The self-test goes on after the start; the newest result, where the node is still there to ask.
    let fresh = heard.elapsed() < Duration::from_secs(5) && !interrupt::requested();
    if let Some(client) = link.client().filter(|_| fresh)
        && let Ok(newer) = client.identify()
    {
        let asked = health::is_known_to(&newer).then(|| client.health().ok()).flatten();
        view.identity = Some(newer);
        view.health = asked.or(view.health);
    }
    drain(&mut link, &mut view, args);
    Ok(Heard { view, losses: link.losses(), fault })
}

/// Says a change of the link, once; gives the new standing.
fn told(former: &Standing, now: Standing) -> Standing {
    match (former, &now) {
        (Standing::Open, Standing::Lost { reason, .. }) => {
            remark!("monitor: link lost ({reason}); it is opened again as soon as it is there");
        }
        (Standing::Lost { .. }, Standing::Open) => remark!("monitor: link open again"),
        _ => {}
    }
    now
}
