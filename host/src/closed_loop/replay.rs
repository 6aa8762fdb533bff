//! Residual spectra before and after, rebuilt from an outcome.
//!
//! The outcome states parameter changes and effects; the same declared changes are adopted, the effects' templates are built again and their
//! strengths solved on the runs that the loop used. So pictures and band levels need nothing but record and outcome, and show it if
//! the stated effects did not lower the residual.

use super::base_fit::{Base, TOLERANCES};
use super::candidate::Candidate;
use super::detect::Found;
use super::input::Record;
use super::least_squares::{Column, Data, normal, solve, subtract};
use super::library::Bench;
use super::outcome::{Effect, Outcome};
use super::spectrum::Bins;

/// Residuals of both models.
pub struct Replay {
    /// Declared machine.
    pub declared: Base,
    /// Machine with the adopted parameters.
    pub fitted: Base,
    /// Residual per run and channel, declared machine.
    pub before: Vec<[Bins; 2]>,
    /// Residual per run and channel, adopted parameters and effects.
    pub after: Vec<[Bins; 2]>,
    /// Effects of the outcome whose templates could not be built again.
    pub missing: Vec<String>,
}

fn matches(effect: &Effect, candidate: &Candidate) -> bool {
    let near = |a: Option<f64>, b: Option<f64>, tolerance: f64| match (a, b) {
        (Some(a), Some(b)) => (a - b).abs() < tolerance,
        (None, None) => true,
        _ => false,
    };
    effect.name.contains(&candidate.name)
        && near(effect.order_of_pinion, candidate.order, 0.02)
        && near(effect.frequency_hz, candidate.frequency_hz, 0.3)
        && candidate.parameters.iter().all(|p| effect.parameters.contains_key(&p.name))
}

/// Rebuilds both residuals of every run.
pub fn replay(record: &Record, outcome: &Outcome) -> Replay {
    let declared = Base::new(record);
    let mut fitted = Base::new(record);
    let delta: Vec<f64> = TOLERANCES
        .iter()
        .map(|(name, _)| outcome.declared_parameter_changes.get(*name).copied().unwrap_or(0.0))
        .collect();
    fitted.adopt(&delta);
    let before = declared.data().residual;
    let found = |at: f64| Found { at, statistic: 0.0, p_value: 0.0 };
    let orders: Vec<Found> = outcome.effects.iter().filter_map(|e| e.order_of_pinion).map(found).collect();
    let frequencies: Vec<Found> = outcome.effects.iter().filter_map(|e| e.frequency_hz).map(found).collect();
    let data = fitted.data();
    let (mut chosen, mut missing) = (Vec::new(), Vec::new());
    if !outcome.effects.is_empty() {
        let bench = Bench::new(&fitted);
        let candidates = bench.candidates(&data, &outcome.split[0], &orders, &frequencies);
        for effect in &outcome.effects {
            let best = candidates.iter().filter(|c| matches(effect, c)).max_by_key(|c| c.name.len());
            match best {
                Some(candidate) => chosen.push(candidate.clone()),
                None => missing.push(effect.name.clone()),
            }
        }
    }
    let seen: Vec<usize> = outcome.split[0].iter().chain(&outcome.split[1]).copied().collect();
    let after = corrected(&fitted, data, &chosen, &seen);
    Replay { declared, fitted, before, after, missing }
}

fn corrected(base: &Base, data: Data, terms: &[Candidate], seen: &[usize]) -> Vec<[Bins; 2]> {
    let free = |template| Column { template, prior: (0.0, 0.0) };
    let mut columns = base.columns();
    for term in terms {
        columns.extend(term.templates.iter().map(free));
    }
    let mut x: Vec<f64> = solve(&normal(&data, seen, &columns)).x.iter().copied().collect();
    // Angle offsets of runs come from the tachometer alone in any prediction.
    x[TOLERANCES.len()..base.nuisances.len()].fill(0.0);
    let mut at = base.nuisances.len();
    for term in terms {
        if term.phase_free {
            for r in (0..base.runs.len()).filter(|r| !seen.contains(r)) {
                let own = [2 * r, 2 * r + 1].map(|i| free(&term.templates[i]));
                let n = normal(&data, &[r], &own);
                let energy = n.gram[(0, 0)].max(1e-300);
                x[at + 2 * r] = n.right[0] / energy;
                x[at + 2 * r + 1] = n.right[1] / energy;
            }
        }
        at += term.templates.len();
    }
    let mut rest = data;
    subtract(&mut rest, &columns, &x);
    rest.residual
}
