//! Response of an effect at its own strength, by simulation in time.
//!
//! Most effects are forces or displacements of a linear machine and exactly proportional to their strength. A cracked
//! tooth, a modulated stiffness and contacts carried along their path are not: at a strength that anybody would call
//! a fault the first-order template leaves a few percent, which then passes for another law. Here the declared
//! equations are integrated ([`crate::model::fixed_step`]) with and without the simulator's own effect, as the
//! hypothesis carries its unknowns to it; the templates are bent so that at the strength `x` they give that
//! difference (a secant). Cost: a time integration per run.

use super::Bench;
use crate::candidate::{Candidate, Template, Tuning};
use crate::dynamics::Effect;
use crate::effects::hypothesis::Fitted;
use crate::effects::of_table;
use crate::least_squares::Data;
use crate::model::fixed_step::{Point, Run, of_runs};
use crate::model::harmonic_balance::Machine;
use crate::observation::spectrum::{Bins, Sparse};
use crate::start::Start;
use rayon::prelude::*;
use rustfft::num_complex::Complex64 as C;
use std::f64::consts::TAU;
use std::sync::OnceLock;

/// Bins of the difference whose squared size times weight is below this are left out: they carry no information.
pub const LEAST_INFORMATION: f64 = 1e-3;

/// The simulator's effects of a candidate at the unknowns `x`, `turned_rad` later than they say; `None` where it has
/// no counterpart.
fn effects(machine: &Machine, candidate: &Candidate, x: &[f64], turned_rad: f64) -> Option<Vec<Box<dyn Effect>>> {
    let facts = machine.facts(0.0);
    let complex = candidate.parameters.first().is_some_and(|p| p.complex);
    let (size, phase_rad) = match x {
        [a, b, ..] if complex => (a.hypot(*b), b.atan2(*a) + turned_rad),
        _ => (*x.first()?, turned_rad),
    };
    let part = |i: usize| x.get(i).copied().unwrap_or(0.0);
    let parts: Vec<[f64; 2]> =
        candidate.parameters.iter().map(|p| [part(p.first), if p.complex { part(p.first + 1) } else { 0.0 }]).collect();
    let fitted = Fitted {
        teeth: facts.teeth,
        pressure_angle_rad: facts.pressure_angle_rad,
        base_pitch_m: facts.base_pitch_m,
        body: candidate.body(),
        order: candidate.order,
        frequency_hz: candidate.frequency_hz,
        size,
        phase_rad,
        tooth: candidate.tooth,
        torque_exponent: candidate.exponents[1],
        parts: &parts,
        channel: 2.0,
        channel_share: [1.0; 2],
        shape: match candidate.tuning {
            Some(Tuning::Relief { share, exponent }) => [share, f64::from(exponent)],
            _ => [0.0; 2],
        },
    };
    let carried = (candidate.hypothesis?.carry)(&fitted)?;
    carried.tables.iter().map(|table| of_table(table).ok()).collect()
}

/// A term at a strength, to be simulated.
pub type Played<'c> = (&'c Candidate, &'c [f64]);

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
        let base = self.base;
        let machine = &base.machine;
        let turns = terms.iter().find_map(|(t, _)| t.start.turns());
        if terms.iter().any(|(t, _)| t.start.turns().is_some_and(|own| Some(own) != turns)) {
            return None;
        }
        let later = |run: usize| turns.map_or(0, |turns| turns[run]);
        // Teeth of the gear that were counted as if every run started in the first turn have no other place.
        let counted = |t: &Candidate| t.start == Start::Counted && t.tooth.is_some() && t.body() == 1;
        if turns.is_some() && terms.iter().any(|(t, _)| counted(t)) {
            return None;
        }
        let effects = |run: usize| -> Option<Vec<Box<dyn Effect>>> {
            let of = |(term, x): &Played<'_>| {
                // Whole turns move the start of the run for all; what does not turn with them is moved back.
                let order = term.order.unwrap_or(0.0);
                let back = -TAU * (order * f64::from(later(run))).fract();
                let turned_rad = match &term.start {
                    Start::Phases(phases) => phases[run] + back,
                    Start::Counted => back,
                    Start::Turns(_) | Start::Given(_) => 0.0,
                };
                effects(machine, term, x, turned_rad)
            };
            Some(terms.iter().map(of).collect::<Option<Vec<_>>>()?.into_iter().flatten().collect())
        };
        let points = base.runs.iter().enumerate().map(|(r, run)| Point {
            start_rad: run.angle.offset_rad + TAU * f64::from(later(r)),
            speed_hz: run.angle.shaft_hz,
            torque_n_m: run.torque_n_m * (1.0 + base.change[14]),
        });
        let effects = (0..base.runs.len()).map(effects).collect::<Option<Vec<_>>>()?;
        let runs: Vec<Run<'_>> = effects.iter().zip(points).map(|(effects, at)| Run { effects, at }).collect();
        let signals = of_runs(machine, &runs, base.analyser.samples, base.analyser.rate_hz);
        Some(signals.into_par_iter().map(|signals| signals.map(|signal| base.analyser.bins_of(&signal))).collect())
    }

    /// Whether the simulator has the candidate, at the unknowns `x`.
    pub fn has_counterpart(&self, candidate: &Candidate, x: &[f64]) -> bool {
        effects(&self.base.machine, candidate, x, 0.0).is_some()
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
