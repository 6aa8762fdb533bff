//! What inference asks of a model of the machine: lines of a run and how they move with each parameter.
//!
//! Inference fits, compares and refuses by this interface alone; what is inside (harmonic balance today) is the
//! model's own. The state of a run is kept by whoever asked, since it is what excitations of the same run are
//! answered with.

use rustfft::num_complex::Complex64 as C;

/// Steady line: complex amplitudes of both channels at one order; the signal is the real part of
/// `amplitude exp(i order theta)`.
#[derive(Debug, Clone, Copy)]
pub struct Line {
    /// Order of the pinion (may be negative).
    pub order: f64,
    /// Acceleration amplitudes, m/s2, both channels.
    pub amplitude: [C; 2],
}

/// How a run is driven.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Operating {
    /// Pinion speed, Hz.
    pub shaft_hz: f64,
    /// Torque at the input, N m.
    pub torque_n_m: f64,
}

/// A model that predicts the lines of a run.
pub trait ForwardModel: Send + Sync {
    /// A run as solved.
    type Run: Send + Sync;

    /// Solves a run.
    fn run(&self, at: Operating) -> Self::Run;

    /// Its prediction: lines of both channels.
    fn prediction<'a>(&self, run: &'a Self::Run) -> &'a [Line];

    /// Change of the prediction with a unit relative change of every parameter, parameter by parameter.
    fn jacobian(&self, run: &Self::Run) -> Vec<Vec<Line>>;
}
