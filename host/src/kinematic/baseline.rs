//! The declared model and the calibrated one: mesh harmonics behind an unknown path, constant or moving with the speed.
//!
//! *Declared*: every harmonic `k z1` has one complex amplitude per run and channel. *Calibrated*: it may move with the speed ([`Basis`]); that takes
//! in path resonances crossed in a run-up or a wander, a delay of the tach (a phase linear in speed) and its angle zero. How many functions, is
//! chosen per run on the fitted turns alone: the Bayesian information criterion over the harmonics' turn-by-turn amplitudes of all channels. A term
//! of speed that the record does not pay for is not fitted. Every function of every line counts as two unknowns.

use super::amplitudes::{FittedLine, Weighted};
use super::basis::Basis;
use super::scene::{Scene, SceneRun};
use rayon::prelude::*;
use rustfft::num_complex::Complex64;

/// Numbers of functions tried.
const FUNCTIONS: [usize; 11] = [1, 2, 3, 4, 6, 9, 13, 19, 28, 40, 60];
/// Fitted turns per function at least.
const TURNS_PER_FUNCTION: usize = 3;

/// Samples by run and channel.
pub type Grids = Vec<Vec<Vec<f64>>>;

/// Both models, fitted.
#[derive(Debug, Clone)]
pub struct Baseline {
    /// Functions of speed per run.
    pub bases: Vec<Basis>,
    /// What constant amplitudes leave.
    pub declared: Grids,
    /// What amplitudes that move with the speed leave.
    pub calibrated: Grids,
    /// Calibrated mesh lines by run and channel.
    pub lines: Vec<Vec<Vec<FittedLine>>>,
    /// Real unknowns of the two.
    pub unknowns: [usize; 2],
}

impl Baseline {
    /// Fits both on the fitted turns.
    pub fn of(scene: &Scene) -> Self {
        let orders = mesh_orders(scene);
        let mut baseline = Self {
            bases: Vec::new(),
            declared: Vec::new(),
            calibrated: Vec::new(),
            lines: Vec::new(),
            unknowns: [0, 0],
        };
        for run in &scene.runs {
            let weighted = Weighted::new(run);
            let basis = chosen(run, &weighted, &orders);
            let constant = Basis::constant();
            let fitted = |basis: &Basis| -> Vec<(Vec<f64>, Vec<FittedLine>)> {
                let of_channel = |samples: &Vec<f64>| {
                    let mut rest = samples.clone();
                    let lines = weighted.fit(&mut rest, &orders, basis);
                    (rest, lines)
                };
                run.samples.par_iter().map(of_channel).collect()
            };
            let (declared, declared_lines): (Vec<_>, Vec<_>) = fitted(&constant).into_iter().unzip();
            let (calibrated, lines) =
                if basis == constant { (declared.clone(), declared_lines) } else { fitted(&basis).into_iter().unzip() };
            let complex = 2 * orders.len() * run.samples.len();
            baseline.unknowns[0] += complex;
            baseline.unknowns[1] += complex * basis.len();
            baseline.declared.push(declared);
            baseline.calibrated.push(calibrated);
            baseline.lines.push(lines);
            baseline.bases.push(basis);
        }
        baseline
    }

    /// Mean amplitude over the run's speed of the calibrated mesh line nearest to `order`.
    pub fn nearest_mesh(&self, scene: &Scene, run: usize, channel: usize, order: f64) -> f64 {
        let lines = &self.lines[run][channel];
        let k = ((order / scene.mesh_order()).round().max(1.0) as usize).min(lines.len());
        lines
            .get(k.wrapping_sub(1))
            .map_or(0.0, |line| self.bases[run].value(&line.coefficients, scene.runs[run].angle.speed.mean_hz).norm())
    }

    /// Largest mean amplitude of a mesh line in a run and channel.
    pub fn strongest_mesh(&self, scene: &Scene, run: usize, channel: usize) -> f64 {
        let orders = mesh_orders(scene);
        orders.iter().map(|&order| self.nearest_mesh(scene, run, channel, order)).fold(0.0, f64::max)
    }
}

/// Orders of the mesh harmonics that every run holds.
pub fn mesh_orders(scene: &Scene) -> Vec<f64> {
    let z = scene.mesh_order();
    (1..=(scene.highest_order / z) as usize).map(|k| k as f64 * z).collect()
}

/// The functions of speed that the fitted turns pay for.
fn chosen(run: &SceneRun, weighted: &Weighted, orders: &[f64]) -> Basis {
    let speeds = weighted.speeds_hz();
    let weights = weighted.weight_of_turn();
    let total: f64 = weights.iter().sum();
    let effective = total * total / weights.iter().map(|w| w * w).sum::<f64>();
    let lines: Vec<Vec<Complex64>> = run
        .samples
        .par_iter()
        .flat_map_iter(|samples| orders.iter().map(move |&order| (samples, order)))
        .map(|(samples, order)| weighted.sums(samples, order))
        .collect();
    // Over whole turns of the gear its sidebands cancel: they are no course of the mesh line.
    let block = (1.0 / run.angle.slower_order()).round().max(1.0) as usize;
    let effective = effective / block as f64;
    let misfit = |basis: &Basis, sums: &[Complex64]| {
        let fit = basis.fit(speeds, weights, sums);
        let left: Vec<Complex64> =
            speeds.iter().zip(weights).zip(sums).map(|((s, w), sum)| sum - basis.value(&fit, *s) * *w).collect();
        let of_block = |(left, weights): (&[Complex64], &[f64])| {
            left.iter().sum::<Complex64>().norm_sqr() / weights.iter().sum::<f64>().max(f64::MIN_POSITIVE)
        };
        left.chunks(block).zip(weights.chunks(block)).map(of_block).sum::<f64>() / total
    };
    let criterion = |basis: &Basis| {
        let gain: f64 = lines.iter().map(|sums| effective * misfit(basis, sums).max(f64::MIN_POSITIVE).ln()).sum();
        gain + (basis.len() * lines.len()) as f64 * effective.ln()
    };
    let bases = FUNCTIONS.iter().filter(|n| **n == 1 || **n * TURNS_PER_FUNCTION <= speeds.len());
    bases
        .map(|&n| Basis::of_speeds(speeds, n))
        .map(|basis| (criterion(&basis), basis))
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .map_or_else(Basis::constant, |(_, basis)| basis)
}
