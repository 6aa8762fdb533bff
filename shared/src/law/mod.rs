//! The bandwidth law as data, and the sampling rates that follow from it.
//!
//! A pinion rate in, a bandwidth and a plan of rates out. A law belongs to one machine; [`data`] holds the paper rig's.

pub mod data;
mod form;
pub mod rate_plan;
pub mod table;

pub use form::*;
