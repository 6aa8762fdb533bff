//! Record, declared model and both residuals side by side, for pictures and band levels.

use super::base_fit::Base;
use super::input::Record;
use super::outcome::Outcome;
use super::spectrum::Bins;

/// Residuals of both models.
pub struct Replay {
    /// Declared machine and measured spectra.
    pub declared: Base,
    /// Residual per run and channel, declared machine.
    pub before: Vec<[Bins; 2]>,
    /// Residual per run and channel, adopted parameters and effects; values from fit and selection runs.
    pub after: Vec<[Bins; 2]>,
}

/// Takes the residuals of `outcome`, which must be of `record`.
pub fn replay(record: &Record, outcome: &Outcome) -> Replay {
    let [before, after] = outcome.residual.clone();
    Replay { declared: Base::new(record), before, after }
}
