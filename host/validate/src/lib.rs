//! What proves the workbench and is not shipped with it: campaigns, injection, measured cases, alarm comparison.

pub mod bearings;
pub mod campaign;
pub mod field_proof;
pub mod injection;
pub mod levels;
pub mod measured;
pub mod train_proof;

use meshband_host::{Error, Result, budget, remark, terminal};
use meshband_host::{
    analysis, drawn, dynamics, effects, field, generate, import, machine, observation, record, spectral,
};
use meshband_host::{model_based, signal_based, train};
