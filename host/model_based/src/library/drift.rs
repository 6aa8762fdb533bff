//! Stiffness of all pairs changing linearly over the run.
//!
//! The machine follows at once, as its memory is short beside a run: its lines' derivative by the stiffness, times
//! the time since the first sample. Of first order; at its own strength it is simulated. Cost: two steady states and
//! a waveform per run.

use super::Responses;
use crate::candidate::{Candidate, Claim, Parameter, Template};
use crate::effects::hypotheses;
use crate::effects::hypothesis::Seat;
use crate::model::forward::{ForwardModel, Line, Operating};
use crate::observation::spectrum::Sparse;
use crate::waveform::at_straight_line;
use rayon::prelude::*;

/// Change of the stiffness, as a share, for a derivative.
const STEP: f64 = 1e-3;

/// The candidate.
pub fn candidate(bench: &Responses<'_>) -> Candidate {
    let base = bench.base;
    let hypothesis = hypotheses().find(|h| matches!(h.seats, [Seat::MeshDrift])).expect("an effect lets it drift");
    let moved = [STEP, -STEP].map(|step| {
        let mut delta = vec![0.0; crate::base_fit::TOLERANCES.len()];
        delta[0] = step;
        base.moved(&delta)
    });
    let runs: Vec<[Sparse; 2]> = base
        .runs
        .par_iter()
        .map(|run| {
            let lines = moved.each_ref().map(|(machine, torque)| {
                let at = Operating { shaft_hz: run.angle.shaft_hz, torque_n_m: run.torque_n_m * torque };
                let own = machine.run(at);
                own.solution.within(machine.harmonics(at.shaft_hz) as usize).lines
            });
            let [up, down] = &lines;
            let slope: Vec<Line> = up
                .iter()
                .zip(down)
                .map(|(a, b)| {
                    let of = |c: usize| (a.amplitude[c] - b.amplitude[c]) / (2.0 * STEP);
                    Line { order: a.order, amplitude: [of(0), of(1)] }
                })
                .collect();
            let analyser = &base.analyser;
            at_straight_line(analyser, run, &slope).map(|signal| {
                let later: Vec<f64> = signal.iter().enumerate().map(|(i, x)| x * i as f64 / analyser.rate_hz).collect();
                Sparse::of(&analyser.bins_of(&later))
            })
        })
        .collect();
    Candidate {
        name: hypothesis.name.into(),
        plain: Some(hypothesis.plain.into()),
        claim: Claim::Named,
        family: "non-stationary",
        parameters: vec![Parameter {
            name: hypothesis.quantity.into(),
            unit: hypothesis.unit,
            first: 0,
            complex: false,
        }],
        templates: vec![Template::new(runs)],
        searched: 2.0,
        exponents: [0.0, 1.0],
        hypothesis: Some(hypothesis),
        seat: Some(Seat::MeshDrift),
        ..Candidate::default()
    }
}
