//! The node's mesh-band lines in f64, from the analogue signal itself and the tachometer's edges.
//!
//! Nothing of the node's chain is used: no ADC codes, no decimation, no FFT. Over the same stretch of time the signal
//! is weighted with a Blackman-Harris window and correlated with a line `exp(-2 pi i order phase)`; the line's order
//! is the one that maximises the result within a few bins of the expected one. Two phases are available:
//!
//! * *time*: `phase` grows uniformly, at the mean speed of the stretch. This is what a spectrum at a constant rate
//!   sees, smear by a wandering speed included: the yardstick of the node's computation.
//! * *angle*: `phase` is the shaft's angle from the tach edges (cubic spline). This is the line without smear: the
//!   yardstick of what the machine did.
//!
//! Exact for one line at least four bins from its neighbours (those weigh in at -92 dB); the mirror image at negative
//! frequencies lies hundreds of bins away. Cost: one pass over the stretch per line, 40 ns per sample.

use super::signal::Signal;
use crate::spectral::{AngleMap, Window};
use std::f64::consts::TAU;

/// Sums that a demodulated line is kept in; the search within a few bins loses less than 1e-6 by it.
const BLOCKS: usize = 2048;
/// Bins searched to each side.
const REACH: f64 = 3.5;

/// What the phase of a line follows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Domain {
    /// Time.
    Time,
    /// Shaft angle.
    Angle,
}

/// Shaft angle over time, in turns of the order shaft.
#[derive(Debug, Clone)]
pub struct Shaft {
    map: AngleMap,
    edges_s: Vec<f64>,
    turns_per_pulse: f64,
    pulses: f64,
    ratio: f64,
}

impl Shaft {
    /// The shaft that turns `ratio` times per turn of the tach's; `None` with fewer than two edges.
    pub fn new(signal: &Signal, ratio: f64) -> Option<Self> {
        let map = AngleMap::new(&signal.edges_s, signal.pulses_per_turn, 0.0)?;
        let pulses = f64::from(signal.pulses_per_turn);
        Some(Self { map, edges_s: signal.edges_s.clone(), turns_per_pulse: 1.0 / pulses, pulses, ratio })
    }

    /// Turns at an instant: the spline of time over angle, inverted by the secant method.
    pub fn turns_at(&self, time_s: f64) -> f64 {
        let last = self.edges_s.len() - 2;
        let i = self.edges_s.partition_point(|&t| t <= time_s).saturating_sub(1).min(last);
        let (left, right) = (self.edges_s[i], self.edges_s[i + 1]);
        let slope = (right - left) * self.pulses;
        let mut turns = (i as f64 + (time_s - left) / (right - left)) * self.turns_per_pulse;
        for _ in 0..6 {
            let miss = self.map.time_at(turns) - time_s;
            turns -= miss / slope;
        }
        turns * self.ratio
    }

    /// Instant at which the order shaft has made this many turns.
    pub fn time_at(&self, turns: f64) -> f64 {
        self.map.time_at(turns / self.ratio)
    }

    /// Mean speed between two instants, Hz.
    pub fn speed_hz(&self, from_s: f64, to_s: f64) -> f64 {
        (self.turns_at(to_s) - self.turns_at(from_s)) / (to_s - from_s)
    }
}

/// One line of the reference.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReferenceLine {
    /// Frequency at the mean speed of the stretch, Hz.
    pub frequency_hz: f64,
    /// Peak amplitude.
    pub amplitude: f64,
}

/// Which stretch of the signal is looked at, and how.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stretch {
    /// First instant, s.
    pub start_s: f64,
    /// Last instant, s.
    pub end_s: f64,
    /// What the phase of a line follows.
    pub domain: Domain,
    /// Weight over the phase.
    pub window: Window,
}

/// A stretch of the signal, weighted.
#[derive(Debug, Clone)]
pub struct Reference {
    weighted: Vec<f64>,
    /// Turns of the order shaft from the stretch's start.
    phase: Vec<f64>,
    weight: f64,
    /// Bin width in orders.
    pub bin: f64,
    /// Mean speed over the stretch, Hz.
    pub speed_hz: f64,
}

impl Reference {
    /// A stretch of the signal; `None` where the signal does not cover it with 64 samples.
    pub fn over(signal: &Signal, shaft: &Shaft, stretch: Stretch) -> Option<Self> {
        let Stretch { start_s, end_s, domain, window } = stretch;
        if !(start_s >= 0.0 && end_s > start_s) {
            return None;
        }
        let (first, end) = ((start_s * signal.rate_hz).ceil() as usize, (end_s * signal.rate_hz).ceil() as usize);
        let samples = signal.samples.get(first..end).filter(|samples| samples.len() >= 64)?;
        let times = (first..end).map(|i| i as f64 / signal.rate_hz);
        let speed_hz = shaft.speed_hz(start_s, end_s);
        let origin = shaft.turns_at(start_s);
        let turns = speed_hz * (end_s - start_s);
        let phase: Vec<f64> = match domain {
            Domain::Time => times.map(|t| (t - start_s) * speed_hz).collect(),
            Domain::Angle => times.map(|t| shaft.turns_at(t) - origin).collect(),
        };
        // Weights go with the phase: equal angles count equally in the angle domain.
        let density = |i: usize| match domain {
            Domain::Time => 1.0,
            Domain::Angle => {
                let (a, b) = (i.saturating_sub(1), (i + 1).min(phase.len() - 1));
                (phase[b] - phase[a]) / (b - a) as f64
            }
        };
        let weights: Vec<f64> = (0..phase.len()).map(|i| density(i) * window.weight(phase[i] / turns)).collect();
        let weight: f64 = weights.iter().sum();
        let mean = samples.iter().zip(&weights).map(|(x, w)| x * w).sum::<f64>() / weight;
        let weighted = samples.iter().zip(&weights).map(|(x, w)| (x - mean) * w).collect();
        Some(Self { weighted, phase, weight, bin: 1.0 / turns, speed_hz })
    }

    /// The strongest line within a few bins of an order.
    pub fn line(&self, order: f64) -> ReferenceLine {
        let sums = self.demodulated(order);
        let size = |bins: f64| turned_back(&sums, bins * self.bin);
        let steps = (8.0 * REACH) as i32;
        let best = (-steps..=steps).map(|k| f64::from(k) * 0.125).max_by(|a, b| size(*a).total_cmp(&size(*b)));
        let best = best.unwrap_or(0.0);
        let bins = maximise(size, best - 0.25, best + 0.25);
        ReferenceLine {
            frequency_hz: (order + bins * self.bin) * self.speed_hz,
            amplitude: 2.0 * size(bins) / self.weight,
        }
    }

    /// The amplitude at exactly this order.
    pub fn amplitude_at(&self, order: f64) -> f64 {
        let (re, im) = self.demodulated(order).iter().fold((0.0, 0.0), |(re, im), s| (re + s.1, im + s.2));
        2.0 * f64::hypot(re, im) / self.weight
    }

    /// The amplitude spectrum within `reach` orders of an order, four points per bin: order and amplitude.
    pub fn spectrum(&self, order: f64, reach: f64) -> Vec<(f64, f64)> {
        let sums = self.demodulated(order);
        let steps = (4.0 * reach / self.bin).ceil() as i32;
        let offsets = (-steps..=steps).map(|k| 0.25 * f64::from(k) * self.bin);
        offsets.map(|o| (order + o, 2.0 * turned_back(&sums, o) / self.weight)).collect()
    }

    /// Weighted samples turned back by an order, in [`BLOCKS`] sums with their middle phases.
    fn demodulated(&self, order: f64) -> Vec<(f64, f64, f64)> {
        let size = self.phase.len().div_ceil(BLOCKS);
        let sum = |(phase, samples): (&[f64], &[f64])| {
            let (mut re, mut im) = (0.0, 0.0);
            for (p, x) in phase.iter().zip(samples) {
                let (s, c) = (TAU * (order * p).fract()).sin_cos();
                re += x * c;
                im -= x * s;
            }
            (0.5 * (phase[0] + phase[phase.len() - 1]), re, im)
        };
        self.phase.chunks(size).zip(self.weighted.chunks(size)).map(sum).collect()
    }
}

/// Size of the sum after turning back by further `orders`.
fn turned_back(sums: &[(f64, f64, f64)], orders: f64) -> f64 {
    let (re, im) = sums.iter().fold((0.0, 0.0), |(re, im), &(phase, a, b)| {
        let (s, c) = (TAU * orders * phase).sin_cos();
        (re + a * c + b * s, im + b * c - a * s)
    });
    f64::hypot(re, im)
}

/// Golden section to 1e-5 of the interval's size.
fn maximise(value: impl Fn(f64) -> f64, mut low: f64, mut high: f64) -> f64 {
    let golden = 0.5 * (5.0_f64.sqrt() - 1.0);
    let (mut a, mut b) = (high - golden * (high - low), low + golden * (high - low));
    let (mut at_a, mut at_b) = (value(a), value(b));
    for _ in 0..24 {
        if at_a > at_b {
            (high, b, at_b) = (b, a, at_a);
            a = high - golden * (high - low);
            at_a = value(a);
        } else {
            (low, a, at_a) = (a, b, at_b);
            b = low + golden * (high - low);
            at_b = value(b);
        }
    }
    0.5 * (low + high)
}
