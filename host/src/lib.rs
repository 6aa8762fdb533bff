//! Workbench of the meshband vibration node: simulator, law, records, virtual node and closed loop.

pub mod closed_loop;
pub mod error;
pub mod machine;
pub mod piecewise;

pub use error::{Error, Result};
