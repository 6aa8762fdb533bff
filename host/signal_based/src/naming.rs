//! What an adopted family is called: a name only where nothing else of the library has the same lines behind an
//! unknown path.

use super::candidate::{Kind, Shaft};
use super::families::bearing::{Bearing, Part};
use super::families::fixed_frequency::supply_hz;
use super::impacts::Impacts;
use super::scene::Scene;
use super::search::Adopted;
use crate::train::families::What;

/// Orders of its shaft at which a passage of a bearing can lie at all: seven elements and a ratio of 0.32, to 30.
const PASSAGES: (f64, f64) = (2.38, 20.0);

/// Fewest teeth of another stage that a pattern is read as.
const FEWEST_TEETH: u32 = 10;
/// Share of the strongest line\'s evidence from which another one is strong.
const STRONG_SHARE: f64 = 0.05;
/// Evidence in nats, about power over floor, from which a line alone is a ghost order: a path's resonances make the
/// lines of a random pattern of the pitch differ by a factor of ten to twenty, and above this the next one would
/// stand as well.
const LONE_LINE: f64 = 400.0;
/// Two orders that are computed are one within this.
const SAME_ORDER: f64 = 1e-6;
/// Ratios of two of the first harmonics of one line.
const HARMONICS: [(f64, f64); 5] = [(2.0, 1.0), (3.0, 1.0), (4.0, 1.0), (3.0, 2.0), (4.0, 3.0)];

/// Verdict and words.
#[derive(Debug, Clone, PartialEq)]
pub struct Naming {
    /// named, ambiguous, generic.
    pub verdict: &'static str,
    /// Library name, names in question, or plain description.
    pub name: String,
    /// Family word.
    pub family: &'static str,
    /// pinion, gear, none.
    pub shaft: &'static str,
    /// What would decide, or why no name is given.
    pub remark: Option<&'static str>,
}

fn naming(
    verdict: &'static str,
    name: impl Into<String>,
    family: &'static str,
    shaft: &'static str,
    remark: Option<&'static str>,
) -> Naming {
    Naming { verdict, name: name.into(), family, shaft, remark }
}

/// Names one family, with the bearing that it may be part of, and the orders of all ghosts found.
pub fn name(adopted: &Adopted, part: Option<(&Bearing, Part)>, ghosts: &[f64], scene: &Scene) -> Naming {
    let candidate = &adopted.candidate;
    if let Some((bearing, part)) = part {
        let remark =
            "two bases agree on one number of elements and one ratio; whether it is damage is not said by that";
        let name = format!("bearing of {}: {}", bearing.shaft.phrase(), part.word());
        return naming("named", name, "non-integer-order", bearing.shaft.word(), Some(remark));
    }
    if let Some(hz) = adopted.either_hz {
        let order = hz / scene.runs.first().map_or(1.0, |run| run.angle.speed.mean_hz);
        let name = format!("{} or unexplained order {order:.4}", tone(hz));
        let remark = "the speed hardly moves: a record at another speed would tell a frequency from an order";
        return naming("ambiguous", name, "fixed-frequency", "none", Some(remark));
    }
    match candidate.kind {
        Kind::Modulation(shaft) => {
            let word = shaft.word();
            let remark =
                "the same lines behind an unknown path: a second sensor on the shaft or a torque signal would decide";
            naming("ambiguous", format!("{word}-eccentricity or {word}-pitch-error"), "sideband", word, Some(remark))
        }
        Kind::ShaftOrders(shaft) => {
            let word = shaft.word();
            let name = format!("{word}-imbalance or coupling-misalignment or {word}-eccentricity");
            naming(
                "ambiguous",
                name,
                "shaft-order",
                word,
                Some("several speeds would decide: imbalance grows with their square"),
            )
        }
        Kind::SingleTooth(shaft) => {
            let word = shaft.word();
            let name = format!("{word}-tooth-crack or {word}-pitch-error");
            naming(
                "ambiguous",
                name,
                "impulsive",
                word,
                Some("one tooth; several torques would decide: a crack's pulse grows with the torque"),
            )
        }
        Kind::Pattern(shaft) => {
            let word = shaft.word();
            if has_common_teeth(adopted, scene.shaft_order(shaft as usize)) {
                let name = format!("{word}-pitch-error or mesh of another stage on the {word}'s shaft");
                let remark = "all its lines are multiples of one number of teeth, as another gear on that shaft has";
                return naming("ambiguous", name, "shaft-order", word, Some(remark));
            }
            naming(
                "ambiguous",
                format!("{word}-pitch-error or {word}-profile-error"),
                "shaft-order",
                word,
                Some("many teeth, no single one"),
            )
        }
        Kind::Ghost => {
            let shaft = shaft_of_ghost(candidate.base);
            if has_harmonics(candidate.base, ghosts) {
                let name = format!("{shaft}-ghost-order or mesh of another stage on the {shaft}'s shaft");
                let remark = "a line with harmonics is what another pair of gears on that shaft has";
                return naming("ambiguous", name, "shaft-order", shaft, Some(remark));
            }
            let is_other = |ghost: &&f64| (*ghost / candidate.base - 1.0).abs() > 1e-6;
            let is_alone = !ghosts.iter().filter(is_other).any(|ghost| shaft_of_ghost(*ghost) == shaft);
            if is_of_both(candidate.base, scene) {
                let ghosts = "pinion-ghost-order or gear-ghost-order";
                let is_sure = is_alone && adopted.verdict.score.ln_bayes >= LONE_LINE;
                let others = if is_sure { "" } else { " or pinion-pitch-error or gear-pitch-error" };
                let remark = "a whole order of both shafts: they have the same line there";
                return naming("ambiguous", format!("{ghosts}{others}"), "shaft-order", "none", Some(remark));
            }
            if !is_alone {
                let name = format!("{shaft}-ghost-order or {shaft}-pitch-error");
                let remark = "more than one whole order of that shaft, as a pattern of the pitch has";
                return naming("ambiguous", name, "shaft-order", shaft, Some(remark));
            }
            if adopted.verdict.score.ln_bayes < LONE_LINE {
                let name = format!("{shaft}-ghost-order or {shaft}-pitch-error");
                let remark = "one line, not strong enough to say that the weaker ones of a pattern of the pitch \
                    would stand, too";
                return naming("ambiguous", name, "shaft-order", shaft, Some(remark));
            }
            naming("named", format!("{shaft}-ghost-order"), "shaft-order", shaft, None)
        }
        Kind::FixedFrequency => naming("named", tone(candidate.base), "fixed-frequency", "none", None),
        Kind::Passage | Kind::ModulatedPassage(_) | Kind::AboutMesh => passage(adopted, scene),
        Kind::Alias => naming("named", "aliasing", "mesh-order", "pinion", None),
        Kind::Clipping => naming("named", "clipping", "other", "none", None),
        Kind::Train(own) => of_train(adopted, own, scene),
        Kind::Swing => naming("ambiguous", "load-fluctuation or speed-fluctuation", "non-stationary", "none", None),
    }
}

/// A fault of a train by gear and stage; every other seat whose lines say the same is named beside it.
fn of_train(adopted: &Adopted, own: u16, scene: &Scene) -> Naming {
    let Some(gearing) = &scene.gearing else { return naming("generic", "", "other", "none", None) };
    let family = gearing.family(own);
    let words = |index: u16| match gearing.family(index).what {
        What::Local if adopted.pulse.is_none() && gearing.is_of_pair(index) => {
            // No single tooth stands out: many teeth, or one that is too weak to be placed.
            format!("{}: pitch error or a weak local tooth fault", gearing.seat_words(index))
        }
        _ => gearing.words(index),
    };
    let names: Vec<String> = std::iter::once(own).chain(adopted.or_else.iter().copied()).map(words).collect();
    let shaft = gearing.shaft_of(own).map_or("none", |shaft| shaft.word());
    let (group, remark) = match family.what {
        What::Modulation => {
            ("sideband", "runout, a pitch error and a torque that turns with the gear have the same lines")
        }
        What::Local => {
            ("impulsive", "once per turn; several torques would tell a crack from a pitch error of one tooth")
        }
        What::Shaft => ("shaft-order", "several speeds would decide: imbalance grows with their square"),
    };
    if names.len() > 1 {
        let remark = "orders of both coincide, or nearly, in this record: `meshband machine check` lists such lines";
        return naming("ambiguous", names.join(" or "), group, shaft, Some(remark));
    }
    let is_unplaced = family.what == What::Local && adopted.pulse.is_none() && gearing.is_of_pair(own);
    let verdict = if family.what == What::Shaft || is_unplaced { "ambiguous" } else { "named" };
    naming(verdict, names.concat(), group, shaft, Some(remark))
}

/// Names a comb of impacts. A rig without gears has one shaft, which needs no name.
pub fn impacts(own: &Impacts, scene: &Scene) -> Naming {
    let reading = &own.reading;
    let shaft = reading.shaft.map_or("none", |shaft| Shaft::PAIR_SHAFTS[shaft].word());
    let seat = match (&own.bearing, reading.shaft) {
        (Some(bearing), _) => format!(" of bearing {}", crate::text::name(bearing)),
        (None, Some(shaft)) if scene.has_gears() => format!(" of the {}'s shaft", Shaft::PAIR_SHAFTS[shaft].word()),
        _ => String::new(),
    };
    let (verdict, name) = match reading.parts.as_slice() {
        [] => ("generic", format!("unexplained order {:.4}", reading.base)),
        [part] => ("named", format!("bearing-impacts, {part}{seat}")),
        parts => ("ambiguous", format!("bearing-impacts, {}{seat}", parts.join(" or "))),
    };
    naming(verdict, name, "non-integer-order", shaft, None)
}

/// A text about a rig of one shaft without the words of gears.
pub fn without_gears(text: &str) -> String {
    let words = [
        ("pinion-pitch-error or pinion-profile-error", "pattern over a turn"),
        ("pinion-tooth-crack or pinion-pitch-error", "one pulse per turn"),
        ("the pinion's shaft", "the shaft"),
        ("pinion-", ""),
        (" of the pinion", " of the shaft"),
        ("pinion", "shaft"),
        ("beyond the mesh", "beyond the shaft's own orders"),
        ("many teeth, no single one", "no single place of the turn"),
        ("mesh", "shaft"),
        ("either shaft", "the shaft"),
        ("gear", "second shaft"),
    ];
    words.iter().fold(text.to_owned(), |text, (own, other)| text.replace(own, other))
}

/// What a line at a frequency is called.
fn tone(hz: f64) -> &'static str {
    if supply_hz(hz).is_some() { "mains-hum" } else { "fixed-tone" }
}

/// Whether the strong lines of a pattern, at least two, are multiples of a number of teeth that a gear can have; what
/// stands of the pattern's others is noise beside a mesh.
fn has_common_teeth(adopted: &Adopted, own: f64) -> bool {
    let places = adopted.candidate.places.iter().zip(&adopted.verdict.score.of_places);
    let strongest = adopted.verdict.score.of_places.iter().copied().fold(0.0, f64::max);
    let is_strong = |ln: f64| ln > 0.0 && ln >= STRONG_SHARE * strongest;
    let numbers: Vec<u32> =
        places.filter(|(_, ln)| is_strong(**ln)).map(|(place, _)| (place.order / own).round() as u32).collect();
    let common = numbers.iter().copied().fold(0, common_divisor);
    numbers.len() >= 2 && common >= FEWEST_TEETH
}

fn common_divisor(a: u32, b: u32) -> u32 {
    if b == 0 { a } else { common_divisor(b, a % b) }
}

/// The shaft of a whole order.
fn shaft_of_ghost(base: f64) -> &'static str {
    if (base - base.round()).abs() < SAME_ORDER { "pinion" } else { "gear" }
}

/// Whether an order is a whole one of both shafts, or nearer to one of the other shaft's than half a bin.
fn is_of_both(base: f64, scene: &Scene) -> bool {
    let away = |own: f64| (base - (base / own).round() * own).abs();
    away(1.0).max(away(scene.gear_order)) <= (0.5 * scene.bin()).max(SAME_ORDER)
}

/// Whether another ghost stands at a whole multiple of this one, or both at multiples of a third.
fn has_harmonics(base: f64, ghosts: &[f64]) -> bool {
    let is_multiple = |other: f64| {
        let (low, high) = (base.min(other), base.max(other));
        HARMONICS.iter().any(|(a, b)| (high / low * b / a - 1.0).abs() < 1e-6)
    };
    ghosts.iter().any(|ghost| (ghost / base - 1.0).abs() > 1e-6 && is_multiple(*ghost))
}

/// Shafts whose bearings could have a passage at an order.
fn shafts(base: f64, scene: &Scene) -> Vec<Shaft> {
    let fits = |shaft: &Shaft| {
        let own = base / scene.shaft_order(*shaft as usize);
        (PASSAGES.0..PASSAGES.1).contains(&own)
    };
    scene.shafts().iter().copied().filter(fits).collect()
}

fn passage(adopted: &Adopted, scene: &Scene) -> Naming {
    let candidate = &adopted.candidate;
    let family = "non-integer-order";
    let order = format!("unexplained order {:.4}", candidate.base);
    let of_bearings = shafts(candidate.base, scene);
    match candidate.kind {
        Kind::AboutMesh if !of_bearings.is_empty() => {
            let name = format!("bearing-stiffness-modulation or {order}");
            naming("ambiguous", name, family, "none", Some("a second order of the same bearing would decide"))
        }
        _ if of_bearings.is_empty() => {
            naming("generic", order, family, "none", Some("no ordinary bearing of either shaft has it"))
        }
        _ => {
            let remark = "one base fits some bearing always; a second order of the same bearing would decide";
            naming("generic", order, family, "none", Some(remark))
        }
    }
}
