//! Lines in the residual that no mesh order explains: orders of the pinion, and fixed frequencies, found jointly over
//! runs.
//!
//! Each run and channel contributes its normalised power (exponential with mean 1 in noise), capped so that a line
//! which stands in one run only, because a fixed frequency crosses an order there, cannot pass for a line of all
//! runs. Family-wise control by Bonferroni.

use super::base_fit::Base;
use super::least_squares::Data;
use super::probability::Probability;
use crate::observation::spectrum::OVERDISPERSION;
use rustfft::num_complex::Complex64 as C;

/// A detected line.
#[derive(Debug, Clone, Copy)]
pub struct Found {
    /// Order of the pinion or frequency in Hz.
    pub at: f64,
    /// Rank: sum over runs of the logarithm of the line's power over noise.
    pub statistic: f64,
    /// Number of independent places that were scanned.
    pub places: f64,
    /// Whether it stands as sidebands of the mesh orders and has no line of its own.
    pub modulation: bool,
}

/// Largest contribution of one run: a line that stands in one run only must not pass for a line of all.
pub const CAP: f64 = 12.0;

/// Power of a line at `hz` over noise, both channels of a run: Gamma(2) in noise.
pub fn statistic(base: &Base, data: &Data, run: usize, hz: f64) -> f64 {
    [0, 1].map(|c| amplitude(base, data, run, c, hz).norm_sqr()).iter().sum()
}

/// Amplitude of a line at `hz` in one channel of a run, its squared size in units of the noise's.
pub fn amplitude(base: &Base, data: &Data, run: usize, channel: usize, hz: f64) -> C {
    amplitude_in(&data.residual[run][channel], base, data, run, channel, hz)
}

/// The same of other `bins` in the place of the residual's.
pub fn amplitude_in(bins: &[C], base: &Base, data: &Data, run: usize, channel: usize, hz: f64) -> C {
    let (a, energy) = base.analyser.amplitude(bins, hz);
    let b = (hz * base.analyser.duration_s()).round() as usize;
    // |a|^2 over its variance S / energy; the tapered window's peak fit keeps about the same inflation.
    let weight = data.weight[run][channel].get(b).copied().unwrap_or(0.0);
    a * (energy * weight * 0.5 * OVERDISPERSION / 1.2).sqrt()
}

/// Share of the steps of a scan's grid that are independent places.
const INDEPENDENT_STEP_SHARE: f64 = 0.3;
/// Largest probability by chance of a line that is proposed, after Bonferroni over the places.
const LARGEST_CHANCE: f64 = 0.01;

/// Whether powers of so many runs, each up to [`CAP`], are a line, among so many places.
pub fn is_line(sum: f64, runs: usize, places: f64) -> bool {
    Probability::gamma_above(sum, 2.0 * runs as f64).among(places.ln()).value() < LARGEST_CHANCE
}

/// Grid of the scan over orders: highest order, step, and distance from the mesh orders that is left out.
pub fn grid_of_orders(base: &Base, runs: &[usize]) -> [f64; 3] {
    let speeds = || runs.iter().map(|&r| base.runs[r].angle.shaft_hz);
    let (fastest, slowest) = (speeds().fold(0.0, f64::max), speeds().fold(f64::INFINITY, f64::min));
    let duration = base.analyser.duration_s();
    let top = (14_000.0 / fastest).min(8.0 * f64::from(base.machine.teeth[0]));
    [top, 0.2 / (duration * fastest), 2.5 / (duration * slowest)]
}

/// Independent places of the scan over orders.
pub fn places_of_orders([top, step, _]: [f64; 3]) -> f64 {
    top / step * INDEPENDENT_STEP_SHARE
}

/// Step of the scan over frequencies, Hz, its number of cells, and of independent places.
pub fn grid_of_frequencies(base: &Base) -> (f64, usize, f64) {
    let step = 0.2 / base.analyser.duration_s();
    let cells = (14_500.0 / step) as usize;
    (step, cells, cells as f64 * INDEPENDENT_STEP_SHARE)
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
    let mut all: Vec<Found> = grid
        .filter_map(|at| {
            let (mut sum, mut rank) = (0.0, 0.0);
            for &r in runs {
                let own = statistic(base, data, r, hz(at, r)?);
                sum += own.min(CAP);
                // Uncapped on a logarithmic scale, so that a strong line's shoulders do not tie with its peak.
                rank += (1.0 + own).ln();
            }
            is_line(sum, runs.len(), tests).then_some(Found { at, statistic: rank, places: tests, modulation: false })
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
    let z = f64::from(base.machine.teeth[0]);
    let limits @ [top, step, guard] = grid_of_orders(base, runs);
    let grid = (1..(top / step) as usize).map(|i| i as f64 * step);
    let tests = places_of_orders(limits);
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

/// Strongest fixed frequencies.
pub fn frequencies(base: &Base, data: &Data, runs: &[usize], count: usize) -> Vec<Found> {
    let (step, cells, tests) = grid_of_frequencies(base);
    let grid = (20..cells).map(|i| i as f64 * step);
    scan(base, data, runs, grid, tests, |hz, _| Some(hz), count)
}

/// Strongest pairs of lines at a fixed distance, Hz, on both sides of the mesh orders: slow modulation that leaves no
/// line of its own.
pub fn modulations(base: &Base, data: &Data, runs: &[usize], count: usize) -> Vec<Found> {
    let duration = base.analyser.duration_s();
    let z = f64::from(base.machine.teeth[0]);
    let slowest = runs.iter().map(|&r| base.runs[r].angle.shaft_hz).fold(f64::INFINITY, f64::min);
    let step = 0.2 / duration;
    let cells = ((0.45 * z * slowest).min(150.0) / step) as usize;
    let harmonics = 12;
    let shape = 4.0 * f64::from(harmonics) * runs.len() as f64;
    let places = INDEPENDENT_STEP_SHARE * cells as f64;
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
            let chance = Probability::gamma_above(sum, shape).among(places.ln());
            (chance.value() < 1e-3).then_some(Found { at, statistic: rank, places, modulation: true })
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
