//! Which guesses of an estimated machine move its bandwidth law, and by how much.
//!
//! One guess at a time is moved by its factor, up and down, or to its other choice; the law's edge is computed anew
//! at three speeds, and the larger change, in parts of a logarithm, is the guess's share. The shares are taken as
//! independent 95 % ranges: the law's stated uncertainty is the root of the sum of their squares. Interaction between
//! guesses is left out.

use super::derive::{edge_bandwidth_hz, study_torque};
use super::domain::Domain;
use super::operating::Bench;
use crate::machine::Machine;
use crate::machine::estimate::{Estimated, Guess};
use crate::{Error, Result};
use rayon::prelude::*;
use serde::Serialize;

/// What a guess does to the law.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Share {
    /// The guess.
    pub guess: Guess,
    /// Factor on the bandwidth, at most, where the guess is as far off as it may be; none where no edge could be timed.
    pub moves: Option<f64>,
}

/// The law's dependence on guesses.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Sensitivity {
    /// Speeds, Hz.
    pub speeds_hz: [f64; 3],
    /// Bandwidths of the estimated machine there, Hz; none where the ring hides the edge.
    pub bandwidth_hz: [Option<f64>; 3],
    /// All guesses, the one that moves the law most first.
    pub shares: Vec<Share>,
    /// The law's truth lies within this factor above or below, by all guesses together (95 %).
    pub within_factor: f64,
}

/// Bandwidths at some speeds; none where no edge stands alone.
///
/// # Errors
/// A machine without torque or engagement.
pub fn bandwidths(machine: &Machine, speeds_hz: [f64; 3]) -> Result<[Option<f64>; 3]> {
    let bench = Bench::new(machine)?;
    let torque_n_m = study_torque(machine)?;
    Ok(speeds_hz.map(|speed| edge_bandwidth_hz(&bench, speed, torque_n_m).ok()))
}

/// Largest ratio between two laws at the speeds where both have an edge; at least 1.
pub fn ratio(a: [Option<f64>; 3], b: [Option<f64>; 3]) -> Option<f64> {
    let ratios = a.into_iter().zip(b).filter_map(|(a, b)| Some((a? / b?).ln().abs().exp()));
    ratios.reduce(f64::max)
}

/// Moves every guess; `step` is told of each that is done.
///
/// # Errors
/// Where the estimated machine itself has no law.
pub fn sensitivity(estimated: &Estimated, step: &(impl Fn() + Sync)) -> Result<Sensitivity> {
    let domain = Domain::of(&estimated.machine);
    let speeds_hz = domain.named_speeds();
    let own = bandwidths(&estimated.machine, speeds_hz)?;
    if own.iter().all(Option::is_none) {
        return Err(Error::impossible("law", "no engagement edge of the estimated machine stands alone"));
    }
    let mut shares: Vec<Share> = (0..estimated.guesses.len())
        .into_par_iter()
        .map(|index| {
            let guess = estimated.guesses[index].clone();
            // A value that makes no machine (a bore beyond its root) says nothing of the law.
            let moved = estimated.moved(index).into_iter().filter_map(Result::ok);
            let moves = moved.filter_map(|machine| ratio(bandwidths(&machine, speeds_hz).ok()?, own)).reduce(f64::max);
            step();
            Share { guess, moves }
        })
        .collect();
    shares.sort_by(|a, b| b.moves.unwrap_or(0.0).total_cmp(&a.moves.unwrap_or(0.0)));
    let square: f64 = shares.iter().filter_map(|share| share.moves).map(|moves| moves.ln().powi(2)).sum();
    Ok(Sensitivity { speeds_hz, bandwidth_hz: own, shares, within_factor: square.sqrt().exp() })
}
