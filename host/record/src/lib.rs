//! Records of machines: folders, import of foreign formats, simulated acquisition, prediction by the declared machine.

pub mod data_quality;
pub mod field;
pub mod import;
pub mod part;
pub mod predict;
pub mod record;

use meshband_common::{Error, Result, budget, confined, output, text};
use meshband_mechanics::{dynamics, machine};
use meshband_signal::{pulses, spectral};
use meshband_train as train;
