//! When a new image may be confirmed, and when it has to give up.
//!
//! Four things in [`TRIAL_S`] seconds of a start: the stored configuration was read, so that the node is the one that
//! it was; the self-test's items that depend on no sensor have passed; blocks of samples have come for [`SAMPLING_S`]
//! seconds without a pause; and a host has spoken with it and asks for the confirmation. The last one is the request
//! itself: an image that measures and cannot be spoken to could never be replaced again. A start that ends without
//! it, however it ends, is one of [`super::slots::TRIALS`].

use crate::message::SelfTest;
use crate::units::TicksPerSecond;

/// Seconds that a start of a new image lasts without a confirmation.
pub const TRIAL_S: u32 = 120;
/// Seconds of blocks without a pause.
pub const SAMPLING_S: u32 = 5;

/// Bit of what is missing: the stored configuration was refused.
pub const CONFIGURATION: u8 = 1;
/// Bit of what is missing: the self-test has not passed.
pub const SELF_TEST: u8 = 2;
/// Bit of what is missing: samples.
pub const SAMPLING: u8 = 4;

/// Items of the self-test that need neither sensor nor machine: sample count against the timer, results of the signal
/// chain.
const ITEMS: u8 = 1 | 1 << 4;

/// Watches a start.
#[derive(Clone, Copy, Debug)]
pub struct Trial {
    second: u64,
    latest: Option<u32>,
    passed: u64,
    sampled: u64,
}

impl Trial {
    /// Begins with the first look.
    pub const fn new(clock: TicksPerSecond) -> Self {
        Self { second: clock.0 as u64, latest: None, passed: 0, sampled: 0 }
    }

    /// A look at the time, at least once per wrap of the counter; `sampling` while blocks come.
    pub fn follow(&mut self, now: u32, sampling: bool) {
        let latest = self.latest.replace(now).unwrap_or(now);
        let elapsed = u64::from(now.wrapping_sub(latest));
        self.passed = self.passed.saturating_add(elapsed);
        self.sampled = if sampling { self.sampled.saturating_add(elapsed) } else { 0 };
    }

    /// Whether the time for a confirmation is over.
    pub fn is_over(&self) -> bool {
        self.passed >= self.second.saturating_mul(u64::from(TRIAL_S))
    }

    /// What a confirmation still lacks.
    pub fn missing(&self, configuration_taken: bool, test: SelfTest) -> u8 {
        let tested = test.run & ITEMS == ITEMS && test.failed & ITEMS == 0;
        let sampled = self.sampled >= self.second.saturating_mul(u64::from(SAMPLING_S));
        let lacks = |bit: u8, has: bool| if has { 0 } else { bit };
        lacks(CONFIGURATION, configuration_taken) | lacks(SELF_TEST, tested) | lacks(SAMPLING, sampled)
    }
}
