//! Which functions of the speed a line's amplitude moves with: those that predict stretches of the fitted turns left
//! out.
//!
//! Chosen line by line and channel by channel: a strong line through resonances pays for many functions, a weak one
//! for a constant. The turns are cut into stretches as long as those held out; each inner one is predicted from the
//! others. The next richer basis must predict better by the share that its unknowns would gain by chance. Means are
//! over whole turns of the slower shaft, over which its sidebands cancel.

use super::basis::{Basis, FittedLine, State};
use super::speed_sweep::{Course, Sweep};
use super::swept_mode::Pole;
use rustfft::num_complex::Complex64;
use std::borrow::Borrow;
use std::sync::Arc;

/// Numbers of a spline's nodes tried.
const FUNCTIONS: [usize; 9] = [1, 2, 3, 4, 6, 9, 13, 19, 28];
/// Stretches per function at least.
const PER_FUNCTION: usize = 3;
/// Nodes beside resonances.
const RESONANCE_NODES: [usize; 5] = [1, 2, 4, 7, 12];
/// Richer bases in turn that gain nothing, after which no richer one is tried.
const MAX_FRUITLESS_BASES: usize = 3;
/// Stretches' worth of error that a richer basis must gain beyond its unknowns: many are tried, and what one of them
/// gains by chance costs a weak line its prediction.
const MIN_GAIN_STRETCHES: f64 = 6.0;
/// Most that a line carrying another may stand from it, share of the swept range, both logarithmic: the rest of its
/// course is not its own.
const MAX_LINE_DISTANCE_SHARE: f64 = 0.5;
/// Folds.
const FOLDS: (usize, usize) = (6, 16);

/// Bases that a run's lines may have.
pub struct Choice {
    /// States and weights of the stretches.
    pub sweep: Sweep,
    splines: Vec<Basis>,
    poles: Vec<Pole>,
    folds: usize,
}

impl Choice {
    /// From the fitted turns' states and weights; a stretch is `block` turns, `held_turns` is the longest stretch
    /// held out.
    pub fn new(states: &[State], weights: &[f64], block: usize, held_turns: usize) -> Self {
        let block = block.max(1);
        let sweep = Sweep::new(states, weights, block);
        let states = &sweep.states;
        let fits = |n: &&usize| **n == 1 || **n * PER_FUNCTION <= states.len();
        let splines: Vec<Basis> = FUNCTIONS.iter().filter(fits).map(|n| Basis::of_speeds(states, *n)).collect();
        let splines = splines.iter().flat_map(|basis| [basis.clone(), basis.with_swings()]).collect();
        let folds = (states.len() * block / held_turns.max(1)).clamp(FOLDS.0, FOLDS.1);
        Self { sweep, splines, poles: Vec::new(), folds }
    }

    /// With resonances.
    pub fn with_poles(self, poles: Vec<Pole>) -> Self {
        Self { poles, ..self }
    }

    /// The basis of a line from its sums turn by turn. Of the `carriers` the one whose frequencies it shares most may
    /// carry it.
    pub fn of(&self, order: f64, sums: &[Complex64], carriers: &[Arc<FittedLine>]) -> Basis {
        let course = self.sweep.course(order, sums);
        let near = self.sweep.near(&self.poles, order);
        let mut bases = self.splines.clone();
        if !near.is_empty() {
            bases.extend(RESONANCE_NODES.iter().map(|n| Basis::of_speeds(&self.sweep.states, *n).with_poles(&near)));
        }
        let count = course.sums.len() as f64;
        bases.extend(self.carried(order, carriers));
        let (mut best, mut in_vain): (Option<(f64, Basis)>, usize) = (None, 0);
        // What a path is known to do comes first.
        bases.sort_by_key(|basis| (basis.len(), !basis.is_carried()));
        for basis in bases.into_iter().filter(|b| b.len() * 2 <= course.sums.len() || b.len() == 1) {
            let error = self.predicted(&course, &basis);
            let gained = best.as_ref().is_none_or(|(least, other)| {
                let more = basis.len().saturating_sub(other.len()) as f64;
                error < least * (1.0 - (more + MIN_GAIN_STRETCHES) / count)
            });
            if gained {
                (best, in_vain) = (Some((error, basis)), 0);
                continue;
            }
            in_vain += 1;
            if in_vain > MAX_FRUITLESS_BASES && near.is_empty() {
                break;
            }
        }
        best.map_or_else(Basis::constant, |(_, basis)| basis)
    }

    /// Bases that the course of another line carries.
    fn carried(&self, order: f64, carriers: &[Arc<FittedLine>]) -> Vec<Basis> {
        let swept = (self.sweep.range_hz.1 / self.sweep.range_hz.0).ln();
        let Some(line) = carrier(carriers, order, swept) else { return Vec::new() };
        let mean_square = self.sweep.mean_square(line);
        let of = |n: &usize| Basis::of_speeds(&self.sweep.states, *n).carried_by(line, mean_square);
        RESONANCE_NODES.iter().map(of).collect()
    }

    /// What the inner folds leave, each predicted from the others.
    fn predicted(&self, course: &Course, basis: &Basis) -> f64 {
        let (weights, count) = (&self.sweep.weights, course.sums.len());
        let rows = self.sweep.rows(course.order, basis);
        let fold = |i: usize| i * self.folds / count;
        (1..self.folds.saturating_sub(1))
            .map(|left_out| {
                let weight = |i: usize| if fold(i) == left_out { 0.0 } else { weights[i] };
                let kept: Vec<f64> = (0..count).map(weight).collect();
                let zero = Complex64::default();
                let sums: Vec<Complex64> =
                    (0..count).map(|i| if fold(i) == left_out { zero } else { course.sums[i] }).collect();
                let fit = basis.solved(&rows, &kept, &sums);
                let error = |i: usize| {
                    let row = &rows[i * basis.len()..(i + 1) * basis.len()];
                    let value: Complex64 = row.iter().zip(&fit).map(|(u, c)| u * c).sum();
                    (course.sums[i] - value * weights[i]).norm_sqr() / weights[i].max(f64::MIN_POSITIVE)
                };
                (0..count).filter(|i| fold(*i) == left_out).map(error).sum::<f64>()
            })
            .sum()
    }
}

/// Of some lines the one whose frequencies another line of this order shares most, where that is half of what is
/// `swept` (logarithm of the fastest over the slowest speed) at least.
pub fn carrier<Line: Borrow<FittedLine>>(lines: &[Line], order: f64, swept: f64) -> Option<&Line> {
    let apart = |line: &Line| (line.borrow().order / order).ln().abs();
    let nearest = lines.iter().min_by(|a, b| apart(a).total_cmp(&apart(b)));
    nearest.filter(|line| apart(line) < MAX_LINE_DISTANCE_SHARE * swept)
}
