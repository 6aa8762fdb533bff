//! Workbench of the meshband vibration node: simulator, law, records, virtual node and closed loop.

pub mod dynamics;
pub mod effects;
pub mod error;
pub mod law;
pub mod machine;
pub mod piecewise;
pub mod record;
pub mod stiffness;

pub use error::{Error, Result};
