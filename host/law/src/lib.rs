//! The bandwidth law: from simulated engagement edges to the numbers a node carries.
//!
//! `edges` defines what is timed, `operating` simulates it, `study` and `sampling` redo the paper's studies, `derive`
//! fits and checks the law, `either_edge` takes the take-up edge where the other cannot be timed, `estimator`
//! compares the node's sampled estimator, `file` and `export` hand the law on; `guesses` says which guesses of an
//! estimated machine move it; `learn` measures one on a record.

pub mod crack;
pub mod derive;
pub mod domain;
pub mod edges;
pub mod either_edge;
pub mod estimator;
pub mod export;
pub mod file;
pub mod fit;
pub mod forms;
pub mod guesses;
pub mod learn;
pub mod operating;
pub mod outcome;
pub mod paper;
pub mod point;
pub mod report;
pub mod sampling;
pub mod study;
pub mod table;
pub mod validation;

use meshband_analysis::analysis;
use meshband_common::{Error, Result, budget, terminal, text};
use meshband_mechanics::{dynamics, machine, piecewise, stiffness};
use meshband_record::record;
use meshband_signal::spectral;
