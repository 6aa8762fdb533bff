//! Spectra, windows, resampling by order and tach pulse repair, in f64.

pub mod pulses;
pub mod spectral;
