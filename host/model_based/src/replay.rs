//! Record, declared model and both residuals side by side, for pictures and band levels.

use super::base_fit::Base;
use super::outcome::Outcome;
use super::tach_delay;
use crate::observation::input::Record;
use crate::observation::spectrum::Bins;

/// Residuals of both models.
pub struct Replay {
    /// Declared machine and measured spectra.
    pub declared: Base,
    /// Residual per run and channel, machine as declared.
    pub declared_residual: Vec<[Bins; 2]>,
    /// Residual per run and channel, adopted parameters and effects; values from fit and selection runs.
    pub corrected_residual: Vec<[Bins; 2]>,
}

/// Takes the residuals of `outcome`, which must be of `record`; runs are those used, in that order.
pub fn replay(record: &Record, outcome: &Outcome) -> Replay {
    let [declared_residual, corrected_residual] = outcome.residual.clone();
    Replay { declared: Base::new(&tach_delay::checked(record).record), declared_residual, corrected_residual }
}
