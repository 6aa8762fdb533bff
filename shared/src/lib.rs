//! Signal and tachometer logic of the meshband vibration node.
//!
//! # Glossary
//!
//! * *mesh frequency*: teeth times shaft rate. *order*: frequency over the rate of a named shaft (here the pinion).
//! * *pulse*: one tach edge; *position*: its integer place on the wheel, counted on over turns.
//! * *bandwidth law*: bandwidth of the vibration over shaft rate; *requested* and *granted* rate: what the law asks and
//!   what an integer timer period gives.
//! * *ADC rate*, *output rate*: before and after half-band decimation by 2^k.
//! * *record*: a gap-free run of samples at one rate; *block*: what a board hands over at a time.
#![no_std]
#![forbid(unsafe_code)]
#![warn(missing_docs)]

pub mod board;
pub mod config;
pub mod dsp;
pub mod identity;
pub mod law;
pub mod link;
pub mod math;
pub mod modbus;
pub mod node;
pub mod pipeline;
pub mod replay;
pub mod tach;
pub mod time;
pub mod units;
pub mod update;

// The names by which the other crates know what lies in the rooms.
pub use config::{schema, store};
pub use dsp::{
    alias, band_velocity, capture_decimator, code_moments, comb, decimate, envelope, gear_condition, indicators,
    mesh_decimator, order, order_chain, peaks, rise_time, sample_ring, shaft_lines, spectrum, stream, tsa, window,
    zoom,
};
pub use law::{data as law_data, rate_plan};
pub use link::{frame, message, session, waveform};
pub use node::{
    alarm, bandwidth_watch, buffers, capture, events, health, levels, mesh_band, safe_start, self_test, watch,
};
pub use tach::{angle_filter, turn_marks};
