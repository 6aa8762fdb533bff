//! Quantities as tuple structs: the unit is the type's name, the number is a public field.
//!
//! No dimension algebra: conversions are named methods, everything else is written out where it happens.
//! All frequencies of the node are `f32`; a tick count is always an integer.

use serde::{Deserialize, Serialize};

/// Frequency or shaft rate, Hz (turns per second for shafts).
#[derive(Clone, Copy, Debug, Default, PartialEq, PartialOrd, Serialize, Deserialize)]
pub struct Hertz(pub f32);

/// Instant or interval of the capture timer, wrapping at 2^32.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Ticks(pub u32);

/// Rate of the capture timer, Hz.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct TicksPerSecond(pub u32);

/// Frequency as a multiple of a named shaft's rate.
#[derive(Clone, Copy, Debug, Default, PartialEq, PartialOrd, Serialize, Deserialize)]
pub struct Order(pub f32);

/// Shaft angle as a wrapping fraction of a turn: 2^32 is one turn, so that sums and differences never drift.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TurnFraction(pub u32);

/// Parts per million.
#[derive(Clone, Copy, Debug, Default, PartialEq, PartialOrd, Serialize, Deserialize)]
pub struct PartsPerMillion(pub f32);

/// Acceleration, m/s^2.
#[derive(Clone, Copy, Debug, Default, PartialEq, PartialOrd, Serialize, Deserialize)]
pub struct Acceleration(pub f32);

impl TicksPerSecond {
    /// Rate of samples taken every `period_ticks` ticks; a period of zero counts as one.
    pub fn rate(self, period_ticks: u32) -> Hertz {
        Hertz(self.0 as f32 / period_ticks.max(1) as f32)
    }

    /// Duration of an interval, s.
    pub fn seconds(self, interval_ticks: u64) -> f32 {
        interval_ticks as f32 / self.0 as f32
    }

    /// Ticks nearest to a duration; zero for negative or undefined durations, saturating above `u32`.
    pub fn ticks(self, seconds: f32) -> u32 {
        // A float-to-integer cast saturates and maps NaN to zero.
        (seconds * self.0 as f32 + 0.5) as u32
    }
}

impl Order {
    /// Frequency of this order at a shaft rate.
    pub fn at(self, shaft: Hertz) -> Hertz {
        Hertz(self.0 * shaft.0)
    }
}

impl TurnFraction {
    /// Fraction in [0, 1).
    pub fn turns(self) -> f32 {
        // The upper 24 bits are exact in f32, so the result can never round up to 1.
        (self.0 >> 8) as f32 / 16_777_216.0
    }

    /// Fraction of a turn of any real angle given in turns; undefined angles give zero.
    pub fn from_turns(turns: f32) -> Self {
        // Below 2^31 turns the cast to i64 keeps the integer part, which then wraps away.
        Self((turns * 4_294_967_296.0) as i64 as u32)
    }
}
