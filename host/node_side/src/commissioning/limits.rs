//! Sixth step: limits from the baseline's own spread, at a stated rate of false alarms.
//!
//! What is asked for is a number of false alarms per year of turning. Values come once a second at most, and an alarm
//! needs three in a row; because successive values of a machine are alike, three count here as one, not as three
//! independent ones. The chance left to a single value is shared evenly among the quantities watched. A limit lies so
//! many standard uncertainties above the expectation as Student's distribution has at that chance, with the degrees
//! of freedom of the baseline (Welch and Satterthwaite, JCGM 100 G.4; the owner's allowance counts as known). Few
//! values hence mean wide limits, not bold ones.
//!
//! Limits: the tail of a distribution is assumed where nothing has been seen; what the baseline did not meet (load,
//! temperature) is the allowance's business.

use super::baseline::{FEWEST_FREEDOM, Spread, Spreads, departures};
use super::run_up::{Heard, ShapeValue};
use super::step::{Finding, Step, StepRecord};
use crate::levels::learn::{Expected, FLOOR_DB, Learned};
use crate::levels::observe::QUANTITIES;
use crate::link::words;
use meshband::alarm::{AlarmBand, Watched};
use meshband::config::MAX_ALARMS;
use meshband::units::Hertz;
use serde::Serialize;
use statrs::distribution::{ContinuousCDF, StudentsT};

/// Values in a row that raise an alarm.
const PERSISTENCE: u8 = 3;
/// Values of a year of turning.
const VALUES_PER_YEAR: f64 = 365.25 * 86_400.0;
/// What clears, as a share of the limit on a departure; of a shape, of its distance from the mean.
const CLEARING_SHARE: f64 = 0.8;
/// Shapes that are watched, beside the levels of the departure.
const SHAPES: [Watched; 3] = [Watched::Kurtosis, Watched::SidebandEnergyRatio, Watched::Fm4];
/// Parts of the speed range with a limit of their own for each shape: with the departure's they fill seven of eight
/// places.
const PARTS: usize = 2;
/// A range of no more than this ratio has one part: a machine of one speed.
const ONE_PART: f64 = 1.2;
/// Fewest values behind a limit on a shape.
const MIN_VALUES: usize = 8;
/// A limit on a shape further away than this, as a natural logarithm, would never be reached: a factor of four.
const MAX_LN_DISTANCE: f64 = 1.386;
/// Decibels of a natural logarithm.
const DB_PER_NEPER: f64 = 8.685_889_638;
/// A limit lies this ratio above the largest departure of the sound machine at least.
const MIN_LIMIT_RATIO: f64 = 1.2;
/// Degrees of freedom beyond which Student's distribution is Gauss's.
pub const MOST_FREEDOM: f64 = 1e4;

/// Degrees of freedom below which a limit is half as far again as it has to be.
const MIN_FREEDOM: f64 = 20.0;

/// What was proposed and why.
#[derive(Debug, Clone, Serialize)]
pub struct Proposal {
    /// Limits, the departure's first.
    pub alarms: Vec<AlarmBand>,
    /// False alarms per year of turning that were asked for.
    pub false_alarms_per_year: f64,
    /// Chance of a single value beyond one limit.
    pub chance: f64,
    /// Fewest degrees of freedom behind the departure's limit.
    pub freedom: f64,
    /// Largest departure of the sound machine, standard uncertainties.
    pub largest_seen: f64,
    /// The owner's own alarms that stay.
    pub kept: usize,
}

/// Proposes limits; `own` are the configuration's alarms, of which those on other quantities stay.
pub fn propose(
    heard: &Heard,
    (learned, spreads): (&Learned, &Spreads),
    allowance_db: f64,
    per_year: f64,
    own: &[AlarmBand],
) -> (Proposal, StepRecord) {
    let quantities = (QUANTITIES.len() + SHAPES.len()) as f64;
    let chance = per_year / (VALUES_PER_YEAR / f64::from(PERSISTENCE)) / quantities;
    let [from_hz, to_hz] = ends(&learned.points);
    let freedom = freedom(spreads, allowance_db);
    let largest_seen = largest(heard, learned);
    let by_chance = quantile(chance, freedom);
    let limit = by_chance.max(MIN_LIMIT_RATIO * largest_seen);
    let kept: Vec<AlarmBand> = own.iter().copied().filter(|alarm| !is_proposed(alarm.watched)).collect();
    let mut alarms = vec![band(Watched::Departure, [from_hz, to_hz], [limit, CLEARING_SHARE * limit])];
    let mut findings = vec![departure_finding(limit, by_chance, freedom, largest_seen, per_year)];
    for (alarm, finding) in on_shapes(heard, [from_hz, to_hz], allowance_db, chance) {
        alarms.extend(alarm);
        findings.push(finding);
    }
    let room = MAX_ALARMS - kept.len().min(MAX_ALARMS - 1);
    if alarms.len() > room {
        let advice = "the node has eight places and the owner's own alarms go before limits on shape";
        let left_out = alarms.len() - room + kept.len().saturating_sub(MAX_ALARMS - 1);
        findings.push(Finding::warned("places", format!("{left_out} limits left out"), advice));
        alarms.truncate(room);
    }
    alarms.extend(kept.iter().take(MAX_ALARMS - 1));
    let proposal = Proposal {
        alarms,
        false_alarms_per_year: per_year,
        chance,
        freedom,
        largest_seen,
        kept: kept.len().min(MAX_ALARMS - 1),
    };
    (proposal, StepRecord::new(Step::Alarms, findings))
}

fn band(watched: Watched, [from, to]: [f64; 2], [raise, clear]: [f64; 2]) -> AlarmBand {
    AlarmBand {
        watched,
        from: Hertz(from as f32),
        to: Hertz(to as f32),
        raise: raise as f32,
        clear: clear as f32,
        persistence: PERSISTENCE,
    }
}

/// Limits on the shapes, part by part of the range, and what is said of each.
fn on_shapes(
    heard: &Heard,
    [from_hz, to_hz]: [f64; 2],
    allowance_db: f64,
    chance: f64,
) -> Vec<(Option<AlarmBand>, Finding)> {
    let parts = if to_hz / from_hz <= ONE_PART { 1 } else { PARTS };
    let edge = |n: usize| from_hz * (to_hz / from_hz).powf(n as f64 / parts as f64);
    let of = |(watched, part): (Watched, usize)| {
        let ends = [edge(part), edge(part + 1)];
        let is_meant = |v: &&ShapeValue| v.watched == watched && (ends[0]..=ends[1]).contains(&v.speed_hz);
        let logs: Vec<f64> = heard.shapes.iter().filter(is_meant).map(|v| v.value.ln()).collect();
        let what = format!("{}, {:.2} to {:.2} Hz", words::watched(watched), ends[0], ends[1]);
        match shape(&logs, allowance_db, chance) {
            Some(levels) => {
                let seen = format!("{:.3}, from {} values", levels[0], logs.len());
                (Some(band(watched, ends, levels)), Finding::passed(what, seen))
            }
            None => {
                let seen = format!("no limit: {} values, or they scatter too much for one", logs.len());
                (None, Finding::not_judged(what, seen))
            }
        }
    };
    SHAPES.into_iter().flat_map(|watched| (0..parts).map(move |part| (watched, part))).map(of).collect()
}

fn is_proposed(watched: Watched) -> bool {
    watched == Watched::Departure || SHAPES.contains(&watched)
}

fn departure_finding(limit: f64, by_chance: f64, freedom: f64, largest_seen: f64, per_year: f64) -> Finding {
    let freedoms = if freedom < MOST_FREEDOM { format!("{freedom:.0}") } else { format!("more than {MOST_FREEDOM}") };
    let seen = format!(
        "{limit:.2} standard uncertainties, {PERSISTENCE} values in a row: false alarms per year of turning \
         {per_year} at {freedoms} degrees of freedom; largest of the sound machine {largest_seen:.2}"
    );
    if limit > by_chance {
        let advice = "the sound machine itself departed by more than its spread says: more values per class \
            (--values) or a larger --allowance";
        return Finding::warned("Departure", seen, advice);
    }
    if freedom < MIN_FREEDOM {
        let advice = "few values mean wide limits: more of them per class (--values) make them narrower";
        return Finding::warned("Departure", seen, advice);
    }
    Finding::passed("Departure", seen)
}

fn ends(points: &[Expected]) -> [f64; 2] {
    let speed = |point: Option<&Expected>| point.map_or(1.0, |point| f64::from(point.speed.0));
    [speed(points.first()), speed(points.last())]
}

/// Fewest effective degrees of freedom of all expectations: what is known of an uncertainty has endless ones.
fn freedom(spreads: &Spreads, allowance_db: f64) -> f64 {
    let of = |spread: &Spread| {
        let all = spread.variance + FLOOR_DB * FLOOR_DB + allowance_db * allowance_db;
        spread.freedom * (all / spread.variance.max(1e-9)).powi(2)
    };
    let known = spreads.iter().filter(|spread| spread.freedom >= FEWEST_FREEDOM);
    known.map(of).fold(MOST_FREEDOM, f64::min).max(1.0)
}

/// Largest departure of the values that the table was learned from.
fn largest(heard: &Heard, learned: &Learned) -> f64 {
    let all = (0..QUANTITIES.len()).flat_map(|quantity| departures(heard, &learned.points, quantity));
    all.map(|departure| f64::from(departure.normalised())).fold(0.0, f64::max)
}

/// Limit and what clears it, of a quantity whose logarithms, given here, scatter evenly; none from too few values, or
/// where it would be out of reach.
pub fn shape(logs: &[f64], allowance_db: f64, chance: f64) -> Option<[f64; 2]> {
    if logs.len() < MIN_VALUES {
        return None;
    }
    let count = logs.len() as f64;
    let mean = logs.iter().sum::<f64>() / count;
    let scatter = logs.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / (count - 1.0) * (1.0 + 1.0 / count);
    let known = (allowance_db / DB_PER_NEPER).powi(2) + (FLOOR_DB / DB_PER_NEPER).powi(2);
    let all = scatter + known;
    let freedom = ((count - 1.0) * (all / scatter.max(1e-12)).powi(2)).min(MOST_FREEDOM);
    let distance = quantile(chance, freedom) * all.sqrt();
    (distance < MAX_LN_DISTANCE).then(|| [(mean + distance).exp(), (mean + CLEARING_SHARE * distance).exp()])
}

/// What Student's variable of so many degrees of freedom exceeds with this chance.
pub fn quantile(chance: f64, freedom: f64) -> f64 {
    let student = StudentsT::new(0.0, 1.0, freedom.clamp(1.0, MOST_FREEDOM));
    student.map_or(f64::INFINITY, |student| -student.inverse_cdf(chance))
}
