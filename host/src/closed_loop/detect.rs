//! Lines in the residual that no mesh order explains: orders of the pinion, and fixed frequencies, found jointly over runs.
//!
//! Each run and channel contributes its normalised power (exponential with mean 1 in noise), capped so that a line which stands in one
//! run only, because a fixed frequency crosses an order there, cannot pass for a line of all runs. Family-wise control by Bonferroni.

use super::base_fit::Base;
use super::least_squares::Data;
use super::spectrum::OVERDISPERSION;
use rayon::prelude::*;
use statrs::distribution::{ContinuousCDF, Gamma};

/// A detected line.
#[derive(Debug, Clone, Copy)]
pub struct Found {
    /// Order of the pinion or frequency in Hz.
    pub at: f64,
    /// Rank: sum over runs of the logarithm of the line's power over noise.
    pub statistic: f64,
    /// p-value after Bonferroni over the scan.
    pub p_value: f64,
    /// Whether it stands as sidebands of the mesh orders and has no line of its own.
    pub modulation: bool,
}

const CAP: f64 = 12.0;

fn statistic(base: &Base, data: &Data, run: usize, hz: f64) -> f64 {
    let mut sum = 0.0;
    for c in 0..2 {
        let (a, energy) = base.analyser.amplitude(&data.residual[run][c], hz);
        let b = (hz * base.analyser.duration_s()).round() as usize;
        if let Some(weight) = data.weight[run][c].get(b) {
            // |a|^2 over its variance S / energy; the tapered window's peak fit keeps about the same inflation.
            sum += a.norm_sqr() * energy * weight * 0.5 * OVERDISPERSION / 1.2;
        }
    }
    sum
}

fn scan(
    base: &Base,
    data: &Data,
    runs: &[usize],
    grid: impl Iterator<Item = f64>,
    tests: f64,
    hz: impl Fn(f64, usize) -> Option<f64>,
    count: usize,
) -> Vec<Found> {
    let null = Gamma::new(2.0 * runs.len() as f64, 1.0).expect("positive shape");
    let mut all: Vec<Found> = grid
        .filter_map(|at| {
            let (mut sum, mut rank) = (0.0, 0.0);
            for &r in runs {
                let own = statistic(base, data, r, hz(at, r)?);
                sum += own.min(CAP);
                // Uncapped on a logarithmic scale, so that a strong line's shoulders do not tie with its peak.
                rank += (1.0 + own).ln();
            }
            let p = (1.0 - null.cdf(sum)) * tests;
            (p < 0.01).then_some(Found { at, statistic: rank, p_value: p, modulation: false })
        })
        .collect();
    all.sort_by(|a, b| b.statistic.total_cmp(&a.statistic));
    let mut kept: Vec<Found> = Vec::new();
    for found in all {
        if kept.len() < count && kept.iter().all(|k| (k.at - found.at).abs() > 0.15 * (1.0 + 0.01 * k.at)) {
            kept.push(found);
        }
    }
    kept
}

/// Strongest non-mesh orders up to a few mesh orders.
pub fn orders(base: &Base, data: &Data, runs: &[usize], count: usize) -> Vec<Found> {
    let fastest = runs.iter().map(|&r| base.runs[r].angle.shaft_hz).fold(0.0, f64::max);
    let z = f64::from(base.machine.teeth[0]);
    let top = (14_000.0 / fastest).min(8.0 * z);
    let step = 0.2 / (base.analyser.duration_s() * fastest);
    let grid = (1..(top / step) as usize).map(|i| i as f64 * step);
    let slowest = runs.iter().map(|&r| base.runs[r].angle.shaft_hz).fold(f64::INFINITY, f64::min);
    let guard = 2.5 / (base.analyser.duration_s() * slowest);
    let tests = top / step * 0.3;
    scan(
        base,
        data,
        runs,
        grid.filter(move |o| (o - z * (o / z).round()).abs() > guard),
        tests,
        |o, r| {
            let hz = o * base.runs[r].angle.shaft_hz;
            (hz > 4.0).then_some(hz)
        },
        count,
    )
}

/// Strongest combs `n z + o` and `n z - o` about the mesh orders, whose lines stand in another place in every run because the machine's modes pick
/// them out: what modulates the mesh weakly leaves no order line that all runs share.
///
/// Each run gives the probability of its strongest line among all of its comb; these combine by Fisher's method, capped as single lines are.
pub fn combs(base: &Base, data: &Data, runs: &[usize], count: usize) -> Vec<Found> {
    let duration = base.analyser.duration_s();
    let z = f64::from(base.machine.teeth[0]);
    let speeds: Vec<f64> = runs.iter().map(|&r| base.runs[r].angle.shaft_hz).collect();
    let fastest = speeds.iter().copied().fold(0.0, f64::max);
    let slowest = speeds.iter().copied().fold(f64::INFINITY, f64::min);
    let cell_hz = 0.2 / duration;
    let cells = (14_500.0 / cell_hz) as usize;
    // Power over noise, both channels, on a fifth of a bin.
    let power: Vec<Vec<f64>> = runs
        .par_iter()
        .map(|&r| (0..cells).map(|i| if i < 20 { 0.0 } else { statistic(base, data, r, i as f64 * cell_hz) }).collect())
        .collect();
    let line = Gamma::new(2.0, 1.0).expect("positive shape");
    let null = Gamma::new(runs.len() as f64, 1.0).expect("positive shape");
    // Of one run: power and place (mesh order, side) of the strongest line, and number of lines.
    let strongest = |own: &[f64], f: f64, order: f64| -> (f64, [f64; 2], f64) {
        let harmonics = (14_000.0 / (z * f)) as i32;
        let comb = (0..=harmonics).flat_map(|n| [1.0, -1.0].map(|side| [f64::from(n) * z, side]));
        let mut best = (0.0_f64, [0.0, 1.0], 0.0);
        for [mesh, side] in comb {
            let cell = ((mesh + side * order) * f / cell_hz).round();
            if cell >= 20.0 && (cell as usize) < cells {
                let own = own[cell as usize];
                best = (best.0.max(own), if own > best.0 { [mesh, side] } else { best.1 }, best.2 + 1.0);
            }
        }
        best
    };
    let at_order = |order: f64| -> (f64, f64) {
        let (mut sum, mut rank) = (0.0, 0.0);
        for (own, &f) in power.iter().zip(&speeds) {
            let (top, _, lines) = strongest(own, f, order);
            let by_chance = -(lines * (-(1.0 - line.cdf(top))).ln_1p()).exp_m1();
            sum += (-by_chance.max(1e-300).ln()).min(CAP);
            rank += (1.0 + top).ln();
        }
        (sum, rank)
    };
    let step = 0.2 / (duration * fastest);
    let guard = 2.5 / (duration * slowest);
    let steps = (0.5 * z / step) as usize;
    let tests = steps as f64 * 0.6;
    let mut all: Vec<Found> = (1..steps)
        .into_par_iter()
        .map(|i| i as f64 * step)
        .filter(|order| *order > guard)
        .filter_map(|at| {
            let (sum, rank) = at_order(at);
            let p = (1.0 - null.cdf(sum)) * tests;
            (p < 1e-3).then_some(Found { at, statistic: rank, p_value: p, modulation: true })
        })
        .collect();
    all.sort_by(|a, b| b.statistic.total_cmp(&a.statistic));
    let mut kept: Vec<Found> = Vec::new();
    for found in all {
        if kept.len() < count && kept.iter().all(|k| (k.at - found.at).abs() > 4.0 * guard) {
            kept.push(found);
        }
    }
    for found in &mut kept {
        let lines: Vec<[f64; 2]> = power.iter().zip(&speeds).map(|(own, &f)| strongest(own, f, found.at).1).collect();
        let summed = |order: f64| -> f64 {
            let of = |((&r, f), [mesh, side]): ((&usize, &f64), &[f64; 2])| {
                statistic(base, data, r, (mesh + side * order) * f)
            };
            runs.iter().zip(&speeds).zip(&lines).map(of).sum()
        };
        let near = (-30..=30).map(|i| found.at + 0.05 * step * f64::from(i));
        found.at = near.max_by(|a, b| summed(*a).total_cmp(&summed(*b))).unwrap_or(found.at);
    }
    kept
}

/// Strongest fixed frequencies.
pub fn frequencies(base: &Base, data: &Data, runs: &[usize], count: usize) -> Vec<Found> {
    let step = 0.2 / base.analyser.duration_s();
    let cells = (14_500.0 / step) as usize;
    let grid = (20..cells).map(|i| i as f64 * step);
    scan(base, data, runs, grid, cells as f64 * 0.3, |hz, _| Some(hz), count)
}

/// Strongest pairs of lines at a fixed distance, Hz, on both sides of the mesh orders: slow modulation that leaves no line of its own.
pub fn modulations(base: &Base, data: &Data, runs: &[usize], count: usize) -> Vec<Found> {
    let duration = base.analyser.duration_s();
    let z = f64::from(base.machine.teeth[0]);
    let slowest = runs.iter().map(|&r| base.runs[r].angle.shaft_hz).fold(f64::INFINITY, f64::min);
    let step = 0.2 / duration;
    let cells = ((0.45 * z * slowest).min(150.0) / step) as usize;
    let harmonics = 12;
    let null = Gamma::new(4.0 * f64::from(harmonics) * runs.len() as f64, 1.0).expect("positive shape");
    let at_distance = |at: f64| {
        let (mut sum, mut rank) = (0.0, 0.0);
        for &r in runs {
            for n in 1..=harmonics {
                for side in [-1.0, 1.0] {
                    let own = statistic(base, data, r, f64::from(n) * z * base.runs[r].angle.shaft_hz + side * at);
                    sum += own.min(0.5 * CAP);
                    rank += (1.0 + own).ln();
                }
            }
        }
        (sum, rank)
    };
    let mut all: Vec<Found> = (16..cells)
        .filter_map(|i| {
            let at = i as f64 * step;
            let (sum, rank) = at_distance(at);
            let p = (1.0 - null.cdf(sum)) * cells as f64 * 0.3;
            (p < 1e-3).then_some(Found { at, statistic: rank, p_value: p, modulation: true })
        })
        .collect();
    all.sort_by(|a, b| b.statistic.total_cmp(&a.statistic));
    all.dedup_by(|b, a| (a.at - b.at).abs() < 2.0 / duration);
    all.truncate(count);
    for found in &mut all {
        // The scan's grid is a fifth of a bin; a modulation many orders up needs a finer place.
        let near = (-20..=20).map(|i| found.at + 0.05 * step * f64::from(i));
        let best = near.map(|at| (at, at_distance(at).1)).max_by(|a, b| a.1.total_cmp(&b.1));
        found.at = best.map_or(found.at, |b| b.0);
    }
    all
}
