//! When a term earns its place: thresholds that more than one step of the loop asks for.

/// Penalty per real unknown, in units of chi-square.
pub const PER_UNKNOWN: f64 = 10.0;
/// Least score of an accepted effect.
pub const LEAST_SCORE: f64 = 15.0;
/// Largest probability of a term's gain by chance, after correction for the search.
pub const LARGEST_P: f64 = 1e-3;
