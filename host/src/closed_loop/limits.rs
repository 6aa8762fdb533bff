//! What would have been found: for every effect of the library that was not, the smallest strength that this record would have shown.
//!
//! Injection and recovery in the linearised model: the response of an effect is laid over the record's own residual at drawn places (phase, tooth, order, channel), over
//! the residual as it is and with the other sign, and the gate is asked as in the search, next to the declared parameters and the terms found. The normal equations change by
//! products that are there already, so that a strength costs a small system of equations and no simulation. In half, and in nine of ten of the places,
//! it is found. Limits: that the search proposes the place is taken for granted; strengths are those of the linear response; one residual, of two signs, stands for all noise.

use super::accept::Adopted;
use super::candidate::{Candidate, Claim};
use super::detect::Found;
use super::judge::{Injection, Judge, Split};
use super::least_squares::Data;
use super::library::{Bench, order, path};
use crate::effects::hypothesis::{Seat, Where};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rayon::prelude::*;
use serde::Serialize;
use std::collections::BTreeMap;
use std::f64::consts::TAU;

/// Places tried for an effect with a phase, and orders, teeth or frequencies drawn for one that may sit anywhere.
const PLACES: usize = 16;
const SEATS: usize = 4;
/// Bisections of the logarithm of a strength, over a range of a million.
const STEPS: usize = 14;
/// Least strength tried, over the one that information alone would show.
const WEAKEST: f64 = 0.1;
const RANGE: f64 = 1e5;
/// Seed of places and phases.
const SEED: u64 = 15;
/// Places of a scan over orders or frequencies: a limit of an order that is not known pays for them.
const SCANNED: f64 = 5000.0;

/// What would have been found.
#[derive(Debug, Clone, Serialize)]
pub struct Limit {
    /// Name of the effect.
    pub family: String,
    /// Strength found in half of the places tried.
    pub found_in_half: Option<f64>,
    /// Strength found in nine of ten.
    pub found_in_90_percent: Option<f64>,
    /// What the strength is, with its unit.
    pub unit: String,
    /// Places tried.
    pub places: usize,
}

impl Limit {
    /// What the strength is, without its unit.
    pub fn quantity(&self) -> &str {
        self.unit.split_once(", ").map_or(self.unit.as_str(), |(_, quantity)| quantity)
    }
}

/// Limits of every named effect of the library that is not among `adopted`.
pub fn limits(bench: &Bench<'_>, data: &Data, split: &Split, adopted: &Adopted, tried: usize) -> Vec<Limit> {
    let terms: Vec<&Candidate> = adopted.iter().collect();
    let judge = Judge::new(bench.base, data, split, &terms);
    let mut by_name: BTreeMap<(String, String), Vec<Candidate>> = BTreeMap::new();
    for candidate in library(bench, data, split) {
        if adopted.iter().all(|t| t.name != candidate.name) {
            by_name.entry((candidate.name.clone(), strength(&candidate))).or_default().push(candidate);
        }
    }
    let of = |((family, unit), candidates): ((String, String), Vec<Candidate>)| {
        let strengths = candidates.into_par_iter().enumerate().flat_map(|(i, c)| {
            let mut random = ChaCha8Rng::seed_from_u64(SEED + i as u64);
            let places = if c.parameters[0].complex { PLACES / SEATS } else { 2 };
            let injection = judge.injection(c);
            let all = (0..places).map(|place| weakest(&injection, adopted, place, &mut random, tried as f64));
            all.collect::<Vec<_>>()
        });
        let mut strengths: Vec<f64> = strengths.map(|s| s.unwrap_or(f64::INFINITY)).collect();
        strengths.sort_by(f64::total_cmp);
        let places = strengths.len();
        let at = |share: f64| {
            let index = ((share * places as f64).ceil() as usize).saturating_sub(1);
            strengths.get(index).copied().filter(|s| s.is_finite())
        };
        Limit { family, unit, found_in_half: at(0.5), found_in_90_percent: at(0.9), places }
    };
    by_name.into_iter().map(of).collect()
}

/// Quantity and unit of a candidate's strength.
fn strength(candidate: &Candidate) -> String {
    let quantity = candidate.hypothesis.map_or("amplitude", |h| h.quantity);
    let unit = candidate.parameters[0].unit;
    if unit == "1" { quantity.into() } else { format!("{unit}, {quantity}") }
}

/// The weakest strength from which on the gate adopts the candidate at a place drawn at random; none where no strength in range does.
fn weakest(
    injection: &Injection<'_>,
    adopted: &Adopted,
    place: usize,
    random: &mut ChaCha8Rng,
    tests: f64,
) -> Option<f64> {
    let phases: Vec<f64> = (0..64).map(|_| TAU * random.random::<f64>()).collect();
    let passes =
        |a: f64| adopted.weigh(&injection.figures(&injection.strengths(a, &phases), place % 2 == 1, tests)).is_ok();
    let weakest = WEAKEST / injection.information().max(1e-300).sqrt();
    let (mut low, mut high) = (0.0, RANGE.ln());
    if !passes(weakest * RANGE) {
        return None;
    }
    for _ in 0..STEPS {
        let middle: f64 = 0.5 * (low + high);
        if passes(weakest * middle.exp()) { high = middle } else { low = middle }
    }
    Some(weakest * high.exp())
}

/// Candidates of every named effect at drawn places.
fn library(bench: &Bench<'_>, data: &Data, split: &Split) -> Vec<Candidate> {
    let mut random = ChaCha8Rng::seed_from_u64(SEED);
    let named = |c: &Candidate| c.claim == Claim::Named;
    let mut all: Vec<Candidate> = bench.fixed().iter().filter(|c| named(c)).cloned().collect();
    for _ in 0..SEATS {
        all.extend(at_drawn_orders(bench, &mut random));
        for channel in 0..2 {
            let hz = 400.0 * (20.0_f64.ln() * random.random::<f64>()).exp();
            all.push(path::mode(bench, channel, hz, 0.02));
        }
        all.extend((0..2).flat_map(|body| bench.teeth.at(bench, body, random.random::<u32>())));
    }
    // What the residual itself would choose (a delay, a mode) is no drawn place.
    let drawn = |c: &Candidate| c.frequency_hz.is_none() && !matches!(c.hypothesis.map(|h| h.at), Some(Where::Nowhere));
    all.extend(
        path::candidates(bench, data, &split.fit).into_iter().filter(|c| named(c) && drawn(c) && !path::is_delay(c)),
    );
    all.extend(path::delays(bench));
    let hum = Found { at: 50.0, statistic: 0.0, places: SCANNED, modulation: true };
    all.extend(order::at_frequency(bench, data, &split.fit, hum).into_iter().filter(named));
    all.retain(|c| !matches!(c.seat, Some(Seat::EveryTooth(_))));
    all
}

/// Named effects at one whole order and one order of neither shaft.
fn at_drawn_orders(bench: &Bench<'_>, random: &mut ChaCha8Rng) -> Vec<Candidate> {
    let z = f64::from(bench.base.machine.teeth[0]);
    let whole = (4.0 + (1.5 * z - 4.0) * random.random::<f64>()).round();
    let whole = if whole % z == 0.0 { whole + 1.0 } else { whole };
    let off = |x: f64| (x - x.round()).abs();
    let mut free = 0.0;
    while off(free) < 0.1 || off(free / bench.ratio()) < 0.1 {
        free = 2.0 + 6.0 * random.random::<f64>();
    }
    let scanned = |order: f64, searched: f64| {
        order::at_order(bench, order, searched).into_iter().map(|c| Candidate { scanned: SCANNED, ..c })
    };
    scanned(whole, 200.0).chain(scanned(free, 200.0)).filter(|c| c.claim == Claim::Named).collect()
}
