//! The node as a Modbus station: which language the line speaks at present, and the way back.
//!
//! A node configured for Modbus begins every life with [`LISTENING_S`] in which it says nothing and listens for the
//! project's own link, at that link's rate. A whole request of it, checksum and all, gives the line to the link for
//! this life, and the host can configure what it likes. Otherwise the line is Modbus' until the next start. So nobody
//! is locked out who can switch the node off and on, whatever the configuration says, and nothing that passes on a
//! Modbus line can switch a node over.
//!
//! Not by watching for the link all the time: at 19 200 bit/s a UART receives nothing of a frame at 921 600 bit/s.

use super::Command;
use super::bank::Bank;
use super::line::Line;
use super::map::{Traffic, View};
use super::server::{self, Answer};
use crate::buffers::Arrays;
use crate::config::{LineFormat, LinkConfig, Personality};
use crate::message::Message;
use crate::node::Node;
use crate::units::TicksPerSecond;

/// How long a node listens for the link before it speaks Modbus.
pub const LISTENING_S: u32 = 3;

/// What the line speaks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// The link. Left by nothing but a restart.
    Meshband,
    /// Nothing yet. Left for the link by one of its requests, for Modbus when the time is over.
    Listening {
        /// When it began; `None` before the board has a clock.
        since: Option<u32>,
    },
    /// Modbus. Left by nothing but a restart.
    Modbus,
}

/// The station.
#[derive(Clone, Debug)]
pub struct Station {
    mode: Mode,
    link: LinkConfig,
    clock: TicksPerSecond,
    line: Line,
    bank: Bank,
    exceptions: u16,
}

impl Station {
    /// At a node's start.
    pub fn new(link: LinkConfig, clock: TicksPerSecond) -> Self {
        let mode = match link.personality {
            Personality::Meshband => Mode::Meshband,
            Personality::Modbus => Mode::Listening { since: None },
        };
        let line = Line::new(LineFormat::of_modbus(&link), clock);
        Self { mode, link, clock, line, bank: Bank::default(), exceptions: 0 }
    }

    /// What the line speaks.
    pub fn mode(&self) -> Mode {
        self.mode
    }

    /// How the board's UART is to be set.
    pub fn format(&self) -> LineFormat {
        match self.mode {
            Mode::Modbus => LineFormat::of_modbus(&self.link),
            Mode::Meshband | Mode::Listening { .. } => LineFormat::MESHBAND,
        }
    }

    /// The link has spoken in time.
    pub fn yield_to_link(&mut self) {
        self.mode = Mode::Meshband;
    }

    /// A received byte, while the line is Modbus'.
    pub fn push(&mut self, byte: u8) {
        self.line.push(byte);
    }

    /// Keeps what a message says.
    pub fn take(&mut self, message: &Message, tick: u64) {
        self.bank.take(message, tick);
    }

    /// Once per turn of the main loop, after the bytes that were there: ends the listening, or gives the answer to a
    /// request, and what the master asks the node to do.
    pub fn follow<A: Arrays>(&mut self, node: &Node<A>, now: u32) -> Option<(Answer, Option<Command>)> {
        match self.mode {
            Mode::Meshband => None,
            Mode::Listening { since } => {
                let since = since.unwrap_or(now);
                let over = now.wrapping_sub(since) >= self.clock.0.saturating_mul(LISTENING_S).min(u32::MAX / 2);
                self.mode = if over { Mode::Modbus } else { Mode::Listening { since: Some(since) } };
                None
            }
            Mode::Modbus => self.serve(node, now),
        }
    }

    fn serve<A: Arrays>(&mut self, node: &Node<A>, now: u32) -> Option<(Answer, Option<Command>)> {
        let request = self.line.look(self.link.address, now)?;
        let traffic = Traffic { heard: self.line.heard(), exceptions: self.exceptions };
        let view = View::of(node, &self.bank, traffic);
        let sample = |place: u32| node.held_sample(place);
        let (answer, outcome) = server::answer(self.link.address, &request, &view, &sample)?;
        if outcome.is_err() {
            self.exceptions = self.exceptions.wrapping_add(1);
        }
        self.line.answered(&answer);
        Some((answer, outcome.unwrap_or(None)))
    }
}
