//! Synchronous averages of every gear of a train, those of suns and planets through the window of planets passing.
//!
//! A gear's average is the signal folded at its rate; what turns otherwise falls with the number of periods. In a set
//! whose carrier turns, a planet is heard best as it passes the sensor: the average is weighted there (McFadden
//! 1991), planet by planet, and for the sun at every pass. When planets pass is read from the phase between two
//! neighbouring lines of the sound mesh. Folds have [`POINTS`] places: orders of the gear beyond half of them are
//! lost.

use super::angle::Angle;
use super::average::{Indicators, judged};
use super::lines::OrderLines;
use crate::train::{Gear, Mesh, Role, Train, phasing};
use meshband::indicators::RunEnsemble;
use rustfft::num_complex::Complex64;
use serde::Serialize;
use std::f64::consts::{PI, TAU};

/// Places of a fold.
pub const POINTS: usize = 2048;
/// Fewest periods that make an average.
const MIN_PERIODS: f64 = 8.0;
/// Carrier orders about the first harmonic among which the lines that say when planets pass are looked for, times the
/// planets.
const PASSES: i64 = 2;

/// The average of one gear.
#[derive(Debug, Clone, Serialize)]
pub struct GearAverage {
    /// "pinion of stage 2", "planet 3 of stage 1".
    pub gear: String,
    /// Teeth.
    pub teeth: u32,
    /// Periods averaged.
    pub periods: f64,
    /// Whether it is weighted where planets pass.
    pub windowed: bool,
    /// The node's indicators.
    pub indicators: Indicators,
    /// Tooth pitch in which the difference signal has most energy.
    pub strongest_tooth: usize,
    /// Its energy over that of the median pitch.
    pub strongest_tooth_over_median: f64,
    /// The average over one period.
    pub samples: Vec<f32>,
}

/// When planets pass the sensor.
#[derive(Debug, Clone, Copy)]
struct Passing {
    /// Order of the carrier.
    carrier: f64,
    planets: u32,
    /// Turns of the carrier by which the first pass comes early.
    offset: f64,
}

impl Passing {
    fn of(mesh: &Mesh, lines: &OrderLines) -> Option<Self> {
        let carrier = mesh.carrier.as_ref().filter(|carrier| carrier.speed.sign() != 0)?;
        let planets = i64::from(carrier.planets);
        let reach = PASSES * planets;
        let stands: Vec<i64> = (-reach..=reach).filter(|n| phasing::stands(carrier, 1, *n)).collect();
        let read =
            |n: i64| phasing::order(mesh, carrier, 1, n).ok().map(|order| (order.value(), lines.at(order.value())));
        let pairs = stands.windows(2).filter(|w| w[1] - w[0] == planets);
        let pair = |w: &[i64]| Some((read(w[0])?, read(w[1])?));
        let strength = |p: &((f64, Complex64), (f64, Complex64))| p.0.1.norm() * p.1.1.norm();
        let (low, high) = pairs.filter_map(pair).max_by(|a, b| strength(a).total_cmp(&strength(b)))?;
        let (low, high) = if low.0 < high.0 { (low.1, high.1) } else { (high.1, low.1) };
        let phase = (high * low.conj()).arg();
        Some(Self {
            carrier: carrier.speed.magnitude().value(),
            planets: carrier.planets,
            offset: phase / TAU / f64::from(carrier.planets),
        })
    }

    /// Weight at `turns` of the input for a planet, or for any.
    fn weight(&self, turns: f64, planet: Option<u32>) -> f64 {
        let passes = (turns * self.carrier + self.offset) * f64::from(self.planets);
        let nearest = passes.round();
        let is_own = planet.is_none_or(|p| (nearest as i64).rem_euclid(i64::from(self.planets)) == i64::from(p));
        if is_own { (PI * (passes - nearest)).cos().powi(4) } else { 0.0 }
    }
}

/// Averages of all gears that turn often enough; samples are at equal angles of the input from its `angle.from_turn`
/// on.
pub fn averages(samples: &[f64], angle: &Angle, train: &Train, lines: &OrderLines) -> Vec<GearAverage> {
    let mut all = Vec::new();
    for mesh in train.meshes.iter().filter(|mesh| mesh.exact) {
        let passing = Passing::of(mesh, lines);
        for gear in mesh.gears.iter().map(|g| &train.gears[*g]) {
            match (&passing, gear.role) {
                (Some(passing), Role::Planet) => {
                    all.extend(
                        (0..passing.planets).filter_map(|p| of_gear(samples, angle, gear, Some((*passing, Some(p))))),
                    );
                }
                (Some(passing), Role::Sun) => all.extend(of_gear(samples, angle, gear, Some((*passing, None)))),
                _ => all.extend(of_gear(samples, angle, gear, None)),
            }
        }
    }
    all
}

fn of_gear(
    samples: &[f64],
    angle: &Angle,
    gear: &Gear,
    passing: Option<(Passing, Option<u32>)>,
) -> Option<GearAverage> {
    let rate = gear.rate.magnitude().value();
    let periods = rate * angle.turns as f64;
    if periods < MIN_PERIODS {
        return None;
    }
    let weight = |turns: f64| passing.as_ref().map_or(1.0, |(passing, planet)| passing.weight(turns, *planet));
    let fold = folded(samples, angle.per_turn[0], rate, &weight)?;
    let samples: Vec<f32> = fold.iter().map(|x| *x as f32).collect();
    let own = judged("", periods as usize, false, samples, gear.teeth, &mut RunEnsemble::default());
    let word = match passing {
        Some((_, Some(planet))) => format!("planet {} of stage {}", planet + 1, gear.stage + 1),
        _ => gear.words(),
    };
    Some(GearAverage {
        gear: word,
        teeth: gear.teeth,
        periods,
        windowed: passing.is_some(),
        indicators: own.indicators,
        strongest_tooth: own.strongest_tooth,
        strongest_tooth_over_median: own.strongest_tooth_over_median,
        samples: own.samples,
    })
}

/// Weighted mean over the periods of a rate, from the first sample on; none where a place has no weight.
pub fn folded(samples: &[f64], per_turn: usize, rate: f64, weight: &dyn Fn(f64) -> f64) -> Option<Vec<f64>> {
    let (mut sums, mut weights) = (vec![0.0; POINTS], vec![0.0; POINTS]);
    for (i, x) in samples.iter().enumerate() {
        let turns = i as f64 / per_turn as f64;
        let place = ((turns * rate).rem_euclid(1.0) * POINTS as f64) as usize % POINTS;
        let w = weight(turns);
        sums[place] += w * x;
        weights[place] += w;
    }
    let least = 1e-3 * weights.iter().sum::<f64>() / POINTS as f64;
    weights.iter().all(|w| *w > least).then(|| sums.iter().zip(&weights).map(|(s, w)| s / w).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::Declaration;

    #[test]
    fn theory_a_knock_of_one_planet_stands_in_its_windowed_average_and_in_no_other() {
        let text = "[[stage]]\nkind = \"planetary\"\nsun = 31\nplanet = 32\nring = 95\nplanets = 3\nfixed \
            = \"ring\"\ninput = \"sun\"\n";
        let train = Train::of(Declaration::parse(text, "t").unwrap()).unwrap();
        let (carrier, rate) = (31.0 / 126.0, 95.0 * 31.0 / (126.0 * 32.0));
        let (per_turn, turns) = (400, 3000);
        // Three planets pass a sensor at turn fractions 0, 1/3, 2/3 of the carrier; each is heard for a sixth of a
        // turn either way.
        let near = |turn: f64, planet: f64| {
            let away = (turn * carrier - planet / 3.0 + 0.5).rem_euclid(1.0) - 0.5;
            if away.abs() < 1.0 / 6.0 { (PI * 3.0 * away).cos().powi(2) } else { 0.0 }
        };
        let samples: Vec<f64> = (0..per_turn * turns)
            .map(|i| {
                let turn = f64::from(i) / f64::from(per_turn);
                let mesh = |p: f64| near(turn, p) * (TAU * (95.0 * carrier * turn - 95.0 * p / 3.0)).cos();
                let knock = if (turn * rate).rem_euclid(1.0) < 0.01 { 3.0 * near(turn, 1.0) } else { 0.0 };
                (0..3).map(|p| mesh(f64::from(p))).sum::<f64>() + knock
            })
            .collect();
        let lines = OrderLines::new(&samples, per_turn as usize);
        let passing = Passing::of(&train.meshes[0], &lines).expect("planets pass");
        let fold = |planet: u32| {
            let fold = folded(&samples, per_turn as usize, rate, &|turns| passing.weight(turns, Some(planet))).unwrap();
            let knock = fold[..16].iter().sum::<f64>() / 16.0;
            let rms = (fold.iter().map(|x| x * x).sum::<f64>() / fold.len() as f64).sqrt();
            knock / rms
        };
        let found: Vec<f64> = (0..3).map(fold).collect();
        let highest = found.iter().copied().fold(0.0, f64::max);
        let others = found.iter().filter(|x| **x < 0.5 * highest).count();
        assert!(highest > 2.0 && others == 2, "{found:?}");
    }
}
