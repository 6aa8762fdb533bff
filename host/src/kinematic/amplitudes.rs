//! Least squares of lines of known order on the fitted turns of one run and channel.
//!
//! Each line's amplitude is complex (the path is unknown) and moves with the speed as its [`Basis`] says. Weights are a Blackman-Harris window per
//! stretch, so lines more than four bins apart do not touch and are fitted one after the other; a second round takes off what the first
//! left between neighbours. Phases count from the first turn of the grid, the same for all stretches: what is fitted predicts the waveform
//! between them. Cost: two passes over the samples per line and round.

use super::basis::Basis;
use super::scene::SceneRun;
use super::split::Stretch;
use crate::analysis::lines::WINDOW;
use rustfft::num_complex::Complex64;
use std::f64::consts::TAU;

/// Rounds over all lines.
const ROUNDS: usize = 2;

/// A line with its fitted amplitude (peak, record's unit).
#[derive(Debug, Clone)]
pub struct FittedLine {
    /// Order of the pinion.
    pub order: f64,
    /// Coefficients of the basis.
    pub coefficients: Vec<Complex64>,
}

/// A run's fitted turns with their weights, made once per run.
pub struct Weighted<'a> {
    run: &'a SceneRun,
    per_turn: usize,
    stretches: Vec<(Stretch, Vec<f64>)>,
    speeds_hz: Vec<f64>,
    weight_of_turn: Vec<f64>,
}

impl<'a> Weighted<'a> {
    /// The fitted turns of `run`.
    pub fn new(run: &'a SceneRun) -> Self {
        Self::of_stretches(run, &run.split.fit)
    }

    /// Other turns of `run`.
    pub fn of_stretches(run: &'a SceneRun, stretches: &[Stretch]) -> Self {
        let per_turn = run.angle.per_turn[0];
        let stretches: Vec<(Stretch, Vec<f64>)> =
            stretches.iter().map(|s| (*s, WINDOW.weights(s.turns * per_turn))).collect();
        let turns =
            || stretches.iter().flat_map(|(s, weights)| (s.from..s.from + s.turns).zip(weights.chunks(per_turn)));
        let speeds_hz = turns().map(|(turn, _)| run.speeds_hz[turn]).collect();
        let weight_of_turn = turns().map(|(_, w)| w.iter().sum()).collect();
        Self { run, per_turn, speeds_hz, weight_of_turn, stretches }
    }

    /// Speeds of the turns, Hz.
    pub fn speeds_hz(&self) -> &[f64] {
        &self.speeds_hz
    }

    /// Twice the weighted Fourier sums of a line, turn by turn.
    pub fn sums(&self, samples: &[f64], order: f64) -> Vec<Complex64> {
        let step = Complex64::from_polar(1.0, -TAU * order / self.per_turn as f64);
        let mut sums = Vec::with_capacity(self.speeds_hz.len());
        for (stretch, weights) in &self.stretches {
            let part = samples[stretch.samples(self.per_turn)].chunks(self.per_turn);
            for (i, (values, weights)) in part.zip(weights.chunks(self.per_turn)).enumerate() {
                let mut turn = Complex64::from_polar(2.0, -TAU * (order * (stretch.from + i) as f64).fract());
                let mut sum = Complex64::default();
                for (x, w) in values.iter().zip(weights) {
                    sum += turn * (x * w);
                    turn *= step;
                }
                sums.push(sum);
            }
        }
        sums
    }

    /// Sum of the weights of each turn.
    pub fn weight_of_turn(&self) -> &[f64] {
        &self.weight_of_turn
    }

    /// Fits lines and takes them off `samples` on the whole grid; returns their amplitudes.
    pub fn fit(&self, samples: &mut [f64], orders: &[f64], basis: &Basis) -> Vec<FittedLine> {
        let empty = vec![Complex64::default(); basis.len()];
        let mut lines: Vec<FittedLine> =
            orders.iter().map(|&order| FittedLine { order, coefficients: empty.clone() }).collect();
        for _ in 0..ROUNDS {
            for line in &mut lines {
                let sums = self.sums(samples, line.order);
                let coefficients = basis.fit(&self.speeds_hz, &self.weight_of_turn, &sums);
                line.coefficients.iter_mut().zip(&coefficients).for_each(|(c, change)| *c += change);
                subtract(samples, self.run, &FittedLine { order: line.order, coefficients }, basis);
            }
        }
        lines
    }
}

/// Takes a line off the whole grid.
pub fn subtract(samples: &mut [f64], run: &SceneRun, line: &FittedLine, basis: &Basis) {
    let per_turn = run.angle.per_turn[0];
    let step = Complex64::from_polar(1.0, TAU * line.order / per_turn as f64);
    let speeds = &run.speeds_hz;
    // At the border of two turns; within a turn the amplitude goes straight on, or its steps would be lines of the pinion's shaft.
    let at_border = |turn: usize| {
        let (before, after) = (turn.saturating_sub(1), turn.min(speeds.len() - 1));
        basis.value(&line.coefficients, 0.5 * (speeds[before] + speeds[after]))
    };
    for (turn, values) in samples.chunks_mut(per_turn).enumerate() {
        let mut amplitude = at_border(turn);
        let change = (at_border(turn + 1) - amplitude) / per_turn as f64;
        let mut rotating = Complex64::from_polar(1.0, TAU * (line.order * turn as f64).fract());
        for x in values {
            *x -= (amplitude * rotating).re;
            rotating *= step;
            amplitude += change;
        }
    }
}
