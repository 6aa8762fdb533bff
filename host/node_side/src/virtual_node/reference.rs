//! The node's mesh-band lines in f64, from the analogue signal itself and the tachometer's edges.
//!
//! Nothing of the node's chain is used: no ADC codes, no decimation, no resampling, no FFT. Over the same turns the
//! signal is weighted with the window that the node's records have (Hann, over the angle) and correlated with
//! `exp(-2 pi i order angle)`, the angle being a cubic spline through the tach edges; a line's order is the one that
//! maximises the result within a bin and a half of the expected one.
//!
//! A neighbour eight bins away weighs in at -62 dB, at sixteen bins at -80 dB, in the node as here. The mirror image at
//! negative orders lies hundreds of bins away. Cost: one pass over the stretch per line, 40 ns per sample.

use super::signal::Signal;
use crate::spectral::{AngleMap, Window};
use std::f64::consts::TAU;

/// Sums that a demodulated line is kept in; the search within a few bins loses less than 1e-6 by it.
const BLOCKS: usize = 2048;
/// Bins searched to each side.
const REACH: f64 = 1.5;
/// Window of the node's mesh-band records.
const WINDOW: Window = Window::Hann;

/// Shaft angle over time, in turns of the pinion.
#[derive(Debug, Clone)]
pub struct Shaft {
    map: AngleMap,
    edges_s: Vec<f64>,
    turns_per_pulse: f64,
    pulses: f64,
    ratio: f64,
}

impl Shaft {
    /// The pinion of a signal; `None` with fewer than two edges.
    pub fn new(signal: &Signal) -> Option<Self> {
        let map = AngleMap::new(&signal.edges_s, signal.pulses_per_turn, 0.0)?;
        let pulses = f64::from(signal.pulses_per_turn);
        Some(Self {
            map,
            edges_s: signal.edges_s.clone(),
            turns_per_pulse: 1.0 / pulses,
            pulses,
            ratio: signal.pinion_per_tach,
        })
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

    /// Instant at which the pinion has made this many turns.
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

/// A stretch of the signal, weighted.
#[derive(Debug, Clone)]
pub struct Reference {
    weighted: Vec<f64>,
    /// Turns of the pinion from the stretch's start.
    phase: Vec<f64>,
    weight: f64,
    /// Bin width in orders.
    pub bin: f64,
    /// Mean speed over the stretch, Hz.
    pub speed_hz: f64,
    /// End of the stretch, s.
    pub end_s: f64,
}

impl Reference {
    /// The `turns` from `start_s` on; `None` where the signal does not cover them with 64 samples.
    pub fn over(signal: &Signal, shaft: &Shaft, start_s: f64, turns: f64) -> Option<Self> {
        let origin = shaft.turns_at(start_s);
        let end_s = shaft.time_at(origin + turns);
        if !(start_s >= 0.0 && end_s > start_s) {
            return None;
        }
        let (first, end) = ((start_s * signal.rate_hz).ceil() as usize, (end_s * signal.rate_hz).ceil() as usize);
        let samples = signal.samples.get(first..end).filter(|samples| samples.len() >= 64)?;
        let phase: Vec<f64> = (first..end).map(|i| shaft.turns_at(i as f64 / signal.rate_hz) - origin).collect();
        // Equal angles count equally, as they do after resampling.
        let density = |i: usize| {
            let (a, b) = (i.saturating_sub(1), (i + 1).min(phase.len() - 1));
            (phase[b] - phase[a]) / (b - a) as f64
        };
        let weights: Vec<f64> = (0..phase.len()).map(|i| density(i) * WINDOW.weight(phase[i] / turns)).collect();
        let weight: f64 = weights.iter().sum();
        let mean = samples.iter().zip(&weights).map(|(x, w)| x * w).sum::<f64>() / weight;
        let weighted = samples.iter().zip(&weights).map(|(x, w)| (x - mean) * w).collect();
        Some(Self { weighted, phase, weight, bin: 1.0 / turns, speed_hz: turns / (end_s - start_s), end_s })
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
