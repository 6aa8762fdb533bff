//! Published measurements through the generic import and loop: a case file says where the data lie and what their
//! owners declare, no answers.
//!
//! The measurements themselves are not part of the project. Nothing here knows a record: what is found in one comes
//! out of [`crate::signal_based`]. `paper` is apart: lines quoted in a text, without data.

pub mod case;
pub mod page;
pub mod paper;

pub use case::{Case, cases};

use crate::signal_based::outcome::Outcome;
use crate::signal_based::preflight::{Level, Preflight};
use crate::{Result, import, signal_based};
use std::path::Path;

/// Imports a case's files and runs the loop on them.
///
/// # Errors
/// Absent or unreadable files, a record that the loop refuses.
pub fn run(case: &Case, data: &Path) -> Result<Outcome> {
    let files = case.paths(data)?;
    let (record, _) = import::import(&files, &case.import_options())?;
    let preflight = Preflight::of(&record);
    preflight.level(Some(Level::SignalBased), &case.name)?;
    let mut outcome = signal_based::run(&record, &preflight)?;
    outcome.record = case.title.clone();
    Ok(outcome)
}
