//! Closed loop: what does the declared machine leave unexplained in a record, which effect explains it,
//! and by how much does adding that effect lower the error on runs that were not used to find it.
//!
//! The declared machine is linear and periodic in the pinion's angle with one rank-one time-varying part (the mesh),
//! so every small effect has an exact steady response on a comb of orders
//! ([`harmonic_balance`](crate::model::harmonic_balance)). All comparisons are made on complex spectral bins below 15
//! kHz, whitened by locally estimated noise ([`spectrum`](crate::observation::spectrum)); declared parameters and
//! tachometer offsets stay in every fit as nuisances with priors ([`base_fit`]), so an effect is credited only with
//! what they cannot explain. Source: reference recipe "split, residual, match by simulation, abstain" of the project.

#![allow(clippy::needless_range_loop, clippy::type_complexity, reason = "indices run over parallel spectra")]

pub mod accept;
pub mod apply;
pub mod bands;
pub mod base_fit;
pub mod bootstrap;
pub mod calibrate;
pub mod candidate;
pub mod carry;
pub mod combs;
pub mod decide;
pub mod detect;
pub mod entrained;
pub mod frame;
pub mod held_out;
pub mod impulsive;
pub mod judge;
pub mod least_squares;
pub mod letter;
pub mod library;
pub mod limits;
pub mod lookahead;
pub mod next_measurement;
pub mod node_check;
pub mod null_records;
pub mod one_start;
pub mod options;
pub mod outcome;
pub mod probability;
pub mod refinement;
pub mod refusal;
pub mod remainder;
pub mod replay;
pub mod report;
pub mod rivals;
pub mod search;
pub mod shapes;
pub mod simulation;
pub mod start;
pub mod strength;
mod summary;
pub mod tables;
pub mod tach_delay;
pub mod together;
pub mod uncertainty;
pub mod verdict;
pub mod waveform;

pub use decide::close_loop;
pub use options::Options;
pub use outcome::Outcome;

use meshband_analysis::{check, model, observation};
use meshband_common::{Error, Result, budget, output, remark, terminal};
use meshband_law as law;
use meshband_mechanics::{dynamics, effects, machine, piecewise, stiffness};
use meshband_node_side::virtual_node;
use meshband_record::{predict, record};
use meshband_signal::spectral;
