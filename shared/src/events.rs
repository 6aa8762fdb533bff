//! Ring of typed events with de-duplication, and one counter per kind that never forgets.
//!
//! An event equal in kind and detail to the newest one only raises its count, so that a stuck input cannot push the
//! history out of the ring. After the counted ring buffer of Hubris.

use heapless::Deque;
use serde::{Deserialize, Serialize};

/// Kinds of events. The order is part of the link's interface: only append.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum EventKind {
    /// Node started; detail is the board's reset cause.
    Started,
    /// Tach speed locked.
    TachLocked,
    /// Tach speed lost: no pulses.
    TachStalled,
    /// Tach pulses contradict the tracked speed.
    TachDoubtful,
    /// Sampling rate changed; detail is the new period in ticks.
    RateChanged,
    /// Blocks were lost; detail is how many.
    BlocksLost,
    /// The ADC reported an overrun.
    Overrun,
    /// A block came with a period that was never granted; detail is the period.
    UnexpectedPeriod,
    /// A block's first tick does not follow from the block before; detail is the difference in ticks.
    TimeJump,
    /// Input at its rails; detail is the share of codes in parts per thousand.
    Saturated,
    /// Input does not move at all.
    Stuck,
    /// Speed outside the law's domain.
    LawClamped,
    /// The wanted rate is beyond the board.
    RateLimited,
    /// An alarm was raised; detail is its index.
    AlarmRaised,
    /// An alarm was cleared; detail is its index.
    AlarmCleared,
    /// A message was dropped because the link was slow; detail is how many.
    MessagesDropped,
    /// A frame was refused; detail is how many.
    FramesRefused,
    /// A self-test failed; detail is the set of failed items.
    SelfTestFailed,
    /// The newest stored configuration was not taken; detail says why ([`crate::store::Origin::complaint`]).
    ConfigurationRefused,
    /// A request was refused.
    RequestRefused,
    /// Reported by the board's own code; detail is the board's number.
    Board,
    /// The configuration in force was stored.
    ConfigurationStored,
    /// The configuration in force could not be stored; the one stored before stays.
    ConfigurationNotStored,
    /// Measured bandwidth and law part; detail is measured over law in per cent.
    BandwidthDeparts,
    /// Measured bandwidth and law agree again; detail as before.
    BandwidthAgrees,
}

/// Number of event kinds.
pub const EVENT_KINDS: usize = EventKind::BandwidthAgrees as usize + 1;

/// Events kept.
pub const RING: usize = 32;

/// One event, possibly repeated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Event {
    /// What happened.
    pub kind: EventKind,
    /// Kind-specific number.
    pub detail: u32,
    /// Instant of the first occurrence, ticks since start.
    pub first_tick: u64,
    /// Instant of the latest occurrence, ticks since start.
    pub last_tick: u64,
    /// Occurrences in a row.
    pub count: u32,
}

/// The ring and the counters.
#[derive(Clone, Debug)]
pub struct EventLog {
    ring: Deque<Event, RING>,
    counters: [u32; EVENT_KINDS],
    /// Newest entries not yet reported over the link.
    unreported: usize,
}

impl Default for EventLog {
    fn default() -> Self {
        Self { ring: Deque::new(), counters: [0; EVENT_KINDS], unreported: 0 }
    }
}

impl EventLog {
    /// Records an event.
    pub fn record(&mut self, kind: EventKind, detail: u32, tick: u64) {
        let counter = &mut self.counters[kind as usize];
        *counter = counter.saturating_add(1);
        if let Some(newest) = self.ring.back_mut()
            && newest.kind == kind
            && newest.detail == detail
        {
            newest.count = newest.count.saturating_add(1);
            newest.last_tick = tick;
            return;
        }
        if self.ring.is_full() {
            self.ring.pop_front();
            self.unreported = self.unreported.min(RING - 1);
        }
        let event = Event { kind, detail, first_tick: tick, last_tick: tick, count: 1 };
        if self.ring.push_back(event).is_ok() {
            self.unreported += 1;
        }
    }

    /// Occurrences of a kind since start.
    pub fn count(&self, kind: EventKind) -> u32 {
        self.counters[kind as usize]
    }

    /// All counters, indexed by kind.
    pub fn counters(&self) -> &[u32; EVENT_KINDS] {
        &self.counters
    }

    /// Events from oldest to newest.
    pub fn iter(&self) -> impl Iterator<Item = &Event> {
        self.ring.iter()
    }

    /// Marks all kept events for the link again.
    pub fn report_all(&mut self) {
        self.unreported = self.ring.len();
    }

    /// Oldest event not yet taken for the link.
    pub fn take_unreported(&mut self) -> Option<Event> {
        let index = self.ring.len().checked_sub(self.unreported)?;
        let event = self.ring.iter().nth(index).copied()?;
        self.unreported -= 1;
        Some(event)
    }
}
