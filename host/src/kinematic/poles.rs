//! Resonances that all lines of a run-up pass: poles shared by every line and channel.
//!
//! One after the other, the pole (frequency and damping on a grid, then refined) whose function of frequency, with a free residue in every line
//! that is swept near it, takes most off what the functions so far leave of all of them; until none pays for its residues (Bayesian information
//! criterion). Each is refined along both axes by steps that are halved down to a hundredth of its half-width, with those next to it; functions are meaned over stretches of turns as the courses are. The same idea as least-squares complex frequency domain fits, on amplitudes of lines instead of a frequency response. Only where the speed moves by
//! a tenth: a wander hardly sweeps anything, and a spline follows it. Limit: a response as the sweep passes is taken for the steady one.

use super::basis::{Basis, FittedLine, Pole, State};
use rayon::prelude::*;
use rustfft::num_complex::Complex64;

/// Most poles.
const MOST: usize = 20;
/// Steps of the frequency grid, and dampings.
const STEP: f64 = 1.02;
const DAMPINGS: [f64; 3] = [0.012, 0.025, 0.05];
/// Share beyond a line's swept range within which a pole still acts on it.
const NEAR: f64 = 0.15;
/// Gain in the criterion that a pole must bring.
const LEAST_GAIN: f64 = 20.0;
/// First steps of a refinement, of the logarithms of frequency and damping, and how often they are halved: to a hundredth of the half-width of a resonance damped by 1 %.
const FIRST_STEPS: [f64; 2] = [0.012, 0.35];
const HALVINGS: usize = 7;
/// Largest damping ratio of a pole: beyond it a spline says as much.
const MOST_DAMPED: f64 = 0.3;
/// Relative distance of poles that bend each other.
const NEIGHBOUR: f64 = 0.25;
/// Rounds over all poles at the end.
const ROUNDS: usize = 2;

/// The course of one line's amplitude in one channel: weighted sums over stretches of turns.
pub struct Course {
    /// Order of the pinion.
    pub order: f64,
    /// Weighted sums.
    pub sums: Vec<Complex64>,
}

/// What all courses share: turns, and stretches of them. Functions are meaned over the stretches as the courses are, since a sharp resonance is crossed within one.
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
            let of = |i: usize| s.iter().zip(w).map(|(s, w)| s[i] * w).sum::<f64>() / weight;
            ([of(0), of(1)], weight)
        };
        let (states, weights): (Vec<State>, Vec<f64>) =
            turns.chunks(block).zip(turn_weights.chunks(block)).map(mean).unzip();
        let range_hz = states.iter().fold((f64::INFINITY, 0.0_f64), |(l, h), s| (l.min(s[0]), h.max(s[0])));
        let (turns, turn_weights) = (turns.to_vec(), turn_weights.to_vec());
        Self { states, weights, range_hz, turns, turn_weights, block }
    }

    /// Poles that act on a line of this order.
    pub fn near(&self, poles: &[Pole], order: f64) -> Vec<Pole> {
        let (low, high) = ((1.0 - NEAR) * order * self.range_hz.0, (1.0 + NEAR) * order * self.range_hz.1);
        poles.iter().copied().filter(|pole| (low..high).contains(&pole[0])).collect()
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
    fn effective(&self) -> f64 {
        let total: f64 = self.weights.iter().sum();
        total * total / self.weights.iter().map(|w| w * w).sum::<f64>().max(f64::MIN_POSITIVE)
    }

    /// What a basis leaves of a course, weighted.
    fn left(&self, course: &Course, basis: &Basis) -> Vec<Complex64> {
        let rows = self.rows(course.order, basis);
        let fit = basis.solved(&rows, &self.weights, &course.sums);
        let value = |((row, w), sum): ((&[Complex64], &f64), &Complex64)| {
            sum - row.iter().zip(&fit).map(|(u, c)| u * c).sum::<Complex64>() * *w
        };
        rows.chunks(basis.len()).zip(&self.weights).zip(&course.sums).map(value).collect()
    }

    fn power(&self, left: &[Complex64]) -> f64 {
        left.iter().zip(&self.weights).map(|(l, w)| l.norm_sqr() / w.max(f64::MIN_POSITIVE)).sum()
    }

    /// Criterion of one course with these poles: the smaller, the better.
    fn criterion(&self, course: &Course, straight: &Basis, poles: &[Pole]) -> f64 {
        let basis = straight.with_poles(&self.near(poles, course.order));
        let count = self.effective();
        let power = self.power(&self.left(course, &basis));
        count * power.max(f64::MIN_POSITIVE).ln() + basis.len() as f64 * count.ln()
    }
}

/// The poles that the courses pay for, ascending.
pub fn found(sweep: &Sweep, courses: &[Course]) -> Vec<Pole> {
    let straight = Basis::of_speeds(&sweep.states, 2);
    let mut poles: Vec<Pole> = Vec::new();
    let total = |poles: &[Pole]| -> f64 { courses.par_iter().map(|c| sweep.criterion(c, &straight, poles)).sum() };
    let refined = |poles: &mut Vec<Pole>, index: usize| refine(sweep, courses, &straight, poles, index);
    let mut best = total(&poles);
    while poles.len() < MOST {
        let Some(pole) = proposed(sweep, courses, &straight, &poles) else { break };
        let before = poles.clone();
        poles.push(pole);
        refined(&mut poles, before.len());
        let own = poles[before.len()];
        for i in 0..before.len() {
            if (poles[i][0] / own[0]).ln().abs() < NEIGHBOUR {
                refined(&mut poles, i);
            }
        }
        let with = total(&poles);
        if with > best - LEAST_GAIN {
            poles = before;
            break;
        }
        best = with;
    }
    for _ in 0..ROUNDS {
        (0..poles.len()).for_each(|i| refined(&mut poles, i));
    }
    poles.sort_by(|a, b| a[0].total_cmp(&b[0]));
    poles
}

/// Moves one pole to where the criterion is least, by a search along both axes with steps that are halved; only lines that it acts on, or nearly, are looked at.
fn refine(sweep: &Sweep, courses: &[Course], straight: &Basis, poles: &mut [Pole], index: usize) {
    let first = poles[index];
    let around = [1.0 - NEAR, 1.0, 1.0 + NEAR].map(|factor| [first[0] * factor, first[1]]);
    let own: Vec<&Course> = courses.iter().filter(|c| !sweep.near(&around, c.order).is_empty()).collect();
    let total = |poles: &[Pole]| -> f64 { own.par_iter().map(|c| sweep.criterion(c, straight, poles)).sum() };
    let mut best = total(poles);
    let mut steps = FIRST_STEPS;
    for _ in 0..HALVINGS {
        for axis in [0, 1] {
            for step in [steps[axis], -steps[axis]] {
                let before = poles[index];
                poles[index][axis] *= step.exp();
                let moved = total(poles);
                let is_allowed = (poles[index][0] / first[0]).ln().abs() < NEAR && poles[index][1] < MOST_DAMPED;
                if moved < best && is_allowed {
                    best = moved;
                    break;
                }
                poles[index] = before;
            }
        }
        steps = steps.map(|step| 0.5 * step);
    }
}

/// The pole of the grid that takes most off what is left.
fn proposed(sweep: &Sweep, courses: &[Course], straight: &Basis, poles: &[Pole]) -> Option<Pole> {
    let rests: Vec<(f64, Vec<Complex64>, f64)> = courses
        .par_iter()
        .map(|course| {
            let left = sweep.left(course, &straight.with_poles(&sweep.near(poles, course.order)));
            let power = sweep.power(&left);
            (course.order, left, power)
        })
        .collect();
    let orders = || courses.iter().map(|c| c.order);
    let (low, high) = (orders().fold(f64::INFINITY, f64::min), orders().fold(0.0, f64::max));
    let (low, high) = (low * sweep.range_hz.0, high * sweep.range_hz.1);
    let steps = ((high / low).ln() / STEP.ln()).max(0.0) as usize;
    let count = sweep.effective();
    let gain = |pole: Pole| -> f64 {
        let near = rests.iter().filter(|(order, ..)| !sweep.near(&[pole], *order).is_empty());
        let of_line = |(order, left, power): &(f64, Vec<Complex64>, f64)| {
            let (mut product, mut size) = (Complex64::default(), 0.0);
            let resonances = sweep.rows(*order, &Basis::of_pole(pole));
            for ((u, w), l) in resonances.chunks(2).map(|row| row[1]).zip(&sweep.weights).zip(left) {
                product += u.conj() * l;
                size += w * u.norm_sqr();
            }
            let taken = (product.norm_sqr() / size.max(f64::MIN_POSITIVE)).min(0.999 * power);
            -count * (1.0 - taken / power.max(f64::MIN_POSITIVE)).ln() - count.ln()
        };
        near.map(of_line).sum()
    };
    let grid: Vec<Pole> = (0..=steps)
        .flat_map(|i| DAMPINGS.map(|damping| [low * STEP.powi(i as i32), damping]))
        .filter(|pole| poles.iter().all(|other| (pole[0] / other[0]).ln().abs() > 0.01))
        .collect();
    let best = grid.into_par_iter().map(|pole| (gain(pole), pole)).max_by(|a, b| a.0.total_cmp(&b.0))?;
    (best.0 > 0.0).then_some(best.1)
}

#[cfg(test)]
mod tests {
    use super::super::basis::resonance;
    use super::*;

    #[test]
    fn theory_sharp_poles_are_placed_though_stretches_of_turns_cross_them_and_one_is_not_seen() {
        let truth = [[467.0, 0.012], [557.0, 0.02]];
        let speeds = (0..346).map(|turn| 18.0 + 25.0 * (f64::from(turn) / 345.0).sqrt());
        let turns: Vec<State> = speeds.map(|hz| [hz, 0.0]).filter(|s| !(24.8..26.0).contains(&s[0])).collect();
        let sweep = Sweep::new(&turns, &vec![1.0; turns.len()], 4);
        let course = |order: f64| {
            let value = |state: &State| -> Complex64 {
                let own = |pole: Pole| resonance(pole, order * state[0]);
                Complex64::new(0.03, 0.01) + own(truth[0]) * Complex64::new(0.6, -0.8) + own(truth[1]) * 0.2
            };
            let turns: Vec<Complex64> = turns.iter().map(value).collect();
            Course { order, sums: turns.chunks(4).map(|part| part.iter().sum()).collect() }
        };
        let poles = found(&sweep, &[course(20.0), course(40.0)]);
        for own in truth {
            let best = poles.iter().map(|pole| (pole[0] / own[0] - 1.0).abs()).fold(f64::INFINITY, f64::min);
            assert!(best < 1e-3, "{own:?} among {poles:?}");
        }
        let sharpest = poles.iter().min_by(|a, b| (a[0] - 467.0).abs().total_cmp(&(b[0] - 467.0).abs()));
        assert!((sharpest.expect("a pole")[1] / 0.012 - 1.0).abs() < 0.1, "{poles:?}");
    }
}
