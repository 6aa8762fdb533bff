//! Expected levels over speed, and how far a value departs from them.
//!
//! Vibration of a sound machine changes by tens of decibels with its speed; a limit that holds at every speed is
//! therefore above most faults. A small table says what is expected instead: per quantity a level and its standard
//! uncertainty at a few speeds, linear in decibels over the logarithm of the speed between them, nothing outside. It
//! is learned on the sound machine or computed from its model (`meshband levels`). The departure is value less
//! expectation, upwards positive; its standard uncertainty is the table's and what the speed's uncertainty makes of
//! the table's slope, in quadrature (JCGM 100, 5.1.2). Alarms watch the largest departure over its uncertainty, so
//! that quantities that scatter much and little are comparable.
//!
//! Two tables: levels of the whole signal, which show what changes all teeth, and what a local fault changes, the
//! sidebands of all harmonics and FM0, which one tooth moves before it moves any level. Each has speeds of its own
//! (the second one came later, and stored configurations only grow at their end).
//!
//! The table's uncertainty has to contain what the machine itself does at one speed (load, temperature); the node
//! knows neither. Cost: four logarithms per quantity and record of values, once a second; nothing per sample.

use crate::math;
use crate::units::Hertz;
use serde::{Deserialize, Serialize};

/// Most speeds in a table.
pub const MAX_LEVELS: usize = 12;

/// Largest standard uncertainty that a table may state, dB.
const MAX_UNCERTAINTY_DB: f32 = 60.0;

/// Least standard uncertainty that a table may state, dB: below it the filters' own ripple would count.
const LEAST_UNCERTAINTY_DB: f32 = 0.01;

/// Expected level of one quantity at one speed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ExpectedLevel {
    /// 20 log10 of the value in its unit (m/s^2; velocity m/s; FM0 1), dB, -200 to 200.
    pub level_db: f32,
    /// Standard uncertainty, dB, 0.01 to 60; 0 where nothing is expected of this quantity.
    pub uncertainty_db: f32,
}

impl ExpectedLevel {
    fn is_sane(&self) -> bool {
        let uncertain = (LEAST_UNCERTAINTY_DB..=MAX_UNCERTAINTY_DB).contains(&self.uncertainty_db);
        (-200.0..=200.0).contains(&self.level_db) && (uncertain || self.uncertainty_db == 0.0)
    }
}

/// Expected levels at one speed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LevelPoint {
    /// Pinion rate, Hz, positive.
    pub speed: Hertz,
    /// Of the acceleration's root mean square.
    pub rms: ExpectedLevel,
    /// Of the velocity's root mean square in its band.
    pub velocity_rms: ExpectedLevel,
    /// Of the amplitude of the first mesh harmonic.
    pub mesh_amplitude: ExpectedLevel,
    /// Of the root mean square of the residual signal of the synchronous average.
    pub residual_rms: ExpectedLevel,
}

/// Expected levels, at one speed, of what a local fault changes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LocalPoint {
    /// Pinion rate, Hz, positive.
    pub speed: Hertz,
    /// Of the sidebands of all mesh harmonics ([`crate::mesh_band::sideband_amplitude`]).
    pub sidebands: ExpectedLevel,
    /// Of FM0 of the synchronous average, dB of 1.
    pub fm0: ExpectedLevel,
}

/// A point of a table over speed.
pub trait Point {
    /// Pinion rate, Hz.
    fn speed(&self) -> Hertz;

    /// All that is expected there.
    fn levels(&self) -> impl IntoIterator<Item = ExpectedLevel>;
}

impl Point for LevelPoint {
    fn speed(&self) -> Hertz {
        self.speed
    }

    fn levels(&self) -> impl IntoIterator<Item = ExpectedLevel> {
        [self.rms, self.velocity_rms, self.mesh_amplitude, self.residual_rms]
    }
}

impl Point for LocalPoint {
    fn speed(&self) -> Hertz {
        self.speed
    }

    fn levels(&self) -> impl IntoIterator<Item = ExpectedLevel> {
        [self.sidebands, self.fm0]
    }
}

/// Whether a table has ascending speeds and levels in their ranges; without points it is not in use.
pub fn are_sane<P: Point>(points: &[P]) -> bool {
    let ascend = points.windows(2).all(|pair| matches!(pair, [a, b] if a.speed().0 < b.speed().0));
    let sane = |point: &P| {
        (0.01..=1000.0).contains(&point.speed().0) && point.levels().into_iter().all(|level| level.is_sane())
    };
    ascend && points.len() != 1 && points.iter().all(sane)
}

/// A value against its expectation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Departure {
    /// Value over expectation, dB.
    pub departure_db: f32,
    /// Its standard uncertainty, dB.
    pub uncertainty_db: f32,
}

impl Departure {
    /// In standard uncertainties: what alarms watch.
    pub fn normalised(&self) -> f32 {
        self.departure_db / self.uncertainty_db
    }
}

/// Departures of all quantities that have an expectation at the present speed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Departures {
    /// Of the acceleration's root mean square.
    pub rms: Option<Departure>,
    /// Of the velocity's root mean square.
    pub velocity_rms: Option<Departure>,
    /// Of the first mesh harmonic, of the latest mesh-band record.
    pub mesh_amplitude: Option<Departure>,
    /// Of the residual signal, of the latest synchronous average.
    pub residual_rms: Option<Departure>,
}

impl Departures {
    /// None known.
    pub const NONE: Self = Self { rms: None, velocity_rms: None, mesh_amplitude: None, residual_rms: None };

    /// The largest in standard uncertainties; `None` where nothing is expected.
    pub fn largest(&self) -> Option<f32> {
        largest(&[self.rms, self.velocity_rms, self.mesh_amplitude, self.residual_rms])
    }
}

/// Departures of what a local fault changes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LocalDepartures {
    /// Of the sidebands of all mesh harmonics, of the latest mesh-band record.
    pub sidebands: Option<Departure>,
    /// Of FM0, of the latest synchronous average.
    pub fm0: Option<Departure>,
}

impl LocalDepartures {
    /// None known.
    pub const NONE: Self = Self { sidebands: None, fm0: None };

    /// The largest in standard uncertainties; `None` where nothing is expected.
    pub fn largest(&self) -> Option<f32> {
        largest(&[self.sidebands, self.fm0])
    }
}

fn largest(all: &[Option<Departure>]) -> Option<f32> {
    all.iter().flatten().map(Departure::normalised).reduce(f32::max)
}

/// Departure of a positive value at a pinion rate with its relative standard uncertainty; `of` selects the quantity.
/// `None` outside the table and where it expects nothing.
pub fn departure<P: Point>(
    points: &[P],
    speed: Hertz,
    speed_uncertainty: f32,
    value: f32,
    of: impl Fn(&P) -> ExpectedLevel,
) -> Option<Departure> {
    let is_between = |a: &P, b: &P| (a.speed().0..=b.speed().0).contains(&speed.0);
    let pair = points.windows(2).find(|pair| matches!(pair, [a, b] if is_between(a, b)))?;
    let [below, above] = pair else { return None };
    let ends = [(below.speed(), of(below)), (above.speed(), of(above))];
    between_points(ends, speed, speed_uncertainty, value)
}

/// One copy of it in an image: every caller would have its own.
#[inline(never)]
fn between_points(
    [(below, low), (above, high)]: [(Hertz, ExpectedLevel); 2],
    speed: Hertz,
    speed_uncertainty: f32,
    value: f32,
) -> Option<Departure> {
    let known = low.uncertainty_db > 0.0 && high.uncertainty_db > 0.0 && value > 0.0 && value.is_finite();
    if !known {
        return None;
    }
    let span = math::ln(above.0 / below.0);
    let share = math::ln(speed.0 / below.0) / span;
    let between = |a: f32, b: f32| a + share * (b - a);
    let of_speed = (high.level_db - low.level_db) / span * speed_uncertainty;
    Some(Departure {
        departure_db: math::decibels(value) - between(low.level_db, high.level_db),
        uncertainty_db: math::hypot(between(low.uncertainty_db, high.uncertainty_db), of_speed),
    })
}
