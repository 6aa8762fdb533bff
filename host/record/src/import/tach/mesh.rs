//! The measured tach against the mesh line: whether the teeth pass as often as the pulses say.
//!
//! The channels are read at equal angles of the tach's shaft, as if it turned at its mean speed: a wander or a run-up
//! that the tach has followed is gone, and the mesh stands as a sharp comb exactly where pulses per turn, shaft and
//! teeth put it. What another number of pulses or another shaft would mean is only another place in the same
//! spectrum, so the rivals are compared on the same data. The comb and its score are those of the virtual tach.
//!
//! Nothing is refused: a second stage, a belt or a weak mesh are the machine's business. Cost: about a second per
//! million samples.

use super::{Shaft, Speed};
use crate::import::mesh_line::{Combs, refine};
use crate::spectral::{AngleMap, resample_by_angle};
use rayon::prelude::*;
use serde::Serialize;

/// Farthest that the mesh may lie from where the pulses put it.
const NEAR: f64 = 0.005;
/// Width of the search for a mesh line beside its place.
const WIDE: f64 = 0.03;
/// Least excess of a comb that counts near its place, dB.
const LEAST_DB: f64 = 3.0;
/// By how much a rival must be better, and how high it must stand, dB.
const BETTER_DB: f64 = 6.0;
/// Least excess of one of its harmonics, dB: the sidebands of a mesh with one tooth more or less are lines, too.
const HARMONIC_DB: f64 = 10.0;
/// Harmonics that stand out so at the declared place, with which another comb at a whole order is a ghost and no
/// doubt of the teeth.
const SURE_HARMONICS: usize = 2;
/// Fewest turns of the tach's shaft that show a comb.
const LEAST_TURNS: f64 = 8.0;
/// Most samples, all channels, that are read at equal angles; 64 MiB in memory.
const MOST_SAMPLES: f64 = 8_388_608.0;
/// Pulses per turn that wheels have.
const USUAL: [u32; 30] = [
    1, 2, 3, 4, 5, 6, 8, 10, 12, 16, 18, 20, 24, 25, 30, 32, 36, 40, 48, 50, 60, 64, 72, 80, 90, 100, 120, 128, 180,
    256,
];

/// What the mesh line says about a tach.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MeshCheck {
    /// Mean mesh frequency by pulses and teeth, Hz.
    pub implied_hz: f64,
    /// Excess of the comb there over its surroundings, dB per line.
    pub excess_db: f64,
    /// Frequency of the mesh found over the implied one; absent where none stands out within 3 %.
    pub found_over_implied: Option<f64>,
    /// One sentence, and whether it is a warning.
    pub sentence: String,
    /// Whether pulses, shaft or teeth look wrong.
    pub doubtful: bool,
}

/// A tach as far as the check needs it.
pub(super) struct Checked<'a> {
    pub channels: &'a [Vec<f64>],
    pub rate_hz: f64,
    /// Pulses whose count is sure.
    pub times_s: &'a [f64],
    pub pulses: u32,
    pub shaft: Shaft,
    pub speed_hz: Speed,
    pub teeth: [u32; 2],
}

/// Compares the mesh line with the pulses; `None` where there is too little signal to say anything.
pub(super) fn check(place: &str, tach: &Checked<'_>) -> Option<MeshCheck> {
    let (channels, rate_hz) = at_equal_angles(tach)?;
    let ratio = tach.shaft.ratio(tach.teeth);
    let implied_hz = tach.speed_hz.mean / ratio * f64::from(tach.teeth[0]);
    let combs = Combs::new(place, &channels, rate_hz, tach.teeth).ok()?;
    if !combs.can_see(implied_hz) {
        let sentence = format!(
            "the mesh, at {implied_hz:.1} Hz by pulses and teeth, cannot be seen at this sampling rate and length"
        );
        return Some(MeshCheck { implied_hz, excess_db: 0.0, found_over_implied: None, sentence, doubtful: false });
    }
    let near = combs.best_between((1.0 - NEAR) * implied_hz, (1.0 + NEAR) * implied_hz);
    let wide = combs.best_between((1.0 - WIDE) * implied_hz, (1.0 + WIDE) * implied_hz);
    let stands_out = |comb: (f64, f64)| comb.1 >= LEAST_DB && combs.harmonics(comb.0, HARMONIC_DB) > 0;
    let at_place = stands_out(near) && wide.1 < near.1 + LEAST_DB;
    let found = if at_place { near } else { wide };
    let fine = refine(&channels, rate_hz, found.0, combs.line_width_hz()).unwrap_or(found.0);
    let found_over_implied = stands_out(found).then_some(fine / implied_hz);
    let rival = rival(tach, &combs, implied_hz).filter(|(_, db)| *db >= BETTER_DB && *db > near.1 + BETTER_DB);
    let (doubtful, sentence) = match (rival, found_over_implied) {
        (Some((name, db)), _) => (
            true,
            format!(
                "the mesh lines fit {name} much better ({db:.1} dB over their surroundings) than what is declared \
                 ({:.1} dB at {implied_hz:.2} Hz)",
                near.1
            ),
        ),
        (None, Some(share)) if at_place => {
            (false, format!("the mesh line stands at {share:.6} of the {implied_hz:.3} Hz that pulses and teeth imply"))
        }
        (None, Some(share)) => (
            true,
            format!(
                "the mesh line nearest to the {implied_hz:.2} Hz that pulses and teeth imply lies {:+.2} % away: \
                 teeth, shaft ratio or pulses per turn may be wrong",
                100.0 * (share - 1.0)
            ),
        ),
        (None, None) => (
            true,
            format!(
                "no mesh line stands out within 3 % of the {implied_hz:.2} Hz that pulses and teeth imply ({:.1} dB)",
                near.1
            ),
        ),
    };
    Some(MeshCheck { implied_hz, excess_db: near.1, found_over_implied, sentence, doubtful })
}

/// Channels at equal angles of the tach's shaft, and the samples per second that makes at its mean speed.
fn at_equal_angles(tach: &Checked<'_>) -> Option<(Vec<Vec<f64>>, f64)> {
    let end_s = tach.channels.first()?.len() as f64 / tach.rate_hz;
    let inside = |t: &&f64| (0.0..=end_s).contains(*t);
    let times: Vec<f64> = tach.times_s.iter().filter(inside).copied().collect();
    let map = AngleMap::new(&times, tach.pulses, 0.0)?;
    let per_turn = (tach.rate_hz / tach.speed_hz.least).ceil();
    let turns = map.range().1.floor().min((MOST_SAMPLES / per_turn / tach.channels.len() as f64).floor());
    if turns < LEAST_TURNS {
        return None;
    }
    let read =
        |channel: &Vec<f64>| resample_by_angle(channel, tach.rate_hz, &map, 0.0, turns as usize, per_turn as usize);
    Some((tach.channels.par_iter().map(read).collect(), per_turn * tach.speed_hz.mean))
}

/// The best of the other numbers of pulses, shafts and teeth, with its score in dB.
fn rival(tach: &Checked<'_>, combs: &Combs, implied_hz: f64) -> Option<(String, f64)> {
    let own = f64::from(tach.pulses) * tach.shaft.ratio(tach.teeth);
    let around = [2 * tach.pulses, tach.pulses.div_ceil(2), tach.pulses + 1, tach.pulses.saturating_sub(1)];
    let shafts = [tach.shaft, Shaft::Pinion, Shaft::Gear];
    let mut best: Option<(String, f64)> = None;
    for shaft in shafts {
        for pulses in [tach.pulses].into_iter().chain(around).chain(USUAL).filter(|pulses| *pulses > 0) {
            let scale = own / (f64::from(pulses) * shaft.ratio(tach.teeth));
            let hz = scale * implied_hz;
            if (scale - 1.0).abs() < WIDE || !combs.can_see(hz) {
                continue;
            }
            let db = combs.score(hz);
            // Those that change less come first: a later one must be better by more than chance.
            if best.as_ref().is_none_or(|(_, before)| db > before + 0.5) {
                best = Some((
                    format!("{pulses} {} per turn of {}", super::plural(pulses as usize, "pulse"), shaft.name()),
                    db,
                ));
            }
        }
    }
    let turn_hz = implied_hz / f64::from(tach.teeth[0]);
    let last = if combs.harmonics(implied_hz, HARMONIC_DB) < SURE_HARMONICS { 4 * tach.teeth[0] } else { 0 };
    for teeth in (5..=last).filter(|teeth| *teeth != tach.teeth[0]) {
        let hz = f64::from(teeth) * turn_hz;
        if combs.can_see(hz) {
            let db = combs.score_with(hz, teeth);
            if best.as_ref().is_none_or(|(_, before)| db > before + 0.5) {
                best = Some((format!("{teeth} teeth of the pinion"), db));
            }
        }
    }
    best
}
