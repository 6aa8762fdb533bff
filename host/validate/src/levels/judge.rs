//! Absolute and departure alarms on the same hours, at equal rates of false alarms.
//!
//! Each policy has one number, the limit: of a departure in standard uncertainties; of an absolute alarm a factor on
//! what the quantity exceeded in one of a thousand values of the hours that also taught the departure its levels.
//! Absolute limits are for all speeds, or for three classes of equal ratio each, as `alarms` of a configuration has
//! them; "all of them" is what a careful owner configures, every quantity in every class. The limit is the lowest one
//! from which on the sound hours give no more false alarms than allowed; it is chosen on the very hours that it is
//! counted on, for all policies alike. Alarms are the node's ([`meshband::alarm::Alarm`]): three values in a row,
//! cleared at nine tenths.

use super::hours::{ABSOLUTE_QUANTITIES, Sample};
use meshband::alarm::{Alarm, AlarmBand, AlarmHolding, Put, Side, Use, Watched};
use meshband::units::Hertz;
use rayon::prelude::*;
use serde::Serialize;

/// Values in a row.
const PERSISTENCE: u8 = 3;
/// Level that clears, as a share of the limit.
const CLEARING_SHARE: f32 = 0.9;
/// Speed classes of absolute alarms.
const CLASSES: usize = 3;
/// Share of the taught values below an absolute alarm's unit.
const QUANTILE: f64 = 0.999;
/// Limits tried, from the lowest on at equal ratios.
const LIMITS: (f32, f32, i32) = (0.3, 1.02, 300);
/// Parts of the fault's growth in the detection curve.
pub const PARTS: usize = 5;

/// What is watched.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Policy {
    /// The departure.
    Departure,
    /// One absolute quantity, one limit for all speeds.
    One(usize),
    /// One absolute quantity, limits by class.
    Classes(usize),
    /// All absolute quantities, limits by class.
    All,
}

impl Policy {
    /// Every policy, the departure first.
    pub fn all() -> Vec<Self> {
        let quantities = 0..ABSOLUTE_QUANTITIES.len();
        let mut all = vec![Self::Departure, Self::All];
        all.extend(quantities.clone().map(Self::Classes));
        all.extend(quantities.map(Self::One));
        all
    }

    /// For tables.
    pub fn name(self) -> String {
        match self {
            Self::Departure => "Departure".into(),
            Self::All => "all absolute, by class".into(),
            Self::Classes(q) => format!("{}, by class", ABSOLUTE_QUANTITIES[q]),
            Self::One(q) => format!("{}, one limit", ABSOLUTE_QUANTITIES[q]),
        }
    }
}

/// What sound hours taught an owner of absolute alarms.
pub struct Scales {
    range_hz: (f64, f64),
    overall: [f32; 8],
    by_class: [[f32; 8]; CLASSES],
}

impl Scales {
    /// From the hours that taught the departure, too.
    pub fn new(taught: &[Sample], range_hz: (f64, f64)) -> Self {
        let mut scales = Self { range_hz, overall: [0.0; 8], by_class: [[0.0; 8]; CLASSES] };
        for q in 0..ABSOLUTE_QUANTITIES.len() {
            scales.overall[q] = quantile(taught.iter().map(|s| s.values[q]));
            for class in 0..CLASSES {
                let of_class = taught.iter().filter(|s| scales.class(s.speed_hz) == class).map(|s| s.values[q]);
                scales.by_class[class][q] = quantile(of_class);
            }
        }
        scales
    }

    fn class(&self, speed_hz: f64) -> usize {
        let (low, high) = self.range_hz;
        ((CLASSES as f64 * (speed_hz / low).ln() / (high / low).ln()) as usize).min(CLASSES - 1)
    }

    /// Which alarm of a policy a value goes to, and the value in its limit's unit.
    fn values(&self, policy: Policy, sample: &Sample, mut give: impl FnMut(usize, f32)) {
        let class = self.class(sample.speed_hz);
        match policy {
            Policy::Departure => sample.departure.into_iter().for_each(|departure| give(0, departure)),
            Policy::One(q) => give(0, sample.values[q] / self.overall[q]),
            Policy::Classes(q) => give(class, sample.values[q] / self.by_class[class][q]),
            Policy::All => {
                (0..ABSOLUTE_QUANTITIES.len())
                    .for_each(|q| give(CLASSES * q + class, sample.values[q] / self.by_class[class][q]));
            }
        }
    }
}

fn quantile(values: impl Iterator<Item = f32>) -> f32 {
    let mut sorted: Vec<f32> = values.filter(|v| v.is_finite()).collect();
    sorted.sort_by(f32::total_cmp);
    let at = (QUANTILE * sorted.len() as f64) as usize;
    sorted.get(at.min(sorted.len().saturating_sub(1))).copied().unwrap_or(f32::NAN)
}

/// A policy's alarms at a limit, over one hour: whether any stands, value by value.
fn standing(scales: &Scales, policy: Policy, limit: f32, hour: &[Sample]) -> Vec<bool> {
    let band = AlarmBand {
        watched: Watched::Departure,
        from: Hertz(0.0),
        to: Hertz(1000.0),
        raise: limit,
        clear: CLEARING_SHARE * limit,
        persistence: PERSISTENCE,
    };
    let mut alarms = [Alarm::default(); CLASSES * ABSOLUTE_QUANTITIES.len()];
    let of = |sample: &Sample| {
        scales.values(policy, sample, |alarm, value| {
            let put = Put { tick: 0, value, may: Use::Both };
            alarms[alarm].update(&band, Side::Above, &AlarmHolding::default(), [0, 1], put);
        });
        alarms.iter().any(Alarm::stands)
    };
    hour.iter().map(of).collect()
}

/// Times that no alarm stood and one was raised.
fn raised(standing: &[bool]) -> usize {
    usize::from(standing.first() == Some(&true)) + standing.windows(2).filter(|pair| !pair[0] && pair[1]).count()
}

/// What a policy is worth against one fault.
#[derive(Debug, Clone, Serialize)]
pub struct Detection {
    /// Median severity at the first alarm over the repetitions; `None` where fewer than half of them had one.
    pub first: Option<f64>,
    /// Share of the values at which an alarm stood, by part of the growth.
    pub standing: [f64; PARTS],
}

/// A policy at one allowed rate of false alarms.
#[derive(Debug, Clone, Serialize)]
pub struct Row {
    /// Policy.
    pub policy: String,
    /// False alarms allowed in all sound hours.
    pub allowed: usize,
    /// Limit that keeps to it.
    pub limit: f32,
    /// False alarms there.
    pub false_alarms: usize,
    /// By fault.
    pub detection: Vec<Detection>,
}

/// Judges all policies; `faulty` has the repetitions of each fault.
pub fn judge(scales: &Scales, sound: &[Vec<Sample>], faulty: &[Vec<Vec<Sample>>], allowed: &[usize]) -> Vec<Row> {
    let (lowest, ratio, count) = LIMITS;
    let limits: Vec<f32> = (0..count).map(|n| lowest * ratio.powi(n)).collect();
    let of_policy = |policy: Policy| {
        let alarms: Vec<usize> = limits
            .iter()
            .map(|&limit| sound.iter().map(|hour| raised(&standing(scales, policy, limit, hour))).sum())
            .collect();
        let row = |&allowed: &usize| {
            // The first limit above the last one that gives too many.
            let at = alarms.iter().rposition(|&n| n > allowed).map_or(0, |last| last + 1).min(limits.len() - 1);
            let detection = faulty.iter().map(|hours| detection(scales, policy, limits[at], hours)).collect();
            Row { policy: policy.name(), allowed, limit: limits[at], false_alarms: alarms[at], detection }
        };
        allowed.iter().map(row).collect::<Vec<Row>>()
    };
    Policy::all().into_par_iter().flat_map_iter(of_policy).collect()
}

fn detection(scales: &Scales, policy: Policy, limit: f32, hours: &[Vec<Sample>]) -> Detection {
    let (mut firsts, mut counts) = (Vec::new(), [(0usize, 0usize); PARTS]);
    for hour in hours {
        let stands = standing(scales, policy, limit, hour);
        firsts.extend(stands.iter().position(|&is| is).map(|at| hour[at].severity));
        for (sample, is) in hour.iter().zip(stands) {
            let part = ((sample.severity * PARTS as f64) as usize).min(PARTS - 1);
            counts[part].0 += usize::from(is);
            counts[part].1 += 1;
        }
    }
    // Hours without an alarm lie behind all others.
    firsts.sort_by(f64::total_cmp);
    Detection {
        first: firsts.get(hours.len() / 2).copied(),
        standing: counts.map(|(n, of)| n as f64 / of.max(1) as f64),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hour(departure: impl Fn(f64) -> f32) -> Vec<Sample> {
        let at = |n: i32| f64::from(n) / 1000.0;
        let sample =
            |n| Sample { severity: at(n), speed_hz: 10.0, values: [1.0; 8], departure: Some(departure(at(n))) };
        (0..1000).map(sample).collect()
    }

    #[test]
    fn theory_the_limit_is_the_lowest_that_keeps_to_the_false_alarms_allowed() {
        // One excursion to 4 and one to 2 that persist.
        let sound = hour(|s| {
            if (0.20..0.21).contains(&s) {
                4.0
            } else if (0.6..0.61).contains(&s) {
                2.0
            } else {
                0.0
            }
        });
        let growing = hour(|s| 10.0 * s as f32);
        let scales = Scales::new(&sound, (5.0, 20.0));
        let rows = judge(&scales, &[sound], &[vec![growing.clone(), growing]], &[0, 1]);
        let of = |n: usize| &rows[n];
        assert_eq!((of(0).policy.as_str(), of(0).false_alarms, of(1).false_alarms), ("Departure", 0, 1));
        assert!((4.0..4.1).contains(&of(0).limit) && (2.0..2.05).contains(&of(1).limit), "{rows:?}");
        let first = of(0).detection[0].first.expect("grows beyond it");
        assert!((first - f64::from(of(0).limit) / 10.0).abs() < 0.004, "{first}");
        assert_eq!(of(0).detection[0].standing[0], 0.0);
        assert_eq!(of(0).detection[0].standing[PARTS - 1], 1.0);
        // The absolute values never move: no alarm above their own quantile.
        assert!(
            rows.iter()
                .filter(|row| row.policy != "Departure")
                .all(|row| row.detection[0].first.is_none() || row.limit < 1.0)
        );
    }
}
