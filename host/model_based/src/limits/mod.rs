//! What would have been found: for every named effect of the library that was not, the smallest strength that this
//! record would have shown.
//!
//! Injection and recovery in the linearised model. The response of an effect is laid, at drawn places (phase, tooth,
//! order, frequency, starts of the runs; `places`), over what the terms found leave of the record (`injection`), and
//! everything is asked that the search asks: the order must be proposed by the scans, the gate must adopt the term
//! next to those found, and the held-out runs must confirm it. The normal equations change by products that are there
//! already, so a strength costs a few small systems of equations and no simulation. Strengths are those of the
//! simulator's own effects ([`Hypothesis::carry`](crate::effects::hypothesis::Hypothesis::carry)), so that a limit
//! can be tried with `simulate --effect`.
//!
//! In half, and in nine of ten of the places, an effect of that strength is found: a term of its kind is adopted.
//! Whether it also earns its name is another question, which needs more. Cost: about the library's responses once
//! more. Limits: responses of first order; of what is searched finely (a tooth, a delay, a mode, an order) the true
//! value is taken to be found, and its search is paid for; effects that distort the record as a whole (clipping,
//! impacts, an angle that moves) have none. Checked by injections into generated records (`meshband prove --limits`).

mod injection;
mod places;
mod proposed;

pub use super::outcome::Limit;

use super::accept::Adopted;
use super::judge::Split;
use super::least_squares::Data;
use super::library::Bench;
use injection::{Scene, Turn};
use places::{Row, Seated};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Limits of every named effect of the library that is not among `adopted`; `tried`: scores given in the search.
pub fn limits(bench: &Bench<'_>, data: &Data, split: &Split, adopted: &Adopted, tried: usize) -> Vec<Limit> {
    let variants = injection::variants(bench.base, data, split, adopted);
    let scene = Scene::new(bench, &variants, split, adopted, tried);
    let is_missing = |seated: &Seated| adopted.iter().all(|term| term.name != seated.candidate.name);
    let mut rows: BTreeMap<Row, Vec<Vec<Turn>>> = BTreeMap::new();
    places::drawn(bench, &variants[0], split, |seats| {
        let of = |seated: Seated| (seated.row.clone(), scene.turns_of_fortune(&seated));
        let found: Vec<_> = seats.into_par_iter().filter(is_missing).map(of).collect();
        found.into_iter().for_each(|(row, places)| rows.entry(row).or_default().extend(places));
    });
    rows.into_iter().map(|(row, places)| row.limit(&places)).collect()
}

/// The strength from which on effects are found in a share of the places: none where they never are.
fn found_in(share: f64, places: &[Vec<Turn>]) -> Option<f64> {
    // k of n places stand for a share k / (n + 1) of further ones on average; between two of them, for one between.
    let needed = (share * (places.len() + 1) as f64).min(places.len() as f64);
    let [fewer, more] = [needed.floor(), needed.ceil()].map(|needed| found_at(needed as usize, places));
    let more = more?;
    let fewer = fewer.unwrap_or(more);
    let between = fewer.ln() + needed.fract() * (more.ln() - fewer.ln());
    Some(between.exp()).filter(|strength| strength.is_finite())
}

/// The strength from which on effects are found at so many of the places.
fn found_at(needed: usize, places: &[Vec<Turn>]) -> Option<f64> {
    let mut count = places.iter().filter(|turns| turns.last().is_some_and(|turn| turn.found_above)).count();
    let mut turns: Vec<Turn> = places.iter().flatten().copied().collect();
    turns.sort_by(|a, b| b.strength.total_cmp(&a.strength));
    // From the strongest down to where too few are left.
    let last = turns.into_iter().find(|turn| {
        let enough = count >= needed;
        count = if turn.found_above { count - 1 } else { count + 1 };
        enough && count < needed
    })?;
    Some(last.strength).filter(|strength| strength.is_finite())
}

impl Row {
    /// The limit by where finding begins and ceases at all places.
    fn limit(self, places: &[Vec<Turn>]) -> Limit {
        Limit {
            found_in_half: found_in(0.5, places),
            found_in_90_percent: found_in(0.9, places),
            family: self.family,
            at: self.at,
            unit: self.unit.into(),
            strength: self.strength,
            at_order: self.at_order,
            within: self.within.map(|(key, band)| (key, band.map(|x| 1e-3 * f64::from(x)))),
            places: places.len(),
            keys: self.keys.into_iter().map(|(key, value)| (key, f64::from(value))).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn theory_a_share_of_places_is_counted_from_the_strongest_down() {
        let at = |turns: &[(f64, bool)]| -> Vec<Turn> {
            turns.iter().map(|&(strength, found_above)| Turn { strength, found_above }).collect()
        };
        // Three places: found from 1, from 4, and from 2 but for 3 to 5.
        let places = [at(&[(1.0, true)]), at(&[(4.0, true)]), at(&[(2.0, true), (3.0, false), (5.0, true)])];
        let is = |share: f64, strength: f64| (found_in(share, &places).unwrap() / strength - 1.0).abs() < 1e-9;
        assert!(is(0.5, 4.0) && is(0.9, 5.0), "{:?} {:?}", found_in(0.5, &places), found_in(0.9, &places));
        // Half way between one place and two, which stand for a quarter and a half of further ones: between 1 and 4.
        assert!(is(0.375, 2.0), "{:?}", found_in(0.375, &places));
        // One that is never found, and one only beyond what can be simulated.
        let places = [at(&[(1.0, true)]), at(&[]), at(&[(f64::INFINITY, true)])];
        assert!((found_in(0.25, &places).unwrap() - 1.0).abs() < 1e-9);
        assert_eq!(found_in(0.5, &places), None);
        assert_eq!(found_in(0.9, &places), None);
    }
}
