//! What a node is told: the configuration, how it is stored, and how older and newer forms of it are read.
//!
//! Bytes in, one validated [`Configuration`] out; the node takes nothing else.

mod capture;
mod configuration;
mod link;
pub mod schema;
pub mod store;
mod train;
mod watch;

pub use capture::{CaptureConfig, CaptureRate};
pub use configuration::*;
pub use link::*;
pub use train::{MAX_FURTHER_STAGES, MAX_TRAIN_GEARS, StageLaw, TrainGear, bandwidth_hz as train_bandwidth_hz};
pub use watch::*;
