//! Records as their owners have them: housing channels, wander, run-up, a tachometer's voltage, coloured noise.
//!
//! In: a machine made ready, a motion, effects, and a [`Field`]. Out: [`FieldRun`]s, which the command makes a record
//! of, or files as an acquisition system writes them. Nothing here is read by `import` or by inference: it is their
//! test.

mod declaration;
mod files;
mod housing;
mod noise;
mod run;
mod wander;
mod wheel;

pub use declaration::{Channel, Field, FileUnit, Housing, Mode, Wander, Wheel, WheelShaft};
pub use files::{Format, content};
pub use housing::Paths;
pub use noise::add as add_noise;
pub use run::{FieldRun, Site};
pub use wander::Course;
