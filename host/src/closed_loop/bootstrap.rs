//! How often a record without any effect would have shown as much: this record's own probability of a false alarm, by a parametric bootstrap.
//!
//! The calibrated machine is played at the record's speeds and torques, with noise of the record's own spectrum and edges with its jitter; the loop looks at each such record exactly as
//! it did at the real one (split, calibration, first round of the search), and the best scores are compared. With `k` of `N` at least as large the probability is
//! `(k + 1) / (N + 1)` (Davison and Hinkley 1997, 4.2): exact for records as the bootstrap makes them. Limits: what the real record holds beyond calibrated machine and
//! stationary Gaussian noise is what is asked for and no part of them; the least probability is `1 / (N + 1)`. Cost: one round of the search per record.

use super::base_fit::Base;
use super::waveform::complete;
use crate::observation::input::{Record, Run};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use rustfft::{FftPlanner, num_complex::Complex64 as C};
use serde::Serialize;

/// What the bootstrap says.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct NullRecords {
    /// Records without any effect.
    pub records: usize,
    /// Those whose best score was at least this record's.
    pub at_least: usize,
    /// Best score of any explanation of this record in the first round.
    pub score: f64,
    /// Probability that a record without any effect shows as much.
    pub probability: f64,
}

impl NullRecords {
    /// Of the record's best score and those of the others.
    pub fn of(score: f64, others: &[f64]) -> Self {
        let at_least = others.iter().filter(|other| **other >= score).count();
        let probability = (at_least + 1) as f64 / (others.len() + 1) as f64;
        Self { records: others.len(), at_least, score, probability }
    }
}

/// Record number `index` of the bootstrap of `record`, of which `base` is the calibrated machine.
pub fn null_record(record: &Record, base: &Base, seed: u64, index: usize) -> Record {
    let mut null = record.clone();
    for (number, run) in null.runs.iter_mut().enumerate() {
        let stream = seed.wrapping_mul(0x9E37_79B9).wrapping_add((index * base.runs.len() + number) as u64);
        play(run, base, number, record, &mut ChaCha8Rng::seed_from_u64(stream));
    }
    null
}

fn play(run: &mut Run, base: &Base, number: usize, record: &Record, random: &mut ChaCha8Rng) {
    let state = &base.runs[number];
    for (channel, predicted) in complete(&base.analyser, state).into_iter().enumerate() {
        let noise = coloured(&state.noise[channel], base, random);
        run.channels[channel] = predicted.iter().zip(&noise).map(|(p, n)| p + n).collect();
    }
    let pulses = f64::from(record.pulses_per_rev);
    for (i, edge) in run.edges_s.iter_mut().enumerate() {
        let turns = (i as f64 + f64::from(run.first_pulse_index)) / pulses;
        let jitter: f64 = StandardNormal.sample(random);
        let line = (turns - state.angle.offset_rad / std::f64::consts::TAU) / state.angle.shaft_hz;
        *edge = (line + record.jitter_s * jitter).max(0.0);
    }
}

/// Gaussian noise with this power per bin; above the last bin as in it.
fn coloured(power: &[f64], base: &Base, random: &mut ChaCha8Rng) -> Vec<f64> {
    let n = base.analyser.samples;
    let mut signal: Vec<C> = (0..n).map(|_| C::new(StandardNormal.sample(random), 0.0)).collect();
    let mut planner = FftPlanner::new();
    planner.plan_fft_forward(n).process(&mut signal);
    let unit = base.analyser.bin_power_of_unit_variance();
    let gain = |bin: usize| (power[bin.min(power.len() - 1)] / unit).sqrt() / n as f64;
    signal.iter_mut().enumerate().for_each(|(i, x)| *x *= gain(i.min(n - i)));
    planner.plan_fft_inverse(n).process(&mut signal);
    signal.into_iter().map(|x| x.re).collect()
}
