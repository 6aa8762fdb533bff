//! Signal and tachometer logic of the meshband vibration node.
//!
//! # Glossary
//!
//! * *mesh frequency*: teeth times shaft rate. *order*: frequency over the rate of a named shaft (here the pinion).
//! * *pulse*: one tach edge; *position*: its integer place on the wheel, counted on over turns.
//! * *bandwidth law*: bandwidth of the vibration over shaft rate; *requested* and *granted* rate: what the law asks and
//!   what an integer timer period gives.
//! * *ADC rate*, *output rate*: before and after half-band decimation by 2^k.
//! * *record*: a gap-free run of samples at one rate; *block*: what a board hands over at a time.
#![no_std]
#![forbid(unsafe_code)]
#![warn(missing_docs)]

pub mod alarm;
pub mod alias;
pub mod angle_filter;
pub mod bandwidth_watch;
pub mod board;
pub mod buffers;
pub mod comb;
pub mod config;
pub mod decimate;
mod edge_shape;
pub mod envelope;
pub mod events;
pub mod frame;
pub mod gear_condition;
pub mod identity;
pub mod indicators;
pub mod law;
pub mod law_data;
pub mod law_table;
pub mod link;
pub mod math;
pub mod mesh_band;
pub mod mesh_decimator;
pub mod message;
pub mod node;
pub mod order;
pub mod order_chain;
pub mod peaks;
pub mod pipeline;
pub mod rate_plan;
pub mod replay;
pub mod rise_time;
pub mod safe_start;
pub mod schema;
pub mod self_test;
pub mod session;
pub mod spectrum;
pub mod store;
pub mod stream;
pub mod tach;
pub mod time;
pub mod tsa;
pub mod turn_marks;
pub mod units;
pub mod window;
pub mod zoom;
