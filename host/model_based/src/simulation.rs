//! The machine with all of some terms at once, simulated on every run: what a fit is compared with in the end.
//!
//! Every term becomes the simulator's own effects, as its hypothesis carries its unknowns to them
//! ([`crate::effects::hypothesis`]), so that what is compared is what `loop --apply` writes. Cost: an integration of
//! every run ([`crate::model::integrated`]).

use super::base_fit::{Base, RunState, TOLERANCES};
use super::candidate::Candidate;
use super::start::Start;
use super::waveform::complete;
use crate::dynamics::Effect;
use crate::effects::of_table;
use crate::model::harmonic_balance::Machine;
use crate::model::integrated::{Integrated, Point, Run};
use crate::observation::spectrum::Bins;
use rayon::prelude::*;
use std::f64::consts::TAU;

/// A term at its unknowns, to be simulated.
pub type Played<'c> = (&'c Candidate, &'c [f64]);

/// Everything that one prediction of a run is made of.
struct Scene {
    effects: Vec<Box<dyn Effect>>,
    at: Point,
}

/// The simulator's effects of a candidate at the unknowns `x`, `turned_rad` later than they say; `None` where it has
/// no counterpart.
fn effects(machine: &Machine, candidate: &Candidate, x: &[f64], turned_rad: f64) -> Option<Vec<Box<dyn Effect>>> {
    let facts = machine.facts(0.0);
    let complex = candidate.parameters.first().is_some_and(|p| p.complex);
    let (size, phase_rad) = match x {
        [a, b, ..] if complex => (a.hypot(*b), b.atan2(*a) + turned_rad),
        _ => (*x.first()?, turned_rad),
    };
    let parts = candidate.parts(x);
    let carried = (candidate.hypothesis?.carry)(&candidate.fitted(&facts, (size, phase_rad), &parts))?;
    carried.tables.iter().map(|table| of_table(table).ok()).collect()
}

/// Whether the simulator has the candidate, at the unknowns `x`, with a phase that holds for all runs.
pub fn has_counterpart(base: &Base, candidate: &Candidate, x: &[f64]) -> bool {
    !candidate.phase_free && effects(&base.machine, candidate, x, 0.0).is_some()
}

/// Turns of the pinion by which every run starts later, as the terms agree on; `Err` where they do not, or where one
/// has no such place.
fn common_turns<'t>(terms: &[Played<'t>]) -> Result<Option<&'t [u32]>, ()> {
    let turns = terms.iter().find_map(|(t, _)| t.start.turns());
    // Teeth of the gear that were counted as if every run started in the first turn have no other place.
    let counted = |t: &Candidate| t.start == Start::Counted && t.tooth.is_some() && t.body() == 1;
    let differs = |t: &Candidate| t.start.turns().is_some_and(|own| Some(own) != turns);
    match terms.iter().any(|(t, _)| differs(t) || turns.is_some() && counted(t)) {
        true => Err(()),
        false => Ok(turns),
    }
}

/// Bins of `runs`, the others empty: see [`signals`].
pub fn simulated(base: &Base, delta: &[f64], terms: &[Played<'_>], runs: &[usize]) -> Option<Vec<[Bins; 2]>> {
    signals(base, delta, terms, runs).map(|signals| bins(base, &signals))
}

/// Bins of signals.
pub fn bins(base: &Base, signals: &[[Vec<f64>; 2]]) -> Vec<[Bins; 2]> {
    let of = |signal: &Vec<f64>| if signal.is_empty() { Bins::new() } else { base.analyser.bins_of(signal) };
    signals.par_iter().map(|run| run.each_ref().map(of)).collect()
}

/// Finds what the table's roughness adds to the signals: the lines of the machine as it stands less what the simulation
/// of the table's pieces gives. Nothing where the pieces stand for the table.
pub fn find_roughness(base: &mut Base) {
    base.roughness = Vec::new();
    if base.is_close {
        return;
    }
    let runs: Vec<usize> = (0..base.runs.len()).collect();
    let Some(smooth) = signals(base, &[0.0; TOLERANCES.len()], &[], &runs) else { return };
    let of = |(run, smooth): (&RunState, [Vec<f64>; 2])| {
        let mut rough = complete(&base.analyser, run);
        for (rough, smooth) in rough.iter_mut().zip(&smooth) {
            rough.iter_mut().zip(smooth).for_each(|(x, y)| *x -= y);
        }
        rough
    };
    base.roughness = base.runs.par_iter().zip(smooth).map(of).collect();
}

/// Signals of `runs`, the others empty, of the machine of `base` with its parameters moved by `delta` and with all of
/// `terms`; `None` where the terms need different starts of the runs, or one is beyond the simulator's range.
pub fn signals(base: &Base, delta: &[f64], terms: &[Played<'_>], runs: &[usize]) -> Option<Vec<[Vec<f64>; 2]>> {
    let (machine, torque) = base.moved(delta);
    let turns = common_turns(terms).ok()?;
    let scene = |run: usize| -> Option<Scene> {
        let later = turns.map_or(0.0, |turns| f64::from(turns[run]));
        let of = |(term, x): &Played<'_>| {
            // Whole turns move the start of the run for all; what does not turn with them is moved back.
            let back = -TAU * (term.order.unwrap_or(0.0) * later).fract();
            let turned_rad = match &term.start {
                Start::Phases(phases) => phases[run] + back,
                Start::Counted => back,
                Start::Turns(_) | Start::Given(_) => 0.0,
            };
            effects(&machine, term, x, turned_rad)
        };
        let effects = terms.iter().map(of).collect::<Option<Vec<_>>>()?.into_iter().flatten().collect();
        let own = &base.runs[run];
        let start_rad = own.angle.offset_rad + TAU * later;
        let at = Point { start_rad, speed_hz: own.angle.shaft_hz, torque_n_m: own.torque_n_m * torque };
        Some(Scene { effects, at })
    };
    let scenes = runs.iter().map(|&run| scene(run)).collect::<Option<Vec<_>>>()?;
    let integrated = Integrated::new(&machine, base.stiffness(delta));
    let analyser = &base.analyser;
    let of = |(scene, &run): (&Scene, &usize)| {
        let beyond = base.roughness.get(run).map_or(&[][..], |rough| &rough[..]);
        let taken = Run { effects: &scene.effects, at: scene.at };
        let signals = integrated.run(&taken, beyond, analyser.samples, analyser.rate_hz);
        signals.ok().map(|signals| (run, signals))
    };
    let done = scenes.par_iter().zip(runs).map(of).collect::<Option<Vec<_>>>()?;
    let mut all = vec![<[Vec<f64>; 2]>::default(); base.runs.len()];
    done.into_iter().for_each(|(run, signals)| all[run] = signals);
    Some(all)
}
