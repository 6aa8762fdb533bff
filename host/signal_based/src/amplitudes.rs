//! Least squares of lines of known order on the fitted turns of one run and channel.
//!
//! Each line's amplitude is complex (the path is unknown) and moves with the speed as its own [`Basis`] says, which
//! [`Choice`] chooses. Weights are a Blackman-Harris window per stretch, so lines more than four bins apart do not
//! touch and are fitted one after the other; a second round takes off what the first left between neighbours. Where
//! the speed runs up all turns weigh alike: resonances are crossed in a few, those next to a gap bound what is fitted
//! across it, and whole orders do not touch over whole turns. Phases count from the first turn of the grid, the same
//! for all stretches: what is fitted predicts the waveform between them. Cost: two passes over the samples per line
//! and round.

use super::basis::{Basis, FittedLine, State};
use super::basis_selection::Choice;
use super::scene::SceneRun;
use super::split::Stretch;
use crate::analysis::lines::WINDOW;
use rustfft::num_complex::Complex64;
use std::f64::consts::TAU;
use std::sync::Arc;

/// Rounds over all lines.
const ROUNDS: usize = 2;

/// Phases turned side by side: one chain of multiplications would wait for itself.
const LANES: usize = 4;

/// A run's fitted turns with their weights, made once per run.
pub struct Weighted<'a> {
    run: &'a SceneRun,
    per_turn: usize,
    stretches: Vec<(Stretch, Vec<f64>)>,
    states: Vec<State>,
    weight_of_turn: Vec<f64>,
}

impl<'a> Weighted<'a> {
    /// The fitted turns of `run`; all alike where the speed runs up, since what stands at the ends of a stretch then
    /// says most of what lies between two.
    pub fn new(run: &'a SceneRun) -> Self {
        if run.runs_up() {
            return Self::by(run, &run.split.fit, |samples| vec![1.0; samples]);
        }
        Self::of_stretches(run, &run.split.fit)
    }

    /// Other turns of `run`, windowed.
    pub fn of_stretches(run: &'a SceneRun, stretches: &[Stretch]) -> Self {
        Self::by(run, stretches, |samples| WINDOW.weights(samples))
    }

    fn by(run: &'a SceneRun, stretches: &[Stretch], weights: impl Fn(usize) -> Vec<f64>) -> Self {
        let per_turn = run.angle.per_turn[0];
        let stretches: Vec<(Stretch, Vec<f64>)> = stretches.iter().map(|s| (*s, weights(s.turns * per_turn))).collect();
        let turns =
            || stretches.iter().flat_map(|(s, weights)| (s.from..s.from + s.turns).zip(weights.chunks(per_turn)));
        let states = turns().map(|(turn, _)| run.states[turn]).collect();
        let weight_of_turn = turns().map(|(_, w)| w.iter().sum()).collect();
        Self { run, per_turn, states, weight_of_turn, stretches }
    }

    /// How the pinion turns in each turn.
    pub fn states(&self) -> &[State] {
        &self.states
    }

    /// Twice the weighted Fourier sums of a line, turn by turn.
    pub fn sums(&self, samples: &[f64], order: f64) -> Vec<Complex64> {
        let step = Complex64::from_polar(1.0, -TAU * order / self.per_turn as f64);
        let mut sums = Vec::with_capacity(self.states.len());
        for (stretch, weights) in &self.stretches {
            let part = samples[stretch.samples(self.per_turn)].chunks(self.per_turn);
            for (i, (values, weights)) in part.zip(weights.chunks(self.per_turn)).enumerate() {
                let mut turn = Complex64::from_polar(2.0, -TAU * (order * (stretch.from + i) as f64).fract());
                let mut lanes = [Complex64::default(); LANES];
                let mut turning: [Complex64; LANES] = std::array::from_fn(|lane| turn * step.powu(lane as u32));
                let (ahead, whole) = (step.powu(LANES as u32), values.len() / LANES * LANES);
                for (x, w) in values[..whole].chunks_exact(LANES).zip(weights[..whole].chunks_exact(LANES)) {
                    for lane in 0..LANES {
                        lanes[lane] += turning[lane] * (x[lane] * w[lane]);
                        turning[lane] *= ahead;
                    }
                }
                let mut sum: Complex64 = lanes.iter().sum();
                turn = turning[0];
                for (x, w) in values[whole..].iter().zip(&weights[whole..]) {
                    sum += turn * (x * w);
                    turn *= step;
                }
                sums.push(sum);
            }
        }
        sums
    }

    /// Sum of the squared weights.
    pub fn sum_of_squares(&self) -> f64 {
        self.stretches.iter().flat_map(|(_, weights)| weights).map(|w| w * w).sum()
    }

    /// Sum of the weights of each turn.
    pub fn weight_of_turn(&self) -> &[f64] {
        &self.weight_of_turn
    }

    /// Fits lines and takes them off `samples` on the whole grid; returns their amplitudes. Constant ones without a
    /// choice. `carriers` are lines of the same channel whose course may carry them.
    pub fn fit(
        &self,
        samples: &mut [f64],
        orders: &[f64],
        choice: Option<&Choice>,
        carriers: &[Arc<FittedLine>],
    ) -> Vec<FittedLine> {
        let mut lines: Vec<FittedLine> = Vec::new();
        for round in 0..ROUNDS {
            for (i, &order) in orders.iter().enumerate() {
                let sums = self.sums(samples, order);
                if round == 0 {
                    let basis = choice.map_or_else(Basis::constant, |choice| choice.of(order, &sums, carriers));
                    let coefficients = vec![Complex64::default(); basis.len()];
                    lines.push(FittedLine { order, basis, coefficients });
                }
                let line = &mut lines[i];
                let change = line.basis.fit(order, &self.states, &self.weight_of_turn, &sums);
                line.coefficients.iter_mut().zip(&change).for_each(|(c, change)| *c += change);
                let change = FittedLine { order, basis: line.basis.clone(), coefficients: change };
                subtract(samples, self.run, &change);
            }
        }
        lines
    }
}

/// Takes a line off the whole grid.
pub fn subtract(samples: &mut [f64], run: &SceneRun, line: &FittedLine) {
    let per_turn = run.angle.per_turn[0];
    let step = Complex64::from_polar(1.0, TAU * line.order / per_turn as f64);
    let ahead = step.powu(LANES as u32);
    let states = &run.states;
    // A place in turns; a turn's state is that of its middle.
    let at = |place: f64| {
        let place = (place - 0.5).clamp(0.0, (states.len() - 1) as f64);
        let turn = place as usize;
        line.at(states[turn].towards(states[(turn + 1).min(states.len() - 1)], place.fract()))
    };
    let mut begin = at(0.0);
    for (turn, values) in samples.chunks_mut(per_turn).enumerate() {
        let points = line.basis.points(line.order, states[turn]);
        // Between points the amplitude goes straight on, or its steps would be lines of the pinion's shaft.
        for point in 0..points {
            let [from, to] = [point, point + 1].map(|i| (i * per_turn / points).min(values.len()));
            let end = at(turn as f64 + to as f64 / per_turn as f64);
            let change = (end - begin) / (to - from).max(1) as f64;
            let first = Complex64::from_polar(1.0, TAU * (line.order * turn as f64).fract()) * step.powu(from as u32);
            let mut rotating: [Complex64; LANES] = std::array::from_fn(|lane| first * step.powu(lane as u32));
            for (chunk, values) in values[from..to].chunks_mut(LANES).enumerate() {
                let amplitude = begin + change * (chunk * LANES) as f64;
                for (lane, x) in values.iter_mut().enumerate() {
                    *x -= ((amplitude + change * lane as f64) * rotating[lane]).re;
                    rotating[lane] *= ahead;
                }
            }
            begin = end;
        }
    }
}
