//! The speed of a machine as it runs: constant or rising, with slow random changes and a swing.
//!
//! The random part is a sum of cosines with drawn frequencies and phases: as smooth as its band says, and of exactly
//! the deviation asked for in the mean over time. The angle is the integral of the speed; between knots it is the
//! cubic that shares angle and speed with it.

use super::declaration::Wander;
use crate::dynamics::Motion;
use rand::RngExt;
use rand_chacha::ChaCha12Rng;
use std::f64::consts::TAU;

/// Cosines of the random part.
const COSINES: usize = 24;
/// Knots per period of the fastest change.
const KNOTS_PER_PERIOD: f64 = 32.0;
/// Longest distance of knots, s: a run-up's angle is exact at any.
const LONGEST_S: f64 = 0.05;

/// Speed of the pinion over time.
#[derive(Debug, Clone, PartialEq)]
pub struct Course {
    base: Motion,
    /// Amplitude over the speed, frequency in Hz, phase in rad.
    parts: Vec<[f64; 3]>,
}

impl Course {
    /// A course about `base`, drawn from `random`.
    pub fn drawn(base: Motion, wander: &Wander, random: &mut ChaCha12Rng) -> Self {
        let mut parts = Vec::new();
        let amplitude = wander.share * (2.0 / COSINES as f64).sqrt();
        let [low, high] = wander.band_hz;
        for _ in 0..COSINES {
            let [frequency, phase]: [f64; 2] = [random.random(), random.random()];
            parts.push([amplitude, low + (high - low) * frequency, TAU * phase]);
        }
        parts.push([wander.swing, wander.swing_hz, TAU * random.random::<f64>()]);
        parts.retain(|part| part[0] > 0.0);
        Self { base, parts }
    }

    /// Speed at `t`, turns per second.
    pub fn speed_hz(&self, t: f64) -> f64 {
        let share: f64 = self.parts.iter().map(|[a, hz, phase]| a * (TAU * hz * t + phase).cos()).sum();
        // A shaft that wanders to a stand is none that this is for.
        self.base.speed_hz(t) * (1.0 + share).max(0.1)
    }

    /// The motion over `-before_s` to `duration_s`, with time 0 moved to the start and `turns` as the angle there.
    pub fn motion(&self, before_s: f64, duration_s: f64, turns: f64) -> Motion {
        if let (Motion::Constant { speed_hz, .. }, true) = (&self.base, self.parts.is_empty()) {
            return Motion::Constant { speed_hz: *speed_hz, turns_at_zero: turns };
        }
        let fastest_hz = self.parts.iter().map(|part| part[1]).fold(0.0, f64::max);
        let step = LONGEST_S.min(1.0 / (KNOTS_PER_PERIOD * fastest_hz));
        let count = ((before_s + duration_s) / step).ceil() as usize + 2;
        let mut times: Vec<f64> = (0..count).map(|i| i as f64 * step).collect();
        // Where a run-up begins and ends its speed has a kink.
        if let Motion::RunUp { duration_s, .. } = self.base {
            let last = times[count - 1];
            times.extend([before_s, before_s + duration_s].iter().filter(|kink| **kink < last));
            times.sort_by(f64::total_cmp);
            times.dedup_by(|a, b| (*a - *b).abs() < 1e-6 * step);
        }
        let speeds_hz: Vec<f64> = times.iter().map(|s| self.speed_hz(s - before_s)).collect();
        let mut angle = turns;
        let mut angles = vec![angle];
        for (t, v) in times.windows(2).zip(speeds_hz.windows(2)) {
            let middle = self.speed_hz(0.5 * (t[0] + t[1]) - before_s);
            angle += (t[1] - t[0]) * (v[0] + 4.0 * middle + v[1]) / 6.0;
            angles.push(angle);
        }
        Motion::Knots { times_s: times, turns: angles, speeds_hz }
    }
}
