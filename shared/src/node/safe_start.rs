//! Safe start: a configuration that is valid and still fatal must not restart a node for ever.
//!
//! Every restart after a failure counts, and an hour of good running, a person at the reset pin or new power ends the
//! count. From [`FAILURES`] in a row on the node starts with the default configuration; the stored one stays where it
//! is. Where the count survives a reset is the board's business.

use crate::units::TicksPerSecond;

/// Failures in a row after which the node starts with the default configuration.
pub const FAILURES: u32 = 4;
/// Seconds without a failure that count as good running.
pub const GOOD_RUN_S: u32 = 3600;

/// How a start came about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Start {
    /// Power or the reset pin: nothing failed, or somebody is there who wants to try again.
    Fresh,
    /// The node itself, after it had recorded and counted why.
    Recorded,
    /// The watchdog, which leaves no record.
    Unrecorded,
}

/// Failures in a row as they stand at a start; `kept` is the count that survived, if one did.
pub const fn failures_at(start: Start, kept: Option<u32>) -> u32 {
    match (start, kept) {
        (Start::Fresh, _) | (Start::Recorded, None) => 0,
        (Start::Recorded, Some(kept)) => kept,
        (Start::Unrecorded, None) => 1,
        (Start::Unrecorded, Some(kept)) => kept.saturating_add(1),
    }
}

/// Whether so many failures in a row ask for the default configuration.
pub const fn is_safe_start(failures: u32) -> bool {
    failures >= FAILURES
}

/// Watches for an hour of good running.
#[derive(Clone, Copy, Debug)]
pub struct GoodRun {
    latest: Option<u32>,
    passed: u64,
    wanted: u64,
}

impl GoodRun {
    /// Begins with the first look.
    pub const fn new(clock: TicksPerSecond) -> Self {
        Self { latest: None, passed: 0, wanted: clock.0 as u64 * GOOD_RUN_S as u64 }
    }

    /// A look at the time, at least once per wrap of the counter; true once, when the hour is full.
    pub fn is_reached(&mut self, now: u32) -> bool {
        let before = self.passed;
        let latest = self.latest.replace(now).unwrap_or(now);
        self.passed = before.saturating_add(u64::from(now.wrapping_sub(latest)));
        before < self.wanted && self.passed >= self.wanted
    }
}
