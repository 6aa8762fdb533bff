//! The gear pair: machine files, mesh stiffness, dynamics, the library of effects.

pub mod dynamics;
pub mod effects;
pub mod lanes;
pub mod machine;
pub mod piecewise;
pub mod stiffness;

use meshband_common::{Error, Result, budget, confined, report, terminal, text};
use meshband_signal::spectral;
