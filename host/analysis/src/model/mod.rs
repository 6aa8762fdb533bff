//! Models that the inference predicts with: lines without stepping through time for what it proposes, and the same
//! equations on the Taylor solver of [`crate::dynamics`] for what it decides.

#![allow(clippy::needless_range_loop, reason = "indices run over parallel arrays of the two shafts")]

pub mod forward;
pub mod harmonic_balance;
pub mod integrated;
pub mod pieces;
pub mod poles;
mod recurring;
