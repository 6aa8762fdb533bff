//! A link that comes back: lost by an error or its end, opened again with growing pauses.
//!
//! Opening may take seconds (a host that does not answer), so it runs on a thread of its own and the view goes on. A
//! node that is merely silent keeps its link: only the port's error or end breaks it.

use super::capture::{Capture, Kept};
use crate::Result;
use crate::link::stream::REOPEN_MARK;
use crate::link::transport::{self, Transport};
use crate::link::{Client, Losses};
use meshband::message::Message;
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::time::{Duration, Instant};

/// First pause before opening again; doubled after each failure.
const FIRST_PAUSE: Duration = Duration::from_millis(500);
/// Longest pause.
const LONGEST_PAUSE: Duration = Duration::from_secs(10);

/// How the link stands.
#[derive(Debug, Clone, PartialEq)]
pub enum Standing {
    /// Open.
    Open,
    /// Lost: why, attempts to open it again so far, seconds until the next one (0: under way).
    Lost {
        /// Why.
        reason: String,
        /// Attempts so far.
        attempts: u32,
        /// Seconds until the next.
        next_s: f64,
    },
}

/// A link with its history.
pub struct Watched {
    port: String,
    capture: Option<Capture>,
    client: Client,
    /// Why and since when the link is lost; none while it is open.
    lost: Option<Lost>,
}

#[derive(Default)]
struct Lost {
    reason: String,
    attempts: u32,
    next: Option<Instant>,
    opening: Option<Receiver<Result<Box<dyn Transport>>>>,
}

impl Watched {
    /// Opens the port for the first time; a port that cannot be opened at all is an error.
    ///
    /// # Errors
    /// Of the port.
    pub fn open(port: &str, capture: Option<Capture>) -> Result<Self> {
        let client = Client::new(kept(transport::open(port)?, capture.as_ref(), false));
        Ok(Self { port: port.to_owned(), capture, client, lost: None })
    }

    /// The client, while the link is open.
    pub fn client(&mut self) -> Option<&mut Client> {
        self.lost.is_none().then_some(&mut self.client)
    }

    /// Losses of all connections together.
    pub fn losses(&self) -> Losses {
        self.client.losses()
    }

    /// How the link stands.
    pub fn standing(&self) -> Standing {
        let Some(lost) = &self.lost else { return Standing::Open };
        let next = lost.next.map_or(0.0, |next| next.saturating_duration_since(Instant::now()).as_secs_f64());
        Standing::Lost { reason: lost.reason.clone(), attempts: lost.attempts, next_s: next }
    }

    /// A message that has come already.
    pub fn waiting_message(&mut self) -> Option<Message> {
        self.client.waiting_message()
    }

    /// The next message within `patience`; opens the link again where it is lost.
    pub fn next_message(&mut self, patience: Duration) -> Option<Message> {
        if self.lost.is_some() {
            self.reopen();
            if self.lost.is_some() {
                std::thread::sleep(patience.min(Duration::from_millis(50)));
            }
            return None;
        }
        match self.client.next_message(patience) {
            Ok(Some(message)) => return Some(message),
            Ok(None) if !self.client.has_ended() => return None,
            Ok(None) => self.drop_link("the other end closed the connection".into()),
            Err(error) => self.drop_link(error.to_string()),
        }
        None
    }

    fn drop_link(&mut self, reason: String) {
        self.client.hang_up();
        self.lost = Some(Lost { reason, next: Some(Instant::now() + FIRST_PAUSE), ..Lost::default() });
    }

    /// Begins an attempt that is due, or takes up the outcome of the one under way.
    fn reopen(&mut self) {
        let Some(lost) = &mut self.lost else { return };
        match lost.opening.as_ref().map(Receiver::try_recv) {
            None if lost.next.is_none_or(|next| Instant::now() >= next) => lost.begin(&self.port),
            None | Some(Err(TryRecvError::Empty)) => {}
            Some(Ok(Ok(transport))) => {
                self.client.reopen(kept(transport, self.capture.as_ref(), true));
                self.lost = None;
            }
            Some(Ok(Err(error))) => lost.failed(error.to_string()),
            Some(Err(TryRecvError::Disconnected)) => lost.failed("the attempt to open the port broke off".into()),
        }
    }
}

impl Lost {
    fn begin(&mut self, port: &str) {
        let (sender, receiver) = channel();
        let port = port.to_owned();
        std::thread::spawn(move || drop(sender.send(transport::open(&port))));
        self.next = None;
        self.opening = Some(receiver);
    }

    fn failed(&mut self, reason: String) {
        self.attempts += 1;
        let pause = FIRST_PAUSE * 2u32.saturating_pow(self.attempts);
        self.next = Some(Instant::now() + pause.min(LONGEST_PAUSE));
        self.opening = None;
        self.reason = reason;
    }
}

/// The transport, with its bytes kept where a capture is wanted; one that was opened again is marked there.
fn kept(transport: Box<dyn Transport>, capture: Option<&Capture>, again: bool) -> Box<dyn Transport> {
    let Some(capture) = capture else { return transport };
    if again {
        capture.keep(REOPEN_MARK);
    }
    Box::new(Kept::new(transport, capture.clone()))
}
