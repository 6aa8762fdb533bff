//! What is in order with a sensor, in which codes it can be told, and how its state leaves the node.
//!
//! The first values are those of nodes that knew none of it ([`crate::schema`]), apart from the range of codes: zeros
//! stand for the standard one, because an amplifier that clips before the converter's ends does so in old
//! configurations, too.

use crate::units::{Acceleration, Hertz};
use serde::{Deserialize, Serialize};

/// Share of the converter's range at either end in which a front end may already clip: an MCP6S21 comes no nearer than
/// 60 mV to its rails (DS21117B, 4.2.3), 1.8 % of 3.3 V.
const STANDARD_MARGIN: f32 = 0.025;
const STANDARD_LOWEST: u16 = (STANDARD_MARGIN * 65_536.0) as u16;
/// Level below the expected RMS that no machine but a sensor without signal has, dB; where
/// [`SensorCheck::far_below_db`] is 0.
pub const STANDARD_FAR_BELOW_DB: f32 = 20.0;
/// Lower edge of the velocity's band where none is configured: ISO 20816-3 for shafts from 600 r/min on.
pub const STANDARD_VELOCITY_FROM_HZ: f32 = 10.0;
/// Lower edges that can be asked for, Hz: ISO 20816-3 asks for 2 Hz below 600 r/min.
pub const VELOCITY_FROM_HZ: core::ops::RangeInclusive<f32> = 1.0..=100.0;

/// Codes between which the front end does not clip, 16 bit, left-aligned; what lies at or beyond either is clipped.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct CodeRange {
    /// Lowest code of the front end; 0 stands for 2.5 % of the converter's range.
    pub lowest: u16,
    /// Highest code of the front end; 0 stands for 97.5 %.
    pub highest: u16,
}

impl CodeRange {
    /// The range in force.
    pub const fn in_force(self) -> Self {
        let lowest = if self.lowest == 0 { STANDARD_LOWEST } else { self.lowest };
        let highest = if self.highest == 0 { u16::MAX - STANDARD_LOWEST } else { self.highest };
        Self { lowest, highest }
    }

    /// Whether a code is at or beyond an end of a range that is in force.
    #[inline]
    pub const fn is_beyond(self, code: u16) -> bool {
        // One comparison: below the lower end the difference wraps.
        code.wrapping_sub(self.lowest).wrapping_sub(1) >= self.highest.wrapping_sub(self.lowest).wrapping_sub(1)
    }

    fn is_sane(self) -> bool {
        let range = self.in_force();
        range.highest.saturating_sub(range.lowest) >= 256
    }
}

/// Where the state of the sensor leaves the node.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum OkOutput {
    /// By the alarm output, where `holding.watch_signal` is on.
    #[default]
    WithAlarm,
    /// By an output of its own: a fault of the sensor does not move the alarm output.
    Own,
}

/// What a sensor in order shows. Zeros switch a check off, but for `far_below_db`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SensorCheck {
    /// Lowest and highest bias at the sensor, V (IEPE: 8 to 14), by a divider into the board's input for it.
    pub bias_v: [f32; 2],
    /// Volts at the sensor per volt at that input, 1 to 100; 0 where nothing is wired there.
    pub bias_divider: f32,
    /// Lowest and highest mean code of the signal: the bias of a sensor that is coupled directly.
    pub mean: [u16; 2],
    /// Root mean square below which a machine that turns is not heard, m/s^2.
    pub floor: Acceleration,
    /// So far below the expected RMS there is no signal, dB; 0 stands for 20.
    pub far_below_db: f32,
    /// Where the state leaves the node.
    pub output: OkOutput,
}

impl SensorCheck {
    /// Departure of the RMS, dB, below which there is no signal.
    pub fn lowest_departure_db(&self) -> f32 {
        -if self.far_below_db > 0.0 { self.far_below_db } else { STANDARD_FAR_BELOW_DB }
    }

    /// Whether bands are ordered and levels in their ranges.
    pub fn is_sane(&self) -> bool {
        let [low, high] = self.bias_v;
        let no_band = low == 0.0 && high == 0.0;
        let divided = self.bias_divider == 0.0 || (1.0..=100.0).contains(&self.bias_divider);
        let band = no_band || (low >= 0.0 && low < high && high <= 100.0 && self.bias_divider > 0.0);
        let mean = self.mean == [0, 0] || self.mean[0] < self.mean[1];
        let floor = self.floor.0 >= 0.0 && self.floor.0.is_finite();
        band && divided && mean && floor && (0.0..=200.0).contains(&self.far_below_db)
    }
}

/// Whether range, check and velocity's edge can be used.
pub(super) fn are_sane(range: CodeRange, check: &SensorCheck, velocity_from: Hertz) -> bool {
    let edge = velocity_from.0 == 0.0 || VELOCITY_FROM_HZ.contains(&velocity_from.0);
    range.is_sane() && check.is_sane() && edge
}
