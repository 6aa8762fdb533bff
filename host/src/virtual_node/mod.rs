//! A node that exists only here: the real firmware in QEMU, fed with a record as an analogue signal.
//!
//! [`analogue`] turns sampled runs into a signal fine enough to be sampled at any rate.

pub mod analogue;
