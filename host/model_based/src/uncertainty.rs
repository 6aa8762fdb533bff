//! Standard errors of the unknowns of adopted terms.
//!
//! The covariance of the fit has two parts: what the priors on declared parameters leave open, which stands as
//! declared, and what the data leave open. The weights take a share of every line for error of form, whose true size
//! nobody knows beforehand; the data's part is therefore scaled by what is really left at the term's own lines, over
//! what the weights allow for (Birge 1932). So model discrepancy enters as an estimated variance and there is no
//! floor. Where there are speeds enough, a law that does not hold from speed to speed shows in a jackknife by speed
//! (Tukey 1958), and the larger of both counts. A shape that was searched, the share of a relief, is an unknown like
//! the others here. Cost: one more solution, and one per speed.

use super::base_fit::Base;
use super::candidate::Candidate;
use super::frame::Frame;
use super::judge::{columns, corrected};
use super::least_squares::{Column, Data, subtract};
use super::shapes;
use crate::observation::spectrum::OVERDISPERSION;
use rustfft::num_complex::Complex64 as C;

/// Speeds from which their spread is an estimate.
const LEAST_SPEEDS: usize = 4;
/// Standard deviation of a shape, the share of the path that a relief covers, before the record is asked.
const WIDEST_SHAPE: f64 = 0.2;
/// Share of a term's largest whitened power in a bin from which the bin is one of its lines.
const OWN_LINE: f64 = 1e-3;
/// Bins from which what is left at them is an estimate.
const LEAST_BINS: f64 = 12.0;

/// Standard errors of all unknowns `x`, nuisances first, as fitted over `runs`.
pub fn standard_errors(base: &Base, data: &Data, runs: &[usize], terms: &[&Candidate], x: &[f64]) -> Vec<f64> {
    let shapes = shapes::slopes(base, terms, &x[base.nuisances.len()..]);
    let mut columns = columns(base, terms);
    columns.extend(shapes.iter().map(|template| Column { template, prior: (1.0 / WIDEST_SHAPE.powi(2), 0.0) }));
    let frame = Frame::new(data, &columns);
    let covariance = frame.estimate(runs, None).covariance;
    let rest = corrected(base, data, x, terms);
    let speeds = jackknife(base, &frame, runs);
    let mut scale = vec![1.0; base.nuisances.len()];
    for term in terms {
        let own = scale.len()..scale.len() + term.templates.len();
        let share = left_over_allowed(data, &rest, runs, term, &x[own.clone()]);
        scale.resize(own.end, share);
    }
    (0..x.len())
        .map(|i| {
            let prior: f64 = columns.iter().enumerate().map(|(j, c)| covariance[(i, j)].powi(2) * c.prior.0).sum();
            let of_data = (covariance[(i, i)] - prior).max(0.0);
            let own = (prior + of_data * scale[i]).sqrt();
            speeds.as_ref().map_or(own, |spread| own.max(spread[i]))
        })
        .collect()
}

/// Whitened power left at the lines of `term` over what its weights allow for.
fn left_over_allowed(data: &Data, rest: &Data, runs: &[usize], term: &Candidate, x: &[f64]) -> f64 {
    let zero = |r: &[Vec<C>; 2]| [vec![C::ZERO; r[0].len()], vec![C::ZERO; r[1].len()]];
    let mut predicted = Data { residual: data.residual.iter().map(zero).collect(), weight: Vec::new() };
    let own: Vec<_> = term.templates.iter().map(|template| Column { template, prior: (0.0, 0.0) }).collect();
    subtract(&mut predicted, &own, x);
    let power = |r: usize, c: usize, b: usize| predicted.residual[r][c][b].norm_sqr() * data.weight[r][c][b];
    let bins: Vec<(usize, usize, usize)> = runs
        .iter()
        .flat_map(|&r| [0, 1].map(|c| (r, c)))
        .flat_map(|(r, c)| (0..data.weight[r][c].len()).map(move |b| (r, c, b)))
        .collect();
    let largest = bins.iter().map(|&(r, c, b)| power(r, c, b)).fold(0.0, f64::max);
    let (mut left, mut count) = (0.0, 0.0);
    for &(r, c, b) in bins.iter().filter(|&&(r, c, b)| power(r, c, b) > OWN_LINE * largest) {
        left += rest.residual[r][c][b].norm_sqr() * data.weight[r][c][b];
        count += 1.0;
    }
    if count < LEAST_BINS { 1.0 } else { left / count * OVERDISPERSION / 2.0 }
}

/// Standard error of every unknown by the jackknife over speeds; `None` where they are too few.
fn jackknife(base: &Base, frame: &Frame<'_>, runs: &[usize]) -> Option<Vec<f64>> {
    let speeds: Vec<Vec<usize>> =
        base.speeds().into_iter().filter(|own| own.iter().any(|r| runs.contains(r))).collect();
    if speeds.len() < LEAST_SPEEDS {
        return None;
    }
    let without = |left_out: &Vec<usize>| {
        let kept: Vec<usize> = runs.iter().copied().filter(|r| !left_out.contains(r)).collect();
        frame.estimate(&kept, None).x
    };
    let all: Vec<_> = speeds.iter().map(without).collect();
    let n = all.len() as f64;
    let spread = |i: usize| {
        let mean = all.iter().map(|x| x[i]).sum::<f64>() / n;
        ((n - 1.0) / n * all.iter().map(|x| (x[i] - mean).powi(2)).sum::<f64>()).sqrt()
    };
    Some((0..all[0].len()).map(spread).collect())
}
