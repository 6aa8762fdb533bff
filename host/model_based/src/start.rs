//! Where a run starts in the hunting period, which a tachometer on the pinion cannot tell.
//!
//! Its edges give the pinion's angle up to whole turns. Started `k` turns later, an effect at order `o` of the pinion
//! stands at a phase turned by `2 pi o k`: nothing for the pinion's and the mesh's orders, one of
//! `N = z2 / gcd(z1, z2)` phases (and teeth) for the gear's, and any phase for an order of neither shaft, such as a
//! bearing's. These turns are unknowns of the record, not of the law.
//!
//! They are found by a matched filter: runs, strongest first, are turned to where they agree best with the sum of
//! those already turned. The price is that of a search, `ln N` nats for each run after the first; a free phase is an
//! unknown of its run. Where all runs start within one turn the effect is also tried as counted, at no price. Cost:
//! nothing beside the products with the residual, which turn with the phase. Limit: what the residual gives is taken
//! after the declared parameters have had their share.

use crate::machine::Hunting;
use rustfft::num_complex::Complex64 as C;
use std::f64::consts::TAU;

/// Sweeps over the runs after which turns that still change are left as they are.
const MOST_SWEEPS: usize = 6;

/// Start of every run, as far as an effect depends on it.
#[derive(Debug, Clone, Default, PartialEq)]
pub enum Start {
    /// As counted from pulse 0 of every run.
    #[default]
    Counted,
    /// This many turns of the pinion later, by run; relative to the first run.
    Turns(Vec<u32>),
    /// The same, known from an effect found before.
    Given(Vec<u32>),
    /// At an order of neither shaft: phase of every run, rad, relative to the first run.
    Phases(Vec<f64>),
}

impl Start {
    /// What it turns an effect at `order` of the pinion by, rad.
    pub fn phase_rad(&self, run: usize, order: f64) -> f64 {
        match self {
            Self::Counted => 0.0,
            Self::Turns(turns) | Self::Given(turns) => TAU * (order * f64::from(turns[run])).fract(),
            Self::Phases(phases) => phases[run],
        }
    }

    /// Turns of the pinion by run, where they are known.
    pub fn turns(&self) -> Option<&[u32]> {
        match self {
            Self::Turns(turns) | Self::Given(turns) => Some(turns),
            Self::Counted | Self::Phases(_) => None,
        }
    }

    /// Logarithm of the number of starts tried, for each run after the first.
    pub fn nats_per_run(&self, hunting: Hunting) -> f64 {
        match self {
            Self::Counted | Self::Given(_) | Self::Phases(_) => 0.0,
            Self::Turns(_) => f64::from(hunting.turns).ln(),
        }
    }

    /// Unknowns fitted, for each run after the first.
    pub fn unknowns_per_run(&self) -> f64 {
        if matches!(self, Self::Phases(_)) { 1.0 } else { 0.0 }
    }
}

/// Products of one run's residual with the quadrature pairs of an effect (real part: cosine), and the pairs' energies.
pub struct Products {
    /// Per pair.
    pub right: Vec<C>,
    /// Per pair.
    pub energy: Vec<f64>,
}

/// Phases by which the runs of an effect with one pair agree; the first run's is zero.
pub fn phases(runs: &[Products]) -> Start {
    let own = |p: &Products| p.right[0].arg();
    Start::Phases(runs.iter().map(|p| own(p) - own(&runs[0])).collect())
}

/// Turns of the pinion by which the runs of an effect of the gear agree, found on `seen`; each other run follows on
/// its own.
pub fn turns(runs: &[Products], orders: &[f64], seen: &[usize], hunting: Hunting) -> Start {
    let back: Vec<Vec<C>> = (0..hunting.turns)
        .map(|k| orders.iter().map(|o| C::cis(-TAU * (o * f64::from(k)).fract())).collect())
        .collect();
    let strength = |r: usize| -> f64 {
        runs[r].right.iter().zip(&runs[r].energy).map(|(x, e)| x.norm_sqr() / e.max(1e-300)).sum()
    };
    let mut order = seen.to_vec();
    order.sort_by(|&a, &b| strength(b).total_cmp(&strength(a)));
    let mut sum = vec![(C::ZERO, 0.0); orders.len()];
    let mut start: Vec<Option<u32>> = vec![None; runs.len()];
    let add = |sum: &mut [(C, f64)], r: usize, k: u32, sign: f64| {
        for (j, (x, energy)) in sum.iter_mut().enumerate() {
            *x += runs[r].right[j] * back[k as usize][j] * sign;
            *energy += sign * runs[r].energy[j];
        }
    };
    let best = |sum: &[(C, f64)], r: usize| -> u32 {
        let agreement = |k: u32| -> f64 {
            let parts = sum.iter().zip(&runs[r].right).zip(&back[k as usize]);
            parts.map(|(((x, energy), own), turn)| (x.conj() * own * turn).re / energy.max(1e-300)).sum()
        };
        let all = (0..hunting.turns).map(|k| (k, agreement(k)));
        all.fold((0, f64::NEG_INFINITY), |top, next| if next.1 > top.1 { next } else { top }).0
    };
    for _ in 0..MOST_SWEEPS {
        let before = start.clone();
        for &r in &order {
            if let Some(k) = start[r] {
                add(&mut sum, r, k, -1.0);
            }
            let k = best(&sum, r);
            start[r] = Some(k);
            add(&mut sum, r, k, 1.0);
        }
        if start == before {
            break;
        }
    }
    relative((0..runs.len()).map(|r| start[r].unwrap_or_else(|| best(&sum, r))).collect(), hunting)
}

/// The same turns with the first run's as zero.
pub fn relative(turns: Vec<u32>, hunting: Hunting) -> Start {
    let first = turns[0];
    Start::Turns(turns.into_iter().map(|k| (k + hunting.turns - first) % hunting.turns).collect())
}
