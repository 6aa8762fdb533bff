//! What a family is in truth, once the gate lets it pass: whether it is one at all, and whether a simpler one or a
//! higher base says the same.

use super::accept::{self, Verdict};
use super::candidate::{Candidate, Domain, Kind, Place, TakenOf};
use super::families::fixed_frequency::supply_hz;
use super::families::{Context, modulation, passage, train};
use super::line_axis::{self, Sharper};
use super::residual_spectra::Views;
use super::scene::{Scene, SceneRun};
use crate::train::families::What;

/// Logarithm of the Bayes factor from which one line alone is an order, or a frequency that is no supply's, of its own.
const MIN_LONE_LN_BAYES: f64 = 20.0;
/// Share of the slower shaft's order about a mesh harmonic within which a wander leaves skirts, and the evidence that
/// something so slow needs (set on generated records with nothing but a wander, where 25 nats and more were seen; in
/// run-ups, where the calibrated model takes most of the wander off and swings must be more, 4 on records without an
/// effect, 21 on one of friction).
const SKIRT: f64 = 0.85;
const MIN_SWING_LN_BAYES: f64 = 60.0;
const MIN_RUN_UP_SWING_LN_BAYES: f64 = 15.0;
/// Share of the evidence of a base's lines that may stand on such skirts.
const MAX_SKIRT_SHARE: f64 = 0.5;
/// Share of a pattern's power in the first sidebands of the mesh from which it is a modulation.
const MIN_MODULATION_SHARE: f64 = 0.5;
/// Share of a family's evidence that is nearly all of it.
const DOMINANT_SHARE: f64 = 0.85;
/// Fewest lines that make a higher base where others stand beside them.
const FEWEST_MULTIPLES: usize = 3;
/// Fewest lines of one tooth of a train: its push is short, so it has many; two are a coincidence of two combs.
const MIN_LINES_OF_TOOTH: usize = 3;
/// Harmonics of a modulated base that stand themselves between their sidebands.
const CARRIERS: usize = 2;
/// The same family with a higher base, where multiples of one number have nearly all of its evidence.
pub fn higher_base(
    candidate: &Candidate,
    verdict: &Verdict,
    context: &Context,
    views: &Views,
    taken: &TakenOf,
) -> Option<(Candidate, Verdict)> {
    let divisor = nearly_common_divisor(candidate, verdict)?;
    let higher = passage::with_base(context, candidate, divisor as f64 * candidate.base)?;
    let verdict = accept::judge(&higher, &views.field(taken, higher.domain, 0..context.scene.searched));
    verdict.refused.is_none().then_some((higher, verdict))
}

/// Largest number above one whose multiples among the harmonics have nearly all of the evidence.
fn nearly_common_divisor(candidate: &Candidate, verdict: &Verdict) -> Option<u64> {
    if !candidate.is_base() {
        return None;
    }
    let number = |place: &Place| (place.spacing / candidate.base).abs().round() as u64;
    let standing: Vec<(u64, f64)> = candidate
        .places
        .iter()
        .zip(&verdict.score.of_places)
        .filter_map(|(place, ln)| (*ln > 0.0).then_some((number(place), *ln)))
        .collect();
    let all: f64 = standing.iter().map(|(_, ln)| ln).sum();
    let most = standing.iter().map(|(n, _)| *n).max()?;
    let are_nearly_all = |d: &u64| {
        let multiples: Vec<f64> = standing.iter().filter(|(n, _)| n % d == 0).map(|(_, ln)| *ln).collect();
        let enough = multiples.len() >= FEWEST_MULTIPLES || multiples.len() == standing.len();
        enough && multiples.iter().sum::<f64>() > DOMINANT_SHARE * all
    };
    (2..=most).rev().find(are_nearly_all)
}

/// Largest number above one that all of them are multiples of.
fn common_divisor(numbers: &[u64]) -> Option<u64> {
    (2..=numbers.first().copied()?).rev().find(|d| numbers.iter().all(|n| n % d == 0))
}

/// Why a family is none, from its higher base: that was found before, or is asked for and does not pass the gate.
pub fn by_higher_base(
    candidate: &Candidate,
    verdict: &Verdict,
    higher: Option<&Candidate>,
    is_known: impl Fn(&Candidate) -> bool,
) -> Option<String> {
    let numbers = standing_harmonics(candidate, verdict);
    match higher {
        Some(higher) => is_known(higher).then(|| "its lines are multiples of a family found before".into()),
        None if numbers.len() > 1 => common_divisor(&numbers)
            .map(|divisor| format!("only multiples of {divisor} stand, which are no family by themselves")),
        None => None,
    }
}

/// Harmonics of the base that stand themselves, not only by their sidebands.
pub fn carriers(candidate: &Candidate, verdict: &Verdict) -> usize {
    let standing = candidate.places.iter().zip(&verdict.score.of_places).filter(|(_, ln)| **ln > 0.0);
    standing.filter(|(place, _)| place.label.ends_with(" o")).count()
}

/// Numbers of the harmonics of the base that stand, ascending.
pub fn standing_harmonics(candidate: &Candidate, verdict: &Verdict) -> Vec<u64> {
    if !candidate.is_base() {
        return Vec::new();
    }
    let standing = candidate.places.iter().zip(&verdict.score.of_places).filter(|(_, ln)| **ln > 0.0);
    let mut numbers: Vec<u64> = standing.map(|(p, _)| (p.spacing / candidate.base).abs().round() as u64).collect();
    numbers.sort_unstable();
    numbers.dedup();
    numbers
}

/// What says the same with fewer lines, where that passes the gate as well: a pattern over all teeth whose power lies
/// next to the mesh is a modulation, a modulated order without a sideband is an order.
pub fn simpler(found: (Candidate, Verdict), context: &Context, views: &Views, taken: &TakenOf) -> (Candidate, Verdict) {
    match found.0.kind {
        Kind::Pattern(shaft) => {
            let modulations = [1, 2, 3].map(|most| modulation::candidate(context, shaft, most));
            without_the_teeth(found, modulations, context.scene, views, taken)
        }
        Kind::Train(_) => {
            let modulations = train::modulations(context, &found.0);
            without_the_teeth(found, modulations, context.scene, views, taken)
        }
        Kind::ModulatedPassage(_) if !has_sidebands(&found.0, &found.1) => {
            without_the_shaft(found, context, views, taken)
        }
        _ => found,
    }
}

/// Whether a sideband of a modulated order stands.
pub fn has_sidebands(candidate: &Candidate, verdict: &Verdict) -> bool {
    let standing = candidate.places.iter().zip(&verdict.score.of_places).filter(|(_, ln)| **ln > 0.0);
    standing.count() > carriers(candidate, verdict)
}

fn without_the_shaft(
    found: (Candidate, Verdict),
    context: &Context,
    views: &Views,
    taken: &TakenOf,
) -> (Candidate, Verdict) {
    let alternatives = found.0.alternatives;
    let alone = passage::harmonics(context, found.0.base, passage::LONE_HARMONICS[0]);
    let alone = Candidate { alternatives, ..alone };
    let verdict = accept::judge(&alone, &views.field(taken, alone.domain, 0..context.scene.searched));
    if verdict.refused.is_none() { (alone, verdict) } else { found }
}

/// The first modulation that holds most of a pattern's power, where it passes the gate.
fn without_the_teeth(
    found: (Candidate, Verdict),
    modulations: impl IntoIterator<Item = Candidate>,
    scene: &Scene,
    views: &Views,
    taken: &TakenOf,
) -> (Candidate, Verdict) {
    let power = |candidate: &Candidate| -> f64 {
        let of = |r: usize, c: usize| -> f64 {
            let line = |p: &Place| views.orders.excess(r, c, 0, p.order, 2).max(0.0);
            candidate.places.iter().map(line).sum::<f64>() / views.orders.floor_power(r, c).max(f64::MIN_POSITIVE)
        };
        (0..scene.runs.len()).flat_map(|r| (0..scene.searched).map(move |c| (r, c))).map(|(r, c)| of(r, c)).sum()
    };
    let field = views.field(taken, Domain::Orders, 0..scene.searched);
    let whole = power(&found.0);
    let simpler = modulations.into_iter().find(|shape| power(shape) > MIN_MODULATION_SHARE * whole);
    let judged = simpler.map(|shape| (accept::judge(&shape, &field), shape));
    match judged {
        Some((verdict, shape)) if verdict.refused.is_none() => (shape, verdict),
        _ => found,
    }
}

/// Why a pattern that has hardly a line but next to the mesh is none: the modulation that it would be does not pass
/// the gate.
pub fn as_modulation(
    candidate: &Candidate,
    verdict: &Verdict,
    context: &Context,
    views: &Views,
    taken: &TakenOf,
) -> Option<String> {
    let Kind::Pattern(shaft) = candidate.kind else { return None };
    let scene = context.scene;
    let (own, z) = (scene.shaft_order(shaft as usize), scene.mesh_order());
    let is_first = |order: f64| (order - (order / z).round().max(1.0) * z).abs() < 1.5 * own;
    let standing = || candidate.places.iter().zip(&verdict.score.of_places).filter(|(_, ln)| **ln > 0.0);
    let all: f64 = standing().map(|(_, ln)| ln).sum();
    let beside: f64 = standing().filter(|(place, _)| is_first(place.order)).map(|(_, ln)| ln).sum();
    if beside <= DOMINANT_SHARE * all {
        return None;
    }
    let field = views.field(taken, Domain::Orders, 0..scene.searched);
    let refused = accept::judge(&modulation::candidate(context, shaft, 1), &field).refused;
    refused.map(|why| format!("hardly more than first sidebands of the mesh: {why}"))
}

/// Why a family that the gate lets pass is none: one line is no family of harmonics, an order that is sharp over
/// frequency is none.
pub fn unsound(candidate: &Candidate, verdict: &Verdict, scene: &Scene, views: &Views) -> Option<String> {
    let stands = |p: &(&Place, &f64)| *p.1 > 0.0;
    let standing: Vec<(&Place, &f64)> = candidate.places.iter().zip(&verdict.score.of_places).filter(stands).collect();
    if let Some(why) = of_the_wander(candidate, verdict, scene) {
        return Some(why);
    }
    if is_tooth_of_train(candidate, scene) && standing.len() < MIN_LINES_OF_TOOTH {
        return Some(format!("{} lines only, {MIN_LINES_OF_TOOTH} asked of one tooth", standing.len()));
    }
    if candidate.is_base() {
        let harmonics = standing_harmonics(candidate, verdict);
        let alone = candidate.kind == Kind::Passage && harmonics.len() == 1;
        if harmonics.len() < 2 && !alone && candidate.kind != Kind::AboutMesh {
            return Some(format!("one harmonic only, {} lines", standing.len()));
        }
        if standing.len() < 2 && !alone {
            return Some("one line only".into());
        }
        if matches!(candidate.kind, Kind::ModulatedPassage(_)) && carriers(candidate, verdict) < CARRIERS {
            return Some("sidebands without the lines between them".into());
        }
    }
    let reading = line_axis::of(candidate, verdict, scene, views);
    // Where the two cannot be told, only a supply's frequency is likelier than an order.
    let may_be_supply = reading != Sharper::OverOrders && supply_hz(candidate.base).is_some();
    match candidate.domain {
        Domain::Frequency if reading != Sharper::OverFrequency && !may_be_supply => {
            Some("stands no higher over frequency than over orders".into())
        }
        Domain::Orders if candidate.is_base() && reading == Sharper::OverFrequency => {
            Some("its strongest line is sharper over frequency than over orders".into())
        }
        _ => None,
    }
}

/// Whether a family is one tooth's of a train's gear.
fn is_tooth_of_train(candidate: &Candidate, scene: &Scene) -> bool {
    let Kind::Train(own) = candidate.kind else { return false };
    scene.gearing.as_ref().is_some_and(|gearing| gearing.family(own).what == What::Local)
}

/// Why a family that is sound says too little: one line alone, an order of neither shaft or a frequency of no supply,
/// must speak more than families do, or hold on other turns as well.
pub fn says_too_little(candidate: &Candidate, verdict: &Verdict) -> Option<String> {
    let standing = verdict.score.of_places.iter().filter(|ln| **ln > 0.0).count();
    let is_lone = match candidate.kind {
        Kind::Passage => standing_harmonics(candidate, verdict).len() < 2,
        Kind::FixedFrequency => supply_hz(candidate.base).is_none() && standing < 2,
        _ => false,
    };
    let nats = verdict.ln_bayes;
    (is_lone && nats <= MIN_LONE_LN_BAYES)
        .then(|| format!("one line of {nats:.0} nats, {MIN_LONE_LN_BAYES:.0} asked of one alone"))
}

/// Whether a base is slower than the slower shaft's first sideband, where a wandering speed leaves skirts.
fn is_slow_base(candidate: &Candidate, scene: &Scene) -> bool {
    candidate.is_base() && candidate.base < SKIRT * scene.gear_order.min(1.0)
}

/// Whether a family is so slow that parts of the turns do not tell it from the mesh lines: an order of the signal
/// that is slower than the slower shaft, be it a cage's or not.
pub fn is_slow(candidate: &Candidate, scene: &Scene) -> bool {
    candidate.domain == Domain::Orders && is_slow_base(candidate, scene) && scene.teeth[0] > 1
}

/// Why a family is what a wandering speed makes of the mesh lines: nearer to a mesh harmonic, or slower, than the
/// slower shaft's first sideband.
fn of_the_wander(candidate: &Candidate, verdict: &Verdict, scene: &Scene) -> Option<String> {
    let near = SKIRT * scene.gear_order.min(1.0);
    let z = scene.mesh_order();
    let k = (candidate.base / z).round();
    // A rig without gears has no mesh to swing.
    if scene.teeth[0] == 1 {
        return None;
    }
    let of_train = scene.gearing.as_ref().is_some_and(|g| g.is_beside(candidate.base, near));
    if candidate.is_base() && (of_train || k >= 1.0 && (candidate.base - k * z).abs() < near) {
        return Some("beside a mesh harmonic, which swings as the speed wanders".into());
    }
    if matches!(candidate.kind, Kind::Passage | Kind::ModulatedPassage(_)) {
        let on_skirt = |order: f64| match &scene.gearing {
            Some(gearing) => gearing.is_beside(order, near),
            None => (order - (order / z).round().max(1.0) * z).abs() < near,
        };
        let lines = || candidate.places.iter().zip(&verdict.score.of_places).filter(|(_, ln)| **ln > 0.0);
        let all: f64 = lines().map(|(_, ln)| ln).sum();
        let beside: f64 = lines().filter(|(place, _)| on_skirt(place.order)).map(|(_, ln)| ln).sum();
        if beside > MAX_SKIRT_SHARE * all {
            return Some("its lines stand beside mesh harmonics, which swing as the speed wanders".into());
        }
    }
    if is_slow_base(candidate, scene) && scene.runs.iter().any(SceneRun::runs_up) {
        return Some("slower than the slower shaft, where a run-up's mesh lines are followed and taken off".into());
    }
    let is_slow = candidate.kind == Kind::Swing || is_slow_base(candidate, scene);
    let least = if scene.runs.iter().any(SceneRun::runs_up) { MIN_RUN_UP_SWING_LN_BAYES } else { MIN_SWING_LN_BAYES };
    (is_slow && verdict.ln_bayes < least).then(|| {
        format!("{:.0} nats of {least:.0}, so slow that a wandering speed may leave as much", verdict.ln_bayes)
    })
}
