//! Dynamics of a declared gear train: shafts, meshes and bearings of any number, from a file to sampled acceleration.
//!
//! `machine` reads the train with its mechanical data; `stiffness` gives each mesh its curve; `planetary` and
//! `assembly` put bodies, springs and meshes together; `integrate` solves them by Taylor series; `effects` are errors
//! and faults at any gear; `stage_pair` is one spur stage as a pair's machine; `simulate` samples what a sensor on the
//! housing gives, with tach edges. Contact is linear: teeth do not separate. Rotations are deviations from the exact
//! motion of the train.

pub mod assembly;
mod builder;
mod effect_text;
pub mod effects;
mod expansion;
pub mod integrate;
pub mod machine;
pub mod modes;
mod planetary;
pub mod sensor;
pub mod simulate;
pub mod stage_pair;
mod stages;
pub mod stiffness;
mod terms;

pub use machine::TrainMachine;
pub use simulate::{Run, Simulated, simulate};

use meshband_common::{Error, Result};
