//! Mesh harmonics of every run, measured and predicted, and how well they agree under a lag.

use crate::model::harmonic_balance::Machine;
use crate::observation::angle::Angle;
use crate::observation::input::{Record, Run};
use crate::observation::spectrum::{Analyser, BAND_HZ};
use crate::spectral::noise_power;
use rayon::prelude::*;
use rustfft::num_complex::Complex64 as C;
use std::f64::consts::TAU;

/// Most harmonics compared.
const MOST_HARMONICS: usize = 60;

/// One harmonic of the mesh.
#[derive(Debug, Clone, Copy)]
pub struct Line {
    /// Frequency, Hz.
    pub hz: f64,
    /// Amplitudes measured, m/s2, by channel.
    pub measured: [C; 2],
    /// Amplitudes predicted.
    pub predicted: [C; 2],
    /// Power of the local noise at the line.
    pub noise: [f64; 2],
}

/// One run.
#[derive(Debug, Clone)]
pub struct Compared {
    /// Mesh frequency, Hz.
    pub mesh_hz: f64,
    /// Its harmonics.
    pub lines: Vec<Line>,
}

/// A lag of the vibration against the tach.
#[derive(Debug, Clone, Copy)]
pub enum Lag {
    /// None.
    None,
    /// The same time in every run, s.
    Time(f64),
    /// The same share of a tooth in every run.
    Teeth(f64),
}

impl Compared {
    /// All runs of a record.
    pub fn of(record: &Record) -> Vec<Self> {
        let machine = Machine::new(&record.pair, &record.shafts, &record.curve);
        record.runs.par_iter().map(|run| Self::new(record, &machine, run)).collect()
    }

    fn new(record: &Record, machine: &Machine, run: &Run) -> Self {
        let angle = Angle::fit(run, record.pulses_per_rev, record.jitter_s);
        let z = f64::from(record.pair.teeth[0]);
        let mesh_hz = z * angle.shaft_hz;
        let top = (BAND_HZ.min(0.4 * record.sample_rate_hz) / mesh_hz) as usize;
        let solution = machine.base(&machine.own_comb(angle.shaft_hz), run.input_torque_n_m);
        let centre = solution.lines.len() / 2;
        let count = top.min(MOST_HARMONICS).min(centre);
        let measured = harmonics(record, run, &angle, count);
        let analyser = Analyser::new(run.channels[0].len(), record.sample_rate_hz);
        let noise = [0, 1].map(|c| noise_power(&analyser.bins_of(&run.channels[c])));
        let lines = (1..=count)
            .map(|h| {
                let (up, down) = (&solution.lines[centre + h], &solution.lines[centre - h]);
                let hz = h as f64 * mesh_hz;
                let bin = (hz * analyser.duration_s()) as usize;
                Line {
                    hz,
                    measured: [0, 1].map(|c| measured[c][h - 1]),
                    predicted: [0, 1].map(|c| up.amplitude[c] + down.amplitude[c].conj()),
                    noise: [0, 1].map(|c| noise[c].get(bin).copied().unwrap_or(0.0)),
                }
            })
            .collect();
        Self { mesh_hz, lines }
    }

    /// The other order of the channels.
    pub fn swap(&mut self) {
        self.lines.iter_mut().for_each(|line| {
            line.measured.swap(0, 1);
            line.noise.swap(0, 1);
        });
    }

    /// The other sign of a channel.
    pub fn invert(&mut self, channel: usize) {
        self.lines.iter_mut().for_each(|line| line.measured[channel] = -line.measured[channel]);
    }

    /// These channels earlier by `lag_s`.
    pub fn earlier(&mut self, channels: &[usize], lag_s: f64) {
        for line in &mut self.lines {
            channels.iter().for_each(|&c| line.measured[c] *= C::cis(TAU * line.hz * lag_s));
        }
    }

    /// Powers measured and predicted of a channel.
    pub fn powers(&self, channel: usize) -> (f64, f64) {
        let sum = |of: &dyn Fn(&Line) -> C| self.lines.iter().map(|line| of(line).norm_sqr()).sum::<f64>();
        (sum(&|l| l.measured[channel]), sum(&|l| l.predicted[channel]))
    }

    /// Products of measured and predicted harmonics, over the predicted size.
    fn products(&self, channels: &[usize]) -> Vec<(f64, C)> {
        let size: Vec<f64> = (0..2).map(|c| (self.powers(c).0 * self.powers(c).1).sqrt().max(1e-300)).collect();
        self.lines
            .iter()
            .map(|line| {
                let product = channels.iter().map(|&c| line.measured[c] * line.predicted[c].conj() / size[c]);
                (line.hz, product.sum::<C>() / channels.len() as f64)
            })
            .collect()
    }
}

/// Amplitudes of the mesh harmonics over the run's whole turns, at the tach's angle.
fn harmonics(record: &Record, run: &Run, angle: &Angle, count: usize) -> [Vec<C>; 2] {
    let z = f64::from(record.pair.teeth[0]);
    let rate = record.sample_rate_hz;
    let samples = run.channels[0].len();
    let per_turn = rate / angle.shaft_hz;
    let turns = (samples as f64 / per_turn).floor().max(1.0);
    let used = ((turns * per_turn).round() as usize).min(samples);
    let mut sums = [vec![C::ZERO; count], vec![C::ZERO; count]];
    for n in 0..used {
        let turn = C::cis(-z * (angle.offset_rad + TAU * angle.shaft_hz * n as f64 / rate));
        let mut phasor = C::ONE;
        let [pinion, gear] = &mut sums;
        for (first, second) in pinion.iter_mut().zip(gear) {
            phasor *= turn;
            *first += run.channels[0][n] * phasor;
            *second += run.channels[1][n] * phasor;
        }
    }
    sums.map(|own| own.iter().map(|x| x * 2.0 / used as f64).collect())
}

/// Agreement of all runs together.
pub mod pooled {
    use super::{Compared, Lag};
    use rayon::prelude::*;
    use rustfft::num_complex::Complex64 as C;
    use std::f64::consts::TAU;

    /// Lags in time that are tried, either way, s.
    const WIDEST_S: f64 = 50e-3;
    /// Coarse step, s: a quarter of a period of the highest line at most.
    const STEP_S: f64 = 5e-6;
    /// Steps of a tooth.
    const TOOTH_STEPS: i32 = 400;
    /// Of lags that agree as well the smallest is taken.
    const AGREEMENT_MARGIN: f64 = 0.01;

    /// A lag with its agreement.
    #[derive(Debug, Clone, Copy)]
    pub struct Best {
        /// Cosine between measured and predicted harmonics.
        pub agreement: f64,
        /// Lag, s or teeth.
        pub value: f64,
    }

    /// Mean cosine over runs and `channels` under a lag.
    pub fn agreement(runs: &[Compared], channels: &[usize], lag: Lag) -> f64 {
        let products: Vec<_> = runs.iter().map(|run| (run.mesh_hz, run.products(channels))).collect();
        at(&products, lag)
    }

    fn at(products: &[(f64, Vec<(f64, C)>)], lag: Lag) -> f64 {
        let one = |(mesh_hz, lines): &(f64, Vec<(f64, C)>)| -> f64 {
            let seconds = match lag {
                Lag::None => 0.0,
                Lag::Time(s) => s,
                Lag::Teeth(t) => t / mesh_hz,
            };
            // Lines are harmonics of the mesh: one phasor and its powers.
            let turn = C::cis(TAU * mesh_hz * seconds);
            let mut phasor = C::ONE;
            lines
                .iter()
                .map(|(_, x)| {
                    phasor *= turn;
                    (x * phasor).re
                })
                .sum()
        };
        products.iter().map(one).sum::<f64>() / products.len().max(1) as f64
    }

    fn finest(score: &dyn Fn(f64) -> f64, near: f64, step: f64) -> Best {
        let mut best = Best { agreement: score(near), value: near };
        let mut step = step;
        for _ in 0..4 {
            for i in -5..=5 {
                let value = best.value + f64::from(i) * 0.2 * step;
                let agreement = score(value);
                if agreement > best.agreement {
                    best = Best { agreement, value };
                }
            }
            step *= 0.2;
        }
        best
    }

    /// The lag in time under which `channels` agree best.
    pub fn best_in_time(runs: &[Compared], channels: &[usize]) -> Best {
        let products: Vec<_> = runs.iter().map(|run| (run.mesh_hz, run.products(channels))).collect();
        let count = (WIDEST_S / STEP_S) as i32;
        let all: Vec<(f64, f64)> = (-count..=count)
            .into_par_iter()
            .map(|i| f64::from(i) * STEP_S)
            .map(|s| (at(&products, Lag::Time(s)), s))
            .collect();
        let top = all.iter().map(|a| a.0).fold(f64::NEG_INFINITY, f64::max);
        let near = all.iter().filter(|a| a.0 > top - AGREEMENT_MARGIN).min_by(|a, b| a.1.abs().total_cmp(&b.1.abs()));
        finest(&|s| at(&products, Lag::Time(s)), near.map_or(0.0, |a| a.1), STEP_S)
    }

    /// Best agreement of a channel under any lag and either sign.
    pub fn strongest(runs: &[Compared], channel: usize) -> f64 {
        let mut turned = runs.to_vec();
        turned.iter_mut().for_each(|run| run.invert(channel));
        best_in_time(runs, &[channel]).agreement.max(best_in_time(&turned, &[channel]).agreement)
    }

    /// The share of a tooth by which all runs turned agree best.
    pub fn best_in_angle(runs: &[Compared], channels: &[usize]) -> Best {
        let products: Vec<_> = runs.iter().map(|run| (run.mesh_hz, run.products(channels))).collect();
        let step = 1.0 / f64::from(TOOTH_STEPS);
        let near = (-TOOTH_STEPS / 2..TOOTH_STEPS / 2)
            .map(|i| f64::from(i) * step)
            .map(|t| (at(&products, Lag::Teeth(t)), t))
            .fold((f64::NEG_INFINITY, 0.0), |a, b| if b.0 > a.0 { b } else { a });
        finest(&|t| at(&products, Lag::Teeth(t)), near.1, step)
    }

    /// Each run's own best lag, s, and the mean agreement with them.
    pub fn best_of_each(runs: &[Compared]) -> (Vec<f64>, f64) {
        let each: Vec<(f64, f64)> = runs
            .iter()
            .map(|run| {
                let best = best_in_angle(std::slice::from_ref(run), &[0, 1]);
                (best.value / run.mesh_hz, best.agreement)
            })
            .collect();
        let mean = each.iter().map(|e| e.1).sum::<f64>() / each.len().max(1) as f64;
        (each.into_iter().map(|e| e.0).collect(), mean)
    }

    /// Level measured over predicted, of a channel over all runs.
    pub fn gain(runs: &[Compared], channel: usize) -> f64 {
        let (measured, predicted) =
            runs.iter().map(|run| run.powers(channel)).fold((0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
        (measured / predicted.max(1e-300)).sqrt()
    }
}
