//! What lies outside the named lines: an upper bound for any model that has just these lines.
//!
//! No amplitude is predicted here. The power of the record itself on the turns not used, up to the highest order, is
//! parted into the bins within a Hann window's main lobe of a mesh harmonic or of a line that stands on the fitted
//! turns (a bearing's where it has slipped to), and the rest. The control moves the spacing of every nonsynchronous
//! family by 1 to 6 % and chooses its lines by the same rule; what lies at real lines is not counted for it.

use super::accept;
use super::bearing_slip;
use super::candidate::Domain;
use super::nonsynchronous::orders;
use super::residual_spectra::Views;
use super::scene::Scene;
use super::search::Adopted;
use super::spectra::Spectra;
use rayon::prelude::*;
use serde::Serialize;

/// Bins on each side of a line: half the main lobe of a Hann window.
const LOBE: usize = 2;

/// Of one channel, meaned over runs.
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub struct NamedLines {
    /// Share of the held-out power outside mesh harmonics and named lines.
    pub outside: f64,
    /// Share of the bins that they cover.
    pub covered: f64,
    /// Share of the power that surrogates of the nonsynchronous families take: median and largest.
    pub control: [f64; 2],
}

/// Which bins are spoken for.
fn mask(orders: &[f64], bin: f64, count: usize) -> Vec<bool> {
    let mut mask = vec![false; count];
    for order in orders {
        let centre = (order / bin).round() as usize;
        for taken in mask.iter_mut().take(centre + LOBE + 1).skip(centre.saturating_sub(LOBE)) {
            *taken = true;
        }
    }
    mask
}

/// Share of a spectrum's sum at the bins that `at` chooses.
fn share(values: &[f64], at: impl Fn(usize) -> bool) -> f64 {
    let sum: f64 = values.iter().enumerate().filter(|(i, _)| at(*i)).map(|(_, v)| v).sum();
    sum / values.iter().sum::<f64>().max(f64::MIN_POSITIVE)
}

/// Channel by channel; `held` are spectra of the record itself on the held-out turns, `views` those that families
/// were found on, and of the turns not used.
pub fn of(scene: &Scene, held: &Spectra, views: [&Views; 2], adopted: &[&Adopted]) -> Vec<NamedLines> {
    let over_orders = |own: &&&Adopted| own.candidate.domain == Domain::Orders;
    let excluded = bearing_slip::excluded(adopted, scene, views[1]);
    let lines = |moved: f64, all: bool| -> Vec<f64> {
        let chosen = adopted.iter().filter(over_orders).filter(|own| all || !own.candidate.locked);
        chosen.flat_map(|own| orders(own, views, scene, moved, &excluded)).map(|order| order[1]).collect()
    };
    let mut named = [vec![0.0], scene.mesh_lines()].concat();
    named.extend(lines(0.0, true));
    let copies: Vec<Vec<f64>> = accept::displacements().map(|moved| lines(moved, false)).collect();
    let of_channel = |c: usize| -> NamedLines {
        let runs = scene.runs.len().max(1) as f64;
        let (mut sum, mut taken) = (NamedLines::default(), vec![0.0; copies.len()]);
        for run in &held.levels {
            let Some(level) = run[c].first() else { continue };
            let bin = level.density.bin;
            let values = &level.density.values[..((held.highest / bin) as usize).min(level.density.values.len())];
            let real = mask(&named, bin, values.len());
            sum.outside += share(values, |i| !real[i]) / runs;
            sum.covered += real.iter().filter(|r| **r).count() as f64 / real.len().max(1) as f64 / runs;
            for (taken, copy) in taken.iter_mut().zip(&copies) {
                let moved = mask(copy, bin, values.len());
                *taken += share(values, |i| moved[i] && !real[i]) / runs;
            }
        }
        taken.sort_by(f64::total_cmp);
        sum.control = [taken[taken.len() / 2], taken[taken.len() - 1]];
        sum
    };
    (0..scene.channels.len()).into_par_iter().map(of_channel).collect()
}
