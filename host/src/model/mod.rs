//! Models that predict a record's lines without stepping through time. The simulator in time is [`crate::dynamics`].

#![allow(clippy::needless_range_loop, reason = "indices run over parallel arrays of the two shafts")]

pub mod harmonic_balance;
