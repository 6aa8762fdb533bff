//! A table of expected levels from values of the sound machine.
//!
//! Least squares in decibels over the logarithm of the speed with the node's own interpolation (hat functions between
//! the table's speeds), so that what is fitted is what the node will expect. Steady speeds give one point each; where
//! they run into each other (a run-up, a machine that wanders) the points lie at equal ratios, as many as the values
//! can carry. The standard uncertainty of a point is that of one further value there: the scatter about the fit, what
//! the fit itself is uncertain by, the owner's allowance for what the observed hours did not show, and a tenth of a
//! decibel for filters. A point with fewer than [`MIN_POINT_VALUES`] values expects nothing of that quantity.
//!
//! A machine of one speed gets one level from all values over time, for speeds within 3 % of those seen: there the
//! node's two points are alike.
//!
//! Limits: a resonance narrower than the distance of two points shows as scatter, honestly but bluntly; loads that
//! did not occur while it was learned are departures afterwards.

use super::observe::{Observation, Observations, QUANTITIES};
use crate::{Error, Result};
use meshband::levels::{ExpectedLevel, LevelPoint, LocalPoint, MAX_LEVELS, Point};
use meshband::units::Hertz;
use nalgebra::{DMatrix, DVector};
use serde::Serialize;

/// Where the quantities of the second table begin.
const FIRST_LOCAL_QUANTITY: usize = 4;
/// Heads of [`Learned::rows`].
pub const HEAD: [&str; 1 + QUANTITIES.len()] =
    ["Hz", "RMS, dB", "velocity RMS, dB", "first mesh harmonic, dB", "residual RMS, dB", "sidebands, dB", "FM0, dB"];
/// Least values behind a point.
pub const MIN_POINT_VALUES: f64 = 3.0;
/// Uncertainty that no scatter shows, dB: ripple of the filters from speed to speed.
pub const FLOOR_DB: f64 = 0.1;
/// Speeds whose ratio is larger than this are two steady speeds.
const MIN_SPEED_RATIO: f64 = 1.03;
/// One steady speed does not wander by more than this ratio.
const MAX_WANDER_RATIO: f64 = 1.05;
/// The outermost points lie this ratio outside the outermost values, so that the next value there is still within.
const MARGIN: f64 = 1.01;

/// What is expected at one speed.
#[derive(Debug, Clone, Copy)]
pub struct Expected {
    /// Pinion rate, Hz.
    pub speed: Hertz,
    /// In the order of [`QUANTITIES`].
    pub levels: [ExpectedLevel; QUANTITIES.len()],
}

impl Point for Expected {
    fn speed(&self) -> Hertz {
        self.speed
    }

    fn levels(&self) -> impl IntoIterator<Item = ExpectedLevel> {
        self.levels
    }
}

/// A table and what it rests on; in JSON, the node's two tables.
#[derive(Debug, Clone, Serialize)]
#[serde(into = "Tables")]
pub struct Learned {
    /// Ascending in speed.
    pub points: Vec<Expected>,
    /// Values behind it, by quantity.
    pub values: [usize; QUANTITIES.len()],
}

/// Makes a table; `allowance_db` is the owner's standard uncertainty for what the values do not show (load,
/// temperature).
///
/// # Errors
/// [`Error::Invalid`] for an allowance that is none, and where there is no value at all.
pub fn learn(observations: &Observations, allowance_db: f64) -> Result<Learned> {
    if !(0.0..=40.0).contains(&allowance_db) {
        return Err(Error::invalid("--allowance", format!("{allowance_db} dB is not within 0 to 40 dB")));
    }
    let speeds = knots(&observations.by_quantity[0]);
    if speeds.is_empty() {
        let what =
            "no value of good quality at a locked speed: a longer record, or one whose tach and signal are sound";
        return Err(Error::invalid("levels", what));
    }
    if let [_] = speeds[..] {
        return Ok(of_one_speed(observations, allowance_db));
    }
    let nothing = |&speed: &f64| Expected { speed: Hertz(speed as f32), levels: Default::default() };
    let mut points: Vec<Expected> = speeds.iter().map(nothing).collect();
    for (quantity, values) in observations.by_quantity.iter().enumerate() {
        for (point, level) in points.iter_mut().zip(fitted(&speeds, values, allowance_db)) {
            point.levels[quantity] = level;
        }
    }
    Ok(Learned { points, values: observations.by_quantity.each_ref().map(Vec::len) })
}

/// A machine of one speed: the same level at both ends of what counts as that speed, scatter over time as everywhere.
fn of_one_speed(observations: &Observations, allowance_db: f64) -> Learned {
    let speeds = observations.by_quantity[0].iter().map(|o| o.speed_hz);
    let [lowest, highest] = [speeds.clone().fold(f64::INFINITY, f64::min), speeds.fold(0.0, f64::max)];
    let levels = observations.by_quantity.each_ref().map(|values| level_of(values, allowance_db));
    let point = |speed: f64| Expected { speed: Hertz(speed as f32), levels };
    let values = observations.by_quantity.each_ref().map(Vec::len);
    Learned { points: vec![point(lowest / MIN_SPEED_RATIO), point(highest * MIN_SPEED_RATIO)], values }
}

/// Mean of all values with the uncertainty of one more.
fn level_of(values: &[Observation], allowance_db: f64) -> ExpectedLevel {
    let count = values.len() as f64;
    if count < MIN_POINT_VALUES {
        return ExpectedLevel::default();
    }
    let mean = values.iter().map(|o| o.level_db).sum::<f64>() / count;
    let scatter: f64 = values.iter().map(|o| (o.level_db - mean).powi(2)).sum();
    let variance = scatter / (count - 1.0) * (1.0 + 1.0 / count);
    let uncertainty = (variance + FLOOR_DB * FLOOR_DB + allowance_db * allowance_db).sqrt();
    ExpectedLevel { level_db: mean as f32, uncertainty_db: uncertainty as f32 }
}

/// Speeds of the table, ascending.
fn knots(values: &[Observation]) -> Vec<f64> {
    let mut speeds: Vec<f64> = values.iter().map(|o| o.speed_hz).collect();
    speeds.sort_by(f64::total_cmp);
    let (Some(&lowest), Some(&highest)) = (speeds.first(), speeds.last()) else { return Vec::new() };
    let steady: Vec<&[f64]> = speeds.chunk_by(|a, b| b / a <= MIN_SPEED_RATIO).collect();
    let wanders = steady.iter().any(|run| run.last().zip(run.first()).is_some_and(|(b, a)| b / a > MAX_WANDER_RATIO));
    let mut knots: Vec<f64> = if wanders || steady.len() > MAX_LEVELS {
        // No more points than there are values to tell each one and its scatter from.
        let points = ((speeds.len() as f64 / (2.0 * MIN_POINT_VALUES)) as usize).clamp(2, MAX_LEVELS);
        let steps = (points - 1) as f64;
        (0..points).map(|n| lowest * (highest / lowest).powf(n as f64 / steps)).collect()
    } else {
        steady.iter().map(|run| run[run.len() / 2]).collect()
    };
    if let [first, .., last] = &mut knots[..] {
        *first = lowest / MARGIN;
        *last = highest * MARGIN;
    }
    knots
}

/// The knots on both sides of a speed, and the share of the upper one.
fn between(speeds: &[f64], speed: f64) -> Option<(usize, f64)> {
    let at = speeds.windows(2).position(|pair| (pair[0]..=pair[1]).contains(&speed))?;
    Some((at, (speed / speeds[at]).ln() / (speeds[at + 1] / speeds[at]).ln()))
}

fn fitted(speeds: &[f64], values: &[Observation], allowance_db: f64) -> Vec<ExpectedLevel> {
    let n = speeds.len();
    let (mut normal, mut right) = (DMatrix::<f64>::zeros(n, n), DVector::<f64>::zeros(n));
    let mut weight = vec![0.0; n];
    let rows: Vec<(usize, f64, f64)> =
        values.iter().filter_map(|o| between(speeds, o.speed_hz).map(|(at, t)| (at, t, o.level_db))).collect();
    for &(at, t, level) in &rows {
        for (i, a) in [(at, 1.0 - t), (at + 1, t)] {
            right[i] += a * level;
            weight[i] += a;
            for (j, b) in [(at, 1.0 - t), (at + 1, t)] {
                normal[(i, j)] += a * b;
            }
        }
    }
    // Points without values stay where nothing pulls; they are left out below.
    for i in 0..n {
        normal[(i, i)] += 1e-9;
    }
    let Some(solved) = normal.cholesky().map(|factor| factor.solve(&right)) else {
        return vec![ExpectedLevel::default(); n];
    };
    let mut scatter = vec![0.0; n];
    for &(at, t, level) in &rows {
        let miss = level - (1.0 - t) * solved[at] - t * solved[at + 1];
        scatter[at] += (1.0 - t) * miss * miss;
        scatter[at + 1] += t * miss * miss;
    }
    let level = |k: usize| {
        if weight[k] < MIN_POINT_VALUES {
            return ExpectedLevel::default();
        }
        // One parameter per point: its variance is that of the values over their number.
        let variance = scatter[k] / (weight[k] - 1.0) * (1.0 + 1.0 / weight[k]);
        let uncertainty = (variance + FLOOR_DB * FLOOR_DB + allowance_db * allowance_db).sqrt();
        ExpectedLevel { level_db: solved[k] as f32, uncertainty_db: uncertainty as f32 }
    };
    (0..n).map(level).collect()
}

#[derive(Serialize)]
struct Tables {
    levels: Vec<LevelPoint>,
    local_levels: Vec<LocalPoint>,
    values: [usize; QUANTITIES.len()],
}

impl From<Learned> for Tables {
    fn from(learned: Learned) -> Self {
        Self {
            levels: learned.levels().collect(),
            local_levels: learned.local_levels().collect(),
            values: learned.values,
        }
    }
}

impl Learned {
    /// The node's table of levels.
    pub fn levels(&self) -> impl Iterator<Item = LevelPoint> {
        self.points.iter().map(|point| {
            let [rms, velocity_rms, mesh_amplitude, residual_rms, ..] = point.levels;
            LevelPoint { speed: point.speed, rms, velocity_rms, mesh_amplitude, residual_rms }
        })
    }

    /// The node's table of what a local fault changes.
    pub fn local_levels(&self) -> impl Iterator<Item = LocalPoint> {
        self.points.iter().map(|point| {
            let [.., sidebands, fm0] = point.levels;
            LocalPoint { speed: point.speed, sidebands, fm0 }
        })
    }

    /// As a settings file of `meshband configure`.
    pub fn to_toml(&self) -> String {
        let mut text = String::from(
            "# Expected levels; dB of m/s2 (velocity m/s, fm0 1). For `meshband configure PORT --settings`.\n",
        );
        for (table, quantities) in
            [("levels", 0..FIRST_LOCAL_QUANTITY), ("local_levels", FIRST_LOCAL_QUANTITY..QUANTITIES.len())]
        {
            for point in &self.points {
                text += &format!("\n[[{table}]]\nspeed = {:.4}\n", point.speed.0);
                for quantity in quantities.clone() {
                    let (name, level) = (QUANTITIES[quantity], point.levels[quantity]);
                    text += &format!(
                        "{name} = {{ level_db = {:.3}, uncertainty_db = {:.3} }}\n",
                        level.level_db, level.uncertainty_db
                    );
                }
            }
        }
        text
    }

    /// One row per point: speed, then level and uncertainty of each quantity.
    pub fn rows(&self) -> Vec<Vec<String>> {
        let cell = |level: ExpectedLevel| match level.uncertainty_db {
            0.0 => "-".to_owned(),
            uncertainty => format!("{:.1} +- {uncertainty:.1}", level.level_db),
        };
        let row =
            |point: &Expected| std::iter::once(format!("{:.2}", point.speed.0)).chain(point.levels.map(cell)).collect();
        self.points.iter().map(row).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use meshband::levels::departure;

    fn observed(values: impl Iterator<Item = (f64, f64)>) -> Observations {
        let rms = values.map(|(speed_hz, level_db)| Observation { speed_hz, level_db }).collect();
        let mut by_quantity: [Vec<Observation>; QUANTITIES.len()] = Default::default();
        by_quantity[0] = rms;
        Observations { by_quantity }
    }

    #[test]
    fn theory_a_line_over_the_logarithm_of_the_speed_is_learned_exactly() {
        let line = |speed: f64| 3.0 + 10.0 * speed.ln();
        let sweep = (0..600).map(|n| 5.0 * 5.0f64.powf(f64::from(n) / 599.0)).map(|speed| (speed, line(speed)));
        let learned = learn(&observed(sweep), 0.0).expect("a sweep");
        assert_eq!((learned.points.len(), learned.values[0]), (MAX_LEVELS, 600));
        for speed in [5.0, 7.3, 12.0, 24.9] {
            let value = 10f64.powf(line(speed) / 20.0) as f32;
            let found = departure(&learned.points, Hertz(speed as f32), 0.0, value, |p| p.levels[0]).expect("within");
            assert!(found.departure_db.abs() < 1e-3 && (found.uncertainty_db - 0.1).abs() < 1e-3, "{found:?}");
        }
        assert!(departure(&learned.points, Hertz(10.0), 0.0, 1.0, |p| p.levels[1]).is_none());
    }

    #[test]
    fn theory_steady_speeds_give_a_point_each_with_their_scatter_and_the_allowance() {
        let values = (0..200).map(|n| (if n < 100 { 10.0 } else { 20.0 }, if n % 2 == 0 { 1.0 } else { -1.0 }));
        let learned = learn(&observed(values), 2.0).expect("two speeds");
        assert_eq!(learned.points.len(), 2);
        for point in &learned.points {
            // Variance 1 of the values, 4 of the allowance, 0.01 of the filters.
            assert!((point.levels[0].uncertainty_db - 5.03f32.sqrt()).abs() < 0.01, "{point:?}");
        }
        assert!(learn(&Observations::default(), 0.0).is_err(), "nothing was heard");
    }

    #[test]
    fn theory_a_machine_of_one_speed_is_expected_at_it_and_nowhere_else() {
        let values = (0..60).map(|n| (24.75 + 0.02 * f64::from(n % 5), if n % 2 == 0 { 4.0 } else { 2.0 }));
        let learned = learn(&observed(values), 1.0).expect("one speed is enough");
        assert_eq!(learned.points.len(), 2, "the node's table has two points at least");
        let at = |speed: f64| {
            let value = 10f64.powf(9.0 / 20.0) as f32;
            departure(&learned.points, Hertz(speed as f32), 0.0, value, |p| p.levels[0])
        };
        let found = at(24.79).expect("this is the speed");
        // Variance 60/59 of the values, 1 of the allowance, 0.01 of the filters.
        let expected = (60.0 / 59.0 * (1.0 + 1.0 / 60.0) + 1.01f64).sqrt();
        assert!((f64::from(found.departure_db) - 6.0).abs() < 1e-3, "{found:?}");
        assert!((f64::from(found.uncertainty_db) - expected).abs() < 1e-3, "{found:?} {expected}");
        assert!(at(25.4).is_some() && at(24.1).is_some(), "slip of 2.5 % is the same speed");
        assert!(at(26.0).is_none() && at(23.0).is_none(), "nothing is known of another speed");
    }

    #[test]
    fn theory_the_file_is_one_that_settings_read() {
        let values = (0..30).map(|n| (if n < 15 { 10.0 } else { 20.0 }, -7.5));
        let mut observations = observed(values);
        observations.by_quantity[5] =
            observations.by_quantity[0].iter().map(|o| Observation { level_db: 12.5, ..*o }).collect();
        let learned = learn(&observations, 1.0).expect("two speeds");
        let settings = crate::link::settings::Settings::from_toml(&learned.to_toml(), "levels.toml").expect("reads");
        let mut config = meshband::config::Configuration::default();
        settings.apply(&mut config).expect("applies");
        assert_eq!((config.levels.len(), config.local_levels.len()), (2, 2));
        assert!(
            (config.levels[1].rms.level_db + 7.5).abs() < 1e-3 && config.levels[1].residual_rms.uncertainty_db == 0.0
        );
        let [_, local] = config.local_levels[..] else { panic!("{:?}", config.local_levels) };
        assert!((local.fm0.level_db - 12.5).abs() < 1e-3 && local.sidebands.uncertainty_db == 0.0, "{local:?}");
        config.validate(meshband::board::Timing::STM32F405).expect("sound");
    }
}
