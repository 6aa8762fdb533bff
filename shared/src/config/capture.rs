//! Which waveforms a node keeps for its alarms.

use crate::units::Hertz;
use core::ops::RangeInclusive;
use serde::{Deserialize, Serialize};

/// Rates that can be asked for, Hz. The lowest is what the filter reaches from the highest ADC rate; the memory then
/// holds 5 s.
pub const RATES: RangeInclusive<f32> = 4_000.0..=100_000.0;
/// Rate that 0 stands for, Hz.
pub const STANDARD_RATE: Hertz = Hertz(10_000.0);

/// At which rate waveforms are kept.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum CaptureRate {
    /// None are kept.
    #[default]
    Off,
    /// At `capture.rate` or the next rate above it that the converter's gives: 2 s at 10 kHz.
    Fixed,
    /// At the law's rate, for as many turns as the memory holds.
    Law,
}

/// Waveforms kept for alarms and requests.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CaptureConfig {
    /// At which rate.
    pub keep: CaptureRate,
    /// Lowest rate with `Fixed`, Hz, 4000 to 100 000; 0 stands for 10 000.
    pub rate: Hertz,
}

impl CaptureConfig {
    /// The lowest rate in force, where the law's is `law`; `None` where nothing is kept.
    pub fn wanted(&self, law: Hertz) -> Option<Hertz> {
        match self.keep {
            CaptureRate::Off => None,
            CaptureRate::Fixed if self.rate.0 == 0.0 => Some(STANDARD_RATE),
            CaptureRate::Fixed => Some(self.rate),
            CaptureRate::Law => Some(law),
        }
    }

    /// Whether the rate is in its range.
    pub fn is_sane(&self) -> bool {
        self.rate.0 == 0.0 || RATES.contains(&self.rate.0)
    }
}
