//! A node that exists only here: the real firmware, fed with a record as an analogue signal.
//!
//! Two boards play it ([`board`]): [`an386`] in QEMU, and the [`emulated`] STM32F405 with the very image that is
//! flashed.
//!
//! [`signal`] is a channel of a record or of a simulated machine, [`setup`] the configuration for it, [`analogue`]
//! makes it fine enough to be sampled at any rate, [`image`] puts it with edges and configuration into a replay image,
//! [`simulation`] runs the node's own code on that image here on the host, and [`frames`] reads what either of them
//! sent; [`serve`] is a node on a signal without an end ([`looped`]), live for all who come ([`peers`]) and as a
//! Modbus station ([`stations`]). [`reference`](mod@reference) is the same measurement in f64 from the signal itself;
//! [`trial`] brings all of it together, [`summary`] says it in tables and [`report`] in pictures.

pub mod an386;
pub mod analogue;
pub mod board;
pub mod emulated;
pub mod frames;
pub mod image;
pub mod looped;
pub mod peers;
pub mod profile;
pub mod qemu;
pub mod reference;
pub mod report;
pub mod second;
pub mod serve;
pub mod setup;
pub mod signal;
pub mod simulation;
pub mod stations;
pub mod summary;
pub mod trial;
