//! Ground floor of the workbench: errors, resource limits, crash-safe output, text, report pages.

pub mod budget;
pub mod confined;
pub mod error;
pub mod output;
pub mod report;
pub mod speed;
pub mod terminal;
pub mod text;

pub use error::{Error, Result};
