//! Workbench of the meshband vibration node: simulator, law, records, virtual node and closed loop.

pub mod analysis;
pub mod budget;
pub mod check;
pub mod closed_loop;
pub mod commissioning;
pub mod confined;
pub mod dynamics;
pub mod effects;
pub mod error;
pub mod field;
pub mod field_proof;
pub mod import;
pub mod injection;
pub mod kinematic;
pub(crate) mod lanes;
pub mod law;
pub mod levels;
pub mod link;
pub mod machine;
pub mod measured;
pub mod model;
#[cfg(feature = "monitor")]
pub mod monitor;
pub mod observation;
pub mod output;
pub mod piecewise;
pub mod pulses;
pub mod record;
pub mod report;
pub mod spectral;
pub mod stiffness;
pub mod terminal;
pub mod text;
pub mod virtual_node;

pub use error::{Error, Result};
