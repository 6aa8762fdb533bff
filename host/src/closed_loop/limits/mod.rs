//! What would have been found: for every named effect of the library that was not, the smallest strength that this record would have shown.
//!
//! Injection and recovery in the linearised model. The response of an effect is laid, at drawn places (phase, tooth, order, frequency, starts of the runs;
//! `places`), over what the terms found leave of the record (`injection`), and everything is asked that the search asks: the order must be proposed
//! by the scans, the gate must adopt the term next to those found, and the held-out runs must confirm it. The normal equations change by products that are there
//! already, so a strength costs a few small systems of equations and no simulation. Strengths are those of the simulator's own effects
//! ([`Hypothesis::carry`](crate::effects::hypothesis::Hypothesis::carry)), so that a limit can be tried with `simulate --effect`.
//!
//! In half, and in nine of ten of the places, an effect of that strength is found: a term of its kind is adopted. Whether it also earns its name is another question, which
//! needs more. Cost: about the library's responses once more. Limits: responses of first order; of what is searched finely (a tooth, a delay, a mode, an order) the true value
//! is taken to be found, and its search is paid for; effects that distort the record as a whole (clipping, impacts, an angle that moves) have none. Checked by injections
//! into generated records (`meshband prove --limits`).

mod injection;
mod places;
mod proposed;

use super::accept::Adopted;
use super::judge::Split;
use super::least_squares::Data;
use super::library::Bench;
use injection::Scene;
use places::{Row, Seated};
use rayon::prelude::*;
use serde::Serialize;
use std::collections::BTreeMap;

/// What would have been found.
#[derive(Debug, Clone, Serialize)]
pub struct Limit {
    /// Name of the effect.
    pub family: String,
    /// The body or channel that it sits on; empty where there is no choice.
    pub at: String,
    /// Strength found in half of the places tried; none where nothing in range would have been.
    pub found_in_half: Option<f64>,
    /// Strength found in nine of ten.
    pub found_in_90_percent: Option<f64>,
    /// Unit of the strength.
    pub unit: String,
    /// The simulator's effect and key that the strength is a value of, as for `--effect`.
    pub strength: String,
    /// Places tried.
    pub places: usize,
    /// The simulator's keys that say where it sits.
    #[serde(skip)]
    pub keys: Vec<(&'static str, f64)>,
    /// Whether it is locked to an order of the pinion.
    #[serde(skip)]
    pub at_order: bool,
}

/// Limits of every named effect of the library that is not among `adopted`; `tried`: scores given in the search.
pub fn limits(bench: &Bench<'_>, data: &Data, split: &Split, adopted: &Adopted, tried: usize) -> Vec<Limit> {
    let variants = injection::variants(bench.base, data, split, adopted);
    let scene = Scene::new(bench, &variants, split, adopted, tried);
    let is_missing = |seated: &Seated| adopted.iter().all(|term| term.name != seated.candidate.name);
    let mut rows: BTreeMap<Row, Vec<f64>> = BTreeMap::new();
    places::drawn(bench, &variants[0], split, |seats| {
        let of = |seated: Seated| (seated.row.clone(), scene.weakest(&seated));
        let found: Vec<_> = seats.into_par_iter().filter(is_missing).map(of).collect();
        for (row, strengths) in found {
            rows.entry(row).or_default().extend(strengths.into_iter().map(|s| s.unwrap_or(f64::INFINITY)));
        }
    });
    rows.into_iter().map(|(row, strengths)| row.limit(strengths)).collect()
}

impl Row {
    /// The limit by the weakest strengths found at all places.
    fn limit(self, mut strengths: Vec<f64>) -> Limit {
        strengths.sort_by(f64::total_cmp);
        let places = strengths.len();
        let at = |share: f64| {
            let index = ((share * places as f64).ceil() as usize).saturating_sub(1);
            strengths.get(index).copied().filter(|s| s.is_finite())
        };
        Limit {
            found_in_half: at(0.5),
            found_in_90_percent: at(0.9),
            family: self.family,
            at: self.at,
            unit: self.unit.into(),
            strength: self.strength,
            at_order: self.at_order,
            places,
            keys: self.keys.into_iter().map(|(key, value)| (key, f64::from(value))).collect(),
        }
    }
}
