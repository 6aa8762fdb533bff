//! What a run will cost, estimated before it is integrated.
//!
//! The steps of the solver are bound by three things: the highest natural frequency or decay rate (a Taylor step of
//! this order reaches about eight of their radians), the breaks of the stiffness curve that pass through the mesh,
//! and the longest step. A machine whose natural frequencies or decay rates lie far beyond the sampling rate is no
//! machine seen by that record but a slip of a decimal, and would take for ever.

use super::assembly::System;
use super::kinematics::Motion;
use super::rig::Rig;
use crate::Result;
use crate::budget::{EDGES, NATURAL_FREQUENCY, SAMPLES, SHAFT, STEPS};
use nalgebra::{DMatrix, SymmetricEigen};
use std::f64::consts::TAU;

/// Radians of the fastest motion that one step covers.
const RADIANS_PER_STEP: f64 = 8.0;

/// Cost of a run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Work {
    /// Integration steps.
    pub steps: f64,
    /// Highest natural frequency at the stiffest mesh or decay rate over 2 pi, Hz.
    pub highest_hz: f64,
    /// Fastest shaft, turns per second; between two tach edges, too.
    pub shaft_hz: f64,
}

impl Work {
    /// Refuses what is beyond the [`crate::budget`].
    ///
    /// # Errors
    /// One line with the figure and the limit.
    pub fn check(&self) -> Result<()> {
        SHAFT.check("speed", self.shaft_hz, "check speeds, tach edges and pulses per turn")?;
        STEPS.check("simulation", self.steps, "shorten the run, or check inertias, masses, stiffnesses and damping")
    }

    /// Refuses a machine that is none for this sampling rate.
    ///
    /// # Errors
    /// One line with the frequency's ratio to the rate.
    pub fn check_against(&self, rate_hz: f64) -> Result<()> {
        let what = "highest natural frequency or decay rate";
        let place = format!("{what} {:.3e} Hz at a sampling rate of {rate_hz} Hz", self.highest_hz);
        NATURAL_FREQUENCY.check(place, self.highest_hz / rate_hz, "check inertias, masses, stiffnesses and damping")
    }
}

/// Refuses more samples than a command may hold, all runs and both channels together.
///
/// # Errors
/// One line with the figure and the limit.
pub fn check_samples(rate_hz: f64, duration_s: f64, runs: usize) -> Result<()> {
    let samples = 2.0 * rate_hz * duration_s * runs as f64;
    SAMPLES.check("--duration and --rate", samples, "shorten the runs, lower the rate, or make fewer runs")
}

/// Refuses more tach edges than a run may have.
///
/// # Errors
/// One line with the figure and the limit.
pub fn check_edges(shaft_hz: f64, pulses_per_turn: u32, duration_s: f64) -> Result<()> {
    let edges = shaft_hz * f64::from(pulses_per_turn) * duration_s;
    EDGES.check("--pulses", edges, "fewer pulses per turn, a lower speed or a shorter run")
}

impl Rig {
    /// Cost of `duration_s` of a motion.
    pub fn work(&self, motion: &Motion, duration_s: f64) -> Work {
        let fastest = fastest(&self.system, self.stiffest(), self.damping_time_s());
        let time_s = self.run_in_s + duration_s;
        let turns = |t: f64| motion.turns(t, 1e-6).coefficient(0);
        let travelled = (turns(duration_s) - turns(-self.run_in_s)).abs();
        let shaft_hz = motion.fastest_hz((-self.run_in_s, duration_s));
        let [z1, z2] = self.facts(0.0).teeth.map(f64::from);
        let passages = travelled * z1 * self.stiffness.knots().len() as f64;
        let steps = time_s * fastest / RADIANS_PER_STEP + passages + time_s / self.options.longest_step_s;
        Work { steps, highest_hz: fastest / TAU, shaft_hz: shaft_hz.max(shaft_hz * z1 / z2) }
    }

    /// Largest total stiffness of the mesh, N/m: as many pairs as fit on the path at the curve's highest knot.
    fn stiffest(&self) -> f64 {
        let knots = self.stiffness.knots();
        let highest = knots.iter().map(|&s| self.stiffness.value(s)).fold(self.mean_stiffness_n_per_m(), f64::max);
        highest * (knots[knots.len() - 1] - knots[0]).ceil().max(1.0)
    }

    fn damping_time_s(&self) -> f64 {
        let super::mesh::MeshDamping::Time(seconds) = self.damping else { return 0.0 };
        seconds
    }
}

/// Highest natural frequency or decay rate, rad/s; NaN where the machine gives no finite one.
fn fastest(system: &System, mesh: f64, damping_time_s: f64) -> f64 {
    let n = system.len();
    let root: Vec<f64> = system.mass.iter().map(|m| m.sqrt()).collect();
    let scaled = |matrix: &DMatrix<f64>, mesh: f64| {
        DMatrix::from_fn(n, n, |i, j| (matrix[(i, j)] + mesh * system.mesh[i] * system.mesh[j]) / root[i] / root[j])
    };
    let largest = |matrix: DMatrix<f64>| {
        if matrix.iter().any(|x| !x.is_finite()) {
            return f64::NAN;
        }
        SymmetricEigen::new(matrix).eigenvalues.amax()
    };
    let omega = largest(scaled(&system.stiffness, mesh)).sqrt();
    let decay = largest(scaled(&system.damping, mesh * damping_time_s));
    // `max` would drop a NaN.
    if omega.is_nan() || decay.is_nan() { f64::NAN } else { omega.max(decay) }
}
