//! What a record shows by itself: observation, steady-state model, check of the record, order analysis.

pub mod analysis;
pub mod check;
pub mod drawn;
pub mod generate;
pub mod model;
pub mod observation;

use meshband_common::{Error, Result, budget, report, terminal, text};
use meshband_mechanics::{dynamics, effects, machine, piecewise, stiffness};
use meshband_record::{data_quality, record};
use meshband_signal::{pulses, spectral};
use meshband_train as train;
