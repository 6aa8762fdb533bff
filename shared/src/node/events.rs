//! History of typed events, and one counter per kind that never forgets.
//!
//! A storm must neither push the history out nor fill the link. So an event equal in kind and detail to one that
//! occurred within the last second only raises that one's count, whatever came in between; beyond [`QUOTA`] entries
//! of one kind within a second the kind's newest takes the others up, with the latest detail; a kind holds at most
//! [`QUOTA`] places, and where all places are taken the kind that has most of them gives up its oldest: the newest of
//! each kind is always kept.

use crate::message::{EventCount, MAX_EVENT_COUNTS};
use crate::units::TicksPerSecond;
use heapless::Vec;
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
    /// Input at its rails; detail is the share of codes in parts per thousand, with [`OF_SECOND`] for the second
    /// sensor.
    Saturated,
    /// Input does not move at all; detail is its code, with [`OF_SECOND`] for the second sensor.
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
    /// A request was refused; detail is 0, or the number of an update's refusal ([`crate::update::UpdateRefused`]).
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
    /// The signal is clipped or does not move; detail has bit 0 for clipped, bit 1 for still, bits 2 and 3 for the
    /// second sensor's.
    SignalBad,
    /// The signal can be judged again.
    SignalGood,
    /// A person has acknowledged all alarms.
    AlarmsAcknowledged,
    /// A step of an update; detail has the step ([`crate::update::receiver::Step`]) in its highest byte, the image's
    /// version below.
    Update,
    /// A waveform is complete and held until a host releases it; detail is its number.
    CaptureHeld,
    /// A trigger found another waveform begun or held; detail is how many have so far.
    CaptureMissed,
    /// Tach edges come as of a shaft faster than `tach.highest`: what is told as speed is a fraction of it.
    TachTooFast,
    /// The tach is locked and no mesh-band record becomes complete; detail is the seconds since the last one.
    NoRecords,
}

/// Bit of a detail that tells the second sensor's input from the first one's.
pub const OF_SECOND: u32 = 1 << 31;

/// Number of event kinds.
pub const EVENT_KINDS: usize = EventKind::NoRecords as usize + 1;

const _: () = assert!(EVENT_KINDS <= MAX_EVENT_COUNTS);

/// Events kept.
pub const MAX_EVENTS: usize = 40;
/// Events kept of one kind, and new ones of one kind per second: every alarm can speak at once.
pub const QUOTA: usize = crate::config::MAX_ALARMS;

// There is always a kind with a second entry to give up; places are bits of a word.
const _: () = assert!(EVENT_KINDS < MAX_EVENTS && MAX_EVENTS <= 64);

/// One event, possibly repeated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Event {
    /// What happened.
    pub kind: EventKind,
    /// Kind-specific number, of the latest occurrence.
    pub detail: u32,
    /// Instant of the first occurrence, ticks since start.
    pub first_tick: u64,
    /// Instant of the latest occurrence, ticks since start.
    pub last_tick: u64,
    /// Occurrences: equal ones never a second apart, or more than [`QUOTA`] of a kind within a second.
    pub count: u32,
}

/// The history and the counters.
#[derive(Clone, Debug)]
pub struct EventLog {
    /// In the order of their first occurrence.
    kept: Vec<Event, MAX_EVENTS>,
    counters: [u32; EVENT_KINDS],
    /// Entries not yet reported over the link, by place.
    unreported: u64,
    /// Ticks within which equal events are one.
    second: u64,
}

impl EventLog {
    /// An empty history on a time base.
    pub const fn new(clock: TicksPerSecond) -> Self {
        Self { kept: Vec::new(), counters: [0; EVENT_KINDS], unreported: 0, second: clock.0 as u64 }
    }

    /// Records an event.
    pub fn record(&mut self, kind: EventKind, detail: u32, tick: u64) {
        if let Some(counter) = self.counters.get_mut(kind as usize) {
            *counter = counter.saturating_add(1);
        }
        let since = tick.saturating_sub(self.second);
        let recent = self.kept.iter().filter(|e| e.kind == kind && e.first_tick > since).count();
        let equal = |e: &&mut Event| e.kind == kind && e.detail == detail && e.last_tick >= since;
        let mut same = self.kept.iter_mut().rev().find(equal);
        // A commit's outcome is an answer that a host waits for: each one speaks.
        let answers = matches!(kind, EventKind::ConfigurationStored | EventKind::ConfigurationNotStored);
        if same.is_none() && recent >= QUOTA && !answers {
            same = self.kept.iter_mut().rev().find(|e| e.kind == kind);
        }
        if let Some(entry) = same {
            (entry.detail, entry.last_tick) = (detail, tick);
            entry.count = entry.count.saturating_add(1);
            return;
        }
        // One line per entry, so that a storm does not fill the probe's buffer either.
        #[cfg(feature = "defmt")]
        defmt::info!("{} {=u32}", kind, detail);
        self.make_room(kind);
        let event = Event { kind, detail, first_tick: tick, last_tick: tick, count: 1 };
        if self.kept.push(event).is_ok() {
            self.unreported |= 1 << (self.kept.len() - 1);
        }
    }

    /// Gives up the oldest of this kind where it has its quota, else, where all is taken, of the kind with most
    /// entries.
    fn make_room(&mut self, kind: EventKind) {
        let entries = |kind: EventKind| self.kept.iter().filter(|e| e.kind == kind).count();
        let giver = if entries(kind) >= QUOTA {
            Some(kind)
        } else if self.kept.is_full() {
            self.kept.iter().map(|e| e.kind).max_by_key(|&kind| entries(kind))
        } else {
            None
        };
        if let Some(place) = self.kept.iter().position(|e| Some(e.kind) == giver) {
            self.kept.remove(place);
            let (below, above) = (self.unreported & ((1 << place) - 1), self.unreported >> place >> 1);
            self.unreported = below | above << place;
        }
    }

    /// Occurrences of a kind since start.
    pub fn count(&self, kind: EventKind) -> u32 {
        self.counters.get(kind as usize).copied().unwrap_or(0)
    }

    /// The kinds that have occurred, with their counts.
    pub fn counts(&self) -> Vec<EventCount, MAX_EVENT_COUNTS> {
        let counts = (0u8..).zip(self.counters).map(|(kind, count)| EventCount { kind, count });
        counts.filter(|entry| entry.count > 0).collect()
    }

    /// Events in the order of their first occurrence.
    pub fn iter(&self) -> impl Iterator<Item = &Event> {
        self.kept.iter()
    }

    /// Marks all kept events for the link again.
    pub fn report_all(&mut self) {
        self.unreported = (1 << self.kept.len()) - 1;
    }

    /// Oldest event not yet taken for the link.
    pub fn take_unreported(&mut self) -> Option<Event> {
        let event = self.kept.get(self.unreported.trailing_zeros() as usize).copied()?;
        self.unreported &= self.unreported - 1;
        Some(event)
    }
}
