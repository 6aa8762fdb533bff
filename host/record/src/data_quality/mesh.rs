//! The mesh line against the pulses: whether the teeth pass as often as pulses and teeth say.
//!
//! A part of the run is read at equal angles of the tach's shaft: a wander or a run-up that the tach has followed is
//! gone, and the mesh stands as a sharp comb exactly where pulses per turn, shaft and teeth put it. What another
//! number of pulses or another shaft would mean is only another place in the same spectrum, so the rivals are
//! compared on the same data. Then the line is followed over all turns (`phase`): its mean place to parts per
//! million, and whether it stays there. Where there is none, the best comb farther away is named, and whether the
//! pulses of an encoder are folded (`folding`).
//!
//! Nothing is refused: a second stage, a belt or a weak mesh are the machine's business. Cost: the part is bounded;
//! all turns cost one pass over each channel.

use super::comb::Combs;
pub use super::folding::Fold;
use super::pulsed::Pulsed;

use super::folding;
use super::phase::{self, Followed};
use crate::spectral::{AngleMap, resample_by_angle};
use rayon::prelude::*;
use serde::Serialize;

/// Farthest that the mesh may lie from where the pulses put it.
const MAX_MESH_OFFSET_SHARE: f64 = 0.005;
/// Width of the search for a mesh line beside its place.
const SEARCH_HALF_WIDTH_SHARE: f64 = 0.03;
/// Range over which the real mesh is looked for where there is none, as factors.
const SEARCH_RANGE_FACTORS: [f64; 2] = [0.5, 2.0];
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
/// Most samples, all channels, that are read at equal angles, and most channels of them.
const MOST_SAMPLES: f64 = 1_048_576.0;
const MOST_CHANNELS: usize = 4;
/// Share of the run's stretches that must hold the line for the pulses to be confirmed.
const MOST_STRETCHES: f64 = 0.7;
/// A clock of its own: the line is off by more than this share, with its error this many times below.
const CLOCK_OFF: f64 = 2e-5;
/// Farthest that a clock can be off; more is another speed.
const MAX_CLOCK_ERROR_SHARE: f64 = 1e-3;
/// Least error of a ratio that is said: clocks of one device agree to about a part in a million.
const LEAST_ERROR: f64 = 1e-6;
/// Pulses per turn that wheels have.
const USUAL_WHEEL_PULSES: [u32; 30] = [
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
    /// Mesh frequency of the best comb elsewhere, Hz, where none stands at its place.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub elsewhere_hz: Option<f64>,
    /// Share of the run's stretches in which the line stands at its place; absent where it was not followed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stretches_share: Option<f64>,
    /// Pulses that a folded encoder really made.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub folded: Option<Fold>,
    /// One sentence, and whether it is a warning.
    pub sentence: String,
    /// Whether pulses, shaft or teeth look wrong.
    pub doubtful: bool,
}

/// Compares the mesh line with the pulses; `None` where there is too little signal to say anything.
pub fn check(place: &str, pulsed: &Pulsed<'_>) -> Option<MeshCheck> {
    let map = AngleMap::new(pulsed.edges_s, pulsed.pulses, 0.0)?;
    let implied_hz = pulsed.mean_speed_hz() / pulsed.ratio * f64::from(pulsed.teeth[0]);
    let Some((channels, rate_hz)) = at_equal_angles(pulsed, &map) else {
        return folded(pulsed, implied_hz);
    };
    let combs = Combs::new(place, &channels, rate_hz, pulsed.teeth).ok()?;
    if !combs.can_see(implied_hz) {
        let by = pulsed.implied_by();
        let sentence =
            format!("the mesh, at {implied_hz:.1} Hz by {by}, cannot be seen at this sampling rate and length");
        return folded(pulsed, implied_hz).or(Some(MeshCheck::new(implied_hz, 0.0, sentence, false)));
    }
    let near =
        combs.best_between((1.0 - MAX_MESH_OFFSET_SHARE) * implied_hz, (1.0 + MAX_MESH_OFFSET_SHARE) * implied_hz);
    let wide =
        combs.best_between((1.0 - SEARCH_HALF_WIDTH_SHARE) * implied_hz, (1.0 + SEARCH_HALF_WIDTH_SHARE) * implied_hz);
    let stands_out = |comb: (f64, f64)| comb.1 >= LEAST_DB && combs.harmonics(comb.0, HARMONIC_DB) > 0;
    let at_place = stands_out(near) && wide.1 < near.1 + LEAST_DB;
    let followed = phase::follow(pulsed, &map);
    let rival = rival(pulsed, &combs, implied_hz)
        .filter(|_| !pulsed.nominal)
        .filter(|(_, db)| *db >= BETTER_DB && *db > near.1 + BETTER_DB);
    if at_place && rival.is_none() {
        let placed = followed.as_ref().and_then(|followed| Some((followed.ratio?, followed.error)));
        let share = |(hz, error_hz): (f64, f64)| (hz / implied_hz, error_hz / implied_hz);
        let placed = placed.or_else(|| combs.placed(&channels, near.0).map(share));
        // The comb alone is good to about the width of a line.
        let placed = placed.unwrap_or_else(|| share((near.0, combs.line_width_hz())));
        return Some(confirmed(pulsed, (implied_hz, near.1), placed, followed.as_ref()));
    }
    let fold = folding::find(pulsed, near.1);
    let elsewhere = if stands_out(wide) {
        wide
    } else {
        combs.best_between(
            SEARCH_RANGE_FACTORS[0] * implied_hz,
            (SEARCH_RANGE_FACTORS[1] * implied_hz).min(0.45 * rate_hz),
        )
    };
    let elsewhere = Some(elsewhere).filter(|comb| stands_out(*comb) && comb.1 >= near.1 + LEAST_DB);
    let sentence = match (&fold, rival, elsewhere) {
        (Some(fold), _, _) => fold.sentence(pulsed.pulses),
        (None, Some((name, db)), _) => format!(
            "the mesh lines fit {name} much better ({db:.1} dB over their surroundings) than what is declared \
              ({:.1} dB at {implied_hz:.2} Hz)",
            near.1
        ),
        (None, None, elsewhere) => missing(pulsed, implied_hz, near.1, elsewhere.map(|comb| comb.0)),
    };
    let mut check = MeshCheck::new(implied_hz, near.1, sentence, true);
    check.found_over_implied = stands_out(wide).then_some(wide.0 / implied_hz);
    check.elsewhere_hz = elsewhere.map(|comb| comb.0);
    check.stretches_share = followed.map(|followed| followed.share);
    check.folded = fold;
    Some(check)
}

/// What the channels say of pulses whose own mesh cannot be looked for: nothing, or that they are folded.
fn folded(pulsed: &Pulsed<'_>, implied_hz: f64) -> Option<MeshCheck> {
    let fold = folding::find(pulsed, f64::NEG_INFINITY)?;
    let mut check = MeshCheck::new(implied_hz, 0.0, fold.sentence(pulsed.pulses), true);
    check.folded = Some(fold);
    Some(check)
}

impl MeshCheck {
    /// Whether the line stands at its place all along, and nothing more is to be said.
    pub fn is_plain(&self) -> bool {
        !self.doubtful && self.found_over_implied.is_some() && !self.sentence.contains([';', ':', ','])
    }

    fn new(implied_hz: f64, excess_db: f64, sentence: String, doubtful: bool) -> Self {
        Self {
            implied_hz,
            excess_db,
            found_over_implied: None,
            elsewhere_hz: None,
            stretches_share: None,
            folded: None,
            sentence,
            doubtful,
        }
    }
}

/// The line stands where it should in the part that was read: what all turns say.
fn confirmed(
    pulsed: &Pulsed<'_>,
    (implied_hz, excess_db): (f64, f64),
    (share, error): (f64, f64),
    followed: Option<&Followed>,
) -> MeshCheck {
    let by = pulsed.implied_by();
    let at = figure(share, error);
    let mut sentence = format!("the mesh line stands at {at} of the {implied_hz:.3} Hz that {by} imply");
    let mut doubtful = false;
    if let Some(followed) = followed {
        let off = (share - 1.0).abs();
        if followed.share < MOST_STRETCHES {
            doubtful = followed.share < 0.5 * MOST_STRETCHES;
            sentence += &format!(
                ", in {:.0} % of the run only: elsewhere it is too weak, or the pulses are wrong",
                100.0 * followed.share
            );
        } else if !pulsed.nominal && (CLOCK_OFF..MAX_CLOCK_ERROR_SHARE).contains(&off) && off > followed.error {
            sentence += &format!(": {:+.0} ppm, as if the tach had a clock of its own", 1e6 * (share - 1.0));
        }
        if let Some((time_s, cycles)) = followed.jump {
            sentence += &format!(
                "; its phase jumps by {cycles:.2} of a tooth at {time_s:.2} s: samples are missing there, or a \
                  pulse was counted wrongly"
            );
        }
    }
    let mut check = MeshCheck::new(implied_hz, excess_db, sentence, doubtful);
    check.found_over_implied = Some(share);
    check.stretches_share = followed.map(|followed| followed.share);
    check
}

/// A ratio with its error, and no decimals beyond that.
fn figure(ratio: f64, error: f64) -> String {
    let error = error.max(LEAST_ERROR);
    let decimals = (-error.log10() - 1e-9).ceil().clamp(2.0, 6.0) as usize;
    format!("{ratio:.decimals$} (+-{error:.decimals$})")
}

/// Nothing stands where it should: said aloud, with how far the real one is.
fn missing(pulsed: &Pulsed<'_>, implied_hz: f64, db: f64, elsewhere_hz: Option<f64>) -> String {
    let by = pulsed.implied_by();
    let Some(hz) = elsewhere_hz else {
        return format!(
            "no mesh line there: nothing stands out at the {implied_hz:.2} Hz that {by} imply ({db:.1} dB), and no \
              comb of such teeth from half to twice that"
        );
    };
    let away = 100.0 * (hz / implied_hz - 1.0);
    let meaning = if pulsed.nominal {
        let rpm = |mesh_hz: f64| 60.0 * mesh_hz / f64::from(pulsed.teeth[0]);
        format!("with these teeth the pinion turns at {:.2} rpm, not at {:.2}", rpm(hz), rpm(implied_hz))
    } else {
        "teeth, shaft ratio or pulses per turn may be wrong".into()
    };
    format!(
        "no mesh line there: the mesh line nearest to the {implied_hz:.2} Hz that {by} imply stands at {hz:.2} Hz, \
          {away:+.2} % away: {meaning}"
    )
}

/// Channels at equal angles of the tach's shaft, and the samples per second that makes at its mean speed.
fn at_equal_angles(pulsed: &Pulsed<'_>, map: &AngleMap) -> Option<(Vec<Vec<f64>>, f64)> {
    let end_s = pulsed.channels.first()?.len() as f64 / pulsed.rate_hz;
    let channels = &pulsed.channels[..pulsed.channels.len().min(MOST_CHANNELS)];
    let (first, last) = map.range();
    let from = if pulsed.edges_s[0] < 0.0 { map.turns_at(0.0) } else { first };
    let to = if pulsed.edges_s[pulsed.edges_s.len() - 1] > end_s { map.turns_at(end_s) } else { last };
    // The slowest of ten turns at the ends and between: a single one may hold a pulse counted wrongly.
    let speed_hz = |turn: f64| 1.0 / (map.time_at(turn + 0.5) - map.time_at(turn - 0.5));
    let some = (0..=40).map(|i| speed_hz(from + 0.5 + (to - from - 1.0).max(0.0) * f64::from(i) / 40.0));
    let slowest_hz = some.fold(f64::INFINITY, f64::min).max(0.05 * pulsed.mean_speed_hz());
    let per_turn = (pulsed.rate_hz / slowest_hz).ceil();
    let most = (MOST_SAMPLES / per_turn / channels.len() as f64).floor();
    let turns = (to - from).floor().min(most);
    if turns < LEAST_TURNS {
        return None;
    }
    // From the middle of the run.
    let from = from + (0.5 * (to - from - turns)).floor();
    let read =
        |channel: &Vec<f64>| resample_by_angle(channel, pulsed.rate_hz, map, from, turns as usize, per_turn as usize);
    Some((channels.par_iter().map(read).collect(), per_turn * pulsed.mean_speed_hz()))
}

/// The best of the other numbers of pulses, shafts and teeth, with its score in dB.
fn rival(pulsed: &Pulsed<'_>, combs: &Combs, implied_hz: f64) -> Option<(String, f64)> {
    let own = f64::from(pulsed.pulses) * pulsed.ratio;
    let around = [2 * pulsed.pulses, pulsed.pulses.div_ceil(2), pulsed.pulses + 1, pulsed.pulses.saturating_sub(1)];
    let gear = f64::from(pulsed.teeth[0]) / f64::from(pulsed.teeth[1]);
    let shafts = [(pulsed.shaft.as_str(), pulsed.ratio), ("the pinion", 1.0), ("the gear", gear)];
    let mut best: Option<(String, f64)> = None;
    for (shaft, ratio) in shafts {
        for pulses in [pulsed.pulses].into_iter().chain(around).chain(USUAL_WHEEL_PULSES).filter(|pulses| *pulses > 0) {
            let scale = own / (f64::from(pulses) * ratio);
            let hz = scale * implied_hz;
            if (scale - 1.0).abs() < SEARCH_HALF_WIDTH_SHARE || !combs.can_see(hz) {
                continue;
            }
            let db = combs.score(hz);
            // Those that change less come first: a later one must be better by more than chance.
            if best.as_ref().is_none_or(|(_, before)| db > before + 0.5) {
                let plural = if pulses == 1 { "pulse" } else { "pulses" };
                best = Some((format!("{pulses} {plural} per turn of {shaft}"), db));
            }
        }
    }
    let turn_hz = implied_hz / f64::from(pulsed.teeth[0]);
    let last = if combs.harmonics(implied_hz, HARMONIC_DB) < SURE_HARMONICS { 4 * pulsed.teeth[0] } else { 0 };
    let own_teeth = pulsed.teeth[0];
    // Beside harmonics of its mesh a planetary set has lines of its own.
    let is_other = |teeth: &u32| (teeth % own_teeth).min(own_teeth - teeth % own_teeth) > pulsed.passes;
    for teeth in (5..=last).filter(|teeth| *teeth != own_teeth && (pulsed.passes == 0 || is_other(teeth))) {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ratio_has_no_decimals_beyond_its_error() {
        assert_eq!(figure(1.001_122_4, 0.0012), "1.001 (+-0.001)");
        assert_eq!(figure(1.000_001_2, 0.000_03), "1.00000 (+-0.00003)");
        assert_eq!(figure(0.999_999_9, 1e-9), "1.000000 (+-0.000001)");
        assert_eq!(figure(1.0, f64::INFINITY), "1.00 (+-inf)");
    }
}
