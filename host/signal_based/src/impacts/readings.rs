//! What a comb of impacts is: all explanations of the same lines, the simplest that stands highest on fitted and
//! held-out turns.
//!
//! A comb of base `o` whose lines a shaft modulates is also read as one of `o + n` shafts, of a multiple or of a part
//! of `o`: the true base's own harmonics stand highest, since a sideband is no stronger than what it is a sideband of
//! (means of logarithms of power over three harmonics, both parts of the turns). Where two are within the evidence
//! both are in question.
//!
//! Rings (Randall, Antoni 2011; McFadden, Smith 1984): an inner ring carries its damage through the load zone once
//! per turn, so its lines have strong sidebands of its shaft, and its order is one that seven elements or more can
//! have. An outer ring has them as well where the load turns (imbalance): below the least inner order it is the only
//! reading, above it both are in question up to the order from which an outer ring needs twelve elements. Lines
//! without sidebands are an outer ring's, where they are sharp; smeared ones may be an element's. A base at half a
//! turn of a shaft is the shaft's own, a loose fit's, or a supply's.

use super::bands::Band;
use super::combs::{Comb, Known, Ranked};
use super::thresholds::{
    BESIDE_SHARE, HALF_TURN, MANY_ELEMENTS, MAX_COINCIDENCE_SHARE, MAX_OUTER_ORDER, MIN_INNER_ORDER, MIN_LN_POWER_LEAD,
    MIN_OUTER_ORDER, MIN_RING_DEPTH, MIN_RING_NATS, MIN_SIDEBAND_POWER_RATIO, MOST_TURNS, MULTIPLE, SIDEBANDS,
    WHOLE_NUMBER_SHARE,
};
use crate::families::bearing::{ELEMENTS, RATIOS};

/// Harmonics that bases are compared by.
const COMPARED_HARMONICS: std::ops::RangeInclusive<u32> = 1..=3;
/// Multiples and parts of a base, and sidebands, that may be the base.
const MULTIPLES: [u32; 2] = [2, 3];
const SIDEBAND_NUMBERS: [i32; 4] = [-2, -1, 1, 2];
/// Least mean logarithm of power by which harmonics stand at all: their highest bins of three have 0.9 in noise.
const MIN_MEAN_LN_POWER: f64 = 1.8;
/// Bins within which a base is at half or a quarter of a shaft's turn.
const BESIDE_BINS: f64 = 1.5;

/// What a comb is.
#[derive(Debug, Clone, PartialEq)]
pub struct Reading {
    /// Base, order of the pinion.
    pub base: f64,
    /// Another base that explains as much.
    pub rival: Option<f64>,
    /// Shaft whose sidebands are strong: index among the shafts.
    pub modulated_by: Option<usize>,
    /// Parts of a bearing in question; none where no name is given.
    pub parts: Vec<&'static str>,
    /// Shaft of the bearing, where only one can have it.
    pub shaft: Option<usize>,
    /// Why no ring is named, or what the name rests on.
    pub remark: String,
}

/// The base that explains a comb best, and a rival within the evidence.
pub fn base(band: &Band, comb: &Comb, shafts: &[f64]) -> (f64, Option<f64>) {
    let own = strength(band, comb.base, COMPARED_HARMONICS.map(f64::from));
    for m in MULTIPLES.map(f64::from) {
        if strength(band, m * comb.base, COMPARED_HARMONICS.map(f64::from)) > own + MULTIPLE {
            return (m * comb.base, None);
        }
        // The lines that only the lower base has.
        let between = (1..).map(f64::from).filter(|h| h % m != 0.0).take(3);
        let lower = strength(band, comb.base / m, between);
        if lower > MIN_MEAN_LN_POWER && lower > own - MULTIPLE {
            return (comb.base / m, None);
        }
    }
    let beside = shafts.iter().flat_map(|own| SIDEBAND_NUMBERS.map(|n| comb.base + f64::from(n) * own));
    let rivals =
        beside.filter(|base| *base > 1.0).map(|base| (strength(band, base, COMPARED_HARMONICS.map(f64::from)), base));
    match rivals.max_by(|a, b| a.0.total_cmp(&b.0)) {
        Some((other, base)) if other > own + MIN_LN_POWER_LEAD => (base, None),
        Some((other, base)) if other > own - MIN_LN_POWER_LEAD => (comb.base, Some(base)),
        _ => (comb.base, None),
    }
}

/// Mean logarithm of the power over the floor at multiples of a base, on both parts of the turns.
fn strength(band: &Band, base: f64, multiples: impl Iterator<Item = f64> + Clone) -> f64 {
    let all: Vec<f64> =
        band.parts.iter().flat_map(|part| multiples.clone().map(|h| (1.0 + part.at(h * base)).ln())).collect();
    all.iter().sum::<f64>() / all.len().max(1) as f64
}

/// The shaft that modulates a comb strongly.
pub fn modulated_by(band: &Band, base: f64, smear: f64, known: &Known) -> Option<usize> {
    known.shafts.iter().position(|own| is_modulated(band, base, smear, known, *own))
}

/// Whether a rate modulates a comb strongly.
pub fn is_modulated(band: &Band, base: f64, smear: f64, known: &Known, own: f64) -> bool {
    let ranked = Ranked::of(&band.parts[0], known, smear);
    let part = &band.parts[0];
    let orders = COMPARED_HARMONICS.flat_map(|h| [-own, own].map(|side| f64::from(h) * base + side));
    let share = |h: u32| {
        let carrier = f64::from(h) * base;
        let most = SIDEBAND_NUMBERS.map(|n| part.at(carrier + f64::from(n) * own)).into_iter().fold(0.0, f64::max);
        (most.max(f64::MIN_POSITIVE) / part.at(carrier).max(1.0)).ln()
    };
    let mean = COMPARED_HARMONICS.map(share).sum::<f64>() / COMPARED_HARMONICS.count() as f64;
    ranked.nats(orders, base, &known.shafts).0 >= SIDEBANDS && mean >= MIN_SIDEBAND_POWER_RATIO.ln()
}

/// Whether two passages of one shaft are outer and inner ring of one bearing: they add up to its elements.
pub fn are_of_one_bearing(one: f64, other: f64, own: f64) -> bool {
    let [outer, inner] = [one.min(other) / own, one.max(other) / own];
    let sum = outer + inner;
    let ratio = (inner - outer) / sum;
    (sum - sum.round()).abs() <= WHOLE_NUMBER_SHARE * sum
        && ELEMENTS.contains(&(sum.round() as u32))
        && (RATIOS.0..=RATIOS.1).contains(&ratio)
}

/// Whether a base is a whole number of `1 / parts` turns of a shaft: at half turns within the slip of a speed that is
/// nominal, at quarters within the resolution. Where a tenth of all orders lie so near to parts of a slower shaft's
/// turn, that says nothing; nor does it of orders above ten of the shaft, where looseness leaves little.
pub fn is_of_shaft(base: f64, bin: f64, shafts: &[f64], parts: f64) -> bool {
    let fastest = shafts.iter().copied().fold(0.0, f64::max);
    shafts.iter().any(|own| {
        let (place, spacing) = (parts * base / own, own / parts);
        let share = if parts > 2.0 { 0.0 } else { HALF_TURN * base };
        let within = share.max(BESIDE_BINS * bin);
        let says = (*own == fastest || 2.0 * within <= MAX_COINCIDENCE_SHARE * spacing) && base <= MOST_TURNS * own;
        says && (place - place.round()).abs() * spacing <= within
    })
}

/// Whether a base is a shaft's first or second order within what slips: no bearing passes there, and what swells once a
/// turn at a wandering speed is smeared about it.
pub fn is_beside_shaft(base: f64, shafts: &[f64]) -> bool {
    shafts.iter().any(|own| {
        let turns = (base / own).round();
        (1.0..=2.0).contains(&turns) && (base / own - turns).abs() <= BESIDE_SHARE * turns
    })
}

/// Reads a comb whose bearing nobody declared.
pub fn read(band: &Band, comb: &Comb, known: &Known) -> Reading {
    let shafts = &known.shafts;
    let (base, rival) = base(band, comb, shafts);
    let modulated_by = modulated_by(band, base, comb.smear, known);
    let mut reading = Reading { base, rival, modulated_by, parts: Vec::new(), shaft: None, remark: String::new() };
    let bin = band.parts[0].bin;
    let possible: Vec<usize> =
        (0..shafts.len()).filter(|s| (MIN_OUTER_ORDER..=MAX_OUTER_ORDER).contains(&(base / shafts[*s]))).collect();
    let fitting: Vec<usize> = possible.into_iter().filter(|s| modulated_by.is_none_or(|m| m == *s)).collect();
    reading.remark = if is_of_shaft(base, bin, shafts, 2.0) || is_of_shaft(base, bin, shafts, 4.0) {
        "a whole number of half or quarter turns: a loose fit, a supply or another machine has it as well".into()
    } else if fitting.is_empty() {
        "no ordinary bearing has it as a passage".into()
    } else if comb.nats < MIN_RING_NATS {
        format!(
            "{:.0} nats of the {MIN_RING_NATS:.0} that a name needs: a sound bearing's passage may stand so high",
            comb.nats
        )
    } else if band.parts[0].depth_at(base) < MIN_RING_DEPTH {
        format!(
            "a depth of {:.2}, of the {MIN_RING_DEPTH} that a name needs: a sound bearing's passage may stand so high",
            band.parts[0].depth_at(base)
        )
    } else if let Some(rival) = rival {
        format!("order {rival:.4}, one turn of a shaft away, explains as much")
    } else {
        reading.shaft = if let [one] = fitting.as_slice() { Some(*one) } else { None };
        // The wider choice counts where either shaft may carry it.
        let orders = || fitting.iter().map(|s| base / shafts[*s]);
        reading.parts = parts(orders().fold(0.0, f64::max), modulated_by.is_some(), comb.smear == 0.0);
        why(&reading.parts, modulated_by.is_some()).into()
    };
    reading
}

/// Parts of a bearing that a comb can be, by its order per turn of their shaft.
fn parts(order: f64, is_modulated: bool, is_sharp: bool) -> Vec<&'static str> {
    match (is_modulated, is_sharp) {
        (true, _) if order < MIN_INNER_ORDER => vec!["outer ring"],
        (true, _) if order < MANY_ELEMENTS => vec!["inner ring", "outer ring"],
        (true, _) => vec!["inner ring"],
        (false, true) => vec!["outer ring"],
        (false, false) => vec!["outer ring", "rolling element"],
    }
}

fn why(parts: &[&str], is_modulated: bool) -> &'static str {
    match (parts, is_modulated) {
        (["outer ring"], true) => {
            "too few turns for an inner ring of seven elements; the shaft modulates it: its load turns with it"
        }
        (["inner ring"], _) => {
            "the shaft modulates it, as it does a ring that turns; an outer ring would need twelve elements and a \
             turning load"
        }
        (_, true) => "the shaft modulates it: a ring that turns, or one that stands under a load that turns",
        (["outer ring"], false) => "sharp harmonics that no shaft modulates: a ring that stands",
        _ => "smeared harmonics that no shaft modulates: the numbers of a declared bearing would decide",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn theory_an_order_below_seven_elements_is_no_inner_ring_however_modulated() {
        assert_eq!(parts(3.585, true, true), ["outer ring"]);
        assert_eq!(parts(5.415, true, true), ["inner ring"]);
        assert_eq!(parts(4.4, true, true), ["inner ring", "outer ring"]);
        assert_eq!(parts(5.0, false, false), ["outer ring", "rolling element"]);
    }

    #[test]
    fn theory_outer_and_inner_ring_add_up_to_the_elements() {
        assert!(are_of_one_bearing(3.607, 5.381, 1.0) && are_of_one_bearing(4.947, 3.05, 1.0));
        assert!(are_of_one_bearing(0.5 * 3.05, 0.5 * 4.947, 0.5));
        // No whole number, by half and by a two-hundredth; too few elements; a ratio that no bearing has.
        assert!(!are_of_one_bearing(3.585, 4.934, 1.0) && !are_of_one_bearing(4.913, 3.05, 1.0));
        assert!(!are_of_one_bearing(2.1, 3.9, 1.0) && !are_of_one_bearing(3.9, 4.1, 1.0));
    }

    #[test]
    fn theory_half_turns_are_the_shafts_own() {
        assert!(is_of_shaft(3.5016, 0.005, &[1.0], 2.0));
        assert!(is_of_shaft(4.7490, 0.002, &[1.0], 4.0) && !is_of_shaft(4.7490, 0.002, &[1.0], 2.0));
        // Nine and a half turns of a slow shaft are no more than chance: every tenth of a turn is as near to a half.
        assert!(!is_of_shaft(3.583, 0.005, &[1.0, 23.0 / 61.0], 2.0));
        for passage in [3.585, 5.415, 3.0543, 4.9457] {
            assert!(!is_of_shaft(passage, 0.003, &[1.0], 2.0), "{passage}");
        }
    }
}
