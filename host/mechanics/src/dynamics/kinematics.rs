//! Angle of the pinion as a function of time, and where the contact stands on its path.
//!
//! Angles are counted in turns from the moment tooth pair 0 enters the path of contact at angle 0.
//! One turn advances the contact by as many base pitches as the pinion has teeth. Every motion is a
//! polynomial between its breaks, so a step's angle is an exact short [`Series`].

use super::series::Series;
use crate::{Error, Result};

/// Angle of the pinion over time.
#[derive(Debug, Clone, PartialEq)]
pub enum Motion {
    /// Constant speed.
    Constant {
        /// Speed, turns per second.
        speed_hz: f64,
        /// Angle at time 0, turns.
        turns_at_zero: f64,
    },
    /// Speed changing linearly from time 0 on for a duration, constant before and after.
    RunUp {
        /// Speed up to time 0, turns per second.
        from_hz: f64,
        /// Speed after the duration, turns per second.
        to_hz: f64,
        /// Duration of the change, s.
        duration_s: f64,
    },
    /// Polynomials between knots (tach edges, a prescribed speed profile); the outer speeds continue.
    Knots {
        /// Ascending times, s.
        times_s: Vec<f64>,
        /// Angles at the knots, turns.
        turns: Vec<f64>,
        /// Speeds at the knots (cubic between them), turns per second; empty for linear between knots.
        speeds_hz: Vec<f64>,
    },
}

/// Straight-line fit of tach edges that agrees with every edge within its timing uncertainty.
const LEAST_EDGE_UNCERTAINTY_S: f64 = 3e-9;

impl Motion {
    /// Motion through tach edges: constant speed if all edges agree with one within their jitter
    /// (4 standard deviations), else linear between edges.
    ///
    /// `first_pulse` counts pulses from angle 0.
    ///
    /// # Errors
    /// Fewer than two edges, or edges that do not ascend.
    pub fn from_tach(edges_s: &[f64], pulses_per_turn: u32, first_pulse: u64, jitter_s: f64) -> Result<Self> {
        if edges_s.len() < 2 {
            return Err(Error::invalid("tach", "at least two edges are needed for a speed"));
        }
        if edges_s.iter().any(|t| !t.is_finite()) || edges_s.windows(2).any(|w| w[0] >= w[1]) {
            return Err(Error::invalid("tach", "edge times must be finite and ascend"));
        }
        let turns: Vec<f64> =
            (0..edges_s.len()).map(|i| (first_pulse + i as u64) as f64 / f64::from(pulses_per_turn)).collect();
        let n = edges_s.len() as f64;
        let mean_t = edges_s.iter().sum::<f64>() / n;
        let mean_a = turns.iter().sum::<f64>() / n;
        let cross: f64 = edges_s.iter().zip(&turns).map(|(t, a)| (t - mean_t) * (a - mean_a)).sum();
        let square: f64 = edges_s.iter().map(|t| (t - mean_t).powi(2)).sum();
        let speed_hz = cross / square;
        let turns_at_zero = mean_a - speed_hz * mean_t;
        let worst =
            edges_s.iter().zip(&turns).map(|(t, a)| ((a - turns_at_zero) / speed_hz - t).abs()).fold(0.0, f64::max);
        if worst <= 4.0 * jitter_s + LEAST_EDGE_UNCERTAINTY_S {
            return Ok(Self::Constant { speed_hz, turns_at_zero });
        }
        Ok(Self::Knots { times_s: edges_s.to_vec(), turns, speeds_hz: Vec::new() })
    }

    /// The motion of a shaft that turns `ratio` times as fast.
    pub fn geared(mut self, ratio: f64) -> Self {
        match &mut self {
            Self::Constant { speed_hz, turns_at_zero } => {
                *speed_hz *= ratio;
                *turns_at_zero *= ratio;
            }
            Self::RunUp { from_hz, to_hz, .. } => {
                *from_hz *= ratio;
                *to_hz *= ratio;
            }
            Self::Knots { turns, speeds_hz, .. } => turns.iter_mut().chain(speeds_hz).for_each(|x| *x *= ratio),
        }
        self
    }

    /// Angle over a step of length `h`, turns; valid if no break lies inside the step.
    pub fn turns(&self, t: f64, h: f64) -> Series {
        match self {
            Self::Constant { speed_hz, turns_at_zero } => Series::linear(turns_at_zero + speed_hz * t, speed_hz * h),
            Self::RunUp { from_hz, to_hz, duration_s } => {
                let slope = (to_hz - from_hz) / duration_s;
                if t < 0.0 {
                    Series::linear(from_hz * t, from_hz * h)
                } else if t < *duration_s {
                    let angle = from_hz * t + 0.5 * slope * t * t;
                    Series::from_slice(&[angle, (from_hz + slope * t) * h, 0.5 * slope * h * h])
                } else {
                    let angle = 0.5 * (from_hz + to_hz) * duration_s + to_hz * (t - duration_s);
                    Series::linear(angle, to_hz * h)
                }
            }
            Self::Knots { times_s, turns, speeds_hz } => knot_piece(times_s, turns, speeds_hz, t, h),
        }
    }

    /// The first break after `t`, infinity if none.
    pub fn next_break(&self, t: f64) -> f64 {
        match self {
            Self::Constant { .. } => f64::INFINITY,
            Self::RunUp { duration_s, .. } => [0.0, *duration_s].into_iter().find(|&b| b > t).unwrap_or(f64::INFINITY),
            Self::Knots { times_s, .. } => {
                let next = times_s.partition_point(|&b| b <= t);
                times_s.get(next).copied().unwrap_or(f64::INFINITY)
            }
        }
    }

    /// Highest mean speed between any two neighbouring knots, and that at the ends of a span of time, turns per second.
    pub fn fastest_hz(&self, (from_s, to_s): (f64, f64)) -> f64 {
        let ends = self.speed_hz(from_s).abs().max(self.speed_hz(to_s).abs());
        let Self::Knots { times_s, turns, .. } = self else { return ends };
        let speeds = times_s.windows(2).zip(turns.windows(2)).map(|(t, a)| ((a[1] - a[0]) / (t[1] - t[0])).abs());
        speeds.fold(ends, f64::max)
    }

    /// Speed at `t` (right-hand), turns per second.
    pub fn speed_hz(&self, t: f64) -> f64 {
        self.turns(t, 1e-6).coefficient(1) / 1e-6
    }
}

fn knot_piece(times: &[f64], turns: &[f64], speeds: &[f64], t: f64, h: f64) -> Series {
    let last = times.len() - 1;
    let after = times.partition_point(|&b| b <= t);
    let linear = |i: usize| (turns[i + 1] - turns[i]) / (times[i + 1] - times[i]);
    let cubic = speeds.len() == times.len();
    if after == 0 || after > last {
        let i = if after == 0 { 0 } else { last };
        let speed = match (cubic, after == 0) {
            (true, _) => speeds[i],
            (false, true) => linear(0),
            (false, false) => linear(last - 1),
        };
        return Series::linear(turns[i] + speed * (t - times[i]), speed * h);
    }
    let i = after - 1;
    let (width, u) = (times[i + 1] - times[i], t - times[i]);
    if !cubic {
        return Series::linear(turns[i] + linear(i) * u, linear(i) * h);
    }
    let (slope, v0, v1) = (linear(i), speeds[i], speeds[i + 1]);
    let c = [turns[i], v0, (3.0 * slope - 2.0 * v0 - v1) / width, (v0 + v1 - 2.0 * slope) / (width * width)];
    Series::linear(u, h).compose(&c)
}
