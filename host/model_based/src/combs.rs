//! Combs `n z + o` and `n z - o` about the mesh orders whose lines stand in another place in every run.
//!
//! What modulates the mesh or a bearing weakly leaves no order line that all runs share: the machine's modes, which
//! stay at their frequencies, pick out another sideband at every speed. Each run gives the probability of its
//! strongest line among all of the comb's; these combine by Fisher's method, each capped as single lines are. Cost:
//! one power spectrum on a fifth of a bin per run.

use super::base_fit::Base;
use super::detect::{CAP, Found, statistic};
use super::least_squares::Data;
use super::probability::Probability;
use rayon::prelude::*;

/// Highest frequency of a comb's lines, Hz.
pub const HIGHEST_HZ: f64 = 14_000.0;
/// Lowest cell of the spectra that is used: below lies the window's leakage of the mean.
const LOWEST_CELL: usize = 20;
/// Largest probability by chance, after Bonferroni over the orders.
const LARGEST_CHANCE: f64 = 1e-3;

/// The strongest line of a comb in one run.
struct Strongest {
    power: f64,
    /// Mesh order about which it stands, and its side, 1 or -1.
    place: [f64; 2],
    /// Number of lines it was chosen from.
    lines: f64,
}

struct Search<'a> {
    base: &'a Base,
    data: &'a Data,
    runs: &'a [usize],
    speeds_hz: Vec<f64>,
    /// Power over noise of every run in cells of [`Search::cell_hz`].
    power: Vec<Vec<f64>>,
    cell_hz: f64,
    mesh_order: f64,
}

impl<'a> Search<'a> {
    fn new(base: &'a Base, data: &'a Data, runs: &'a [usize]) -> Self {
        let cell_hz = 0.2 / base.analyser.duration_s();
        let cells = ((HIGHEST_HZ + 500.0) / cell_hz) as usize;
        let of = |r: usize, i: usize| {
            if i < LOWEST_CELL { 0.0 } else { statistic(base, data, r, i as f64 * cell_hz) }
        };
        Self {
            base,
            data,
            runs,
            speeds_hz: runs.iter().map(|&r| base.runs[r].angle.shaft_hz).collect(),
            power: runs.par_iter().map(|&r| (0..cells).map(|i| of(r, i)).collect()).collect(),
            cell_hz,
            mesh_order: f64::from(base.machine.teeth[0]),
        }
    }

    /// Of the comb about `order` in run number `index` of those searched.
    fn strongest(&self, index: usize, order: f64) -> Strongest {
        let (own, speed_hz) = (&self.power[index], self.speeds_hz[index]);
        let harmonics = (HIGHEST_HZ / (self.mesh_order * speed_hz)) as i32;
        let mut best = Strongest { power: 0.0, place: [0.0, 1.0], lines: 0.0 };
        for mesh in (0..=harmonics).map(|n| f64::from(n) * self.mesh_order) {
            for side in [1.0, -1.0] {
                let cell = ((mesh + side * order) * speed_hz / self.cell_hz).round();
                if cell >= LOWEST_CELL as f64 && (cell as usize) < own.len() {
                    best.lines += 1.0;
                    if own[cell as usize] > best.power {
                        best.power = own[cell as usize];
                        best.place = [mesh, side];
                    }
                }
            }
        }
        best
    }

    /// Fisher's sum over the runs (Gamma with their number in noise), and a rank by which neighbouring orders compare.
    fn evidence(&self, order: f64) -> (f64, f64) {
        (0..self.runs.len()).fold((0.0, 0.0), |(sum, rank), index| {
            let top = self.strongest(index, order);
            (sum + evidence_of(top.power, top.lines), rank + (1.0 + top.power).ln())
        })
    }

    /// Order within a step and a half of `order` where the lines that are strongest there have the most power.
    fn placed(&self, order: f64, step: f64) -> f64 {
        let places: Vec<[f64; 2]> = (0..self.runs.len()).map(|i| self.strongest(i, order).place).collect();
        let summed = |order: f64| -> f64 {
            let of = |(i, [mesh, side]): (usize, &[f64; 2])| {
                statistic(self.base, self.data, self.runs[i], (mesh + side * order) * self.speeds_hz[i])
            };
            places.iter().enumerate().map(of).sum()
        };
        let near = (-30..=30).map(|i| order + 0.05 * step * f64::from(i));
        near.max_by(|a, b| summed(*a).total_cmp(&summed(*b))).unwrap_or(order)
    }
}

/// One run's share of Fisher's sum: the power of the strongest of so many lines.
pub fn evidence_of(power: f64, lines: f64) -> f64 {
    // 1 - (1 - p)^lines without its rounding.
    let one = Probability::gamma_above(power, 2.0).value();
    let by_chance = -(lines * (-one).ln_1p()).exp_m1();
    (-by_chance.max(1e-300).ln()).min(CAP)
}

/// Independent places of the search; `step` of its grid.
pub fn places(mesh_order: f64, step: f64) -> f64 {
    ((0.5 * mesh_order / step) as usize) as f64 * 0.6
}

/// Whether Fisher's sum over so many runs is a comb, among so many places.
pub fn is_comb(sum: f64, runs: usize, places: f64) -> bool {
    Probability::gamma_above(sum, runs as f64).among(places.ln()).value() < LARGEST_CHANCE
}

/// The `count` strongest combs; their orders lie between none and half the mesh order.
pub fn combs(base: &Base, data: &Data, runs: &[usize], count: usize) -> Vec<Found> {
    let search = Search::new(base, data, runs);
    let duration_s = base.analyser.duration_s();
    let fastest = search.speeds_hz.iter().copied().fold(0.0, f64::max);
    let slowest = search.speeds_hz.iter().copied().fold(f64::INFINITY, f64::min);
    let step = 0.2 / (duration_s * fastest);
    let guard = 2.5 / (duration_s * slowest);
    let steps = (0.5 * search.mesh_order / step) as usize;
    let tests = places(search.mesh_order, step);
    let mut all: Vec<Found> = (1..steps)
        .into_par_iter()
        .map(|i| i as f64 * step)
        .filter(|order| *order > guard)
        .filter_map(|at| {
            let (sum, statistic) = search.evidence(at);
            is_comb(sum, runs.len(), tests).then_some(Found { at, statistic, places: tests, modulation: true })
        })
        .collect();
    all.sort_by(|a, b| b.statistic.total_cmp(&a.statistic));
    let mut kept: Vec<Found> = Vec::new();
    for found in all {
        if kept.len() < count && kept.iter().all(|k| (k.at - found.at).abs() > 4.0 * guard) {
            kept.push(found);
        }
    }
    kept.iter_mut().for_each(|found| found.at = search.placed(found.at, step));
    kept
}
