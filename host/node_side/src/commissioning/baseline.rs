//! Fifth step: the levels of the sound machine over its speeds, by the same table as `meshband levels learn`.
//!
//! A table of twelve points from a hundred values has a handful behind each point, and a spread from a handful is
//! hardly known: limits from it would be several times too wide or too bold. So the spread about the table is pooled
//! over all points of a quantity, and no point counts as less uncertain than that. A quantity with too few values to
//! tell its spread is not expected at all.

use super::coverage::STRETCHES;
use super::run_up::Heard;
use super::step::{Finding, Step, StepRecord};
use crate::Result;
use crate::levels::learn::{Expected, FLOOR_DB, Learned, learn};
use crate::levels::observe::{Observation, QUANTITIES};
use meshband::levels::{Departure, ExpectedLevel, departure};
use meshband::units::Hertz;
use serde::Serialize;

/// Largest useful standard uncertainty of an expected level, dB: beyond it a fault has to triple the value before
/// anybody is told.
const USEFUL_DB: f32 = 3.0;
/// Difference of stretches of a steady machine that load or temperature explain rather than chance, dB.
const DRIFT_DB: f64 = 1.0;
/// Names of the quantities, in the order of the observations.
pub const NAMES: [&str; QUANTITIES.len()] =
    ["RMS", "velocity RMS", "first mesh harmonic", "residual RMS", "sidebands", "FM0"];

/// Fewest degrees of freedom behind a spread.
pub const FEWEST_FREEDOM: f64 = 10.0;

/// The spread of a quantity about the table, over all speeds.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Spread {
    /// Variance of a value, dB squared.
    pub variance: f64,
    /// Values less points of the table.
    pub freedom: f64,
}

/// By quantity.
pub type Spreads = [Spread; QUANTITIES.len()];

/// Learns the table from what lies within the filled classes.
///
/// # Errors
/// An allowance that is none, values at fewer than two speeds.
pub fn baseline(heard: &mut Heard, allowance_db: f64) -> Result<(Learned, Spreads, StepRecord)> {
    if let Some([slowest, fastest]) = heard.coverage.covered_hz() {
        for values in &mut heard.levels.by_quantity {
            values.retain(|value| (slowest..=fastest).contains(&value.speed_hz));
        }
        heard.shapes.retain(|value| (slowest..=fastest).contains(&value.speed_hz));
    }
    let mut learned = learn(&heard.levels, allowance_db)?;
    let spreads = pool(heard, &mut learned, allowance_db);
    let ends = [learned.points.first(), learned.points.last()].map(|point| point.map_or(0.0, |point| point.speed.0));
    let seen = format!("{} points, {:.2} to {:.2} Hz", learned.points.len(), ends[0], ends[1]);
    let is_empty = learned.points.iter().flat_map(|point| point.levels).all(|level| level.uncertainty_db == 0.0);
    let mut findings = vec![match is_empty {
        true => Finding::refused(
            "table of expected levels",
            seen,
            "nothing can be expected from so few values: more of them (--values)",
        ),
        false => Finding::passed("table of expected levels", seen),
    }];
    for ((quantity, name), values) in NAMES.into_iter().enumerate().zip(learned.values) {
        let of_all = learned.points.iter().map(|point| point.levels[quantity]);
        let levels: Vec<ExpectedLevel> = of_all.filter(|level| level.uncertainty_db > 0.0).collect();
        let worst = levels.iter().map(|level| level.uncertainty_db).fold(0.0, f32::max);
        let seen = match levels.len() {
            0 => format!("{values} values"),
            known => format!(
                "{known} of {} points from {values} values, standard uncertainty {worst:.2} dB at most",
                learned.points.len()
            ),
        };
        findings.push(match levels.len() {
            0 => Finding::warned(name, seen, "nothing is expected of it: too few values (--values), or no mesh line"),
            _ if worst > USEFUL_DB => {
                let advice = "it scatters much at one speed: steadier load while commissioning, or a resonance \
                    between two points";
                Finding::warned(name, seen, advice)
            }
            _ => Finding::passed(name, seen),
        });
    }
    findings.extend(over_time(heard));
    Ok((learned, spreads, StepRecord::new(Step::Baseline, findings)))
}

/// For a machine of one speed: what its level did while it was listened to, stretch by stretch; load and temperature
/// show here or nowhere.
fn over_time(heard: &Heard) -> Option<Finding> {
    let values = &heard.levels.by_quantity[0];
    if !heard.coverage.has_one_speed() || values.len() < STRETCHES {
        return None;
    }
    let mean = |part: &[Observation]| part.iter().map(|value| value.level_db).sum::<f64>() / part.len() as f64;
    let means: Vec<f64> = values.chunks(values.len().div_ceil(STRETCHES)).map(mean).collect();
    let [low, high] =
        [means.iter().copied().fold(f64::INFINITY, f64::min), means.iter().copied().fold(f64::MIN, f64::max)];
    let seen = format!("means of {} stretches within {:.2} dB of each other", means.len(), high - low);
    Some(if high - low > DRIFT_DB {
        let advice = "the level follows load or temperature: listen through more of both (--values), or allow for it \
            (--allowance)";
        Finding::warned("RMS over time", seen, advice)
    } else {
        Finding::passed("RMS over time", seen)
    })
}

/// Pools each quantity's spread, and raises the points that claim less.
fn pool(heard: &Heard, learned: &mut Learned, allowance_db: f64) -> Spreads {
    let mut spreads = Spreads::default();
    for (quantity, spread) in spreads.iter_mut().enumerate() {
        let squares: Vec<f64> =
            departures(heard, &learned.points, quantity).map(|found| f64::from(found.departure_db).powi(2)).collect();
        let points = learned.points.iter().filter(|point| point.levels[quantity].uncertainty_db > 0.0).count();
        spread.freedom = (squares.len() as f64 - points as f64).max(0.0);
        spread.variance = squares.iter().sum::<f64>() / spread.freedom.max(1.0);
        let least = (spread.variance + FLOOR_DB * FLOOR_DB + allowance_db * allowance_db).sqrt() as f32;
        for point in &mut learned.points {
            let level = &mut point.levels[quantity];
            level.uncertainty_db = match level.uncertainty_db {
                0.0 => 0.0,
                _ if spread.freedom < FEWEST_FREEDOM => 0.0,
                own => own.max(least),
            };
        }
    }
    spreads
}

/// What a quantity's values depart by from the table, where it expects something of them.
pub(super) fn departures(heard: &Heard, points: &[Expected], quantity: usize) -> impl Iterator<Item = Departure> {
    heard.levels.by_quantity[quantity].iter().filter_map(move |value| {
        let linear = 10f64.powf(value.level_db / 20.0) as f32;
        departure(points, Hertz(value.speed_hz as f32), 0.0, linear, |point| point.levels[quantity])
    })
}
