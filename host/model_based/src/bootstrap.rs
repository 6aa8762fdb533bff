//! How often a record without any effect would have shown as much: this record's own probability of a false alarm, by
//! a parametric bootstrap.
//!
//! The calibrated machine is played at the record's speeds and torques with noise of the record's own spectrum, and
//! edges with the jitter that its edges have. The loop looks at each such record as it did at the real one
//! (calibration, first round of the search), and the best scores are compared. With `k` of `N` at least as high the
//! probability is `(k + 1) / (N + 1)` (Davison and Hinkley, Bootstrap Methods and their Application, 1997, section
//! 4.2). Cost: a calibration and one round of the search per record. Limits: what the real record holds beyond the
//! calibrated machine and stationary Gaussian noise is what is asked for and no part of them; no probability is below
//! `1 / (N + 1)`; a record that is distorted as a whole (clipped, a moving speed) has none.

use super::base_fit::{Base, TOLERANCES};
use super::calibrate::calibrate;
use super::judge::Split;
use super::least_squares::Data;
use super::options::Options;
use super::search::{Memory, search};
use super::simulation::signals;
use super::waveform::complete;
use crate::observation::input::{Record, Run};
use crate::spectral::{noise_power, shaped};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Share of a bin's frequency to either side over which its noise is levelled.
const REACH: f64 = 0.12;
/// Bins to either side over which it is at least.
const LEAST_REACH: usize = 90;

/// Best scores of `options.null_records` records without any effect, of the machine and the noise in `base`,
/// calibrated on `record`, and what it leaves.
pub fn best_scores(
    record: &Record,
    base: &Base,
    left: &Data,
    split: &Split,
    options: &Options,
    say: &dyn Fn(&str),
) -> Vec<f64> {
    let quiet = Quiet::new(record, base, left);
    let of = |index: usize| {
        say(&format!("record {} of {} without any effect", index + 1, options.null_records));
        let null = quiet.record(options.seed, index);
        let mut base = Base::new(&null);
        calibrate(&mut base, &split.seen());
        let mut memory = Memory::default();
        search(&mut base, split, options, 1, &mut memory, &|_| {});
        memory.first_score
    };
    (0..options.null_records).map(of).collect()
}

/// The machine alone at the record's speeds and torques, with the record's noise.
struct Quiet<'a> {
    record: &'a Record,
    base: &'a Base,
    /// Vibration without noise, by run and channel.
    vibration: Vec<[Vec<f64>; 2]>,
    /// Noise per bin, by run and channel.
    noise: Vec<[Vec<f64>; 2]>,
    /// Jitter of the tachometer's edges, s.
    jitter_s: f64,
}

impl<'a> Quiet<'a> {
    fn new(record: &'a Record, base: &'a Base, left: &Data) -> Self {
        let runs: Vec<usize> = (0..base.runs.len()).collect();
        let vibration = signals(base, &[0.0; TOLERANCES.len()], &[], &runs)
            .unwrap_or_else(|| base.runs.par_iter().map(|run| complete(&base.analyser, run)).collect());
        let noise = left.residual.iter().map(|channels| [0, 1].map(|c| smoothed(&noise_power(&channels[c])))).collect();
        Self { record, base, vibration, noise, jitter_s: jitter_s(record, base) }
    }

    /// Record number `index`.
    fn record(&self, seed: u64, index: usize) -> Record {
        let mut null = self.record.clone();
        let count = null.runs.len();
        null.runs.par_iter_mut().enumerate().for_each(|(number, run)| {
            let stream = seed.wrapping_mul(0x9E37_79B9).wrapping_add((index * count + number) as u64);
            self.play(run, number, &mut ChaCha8Rng::seed_from_u64(stream));
        });
        null
    }

    fn play(&self, run: &mut Run, number: usize, random: &mut impl Rng) {
        for (channel, alone) in self.vibration[number].iter().enumerate() {
            let noise = self.coloured(&self.noise[number][channel], random);
            run.channels[channel] = alone.iter().zip(&noise).map(|(a, n)| a + n).collect();
        }
        let angle = self.base.runs[number].angle;
        for (i, edge) in run.edges_s.iter_mut().enumerate() {
            let turns = (i as f64 + f64::from(run.first_pulse_index)) / f64::from(self.record.pulses_per_rev);
            let jitter: f64 = StandardNormal.sample(random);
            *edge = ((TAU * turns - angle.offset_rad) / (TAU * angle.shaft_hz) + self.jitter_s * jitter).max(0.0);
        }
    }

    /// Gaussian noise with this power per bin; above the last bin as in it.
    fn coloured(&self, power: &[f64], random: &mut impl Rng) -> Vec<f64> {
        let analyser = &self.base.analyser;
        let n = analyser.samples;
        let mut signal: Vec<f64> = (0..n).map(|_| StandardNormal.sample(random)).collect();
        let unit = analyser.bin_power_of_unit_variance();
        shaped(&mut signal, |bin| (power[bin.min(power.len() - 1)] / unit).sqrt() / n as f64);
        signal
    }
}

/// Noise levels without the roughness of their estimate, which a record that is played would have on top of its own:
/// means over the bins around each.
fn smoothed(level: &[f64]) -> Vec<f64> {
    let sums: Vec<f64> = std::iter::once(0.0)
        .chain(level.iter().scan(0.0, |sum, x| {
            *sum += x;
            Some(*sum)
        }))
        .collect();
    let mean = |bin: usize| {
        let reach = LEAST_REACH.max((REACH * bin as f64) as usize).min(bin).min(level.len() - 1 - bin);
        (sums[bin + reach + 1] - sums[bin - reach]) / (2 * reach + 1) as f64
    };
    (0..level.len()).map(mean).collect()
}

/// Jitter that the edges of all runs show about the straight lines through each run's.
fn jitter_s(record: &Record, base: &Base) -> f64 {
    let (mut squares, mut freedoms) = (0.0, 0.0);
    for (run, state) in record.runs.iter().zip(&base.runs) {
        let count = run.edges_s.len() as f64;
        squares += count * state.angle.edge_scatter_s.powi(2);
        // Two of the edges' freedoms went into the line.
        freedoms += count - 2.0;
    }
    (squares / freedoms.max(1.0)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use meshband_analysis::drawn;
    use meshband_analysis::generate::{self, Scenario};
    use rustfft::num_complex::Complex64 as C;

    /// A record without any effect, of a drawn machine.
    fn record() -> Record {
        let mut random = ChaCha8Rng::seed_from_u64(1003);
        let declared = drawn::machine(&mut random).unwrap();
        let mut scenario = Scenario::null(&declared.shafts, 7);
        scenario.duration_s = 1.0;
        drawn::layout(&declared, &mut scenario, &mut random);
        scenario.noise_colour = 0.9;
        generate::record(&declared.pair, &declared.shafts, &declared.curve, &scenario).unwrap()
    }

    #[test]
    fn bootstrap_plays_the_machine_and_the_noise_of_the_record_and_nothing_else() {
        let record = record();
        let base = Base::new(&record);
        let quiet = Quiet::new(&record, &base, &base.data());
        let null = quiet.record(3, 0);
        let of = Base::new(&null);
        let (residual, first) = (of.data().residual, base.data().residual);
        let sum = |bins: &[C]| noise_power(bins).iter().skip(8).sum::<f64>();
        let mut ratios = Vec::new();
        for (run, channels) in residual.iter().enumerate() {
            assert!((of.runs[run].angle.shaft_hz / base.runs[run].angle.shaft_hz - 1.0).abs() < 1e-5);
            ratios.extend([0, 1].map(|c| sum(&channels[c]) / sum(&first[run][c])));
        }
        let mean = ratios.iter().sum::<f64>() / ratios.len() as f64;
        assert!((mean - 1.0).abs() < 0.03, "noise {mean:.3} of the record's, {ratios:.3?}");
        let again = quiet.record(3, 0);
        assert_eq!(null.runs[0].channels, again.runs[0].channels);
        assert_ne!(null.runs[0].channels, quiet.record(3, 1).runs[0].channels);
    }
}
