//! Resonances that all lines of a run-up pass: poles shared by every line and channel.
//!
//! One after the other, the pole (frequency and damping on a grid, then refined) whose function of frequency, with a free residue in every line
//! that is swept near it, takes most off what the functions so far leave of all of them; until none pays for its residues (Bayesian information
//! criterion). The same idea as least-squares complex frequency domain fits, on amplitudes of lines instead of a frequency response. Only where the speed moves by
//! a tenth: a wander hardly sweeps anything, and a spline follows it. Limit: a response as the sweep passes is taken for the steady one.

use super::basis::{Basis, Pole, State, resonance};
use rayon::prelude::*;
use rustfft::num_complex::Complex64;

/// Most poles.
const MOST: usize = 14;
/// Steps of the frequency grid, and dampings.
const STEP: f64 = 1.02;
const DAMPINGS: [f64; 3] = [0.012, 0.025, 0.05];
/// Share beyond a line's swept range within which a pole still acts on it.
const NEAR: f64 = 0.15;
/// Gain in the criterion that a pole must bring.
const LEAST_GAIN: f64 = 20.0;
/// Refinements: factors of frequency and damping.
const FINE: [(f64, f64); 8] =
    [(0.985, 1.0), (1.015, 1.0), (0.994, 1.0), (1.006, 1.0), (1.0, 0.7), (1.0, 1.4), (1.0, 0.87), (1.0, 1.15)];

/// The course of one line's amplitude in one channel: weighted means over stretches of turns.
pub struct Course {
    /// Order of the pinion.
    pub order: f64,
    /// Weighted sums.
    pub sums: Vec<Complex64>,
}

/// What all courses share.
pub struct Sweep {
    /// How the shaft turns in the stretches.
    pub states: Vec<State>,
    /// Their weights.
    pub weights: Vec<f64>,
    /// Slowest and fastest.
    pub range_hz: (f64, f64),
}

impl Sweep {
    /// Of stretches.
    pub fn new(states: Vec<State>, weights: Vec<f64>) -> Self {
        let range_hz = states.iter().fold((f64::INFINITY, 0.0_f64), |(l, h), s| (l.min(s[0]), h.max(s[0])));
        Self { states, weights, range_hz }
    }

    /// Poles that act on a line of this order.
    pub fn near(&self, poles: &[Pole], order: f64) -> Vec<Pole> {
        let (low, high) = ((1.0 - NEAR) * order * self.range_hz.0, (1.0 + NEAR) * order * self.range_hz.1);
        poles.iter().copied().filter(|pole| (low..high).contains(&pole[0])).collect()
    }

    /// Independent values among the stretches.
    fn effective(&self) -> f64 {
        let total: f64 = self.weights.iter().sum();
        total * total / self.weights.iter().map(|w| w * w).sum::<f64>().max(f64::MIN_POSITIVE)
    }

    /// What a basis leaves of a course, weighted.
    fn left(&self, course: &Course, basis: &Basis) -> Vec<Complex64> {
        let fit = basis.fit(course.order, &self.states, &self.weights, &course.sums);
        let value = |((s, w), sum): ((&State, &f64), &Complex64)| sum - basis.value(course.order, &fit, *s) * *w;
        self.states.iter().zip(&self.weights).zip(&course.sums).map(value).collect()
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
    let mut best = total(&poles);
    while poles.len() < MOST {
        let Some(pole) = proposed(sweep, courses, &straight, &poles) else { break };
        poles.push(pole);
        let last = poles.len() - 1;
        let refined = refine(&mut poles, last, &total);
        if refined > best - LEAST_GAIN {
            poles.pop();
            break;
        }
        best = refined;
    }
    for i in 0..poles.len() {
        refine(&mut poles, i, &total);
    }
    poles.sort_by(|a, b| a[0].total_cmp(&b[0]));
    poles
}

/// Moves one pole to where the criterion is least; returns it.
fn refine(poles: &mut [Pole], index: usize, total: &impl Fn(&[Pole]) -> f64) -> f64 {
    let mut best = total(poles);
    for (frequency, damping) in FINE {
        let before = poles[index];
        poles[index] = [before[0] * frequency, before[1] * damping];
        let moved = total(poles);
        if moved < best {
            best = moved;
        } else {
            poles[index] = before;
        }
    }
    best
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
            for ((s, w), l) in sweep.states.iter().zip(&sweep.weights).zip(left) {
                let u = resonance(pole, order * s[0]);
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
