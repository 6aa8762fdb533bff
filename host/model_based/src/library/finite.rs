//! Response of an effect at its own strength, by simulation in time.
//!
//! Most effects are forces or displacements of a linear machine and exactly proportional to their strength. A cracked
//! tooth, a modulated stiffness and contacts carried along their path are not: at a strength that anybody would call
//! a fault the first-order template leaves a few percent, which then passes for another law. Here the declared
//! equations are integrated ([`crate::model::integrated`]) with and without the simulator's own effect, as the
//! hypothesis carries its unknowns to it; the templates are bent so that at the strength `x` they give that
//! difference (a secant). Cost: a time integration per run.

use super::Bench;
use crate::base_fit::TOLERANCES;
use crate::candidate::{Candidate, Template};
use crate::least_squares::Data;
use crate::observation::spectrum::{Bins, Sparse};
use crate::simulation::{Played, simulated};
use rustfft::num_complex::Complex64 as C;
use std::sync::OnceLock;

/// Bins of the difference whose squared size times weight is below this are left out: they carry no information.
pub const LEAST_INFORMATION: f64 = 1e-3;

/// Strong terms found so far, at the strengths fitted: others act on a machine that has them already.
#[derive(Default)]
pub struct Company {
    terms: Vec<(Candidate, Vec<f64>)>,
    alone: OnceLock<Option<Vec<[Bins; 2]>>>,
}

impl Company {
    /// Those of `terms` that were simulated at a strength, with their unknowns.
    pub fn new(terms: &[Candidate], unknowns: &[Vec<f64>]) -> Self {
        let bent = terms.iter().zip(unknowns).filter(|(t, _)| t.bent && !t.phase_free);
        Self { terms: bent.map(|(t, x)| (t.clone(), x.clone())).collect(), alone: OnceLock::new() }
    }

    fn played(&self) -> Vec<Played<'_>> {
        self.terms.iter().map(|(t, x)| (t, x.as_slice())).collect()
    }
}

impl Bench<'_> {
    /// Bins of the declared machine with all of `terms` at once; `None` where they need different starts of the runs,
    /// or one is beyond the simulator's range.
    pub fn simulated(&self, terms: &[Played<'_>]) -> Option<Vec<[Bins; 2]>> {
        let runs: Vec<usize> = (0..self.base.runs.len()).collect();
        simulated(self.base, &[0.0; TOLERANCES.len()], terms, &runs)
    }

    /// The candidate with templates that give the simulated response at the strength `x` on a machine with the
    /// `company`; `None` where they do already.
    pub fn at_strength(&self, candidate: &Candidate, x: &[f64], data: &Data, company: &Company) -> Option<Candidate> {
        if !candidate.bends() {
            return None;
        }
        let square: f64 = x.iter().map(|v| v * v).sum();
        if square == 0.0 || x.iter().any(|v| !v.is_finite()) {
            return None;
        }
        let mut terms = company.played();
        terms.push((candidate, x));
        let together =
            self.simulated(&terms).zip(company.alone.get_or_init(|| self.simulated(&company.played())).as_ref());
        let (with, without) = match together {
            Some((with, without)) => (with, without),
            None => (self.simulated(&[(candidate, x)])?, self.plain()),
        };
        let mut bent = Candidate { bent: true, ..candidate.clone() };
        for r in 0..with.len() {
            for c in 0..2 {
                let mut missing: Vec<C> = with[r][c].iter().zip(&without[r][c]).map(|(a, b)| a - b).collect();
                for (b, value) in missing.iter_mut().enumerate() {
                    if value.norm_sqr() * data.weight[r][c][b] < LEAST_INFORMATION {
                        *value = C::ZERO;
                    }
                }
                for (template, value) in candidate.templates.iter().zip(x) {
                    template.runs[r][c].iter().for_each(|(b, t)| missing[b] -= t * value);
                }
                for (template, value) in bent.templates.iter_mut().zip(x) {
                    add(template, r, c, &missing, value / square);
                }
            }
        }
        Some(bent)
    }

    /// Bins of the declared machine integrated in time.
    pub fn plain(&self) -> &Vec<[Bins; 2]> {
        self.plain.get_or_init(|| self.simulated(&[]).expect("nothing to disagree on"))
    }
}

/// Adds `factor` times dense `bins` to one part of a template.
fn add(template: &mut Template, run: usize, channel: usize, bins: &[C], factor: f64) {
    let mut dense: Vec<C> = bins.iter().map(|x| x * factor).collect();
    template.runs[run][channel].iter().for_each(|(b, t)| dense[b] += t);
    std::sync::Arc::make_mut(&mut template.runs[run])[channel] = Sparse::of(&dense);
}
