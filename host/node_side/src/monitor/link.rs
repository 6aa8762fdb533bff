//! A link that comes back: lost by an error or its end, opened again with growing pauses.
//!
//! Opening may take seconds (a host that does not answer), so it runs on a thread of its own and the view goes on. A node that is merely
//! silent keeps its link: only the port's error or end breaks it.

use super::capture::{Capture, Kept};
use crate::Result;
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
    client: Option<Client>,
    /// Losses of the clients before this one.
    former: Losses,
    lost: Lost,
    /// Times the link was opened again.
    pub reconnects: u32,
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
        let mut watched = Self {
            port: port.to_owned(),
            capture,
            client: None,
            former: Losses::default(),
            lost: Lost::default(),
            reconnects: 0,
        };
        watched.client = Some(watched.client_of(transport::open(port)?));
        Ok(watched)
    }

    /// The client, while the link is open.
    pub fn client(&mut self) -> Option<&mut Client> {
        self.client.as_mut()
    }

    /// Losses of all connections together.
    pub fn losses(&self) -> Losses {
        let now = self.client.as_ref().map(Client::losses).unwrap_or_default();
        sum(self.former, now)
    }

    /// How the link stands.
    pub fn standing(&self) -> Standing {
        if self.client.is_some() {
            return Standing::Open;
        }
        let next = self.lost.next.map_or(0.0, |next| next.saturating_duration_since(Instant::now()).as_secs_f64());
        Standing::Lost { reason: self.lost.reason.clone(), attempts: self.lost.attempts, next_s: next }
    }

    /// The next message within `patience`; opens the link again where it is lost.
    pub fn next_message(&mut self, patience: Duration) -> Option<Message> {
        let Some(client) = &mut self.client else {
            self.reopen();
            if self.client.is_none() {
                std::thread::sleep(patience.min(Duration::from_millis(50)));
            }
            return None;
        };
        match client.next_message(patience) {
            Ok(Some(message)) => return Some(message),
            Ok(None) if !client.has_ended() => return None,
            Ok(None) => self.drop_link("the other end closed the connection".into()),
            Err(error) => self.drop_link(error.to_string()),
        }
        None
    }

    fn drop_link(&mut self, reason: String) {
        self.former = self.losses();
        self.client = None;
        self.lost = Lost { reason, next: Some(Instant::now() + FIRST_PAUSE), ..Lost::default() };
    }

    /// Begins an attempt that is due, or takes up the outcome of the one under way.
    fn reopen(&mut self) {
        match self.lost.opening.as_ref().map(Receiver::try_recv) {
            None if self.lost.next.is_none_or(|next| Instant::now() >= next) => self.begin(),
            None | Some(Err(TryRecvError::Empty)) => {}
            Some(Ok(Ok(transport))) => {
                self.client = Some(self.client_of(transport));
                self.reconnects += 1;
                self.lost = Lost::default();
            }
            Some(Ok(Err(error))) => self.failed(error.to_string()),
            Some(Err(TryRecvError::Disconnected)) => self.failed("the attempt to open the port broke off".into()),
        }
    }

    fn begin(&mut self) {
        let (sender, receiver) = channel();
        let port = self.port.clone();
        std::thread::spawn(move || drop(sender.send(transport::open(&port))));
        self.lost.next = None;
        self.lost.opening = Some(receiver);
    }

    fn failed(&mut self, reason: String) {
        self.lost.attempts += 1;
        let pause = FIRST_PAUSE * 2u32.saturating_pow(self.lost.attempts);
        self.lost.next = Some(Instant::now() + pause.min(LONGEST_PAUSE));
        self.lost.opening = None;
        self.lost.reason = reason;
    }

    fn client_of(&self, transport: Box<dyn Transport>) -> Client {
        match &self.capture {
            Some(capture) => Client::new(Box::new(Kept::new(transport, capture.clone()))),
            None => Client::new(transport),
        }
    }
}

fn sum(a: Losses, b: Losses) -> Losses {
    Losses {
        lost: a.lost + b.lost,
        refused: a.refused + b.refused,
        restarts: a.restarts + b.restarts,
        unread: a.unread + b.unread,
        unknown: a.unknown + b.unknown,
    }
}
