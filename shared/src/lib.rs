//! Signal and tachometer logic of the meshband vibration node.
#![no_std]
#![forbid(unsafe_code)]
#![warn(missing_docs)]

pub mod alias;
pub mod envelope;
pub mod indicators;
pub mod math;
pub mod order;
pub mod rise_time;
pub mod spectrum;
pub mod tsa;
pub mod window;
pub mod zoom;
