//! The turns of a run over which lines are swept, and the courses of their amplitudes.
//!
//! Amplitudes are sums over stretches of turns (whole turns of the slower shaft, in which its sidebands vanish). A
//! sharp resonance is crossed within one, so functions of the speed are meaned over the stretches as the courses are.

use super::basis::{Basis, FittedLine, State};
use super::swept_mode::Pole;
use rustfft::num_complex::Complex64;

/// Share beyond a line's swept range within which a pole still acts on it.
const POLE_REACH_SHARE: f64 = 0.15;
/// The course of one line's amplitude in one channel: weighted sums over stretches of turns.
pub struct Course {
    /// Order of the pinion.
    pub order: f64,
    /// Weighted sums.
    pub sums: Vec<Complex64>,
}

/// What all courses share: turns, and stretches of them. Functions are meaned over the stretches as the courses are,
/// since a sharp resonance is crossed within one.
pub struct Sweep {
    /// Mean state of each stretch.
    pub states: Vec<State>,
    /// Weights of the stretches.
    pub weights: Vec<f64>,
    /// Slowest and fastest.
    pub range_hz: (f64, f64),
    turns: Vec<State>,
    turn_weights: Vec<f64>,
    block: usize,
}

impl Sweep {
    /// Of turns with weights, `block` of them to a stretch.
    pub fn new(turns: &[State], turn_weights: &[f64], block: usize) -> Self {
        let mean = |(s, w): (&[State], &[f64])| {
            let weight: f64 = w.iter().sum::<f64>().max(f64::MIN_POSITIVE);
            let of = |value: fn(&State) -> f64| s.iter().zip(w).map(|(s, w)| value(s) * w).sum::<f64>() / weight;
            let state =
                State { speed_hz: of(|s| s.speed_hz), sweep_hz_s: of(|s| s.sweep_hz_s), swing: of(|s| s.swing) };
            (state, weight)
        };
        let (states, weights): (Vec<State>, Vec<f64>) =
            turns.chunks(block).zip(turn_weights.chunks(block)).map(mean).unzip();
        let range_hz = states.iter().fold((f64::INFINITY, 0.0_f64), |(l, h), s| (l.min(s.speed_hz), h.max(s.speed_hz)));
        let (turns, turn_weights) = (turns.to_vec(), turn_weights.to_vec());
        Self { states, weights, range_hz, turns, turn_weights, block }
    }

    /// Whether a pole acts on a line of this order.
    pub fn acts(&self, pole: Pole, order: f64) -> bool {
        ((1.0 - POLE_REACH_SHARE) * order * self.range_hz.0..(1.0 + POLE_REACH_SHARE) * order * self.range_hz.1)
            .contains(&pole[0])
    }

    /// Poles that act on a line of this order.
    pub fn near(&self, poles: &[Pole], order: f64) -> Vec<Pole> {
        poles.iter().copied().filter(|pole| self.acts(*pole, order)).collect()
    }

    /// Functions of a basis for a line of this order, meaned over the stretches, one row each.
    pub fn rows(&self, order: f64, basis: &Basis) -> Vec<Complex64> {
        let n = basis.len();
        let of_turns = basis.rows(order, &self.turns);
        let mut rows = Vec::with_capacity(n * self.states.len());
        let stretches = of_turns.chunks(n * self.block).zip(self.turn_weights.chunks(self.block));
        for ((turns, weights), total) in stretches.zip(&self.weights) {
            rows.extend(
                (0..n).map(|i| turns.chunks(n).zip(weights).map(|(row, w)| row[i] * *w).sum::<Complex64>() / *total),
            );
        }
        rows
    }

    /// A line's course from its sums turn by turn.
    pub fn course(&self, order: f64, sums: &[Complex64]) -> Course {
        Course { order, sums: sums.chunks(self.block).map(|part| part.iter().sum()).collect() }
    }

    /// Mean square of a line's amplitude.
    pub fn mean_square(&self, line: &FittedLine) -> f64 {
        let total: f64 = self.weights.iter().sum();
        let squares = self.states.iter().zip(&self.weights).map(|(state, w)| line.at(*state).norm_sqr() * w);
        squares.sum::<f64>() / total.max(f64::MIN_POSITIVE)
    }

    /// Independent values among the stretches.
    pub fn effective(&self) -> f64 {
        let total: f64 = self.weights.iter().sum();
        total * total / self.weights.iter().map(|w| w * w).sum::<f64>().max(f64::MIN_POSITIVE)
    }

    /// What a basis leaves of a course, weighted.
    pub fn left(&self, course: &Course, basis: &Basis) -> Vec<Complex64> {
        let rows = self.rows(course.order, basis);
        let fit = basis.solved(&rows, &self.weights, &course.sums);
        let value = |((row, w), sum): ((&[Complex64], &f64), &Complex64)| {
            sum - row.iter().zip(&fit).map(|(u, c)| u * c).sum::<Complex64>() * *w
        };
        rows.chunks(basis.len()).zip(&self.weights).zip(&course.sums).map(value).collect()
    }

    /// Weighted power of what is left.
    pub fn power(&self, left: &[Complex64]) -> f64 {
        left.iter().zip(&self.weights).map(|(l, w)| l.norm_sqr() / w.max(f64::MIN_POSITIVE)).sum()
    }
}
