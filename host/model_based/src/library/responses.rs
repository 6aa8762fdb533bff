//! The machine on every run of a record, asked for its response to small excitations.

use crate::base_fit::{Base, RunState};
use crate::model::forward::Line;
use crate::model::harmonic_balance::{Comb, DOF};
use rayon::prelude::*;
use rustfft::num_complex::Complex64 as C;

/// Ratio of the largest to the smallest torque from which what goes with torque is told from what does not.
const LEAST_TORQUE_RATIO: f64 = 1.05;

/// Excitation of one comb: generalised forces and extra contact force, both per order.
pub type Excitation = (Vec<[C; DOF]>, Vec<C>);

/// The machine on every run.
pub struct Responses<'a> {
    /// Model and spectra.
    pub base: &'a Base,
    /// Angle offset and shaft frequency per run.
    pub angles: Vec<(f64, f64)>,
}

impl<'a> Responses<'a> {
    /// Of the runs of `base`.
    pub fn new(base: &'a Base) -> Self {
        Self { base, angles: base.runs.iter().map(|r| (r.angle.offset_rad, r.angle.shaft_hz)).collect() }
    }

    /// Teeth ratio: order of the gear's rotation per pinion turn.
    pub fn ratio(&self) -> f64 {
        f64::from(self.base.machine.teeth[0]) / f64::from(self.base.machine.teeth[1])
    }

    /// Whether the runs' torques differ by enough to tell what goes with torque from what does not.
    pub fn torques_differ(&self) -> bool {
        let torques = || self.base.runs.iter().map(|run| run.torque_n_m.abs());
        torques().fold(0.0, f64::max) > LEAST_TORQUE_RATIO * torques().fold(f64::INFINITY, f64::min)
    }

    /// Response lines of several excitations on the comb with the given centre order (per run): `[excitation][run]`.
    pub fn respond(
        &self,
        centre: impl Fn(&RunState) -> f64 + Sync,
        excite: impl Fn(&RunState, &Comb) -> Vec<Excitation> + Sync,
    ) -> Vec<Vec<Vec<Line>>> {
        let per_run: Vec<Vec<Vec<Line>>> = self
            .base
            .runs
            .par_iter()
            .map(|run| {
                let machine = &self.base.machine;
                let comb = machine.comb(centre(run), run.angle.shaft_hz);
                excite(run, &comb).iter().map(|(f, g)| machine.respond(&comb, f, g).lines).collect()
            })
            .collect();
        let count = per_run.first().map_or(0, Vec::len);
        (0..count).map(|e| per_run.iter().map(|run| run[e].clone()).collect()).collect()
    }
}
