//! All poles of a run-up at once: where every line and channel together is left with least.
//!
//! Close poles bend each other, so moving one after the other creeps. Here all frequencies and dampings step together
//! (Levenberg and Marquardt), with the residues and the spline of every course solved for at each step (variable
//! projection, Golub and Pereyra 1973, SIAM J. Numer. Anal. 10, in Kaufman's form): a course is told apart from the
//! others by its own residues alone. A course weighs by the inverse of what it is left with: minimised is the sum of
//! the logarithms of what the courses are left with, the likelihood where nobody knows their noise. Functions are
//! worked out once for the channels of a line. Limit: it finds the nearest minimum, so what it starts from must be
//! within a half-width or two.

use super::basis::Basis;
use super::speed_sweep::{Course, Sweep};
use super::swept_mode::Pole;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use rayon::prelude::*;
use rustfft::num_complex::Complex64;

/// Steps at most, and the gain in the criterion below which they end.
const STEPS: usize = 12;
const LEAST_GAIN: f64 = 0.5;
/// First share of the diagonal that holds a step back, its changes, and where it gives up.
const FIRST_RIDGE_SHARE: f64 = 1e-2;
const RIDGE_DECREASE: f64 = 0.2;
const RIDGE_INCREASE: f64 = 8.0;
const MAX_RIDGE_SHARE: f64 = 1e6;
/// Longest step: of the logarithm of the frequency in half-widths, and of the damping.
const MAX_POLE_STEP: [f64; 2] = [1.0, 0.5];
/// Step of a difference, of the logarithms: in half-widths, and of the damping.
const DIFFERENCE: [f64; 2] = [1e-3, 1e-3];
/// Damping ratios of a pole: sharper is no machine's mode, broader a spline says as well.
const DAMPINGS: [f64; 2] = [0.004, 0.3];
/// Ridge against the mean square of a function.
const RIDGE: f64 = 1e-9;

/// Courses of one line in all channels.
pub struct Line<'a> {
    /// Order of the pinion.
    pub order: f64,
    /// By channel.
    pub courses: Vec<&'a Course>,
}

/// Courses by line.
pub fn lines(courses: &[Course]) -> Vec<Line<'_>> {
    let mut lines: Vec<Line> = Vec::new();
    for course in courses {
        match lines.iter_mut().find(|line| line.order == course.order) {
            Some(line) => line.courses.push(course),
            None => lines.push(Line { order: course.order, courses: vec![course] }),
        }
    }
    lines
}

/// The functions of a line, weighted, and their normal equations.
struct Functions {
    columns: DMatrix<Complex64>,
    normal: Cholesky<Complex64, Dyn>,
    roots: Vec<f64>,
    near: Vec<usize>,
}

impl Functions {
    fn of(sweep: &Sweep, beside: &Basis, poles: &[Pole], order: f64) -> Option<Self> {
        let near: Vec<usize> = (0..poles.len()).filter(|&i| sweep.acts(poles[i], order)).collect();
        let basis = beside.with_poles(&near.iter().map(|&i| poles[i]).collect::<Vec<_>>());
        let roots: Vec<f64> = sweep.weights.iter().map(|w| w.max(0.0).sqrt()).collect();
        let rows = sweep.rows(order, &basis);
        let columns = DMatrix::from_fn(roots.len(), basis.len(), |i, j| rows[i * basis.len() + j] * roots[i]);
        let mut normal = columns.ad_mul(&columns);
        let ridge = RIDGE * normal.trace().re / basis.len() as f64;
        (0..basis.len()).for_each(|i| normal[(i, i)] += ridge);
        Some(Self { normal: normal.cholesky()?, columns, roots, near })
    }

    /// Coefficients of weighted values.
    fn solved(&self, values: &DVector<Complex64>) -> DVector<Complex64> {
        self.normal.solve(&self.columns.ad_mul(values))
    }

    /// What no coefficients explain.
    fn beyond(&self, values: &DVector<Complex64>) -> DVector<Complex64> {
        values - &self.columns * self.solved(values)
    }

    /// A course as this weighs it.
    fn weighted(&self, course: &Course) -> DVector<Complex64> {
        let value = |(sum, root): (&Complex64, &f64)| if *root > 0.0 { sum / *root } else { Complex64::ZERO };
        DVector::from_iterator(self.roots.len(), course.sums.iter().zip(&self.roots).map(value))
    }
}

/// The criterion of a line's courses: the smaller, the better.
fn criterion(sweep: &Sweep, functions: &Functions, line: &Line) -> f64 {
    let count = sweep.effective();
    let cost = functions.columns.ncols() as f64 * count.ln();
    let of = |course: &&Course| {
        let left = functions.beyond(&functions.weighted(course)).norm_squared();
        count * left.max(f64::MIN_POSITIVE).ln() + cost
    };
    line.courses.iter().map(of).sum()
}

/// The Bayesian information criterion of all courses with these poles.
pub fn total(sweep: &Sweep, lines: &[Line], beside: &Basis, poles: &[Pole]) -> f64 {
    let of = |line: &Line| {
        Functions::of(sweep, beside, poles, line.order).map_or(f64::INFINITY, |own| criterion(sweep, &own, line))
    };
    lines.par_iter().map(of).sum()
}

/// Moves all poles to where the criterion is least nearby; returns it.
pub fn fit(sweep: &Sweep, lines: &[Line], beside: &Basis, poles: &mut Vec<Pole>) -> f64 {
    let mut best = total(sweep, lines, beside, poles);
    let mut held_back = FIRST_RIDGE_SHARE;
    for _ in 0..STEPS {
        let (matrix, slope) = equations(sweep, lines, beside, poles);
        let mut gained = None;
        while gained.is_none() && held_back < MAX_RIDGE_SHARE {
            let moved = stepped(poles, &matrix, &slope, held_back);
            let with = moved.as_ref().map_or(f64::INFINITY, |moved| total(sweep, lines, beside, moved));
            match moved.filter(|_| with < best) {
                Some(moved) => {
                    gained = Some(best - with);
                    (*poles, best) = (moved, with);
                    held_back *= RIDGE_DECREASE;
                }
                None => held_back *= RIDGE_INCREASE,
            }
        }
        if gained.is_none_or(|gained| gained < LEAST_GAIN) {
            break;
        }
    }
    best
}

/// Poles after a step that is held back.
fn stepped(poles: &[Pole], matrix: &DMatrix<f64>, slope: &DVector<f64>, held_back: f64) -> Option<Vec<Pole>> {
    let mut matrix = matrix.clone();
    for i in 0..matrix.nrows() {
        matrix[(i, i)] += held_back * matrix[(i, i)] + f64::MIN_POSITIVE.sqrt();
    }
    let step = matrix.cholesky()?.solve(slope);
    let moved = |(i, [hz, damping]): (usize, &Pole)| {
        let longest = MAX_POLE_STEP[0] * damping;
        let frequency = hz * step[2 * i].clamp(-longest, longest).exp();
        let damping = damping * step[2 * i + 1].clamp(-MAX_POLE_STEP[1], MAX_POLE_STEP[1]).exp();
        [frequency, damping.clamp(DAMPINGS[0], DAMPINGS[1])]
    };
    Some(poles.iter().enumerate().map(moved).collect())
}

/// Normal equations of the logarithms of frequency and damping of every pole in turn.
fn equations(sweep: &Sweep, lines: &[Line], beside: &Basis, poles: &[Pole]) -> (DMatrix<f64>, DVector<f64>) {
    let size = 2 * poles.len();
    let none = || (DMatrix::<f64>::zeros(size, size), DVector::<f64>::zeros(size));
    let of_line = |line: &Line| {
        let (mut matrix, mut slope) = none();
        let Some(own) = Functions::of(sweep, beside, poles, line.order) else { return (matrix, slope) };
        let first = own.columns.ncols() - own.near.len();
        let changes: Vec<DVector<Complex64>> =
            own.near.iter().flat_map(|&i| changes(sweep, poles[i], line.order, &own.roots)).collect();
        let beyond: Vec<DVector<Complex64>> = changes.iter().map(|change| own.beyond(change)).collect();
        for course in &line.courses {
            let values = own.weighted(course);
            let fit = own.solved(&values);
            let left = &values - &own.columns * &fit;
            let weight = sweep.effective() / left.norm_squared().max(f64::MIN_POSITIVE);
            let place = |k: usize| 2 * own.near[k / 2] + k % 2;
            for (j, a) in beyond.iter().enumerate() {
                let of_a = fit[first + j / 2];
                slope[place(j)] += weight * (a.dotc(&left) * of_a.conj()).re;
                for (k, b) in beyond.iter().enumerate().take(j + 1) {
                    let product = weight * (a.dotc(b) * of_a.conj() * fit[first + k / 2]).re;
                    matrix[(place(j), place(k))] += product;
                    if k != j {
                        matrix[(place(k), place(j))] += product;
                    }
                }
            }
        }
        (matrix, slope)
    };
    let add = |(a, b): (DMatrix<f64>, DVector<f64>), (c, d): (DMatrix<f64>, DVector<f64>)| (a + c, b + d);
    lines.par_iter().map(of_line).reduce(none, add)
}

/// How a pole's function changes with the logarithms of its frequency and of its damping.
fn changes(sweep: &Sweep, [hz, damping]: Pole, order: f64, roots: &[f64]) -> [DVector<Complex64>; 2] {
    let function = |pole: Pole| -> Vec<Complex64> {
        sweep.rows(order, &Basis::of_pole(pole)).chunks(2).map(|row| row[1]).collect()
    };
    [[DIFFERENCE[0] * damping, 0.0], [0.0, DIFFERENCE[1]]].map(|[of_hz, of_damping]: [f64; 2]| {
        let at = |sign: f64| function([hz * (sign * of_hz).exp(), damping * (sign * of_damping).exp()]);
        let (before, after, step) = (at(-1.0), at(1.0), 2.0 * (of_hz + of_damping));
        DVector::from_fn(roots.len(), |i, _| (after[i] - before[i]) * (roots[i] / step))
    })
}
