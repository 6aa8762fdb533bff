//! The node's clock against a pulse per second, from a GNSS receiver or another clock.
//!
//! Pulses are counted by whole seconds of the node's clock; what lies further from a whole second than the worst
//! oscillator could is refused. The clock's error is the distance of the newest pulse from the oldest one of a
//! baseline of 64 to 128 s, so it follows the temperature. Its uncertainty is the scatter of the pulses and a tick,
//! over the baseline.
//!
//! Speeds and rates are not corrected by it. Source: two-point frequency offset, as in NIST special publication 1065,
//! section 5.

use crate::math;
use crate::units::TicksPerSecond;
use serde::{Deserialize, Serialize};

/// Largest distance from a whole second, relative: an internal oscillator's 2 %.
pub const LARGEST_ERROR: f64 = 0.02;
/// Pulses may be missing for so many seconds; then the baseline begins anew.
pub const LONGEST_GAP_S: u64 = 10;
/// Half of the longest baseline, s.
const HALF_BASELINE_S: u64 = 64;
/// Refused pulses in a row that make the latest one the first of a new baseline.
const MAX_REFUSED_PULSES: u32 = 3;

/// The clock as the pulses say.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SecondPulse {
    /// The node's clock runs fast by so many parts per million.
    pub fast_ppm: f32,
    /// Standard uncertainty of it, parts per million.
    pub uncertainty_ppm: f32,
    /// Seconds from the oldest to the newest pulse that it rests on.
    pub baseline_s: u32,
    /// Pulses accepted since the start.
    pub pulses: u32,
    /// Pulses refused since the start: not at a whole second.
    pub refused: u32,
    /// Since the newest accepted pulse, s.
    pub age_s: f32,
}

/// A pulse, with the seconds since the first one of its baseline.
#[derive(Clone, Copy, Debug, Default)]
struct Pulse {
    instant: u64,
    second: u64,
}

/// Follows the pulses.
#[derive(Clone, Copy, Debug, Default)]
pub struct PulseClock {
    oldest: Pulse,
    /// The first one half a baseline behind the oldest.
    middle: Option<Pulse>,
    newest: Pulse,
    /// Mean square of the differences of successive seconds, ticks squared.
    scatter: f32,
    /// Ticks of the second before.
    former: Option<f64>,
    pulses: u32,
    refused: u32,
    in_a_row: u32,
}

impl PulseClock {
    /// No pulse yet.
    pub const NONE: Self = Self {
        oldest: Pulse { instant: 0, second: 0 },
        middle: None,
        newest: Pulse { instant: 0, second: 0 },
        scatter: 0.0,
        former: None,
        pulses: 0,
        refused: 0,
        in_a_row: 0,
    };

    /// A pulse was captured.
    pub fn on_pulse(&mut self, instant: u64, clock: TicksPerSecond) {
        if self.pulses == 0 {
            self.begin(instant);
            return;
        }
        let ticks = instant.saturating_sub(self.newest.instant);
        let clock_hz = u64::from(clock.0.max(1));
        let seconds = (ticks + clock_hz / 2) / clock_hz;
        if seconds > LONGEST_GAP_S {
            self.begin(instant);
            return;
        }
        let wanted = (seconds * clock_hz) as f64;
        if seconds == 0 || (ticks as f64 - wanted).abs() > LARGEST_ERROR * wanted {
            self.refused = self.refused.saturating_add(1);
            self.in_a_row += 1;
            if self.in_a_row >= MAX_REFUSED_PULSES {
                self.begin(instant);
            }
            return;
        }
        self.in_a_row = 0;
        self.pulses = self.pulses.saturating_add(1);
        self.follow_scatter(ticks as f64 / seconds as f64);
        self.newest = Pulse { instant, second: self.newest.second + seconds };
        let span = self.newest.second - self.oldest.second;
        if span >= 2 * HALF_BASELINE_S {
            self.oldest = self.middle.replace(self.newest).unwrap_or(self.newest);
        } else if span >= HALF_BASELINE_S && self.middle.is_none() {
            self.middle = Some(self.newest);
        }
    }

    fn begin(&mut self, instant: u64) {
        let first = Pulse { instant, second: 0 };
        (self.oldest, self.middle, self.newest) = (first, None, first);
        (self.former, self.scatter, self.in_a_row) = (None, 0.0, 0);
        self.pulses = self.pulses.saturating_add(1);
    }

    fn follow_scatter(&mut self, second: f64) {
        if let Some(former) = self.former.replace(second) {
            let difference = (second - former) as f32;
            // A mean over about eight seconds, from the first one on.
            self.scatter += (difference * difference - self.scatter) / 8.0;
        }
    }

    /// The clock's error; `None` before two pulses, and when they have stopped for longer than [`LONGEST_GAP_S`].
    pub fn report(&self, now: u64, clock: TicksPerSecond) -> Option<SecondPulse> {
        let seconds = self.newest.second - self.oldest.second;
        let clock_hz = f64::from(clock.0.max(1));
        let age_s = now.saturating_sub(self.newest.instant) as f64 / clock_hz;
        if seconds == 0 || age_s > LONGEST_GAP_S as f64 {
            return None;
        }
        let ticks = (self.newest.instant - self.oldest.instant) as f64;
        let wanted = seconds as f64 * clock_hz;
        // A second has two ends, the difference of two has the middle one twice: six times a pulse's own variance.
        let pulse = math::sqrt(self.scatter / 6.0 + 1.0 / 12.0);
        let uncertainty = core::f64::consts::SQRT_2 * f64::from(pulse) / wanted;
        Some(SecondPulse {
            fast_ppm: ((ticks / wanted - 1.0) * 1e6) as f32,
            uncertainty_ppm: (uncertainty * 1e6) as f32,
            baseline_s: seconds as u32,
            pulses: self.pulses,
            refused: self.refused,
            age_s: age_s as f32,
        })
    }
}
