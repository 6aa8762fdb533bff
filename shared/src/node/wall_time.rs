//! Time of day, told by a host and carried on by the node's clock.
//!
//! What is reported always says how wrong it may be: what the host said, how long the node takes to read a command,
//! and the drift since then. The drift is the oscillator's tolerance, or, while there are pulses per second, what is
//! left after their correction. A node has no battery: the time is gone with the power.

use crate::node::second_pulse::SecondPulse;
use crate::units::TicksPerSecond;
use serde::{Deserialize, Serialize};

/// Tolerance of a crystal without a better word, parts per million: 30 of adjustment and temperature, 20 of ageing.
pub const CRYSTAL_PPM: f32 = 50.0;
/// Longest time from a command's last byte to its execution, microseconds: a turn of the main loop.
pub const RECEPTION_US: u32 = 25_000;
/// Drift that pulses leave beside their own uncertainty, parts per million: what temperature does within a baseline.
pub const CORRECTED_PPM: f32 = 1.0;

/// What a host says.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ToldTime {
    /// Microseconds since 1970-01-01 00:00:00 UTC, without leap seconds.
    pub unix_us: u64,
    /// How wrong it may be when it arrives, microseconds.
    pub uncertainty_us: u32,
}

/// What the node says.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct WallTime {
    /// Time of day at the message's tick, microseconds since 1970-01-01 00:00:00 UTC, without leap seconds.
    pub unix_us: u64,
    /// How wrong it may be, microseconds.
    pub uncertainty_us: u64,
    /// Since a host has told it, s.
    pub told_before_s: u32,
    /// Drift that is counted for every second since, parts per million.
    pub drift_ppm: f32,
}

/// The time of day.
#[derive(Clone, Copy, Debug)]
pub struct WallClock {
    told: Option<(u64, ToldTime)>,
    tolerance_ppm: f32,
}

impl WallClock {
    /// Nobody has told the time yet; driven by a crystal.
    pub const UNKNOWN: Self = Self { told: None, tolerance_ppm: CRYSTAL_PPM };

    /// The clock is no better than this, parts per million.
    pub fn set_tolerance(&mut self, tolerance_ppm: f32) {
        self.tolerance_ppm = tolerance_ppm;
    }

    /// A host has told the time at an instant.
    pub fn set(&mut self, instant: u64, told: ToldTime) {
        self.told = Some((instant, told));
    }

    /// The time of day at an instant; `None` until told.
    pub fn at(&self, now: u64, clock: TicksPerSecond, pulses: Option<&SecondPulse>) -> Option<WallTime> {
        let (instant, told) = self.told?;
        let since_s = now.saturating_sub(instant) as f64 / f64::from(clock.0.max(1));
        let (fast_ppm, drift_ppm) = match pulses {
            Some(pulses) => (pulses.fast_ppm, 2.0 * pulses.uncertainty_ppm + CORRECTED_PPM),
            None => (0.0, self.tolerance_ppm),
        };
        let elapsed_us = (since_s / (1.0 + f64::from(fast_ppm) * 1e-6) * 1e6) as u64;
        let drift_us = (since_s * f64::from(drift_ppm)) as u64;
        Some(WallTime {
            unix_us: told.unix_us.saturating_add(elapsed_us),
            uncertainty_us: u64::from(told.uncertainty_us) + u64::from(RECEPTION_US) + drift_us,
            told_before_s: since_s as u32,
            drift_ppm,
        })
    }
}
