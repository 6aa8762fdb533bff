//! A declared parameter that is off by much more than its tolerance.
//!
//! The templates are the nuisances' own sensitivities without their prior: they gain only what the tolerance forbids,
//! so a parameter within two or three tolerances never competes with an effect. Of first order; always a plain
//! description, never a named effect.

use super::Bench;
use crate::base_fit::TOLERANCES;
use crate::candidate::{Candidate, Claim, Parameter};

/// One candidate per declared parameter.
pub fn candidates(bench: &Bench<'_>) -> Vec<Candidate> {
    TOLERANCES
        .iter()
        .zip(&bench.base.nuisances)
        .map(|((name, _), template)| Candidate {
            name: format!("declared {name} off by more than its tolerance"),
            claim: Claim::Generic,
            family: "mesh-order",
            order: Some(f64::from(bench.base.machine.teeth[0])),
            parameters: vec![Parameter { name: "relative_change".into(), unit: "1", first: 0, complex: false }],
            templates: vec![template.clone()],
            searched: 15.0,
            exponents: [0.0, 1.0],
            ..Candidate::default()
        })
        .collect()
}
