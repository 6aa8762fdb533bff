//! The unknowns of terms within a fit of everything.

use super::base_fit::Base;
use super::candidate::Candidate;
use super::judge::joint;
use super::least_squares::Data;

/// The unknowns of every term within all unknowns of a fit, `x`.
pub fn unknowns(base: &Base, terms: &[Candidate], x: &[f64]) -> Vec<Vec<f64>> {
    let mut at = base.nuisances.len();
    terms
        .iter()
        .map(|t| {
            let own = at..at + t.templates.len();
            at = own.end;
            x[own].to_vec()
        })
        .collect()
}

/// The unknowns of every term, fitted over the runs `seen`.
pub fn fitted(base: &Base, data: &Data, seen: &[usize], terms: &[Candidate]) -> Vec<Vec<f64>> {
    let all: Vec<&Candidate> = terms.iter().collect();
    unknowns(base, terms, &joint(base, data, seen, &all).x)
}
