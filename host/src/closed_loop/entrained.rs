//! What the declared parameters do to the responses of the effects found.
//!
//! A force reaches a sensor through the same masses, bearings and couplings that are declared within tolerance only: with 3 % open of a coupling's stiffness, a ripple's
//! response near that coupling's mode is open by many times that. A fit whose sensitivities are those of the mesh's vibration alone knows nothing of this, gives such a strength too
//! narrow an interval, and has no use for what the effect's lines say of the parameters. So, once the effects are known, each parameter's
//! sensitivity gets the share of the effects' responses at their fitted strength: one step of Gauss and Newton in strengths and parameters together.
//!
//! Cost: one comb per effect, run and parameter. Limits: sinusoids at an order (forces, displacements, stiffnesses) and what every pair has, to first order in their strength; single
//! teeth and the path keep the sensitivities of the machine alone.

use super::base_fit::{Base, TOLERANCES};
use super::candidate::{Candidate, Template};
use super::library::{Responses, mesh, order};
use crate::observation::spectrum::Sparse;

/// Change of a parameter for a derivative, as a share of its tolerance.
const STEP: f64 = 0.1;

/// Adds to the sensitivities of `base` what its parameters do to `accepted` at their `unknowns`.
pub fn entrain(base: &mut Base, accepted: &[Candidate], unknowns: &[Vec<f64>]) {
    let here = Responses::new(base);
    let waves: Vec<(Candidate, &Candidate, &[f64])> =
        accepted.iter().zip(unknowns).filter_map(|(term, x)| Some((on(&here, term)?, term, x.as_slice()))).collect();
    if waves.is_empty() {
        return;
    }
    let mut nuisances = base.nuisances.clone();
    for (parameter, (_, tolerance)) in TOLERANCES.iter().enumerate() {
        let mut delta = vec![0.0; TOLERANCES.len()];
        delta[parameter] = STEP * tolerance;
        let moved = base.alone(base.tried(&delta, 0.0));
        let there = Responses::new(&moved);
        for (first, term, x) in &waves {
            let Some(second) = on(&there, term) else { continue };
            for ((a, b), x) in first.templates.iter().zip(&second.templates).zip(*x) {
                nuisances[parameter].add(a, -x / delta[parameter]);
                nuisances[parameter].add(b, x / delta[parameter]);
            }
        }
    }
    base.nuisances = nuisances;
}

/// The first-order response of this machine to the same effect, where it is one of those that are taken along.
fn on(machine: &Responses<'_>, term: &Candidate) -> Option<Candidate> {
    order::on(machine, term).or_else(|| mesh::on(machine, term))
}

impl Template {
    /// Adds `factor` times `other`.
    fn add(&mut self, other: &Self, factor: f64) {
        let sum =
            |own: &[Sparse; 2], other: &[Sparse; 2]| [0, 1].map(|c| Sparse::mixed(&own[c], 1.0, &other[c], factor));
        *self = Self::new(self.runs.iter().zip(&other.runs).map(|(own, other)| sum(own, other)));
    }
}
