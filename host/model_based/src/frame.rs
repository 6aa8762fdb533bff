//! Bordered normal equations: the columns common to all candidates are weighted and multiplied once, a candidate adds
//! its border.
//!
//! Everything is kept per run, so that any split of the runs is a sum of small matrices. The common columns are
//! stored bin by bin (single precision), which turns a candidate's products into streams; bins that no common column
//! has, nine of ten beside the mesh lines, take no room. Cost of a border: non-zero bins times common columns.

use super::candidate::Template;
use super::least_squares::{Column, Data, Estimate, Normal, solve};
use crate::observation::spectrum::Sparse;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use rustfft::num_complex::Complex64 as C;
use std::ops::Range;
use std::sync::Arc;

/// Common columns of one run, ready for products.
#[derive(Clone)]
struct RunFrame {
    /// Columns with bins in this run.
    active: Vec<usize>,
    /// Their values per channel.
    parts: Arc<[Rows; 2]>,
    /// Gram over all common columns and right-hand side, without priors.
    own: Normal,
}

/// Values of all active columns, bin by bin where any of them has one.
struct Rows {
    /// Each bin's row; [`NONE`] where no column has a value.
    row: Vec<u32>,
    /// Real and imaginary parts, one value per active column in each row.
    re: Vec<f32>,
    im: Vec<f32>,
}

/// No row.
const NONE: u32 = u32::MAX;

impl Rows {
    /// Of `columns` over so many bins.
    fn new(columns: &[&Sparse], bins: usize) -> Self {
        let mut row = vec![NONE; bins];
        columns.iter().flat_map(|column| column.iter()).for_each(|(b, _)| row[b] = 0);
        let mut rows = 0;
        for row in row.iter_mut().filter(|row| **row != NONE) {
            *row = rows;
            rows += 1;
        }
        let width = columns.len();
        let mut re = vec![0.0_f32; rows as usize * width];
        let mut im = re.clone();
        for (slot, column) in columns.iter().enumerate() {
            for (b, t) in column.iter() {
                let at = row[b] as usize * width + slot;
                (re[at], im[at]) = (t.re as f32, t.im as f32);
            }
        }
        Self { row, re, im }
    }
}

/// The common columns of all candidates.
pub struct Frame<'a> {
    data: &'a Data,
    priors: Vec<(f64, f64)>,
    runs: Vec<RunFrame>,
}

/// What one candidate adds, per run.
pub struct Border {
    /// Number of its columns.
    pub count: usize,
    /// Per run: own Gram, products with the common columns (rows: own), right-hand side.
    runs: Vec<(DMatrix<f64>, DMatrix<f64>, DVector<f64>)>,
}

impl<'a> Frame<'a> {
    /// Prepares `columns` for the residual and weights of `data`.
    pub fn new(data: &'a Data, columns: &[Column<'_>]) -> Self {
        let m = columns.len();
        let runs = (0..data.residual.len())
            .into_par_iter()
            .map(|r| {
                let active: Vec<usize> =
                    (0..m).filter(|&i| columns[i].template.runs[r].iter().any(|part| !part.is_empty())).collect();
                let parts = Arc::new([0, 1].map(|c| {
                    let own: Vec<&Sparse> = active.iter().map(|&i| &columns[i].template.runs[r][c]).collect();
                    Rows::new(&own, data.residual[r][c].len())
                }));
                let own = Normal { gram: DMatrix::zeros(m, m), right: DVector::zeros(m) };
                let mut run = RunFrame { active, parts, own };
                for i in run.active.clone() {
                    let (products, dot) = products(&run, data, r, columns[i].template);
                    for (slot, &j) in run.active.iter().enumerate() {
                        run.own.gram[(i, j)] = products[slot];
                    }
                    run.own.right[i] = dot;
                }
                run.own.gram = (&run.own.gram + run.own.gram.transpose()) * 0.5;
                run
            })
            .collect();
        Self { data, priors: columns.iter().map(|c| c.prior).collect(), runs }
    }

    /// Products of a candidate's templates.
    pub fn border(&self, templates: &[Template]) -> Border {
        let (k, m) = (templates.len(), self.priors.len());
        let runs = (0..self.runs.len())
            .map(|r| {
                let mut gram = DMatrix::zeros(k, k);
                let mut cross = DMatrix::zeros(k, m);
                let mut right = DVector::zeros(k);
                for (i, template) in templates.iter().enumerate() {
                    if template.runs[r].iter().all(Sparse::is_empty) {
                        continue;
                    }
                    let (products, dot) = products(&self.runs[r], self.data, r, template);
                    for (slot, &j) in self.runs[r].active.iter().enumerate() {
                        cross[(i, j)] = products[slot];
                    }
                    right[i] = dot;
                }
                for c in 0..2 {
                    let weight = &self.data.weight[r][c];
                    let mut dense = vec![C::ZERO; if k > 0 { weight.len() } else { 0 }];
                    for i in 0..k {
                        let own = &templates[i].runs[r][c];
                        own.iter().for_each(|(b, t)| dense[b] = t.conj() * weight[b]);
                        for j in i..k {
                            let sum: f64 = templates[j].runs[r][c].iter().map(|(b, t)| (dense[b] * t).re).sum();
                            gram[(i, j)] += sum;
                            if i != j {
                                gram[(j, i)] += sum;
                            }
                        }
                        own.iter().for_each(|(b, _)| dense[b] = C::ZERO);
                    }
                }
                (gram, cross, right)
            })
            .collect();
        Border { count: k, runs }
    }

    fn sum(&self, runs: &[usize], border: Option<&Border>) -> Normal {
        let (m, k) = (self.priors.len(), border.map_or(0, |b| b.count));
        let mut all = Normal { gram: DMatrix::zeros(m + k, m + k), right: DVector::zeros(m + k) };
        for &r in runs {
            let own = &self.runs[r].own;
            let mut view = all.gram.view_mut((0, 0), (m, m));
            view += &own.gram;
            let mut view = all.right.rows_mut(0, m);
            view += &own.right;
            if let Some(border) = border {
                let (gram, cross, right) = &border.runs[r];
                let mut view = all.gram.view_mut((m, m), (k, k));
                view += gram;
                let mut view = all.gram.view_mut((m, 0), (k, m));
                view += cross;
                let mut view = all.gram.view_mut((0, m), (m, k));
                view += cross.transpose();
                let mut view = all.right.rows_mut(m, k);
                view += right;
            }
        }
        all
    }

    /// Estimate of the common columns, and of the candidate's after them, over `runs`.
    pub fn estimate(&self, runs: &[usize], border: Option<&Border>) -> Estimate {
        let mut all = self.sum(runs, border);
        for (i, (precision, mean)) in self.priors.iter().enumerate() {
            all.gram[(i, i)] += precision;
            all.right[i] += precision * mean;
        }
        solve(&all)
    }

    /// Change of the objective without priors over `runs` when `x` is applied.
    pub fn change(&self, runs: &[usize], border: Option<&Border>, x: &DVector<f64>) -> f64 {
        let all = self.sum(runs, border);
        x.dot(&(&all.gram * x)) - 2.0 * x.dot(&all.right)
    }

    /// The same, after which the columns `own` are fitted to what is left.
    pub fn change_refitted(&self, runs: &[usize], border: Option<&Border>, x: &DVector<f64>, own: Range<usize>) -> f64 {
        let all = self.sum(runs, border);
        let left = &all.right - &all.gram * x;
        let (first, count) = (own.start, own.len());
        let mut rest = Normal {
            gram: all.gram.view((first, first), (count, count)).into_owned(),
            right: left.rows(first, count).into_owned(),
        };
        for (i, (precision, mean)) in self.priors[own].iter().enumerate() {
            rest.gram[(i, i)] += precision;
            rest.right[i] += precision * mean;
        }
        -x.dot(&(&all.right + left)) - solve(&rest).gain
    }

    /// The same columns before another residual with the same weights; `columns` as they were.
    pub fn before<'b>(&self, data: &'b Data, columns: &[Column<'_>]) -> Frame<'b> {
        let mut runs = self.runs.clone();
        runs.par_iter_mut().enumerate().for_each(|(r, run)| {
            for &i in &run.active {
                run.own.right[i] = dot(data, r, columns[i].template);
            }
        });
        Frame { data, priors: self.priors.clone(), runs }
    }

    /// The same where the residual of every run also holds the templates of `border` at `x`, and that border before
    /// this residual.
    pub fn holding(&self, border: &Border, x: &[DVector<f64>]) -> (Self, Border) {
        let mut runs = self.runs.clone();
        let mut own = Border { count: border.count, runs: border.runs.clone() };
        for ((run, (gram, cross, right)), x) in runs.iter_mut().zip(&mut own.runs).zip(x) {
            run.own.right += cross.transpose() * x;
            *right += &*gram * x;
        }
        (Self { data: self.data, priors: self.priors.clone(), runs }, own)
    }
}

impl Border {
    /// The same templates with unknowns of their own on the runs `other`.
    pub fn apart(&self, other: &[usize]) -> Self {
        let k = self.count;
        let runs = (0..self.runs.len())
            .map(|r| {
                let (gram, cross, right) = &self.runs[r];
                let at = if other.contains(&r) { k } else { 0 };
                let mut wide =
                    (DMatrix::zeros(2 * k, 2 * k), DMatrix::zeros(2 * k, cross.ncols()), DVector::zeros(2 * k));
                wide.0.view_mut((at, at), (k, k)).copy_from(gram);
                wide.1.view_mut((at, 0), (k, cross.ncols())).copy_from(cross);
                wide.2.rows_mut(at, k).copy_from(right);
                wide
            })
            .collect();
        Self { count: 2 * k, runs }
    }

    /// The same templates with their quadrature pairs turned in every run by `phase_rad(run, pair)`.
    pub fn turned(&self, phase_rad: impl Fn(usize, usize) -> f64) -> Self {
        let runs = self
            .runs
            .iter()
            .enumerate()
            .map(|(r, (gram, cross, right))| {
                let mut turn = DMatrix::zeros(self.count, self.count);
                for pair in 0..self.count / 2 {
                    let (sin, cos) = phase_rad(r, pair).sin_cos();
                    let at = 2 * pair;
                    turn[(at, at)] = cos;
                    turn[(at + 1, at)] = sin;
                    turn[(at, at + 1)] = -sin;
                    turn[(at + 1, at + 1)] = cos;
                }
                let back = turn.transpose();
                (&back * gram * turn, &back * cross, back * right)
            })
            .collect();
        Self { count: self.count, runs }
    }

    /// The same `templates` before another residual with the same weights.
    pub fn before(&self, data: &Data, templates: &[Template]) -> Self {
        let mut runs = self.runs.clone();
        for (r, (.., right)) in runs.iter_mut().enumerate() {
            templates.iter().enumerate().for_each(|(i, template)| right[i] = dot(data, r, template));
        }
        Self { count: self.count, runs }
    }

    /// Right-hand side of one run.
    pub fn right(&self, run: usize) -> &DVector<f64> {
        &self.runs[run].2
    }

    /// Own Gram of one run.
    pub fn gram(&self, run: usize) -> &DMatrix<f64> {
        &self.runs[run].0
    }

    /// Right-hand side of one run with the common columns' share `x` removed.
    pub fn right_after(&self, run: usize, x: &DVector<f64>) -> DVector<f64> {
        let (_, cross, right) = &self.runs[run];
        right - cross * x.rows(0, cross.ncols())
    }
}

/// Weighted products of a template with the active common columns, and with the residual, of one run.
fn products(run: &RunFrame, data: &Data, r: usize, template: &Template) -> (Vec<f64>, f64) {
    let m = run.active.len();
    let mut sums = vec![0.0_f64; m];
    let mut dot = 0.0;
    for c in 0..2 {
        let (residual, weight) = (&data.residual[r][c], &data.weight[r][c]);
        let Rows { row, re, im } = &run.parts[c];
        for (b, t) in template.runs[r][c].iter() {
            let (a, d) = (t.re * weight[b], t.im * weight[b]);
            dot += a * residual[b].re + d * residual[b].im;
            if row[b] == NONE {
                continue;
            }
            let own = row[b] as usize * m..(row[b] as usize + 1) * m;
            for ((sum, x), y) in sums.iter_mut().zip(&re[own.clone()]).zip(&im[own]) {
                *sum += a * f64::from(*x) + d * f64::from(*y);
            }
        }
    }
    (sums, dot)
}

/// Weighted product of a template with the residual of one run.
fn dot(data: &Data, r: usize, template: &Template) -> f64 {
    let of = |c: usize| -> f64 {
        let (residual, weight) = (&data.residual[r][c], &data.weight[r][c]);
        template.runs[r][c].iter().map(|(b, t)| (t.conj() * residual[b]).re * weight[b]).sum()
    };
    of(0) + of(1)
}
