//! Signal processing without a node around it: samples, angles and turns in, spectra, averages and indicators out.
//!
//! Nothing here knows of configuration, messages or boards. Only `math` and `units` lie below.

pub mod alias;
pub mod band_velocity;
pub mod capture_decimator;
pub mod code_moments;
pub mod comb;
pub mod decimate;
mod edge_shape;
pub mod envelope;
pub mod gear_condition;
pub mod indicators;
pub mod mesh_decimator;
pub mod order;
pub mod order_chain;
pub mod peaks;
pub mod rise_time;
pub mod sample_ring;
pub mod shaft_lines;
pub mod spectrum;
pub mod stream;
pub mod tsa;
pub mod window;
pub mod zoom;
