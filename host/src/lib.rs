//! Workbench of the meshband vibration node, under one name: every room of the crates below.
//!
//! The layers, lowest first: `meshband-common`, `-signal`, `-mechanics`, `-record`, `-analysis`, `-law`, `-node`,
//! `-signal-based` and `-model-based`. Cargo keeps them: a room can only name what its crate depends on.

pub mod program;
pub mod results;

pub use meshband_analysis::{analysis, check, drawn, generate, model, observation};
pub use meshband_common::{Error, Result, budget, confined, error, output, remark, report, say, speed, terminal, text};
pub use meshband_law as law;
pub use meshband_mechanics::{dynamics, effects, machine, piecewise, stiffness};
pub use meshband_model_based as model_based;
#[cfg(feature = "monitor")]
pub use meshband_node_side::monitor;
pub use meshband_node_side::{commissioning, levels, link, virtual_node};
pub use meshband_record::{data_quality, field, import, part, predict, record};
pub use meshband_signal::{pulses, spectral};
pub use meshband_signal_based as signal_based;
pub use meshband_train as train;
pub use meshband_train_dynamics as train_dynamics;
