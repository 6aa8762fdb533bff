//! Alarm bands: a limit on one indicator inside a speed band, with hysteresis in level and in count.
//!
//! An alarm is raised after `raise_after` consecutive values above `raise` and cleared after as many below `clear`. A
//! value outside the speed band, or without a valid speed, leaves the alarm as it is: no evidence either way.

use crate::units::Hertz;
use serde::{Deserialize, Serialize};

/// What an alarm watches.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Watched {
    /// Root mean square, m/s^2.
    Rms,
    /// Peak, m/s^2.
    Peak,
    /// Crest factor.
    Crest,
    /// Kurtosis (3 for Gaussian noise).
    Kurtosis,
    /// FM0.
    Fm0,
    /// FM4 of the difference signal.
    Fm4,
    /// Sideband energy ratio of the first mesh harmonic.
    SidebandEnergyRatio,
    /// Amplitude of the first mesh harmonic, m/s^2.
    MeshAmplitude,
    /// Measured over law bandwidth.
    BandwidthRatio,
}

/// One limit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct AlarmBand {
    /// Indicator watched.
    pub watched: Watched,
    /// Lowest pinion rate at which the limit applies.
    pub from: Hertz,
    /// Highest pinion rate at which the limit applies.
    pub to: Hertz,
    /// Level that raises.
    pub raise: f32,
    /// Level that clears, at most `raise`.
    pub clear: f32,
    /// Consecutive values needed, 1 to 255.
    pub persistence: u8,
}

impl AlarmBand {
    /// Whether limits are finite and ordered.
    pub fn is_sane(&self) -> bool {
        let speeds = self.from.0 >= 0.0 && self.from.0 < self.to.0 && self.to.0.is_finite();
        let levels = self.raise.is_finite() && self.clear.is_finite() && self.clear <= self.raise;
        speeds && levels && self.persistence > 0
    }
}

/// State of one alarm.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Alarm {
    raised: bool,
    streak: u8,
}

/// What a value did to an alarm.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AlarmChange {
    /// Now raised.
    Raised,
    /// Now cleared.
    Cleared,
}

impl Alarm {
    /// Feeds one value at a speed; undefined values change nothing.
    pub fn update(&mut self, band: &AlarmBand, speed: Hertz, value: f32) -> Option<AlarmChange> {
        let inside = speed.0 >= band.from.0 && speed.0 <= band.to.0;
        if !inside || value.is_nan() {
            return None;
        }
        let contradicts = if self.raised { value < band.clear } else { value > band.raise };
        self.streak = if contradicts { self.streak.saturating_add(1) } else { 0 };
        if self.streak < band.persistence {
            return None;
        }
        self.streak = 0;
        self.raised = !self.raised;
        Some(if self.raised { AlarmChange::Raised } else { AlarmChange::Cleared })
    }

    /// Whether the alarm stands.
    pub fn is_raised(&self) -> bool {
        self.raised
    }
}
