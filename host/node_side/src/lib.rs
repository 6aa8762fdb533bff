//! The host side of a node: link, expected levels, virtual node, commissioning, live view.

pub mod commissioning;
pub mod levels;
pub mod link;
#[cfg(feature = "monitor")]
pub mod monitor;
pub mod virtual_node;

use meshband_common::{Error, Result, budget, output, report, terminal};
use meshband_law as law;
use meshband_mechanics::{dynamics, machine};
use meshband_record::record;
use meshband_signal::spectral;
