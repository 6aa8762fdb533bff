//! What inference sees of a record: its runs in SI units, the shaft's angle from the tach, and spectra with the
//! kernel of a line.
//!
//! A room of its own because two ask it: the check of a record ([`crate::check`]) before anything is inferred, and
//! the closed loop of `meshband-model-based`, which asks the check.

pub mod angle;
pub mod input;
pub mod spectrum;
