//! A node that exists only here: the real firmware in QEMU, fed with a record as an analogue signal.
//!
//! [`signal`] is a channel of a record or of a simulated machine, [`setup`] the configuration for it, [`analogue`]
//! makes it fine enough to be sampled at any rate, [`image`] puts it with edges and configuration into a replay image,
//! [`simulation`] runs the node's own code on that image here on the host, and [`frames`] reads what either of them
//! sent. [`reference`](mod@reference) is the same measurement in f64 from the signal itself; [`trial`] brings all of it
//! together, [`summary`] says it in tables and [`report`] in pictures.

pub mod analogue;
pub mod frames;
pub mod image;
pub mod profile;
pub mod reference;
pub mod report;
pub mod setup;
pub mod signal;
pub mod simulation;
pub mod summary;
pub mod trial;
