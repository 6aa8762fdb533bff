//! Weighted least squares of residual bins on templates, with Gaussian priors.
//!
//! The objective is `sum_b w_b |R_b - sum_j x_j T_jb|^2 + sum_j prior_j (x_j - mean_j)^2`, which is minus twice the
//! log likelihood of circular Gaussian noise when `w = 2 / (S * overdispersion)`. Real unknowns.

use super::candidate::Template;
use nalgebra::{DMatrix, DVector};
use rustfft::num_complex::Complex64 as C;

/// Residual and weights of all runs: per run, per channel.
pub struct Data {
    /// Residual bins.
    pub residual: Vec<[Vec<C>; 2]>,
    /// Weights, 1/power.
    pub weight: Vec<[Vec<f64>; 2]>,
}

/// A column of the regression.
#[derive(Clone, Copy)]
pub struct Column<'a> {
    /// Its template.
    pub template: &'a Template,
    /// Prior precision (0: free) and prior mean.
    pub prior: (f64, f64),
}

/// Normal equations over a set of runs.
#[derive(Clone)]
pub struct Normal {
    /// Gram matrix with priors.
    pub gram: DMatrix<f64>,
    /// Right-hand side.
    pub right: DVector<f64>,
}

/// Estimate with covariance.
pub struct Estimate {
    /// Values.
    pub x: DVector<f64>,
    /// Covariance.
    pub covariance: DMatrix<f64>,
    /// Drop of the objective from `x = 0`.
    pub gain: f64,
}

/// Normal equations of `columns` over `runs`.
pub fn normal(data: &Data, runs: &[usize], columns: &[Column<'_>]) -> Normal {
    let k = columns.len();
    let mut gram = DMatrix::zeros(k, k);
    let mut right = DVector::zeros(k);
    for &r in runs {
        for c in 0..2 {
            let (residual, weight) = (&data.residual[r][c], &data.weight[r][c]);
            let mut dense = vec![C::ZERO; residual.len()];
            for i in 0..k {
                let own = &columns[i].template.runs[r][c];
                if own.is_empty() {
                    continue;
                }
                let mut dot = 0.0;
                for (b, t) in own.iter() {
                    let weighted = t.conj() * weight[b];
                    dense[b] = weighted;
                    dot += (weighted * residual[b]).re;
                }
                right[i] += dot;
                for j in i..k {
                    let other = &columns[j].template.runs[r][c];
                    let dot: f64 = other.iter().map(|(b, t)| (dense[b] * t).re).sum();
                    gram[(i, j)] += dot;
                }
                own.iter().for_each(|(b, _)| dense[b] = C::ZERO);
            }
        }
    }
    for i in 0..k {
        let (precision, mean) = columns[i].prior;
        gram[(i, i)] += precision;
        right[i] += precision * mean;
        for j in 0..i {
            gram[(i, j)] = gram[(j, i)];
        }
    }
    Normal { gram, right }
}

/// Solves normal equations; columns without information get zero.
pub fn solve(normal: &Normal) -> Estimate {
    let k = normal.right.len();
    let scale: Vec<f64> = (0..k).map(|i| normal.gram[(i, i)].max(1e-300).sqrt().recip()).collect();
    let mut scaled = DMatrix::from_fn(k, k, |i, j| normal.gram[(i, j)] * scale[i] * scale[j]);
    for i in 0..k {
        scaled[(i, i)] = if normal.gram[(i, i)] > 0.0 { scaled[(i, i)] + 1e-9 } else { 1.0 };
    }
    let inverse = scaled.cholesky().map(|c| c.inverse()).unwrap_or_else(|| DMatrix::zeros(k, k));
    let covariance = DMatrix::from_fn(k, k, |i, j| inverse[(i, j)] * scale[i] * scale[j]);
    let x = &covariance * &normal.right;
    let gain = x.dot(&normal.right);
    Estimate { x, covariance, gain }
}

/// Data with `columns * x` removed from the residual.
pub fn subtract(data: &mut Data, columns: &[Column<'_>], x: &[f64]) {
    for (column, &value) in columns.iter().zip(x) {
        for (run, parts) in column.template.runs.iter().enumerate() {
            for (channel, part) in parts.iter().enumerate() {
                part.iter().for_each(|(b, t)| data.residual[run][channel][b] -= t * value);
            }
        }
    }
}

/// Objective without priors over `runs`.
pub fn chi_square(data: &Data, runs: &[usize]) -> f64 {
    let one = |r: usize, c: usize| -> f64 {
        data.residual[r][c].iter().zip(&data.weight[r][c]).map(|(x, w)| x.norm_sqr() * w).sum()
    };
    runs.iter().map(|&r| one(r, 0) + one(r, 1)).sum()
}
