//! The terminal while the view is live: taken over at the start, given back at every end, keys in between.
//!
//! A terminal that is closed while its signal is ignored (`nohup`, a shell's background job) ends the view like a
//! key: crossterm would read the end of the file for ever. Looked at before every reading of keys; on Unix only,
//! elsewhere the system ends the program.

use super::link::Watched;
use super::panel::Panel;
use super::screen::{Scene, draw};
use crate::link::health;
use crate::link::view::View;
use crate::monitor::capture::Capture;
use crate::output::interrupt;
use crate::{Error, Result};
use meshband::message::Request;
use ratatui::crossterm::event::{self, Event, KeyCode, KeyEventKind, KeyModifiers};
use std::time::{Duration, Instant};

/// Time between two drawings.
const REDRAW: Duration = Duration::from_millis(200);
/// Time between two questions for the node's health.
const HEALTH_EVERY: Duration = Duration::from_secs(5);

/// What the user has open.
#[derive(Debug, Default)]
struct Open {
    events: bool,
    help: bool,
    end: bool,
}

/// When the view ends by itself.
#[derive(Debug, Clone, Copy, Default)]
pub struct Limits {
    /// After so many messages.
    pub messages: Option<u64>,
}

/// Shows the view until it is told to end; the panel then holds what was heard.
///
/// # Errors
/// A terminal that cannot be used.
pub fn live(link: &mut Watched, panel: &mut Panel, capture: Option<&Capture>, limits: Limits) -> Result<()> {
    let started = Instant::now();
    let mut terminal = ratatui::try_init().map_err(|error| Error::tool("terminal", error))?;
    let keyboard = keyboard();
    let result = (|| {
        let mut open = Open::default();
        let mut drawn: Option<Instant> = None;
        let mut health_asked: Option<Instant> = None;
        let mut reopened = link.losses().reopened;
        while !open.end && !interrupt::requested() && !is_closed(keyboard.as_ref()) {
            let pause = drawn.map_or(Duration::ZERO, |at| REDRAW.saturating_sub(at.elapsed()));
            if let Some(message) = link.next_message(pause.min(Duration::from_millis(50))) {
                panel.take(message, started.elapsed().as_secs_f64());
            }
            if link.losses().reopened != reopened {
                // Another node may answer there, or the same with another configuration.
                reopened = link.losses().reopened;
                ask(link, Request::Identify);
                ask(link, Request::GetConfiguration);
            }
            let health_known = panel.view.identity.as_ref().is_some_and(health::is_known_to);
            if health_known && health_asked.is_none_or(|at| at.elapsed() >= HEALTH_EVERY) {
                health_asked = Some(Instant::now());
                ask(link, Request::GetHealth);
            }
            take_replies(link, &mut panel.view);
            if is_closed(keyboard.as_ref()) {
                break;
            }
            keys(&mut open, link, panel)?;
            open.end |= limits.messages.is_some_and(|most| panel.view.messages >= most);
            if drawn.is_none_or(|at| at.elapsed() >= REDRAW) {
                drawn = Some(Instant::now());
                let scene = Scene {
                    panel,
                    standing: &link.standing(),
                    losses: link.losses(),
                    capture,
                    now_s: started.elapsed().as_secs_f64(),
                    events_open: open.events,
                    help: open.help,
                };
                match terminal.draw(|frame| draw(frame, &scene)) {
                    Err(_) if is_closed(keyboard.as_ref()) => break,
                    drawn => drawn.map_err(Error::Output)?,
                };
            }
        }
        Ok(())
    })();
    let restored = ratatui::try_restore();
    if is_closed(keyboard.as_ref()) {
        // Its end would write to the terminal, fail, and panic over a message that cannot be written either.
        std::mem::forget(terminal);
        return result;
    }
    result.and(restored.map_err(Error::Output))
}

/// Where crossterm reads keys from: standard input, or the terminal of the session where that is none.
#[cfg(unix)]
fn keyboard() -> Option<std::os::fd::OwnedFd> {
    use std::io::{IsTerminal, stdin};
    use std::os::fd::AsFd;
    let input = stdin();
    if input.is_terminal() {
        input.as_fd().try_clone_to_owned().ok()
    } else {
        Some(std::fs::File::open("/dev/tty").ok()?.into())
    }
}

#[cfg(unix)]
fn is_closed(keyboard: Option<&std::os::fd::OwnedFd>) -> bool {
    use rustix::event::{PollFd, PollFlags, Timespec, poll};
    keyboard.is_some_and(|keyboard| {
        let mut asked = [PollFd::new(keyboard, PollFlags::IN)];
        let answered = poll(&mut asked, Some(&Timespec::default())).is_ok();
        answered && asked[0].revents().intersects(PollFlags::HUP | PollFlags::ERR)
    })
}

#[cfg(not(unix))]
fn keyboard() -> Option<()> {
    None
}

#[cfg(not(unix))]
fn is_closed(_keyboard: Option<&()>) -> bool {
    false
}

/// Takes all keys that wait.
fn keys(open: &mut Open, link: &mut Watched, panel: &mut Panel) -> Result<()> {
    let failed = |error: std::io::Error| Error::tool("terminal", error);
    while event::poll(Duration::ZERO).map_err(failed)? {
        let Event::Key(key) = event::read().map_err(failed)? else { continue };
        if key.kind != KeyEventKind::Press {
            continue;
        }
        match key.code {
            KeyCode::Char('c') if key.modifiers.contains(KeyModifiers::CONTROL) => open.end = true,
            KeyCode::Esc if open.help => open.help = false,
            KeyCode::Char('q') => open.end = true,
            KeyCode::Char('h' | '?') => open.help = !open.help,
            KeyCode::Char('e') => open.events = !open.events,
            KeyCode::Char('a') => {
                ask(link, Request::AcknowledgeAlarms);
                panel.over.clear();
            }
            KeyCode::Char('s') => ask(link, Request::Snapshot),
            KeyCode::Char('t') => ask(link, Request::SelfTest),
            _ => {}
        }
    }
    Ok(())
}

/// Hands on the answers that nobody waits for.
pub fn take_replies(link: &mut Watched, view: &mut View) {
    let replies = link.client().map(|client| client.take_replies()).unwrap_or_default();
    replies.into_iter().for_each(|reply| view.take_reply(reply));
}

/// Sends a request without waiting: a node that is silent must not stop the view.
fn ask(link: &mut Watched, request: Request) {
    if let Some(client) = link.client() {
        // A port that fails here fails at the next reading, too, and is said then.
        let _ = client.send(&request);
    }
}
