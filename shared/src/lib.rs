//! Signal and tachometer logic of the meshband vibration node.
#![no_std]
#![forbid(unsafe_code)]
#![warn(missing_docs)]

pub mod replay;
