//! A node that exists only here: the real firmware in QEMU, fed with a record as an analogue signal.
//!
//! [`analogue`] turns sampled runs into a signal fine enough to be sampled at any rate, [`image`] puts it with
//! edges and configuration into a replay image, [`simulation`] runs the node's own code on that image here on
//! the host, and [`frames`] reads what either of them sent.

pub mod analogue;
pub mod frames;
pub mod image;
pub mod simulation;
