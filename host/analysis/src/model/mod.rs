//! Models that the loop predicts with: lines without stepping through time, and the same equations in fixed steps for
//! what is strong. The simulator in time is [`crate::dynamics`].

#![allow(clippy::needless_range_loop, reason = "indices run over parallel arrays of the two shafts")]

pub mod fixed_step;
pub mod forward;
pub mod harmonic_balance;
mod poles;
mod stepped_bodies;
mod stepped_mesh;
