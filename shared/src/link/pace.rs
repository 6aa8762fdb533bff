//! When the next message may leave: a budget of bytes that the node's own clock pays off.
//!
//! Three ranks share the line. Replies go at once, and a command is only taken while there is room for its reply.
//! Events (alarms among them), statuses and results leave while there is room for one of them and a reply. Waveforms
//! take what is left and never so much that a message of the second rank would have to wait.

use super::{PACE, WINDOW};
use crate::frame::MAX_FRAME;
use crate::units::TicksPerSecond;

/// Bytes on their way up to which results may be sent: room stays for one of them and a reply.
const RESULTS: usize = WINDOW - 2 * MAX_FRAME;
/// Longest frame of a waveform's part.
const PART: usize = 448;
/// Bytes on their way up to which a waveform's next part may be sent.
const WAVEFORM: usize = RESULTS - PART;

/// What may be sent at present.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Room {
    /// Nothing, and no command is taken.
    Nothing,
    /// A reply.
    Reply,
    /// A result, an event, a status.
    Result,
    /// Part of a waveform.
    Waveform,
}

/// The budget.
#[derive(Clone, Copy, Debug)]
pub struct Pace {
    clock: TicksPerSecond,
    /// Bytes that, at the pace, the line has not yet taken.
    on_way: usize,
    /// Ticks times [`PACE`] that do not make a whole byte yet.
    part: u64,
    /// Tick up to which the line has been paid.
    paid: Option<u32>,
}

impl Pace {
    /// An empty line.
    pub const fn new(clock: TicksPerSecond) -> Self {
        Self { clock, on_way: 0, part: 0, paid: None }
    }

    /// Time passes up to a tick of the wrapping time base; ticks before the latest one change nothing.
    pub fn advance(&mut self, now: u32) {
        let elapsed = now.wrapping_sub(*self.paid.get_or_insert(now));
        if elapsed as i32 <= 0 {
            return;
        }
        self.paid = Some(now);
        let clock = u64::from(self.clock.0.max(1));
        self.part += u64::from(elapsed) * u64::from(PACE);
        let taken = self.part / clock;
        self.on_way = self.on_way.saturating_sub(taken as usize);
        // An idle line saves nothing up.
        self.part = if self.on_way == 0 { 0 } else { self.part % clock };
    }

    /// Bytes were sent.
    pub fn take(&mut self, bytes: usize) {
        self.on_way = self.on_way.saturating_add(bytes);
    }

    /// The line is known to be empty.
    pub fn clear(&mut self) {
        self.on_way = 0;
    }

    /// What may be sent.
    pub fn room(&self) -> Room {
        match self.on_way {
            on_way if on_way <= WAVEFORM => Room::Waveform,
            on_way if on_way <= RESULTS => Room::Result,
            on_way if on_way <= WINDOW - MAX_FRAME => Room::Reply,
            _ => Room::Nothing,
        }
    }

    /// Bytes on their way.
    pub fn on_way(&self) -> usize {
        self.on_way
    }
}
