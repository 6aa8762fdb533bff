//! From families, errors and limits to the answer: values, headline, what is left.

use super::accept::{FALSE_ALARM, Verdict};
use super::baseline::{Baseline, Grids};
use super::candidate::{Candidate, Domain, Kind};
use super::errors::{Corrected, Errors};
use super::families::bearing::{Bearing, Part};
use super::families::clipping;
use super::holdout_test::{self, HoldoutResult};
use super::impacts::Impacts;
use super::naming;
use super::outcome::{
    BearingRead, Effect, ErrorTable, Evidence, Judged, Limit, Outcome, Picture, SplitUsed, Unexplained, Value,
};
use super::preflight::Preflight;
use super::residual_spectra::Views;
use super::scene::Scene;
use super::search::{self, Adopted, Search};
use crate::analysis::lines::WINDOW;
use crate::spectral::amplitude_spectrum;
use std::collections::BTreeMap;

/// Lines listed of a family.
const LINES: usize = 24;
/// Mesh harmonics that the pictures reach to.
const PICTURE_HARMONICS: f64 = 6.5;

/// What the answer is made of.
pub struct Parts<'a> {
    /// The record.
    pub scene: &'a Scene,
    /// Declared and calibrated model.
    pub baseline: &'a Baseline,
    /// Fitted turns.
    pub views: &'a Views,
    /// Corrected model.
    pub corrected: &'a Corrected,
    /// The search.
    pub search: &'a Search,
    /// Further lines of the shafts, let pass or refused.
    pub rest: &'a [Adopted],
    /// Combs of impacts.
    pub impacts: &'a [Impacts],
}

type Judgement<'a> = (&'a Adopted, HoldoutResult);

/// The answer.
pub fn outcome(
    parts: &Parts,
    kept: &[Judgement],
    vetoed: &[Judgement],
    errors: Errors,
    limits: Vec<Limit>,
    preflight: &Preflight,
) -> Outcome {
    let scene = parts.scene;
    let adopted: Vec<Adopted> = kept.iter().map(|(a, _)| (*a).clone()).collect();
    let bearing = search::bearing(&adopted, scene).filter(|bearing| agrees(bearing, parts.impacts, scene));
    let bases = search::bases(&adopted);
    let read_from = bearing.as_ref().map(|b| (b, bases.as_slice()));
    let is_ghost = |a: &&Adopted| a.candidate.kind == Kind::Ghost;
    let ghosts: Vec<f64> = adopted.iter().filter(is_ghost).map(|a| a.candidate.base).collect();
    let of_impacts = |a: &Adopted| read_from.is_none() && parts.impacts.iter().any(|own| is_of(a, own, scene));
    let others = kept.iter().filter(|(a, _)| !of_impacts(a));
    let effects: Vec<Effect> = others.map(|(a, worth)| effect(parts, a, worth, read_from, &ghosts)).collect();
    let is_read = |own: &Impacts| bearing.is_some() && bases.iter().any(|base| own.explains(*base));
    let combs: Vec<&Impacts> = parts.impacts.iter().filter(|own| !is_read(own)).collect();
    let of_combs =
        combs.iter().map(|own| of_comb(own, kept.iter().filter(|(a, _)| is_of(a, own, scene)).count(), scene));
    let mut effects = [of_combs.collect(), effects, clipped(scene)].concat();
    if !scene.has_gears() {
        effects.iter_mut().for_each(Effect::forget_gears);
    }
    let mut surrogates: Vec<Judged> =
        parts.search.adopted.iter().map(|a| judged(&a.candidate, &a.verdict, scene)).collect();
    for (judged, adopted) in surrogates.iter_mut().zip(&parts.search.adopted) {
        judged.refused = veto(adopted, vetoed);
    }
    surrogates.extend(parts.search.refused.iter().map(|(c, v)| judged(c, v, scene)));
    surrogates.extend(parts.rest.iter().map(|own| {
        let row = judged(&own.candidate, &own.verdict, scene);
        Judged {
            family: further_orders(&own.candidate, scene),
            refused: row.refused.clone().or(veto(own, vetoed)),
            ..row
        }
    }));
    let [declared, calibrated] = parts.baseline.unknowns;
    Outcome {
        record: scene.title.clone(),
        headline: headline(&effects, bearing.as_ref(), &errors, scene),
        level: "signal-based",
        to_raise_the_level: preflight.for_model_based.clone(),
        notes: scene.notes.clone(),
        unit: scene.unit.clone(),
        split: split(scene),
        held_out: errors.held_out,
        unknowns: [declared, calibrated, calibrated + parts.corrected.unknowns],
        speed_functions: parts.baseline.functions(),
        unexplained: unexplained(&errors),
        error: ErrorTable { metric: METRIC.into(), errors },
        impacts: combs.into_iter().cloned().collect(),
        effects,
        bearing: bearing.map(|b| read(&b, &adopted)),
        slip: None,
        limits,
        surrogates,
        candidates_tried: parts.search.tried,
        false_alarm: FALSE_ALARM,
        pictures: pictures(parts),
    }
}

const METRIC: &str = "waveform: nrmse below the highest order held, root of the residual's share of the power meaned \
    over \
     channels; share of power: unexplained share of the power, with what slips predicted as power at its lines";

fn veto(adopted: &Adopted, vetoed: &[Judgement]) -> Option<String> {
    let own = vetoed.iter().find(|(a, _)| std::ptr::eq(*a, adopted));
    own.map(|(_, w)| format!("held-out turns do not gain ({:.2e} of the power, {:.1} nats)", w.gain, w.ln_bayes))
}

/// Channels that stand still at the end of their range.
fn clipped(scene: &Scene) -> Vec<Effect> {
    let channels = clipping::limited(scene);
    if channels.is_empty() {
        return Vec::new();
    }
    let list: Vec<String> =
        channels.iter().map(|(channel, count)| format!("channel {channel} ({count} samples)")).collect();
    vec![Effect {
        verdict: "named".into(),
        name: "clipping".into(),
        family: "other".into(),
        shaft: "none".into(),
        predicts: "nothing",
        remark: Some(format!("stands still at the end of its range: {}", list.join(", "))),
        ..Effect::default()
    }]
}

/// Name of a family in lists.
pub fn words(candidate: &Candidate, scene: &Scene) -> String {
    let base = candidate.base;
    match candidate.kind {
        Kind::Modulation(shaft) => format!("modulation of the mesh by the {}'s shaft", shaft.word()),
        Kind::ShaftOrders(shaft) => format!("orders of the {}'s shaft", shaft.word()),
        Kind::SingleTooth(shaft) => format!("one tooth of the {}", shaft.word()),
        Kind::Pattern(shaft) => format!("pattern over the teeth of the {}", shaft.word()),
        Kind::Ghost => format!("ghost order {base:.4}"),
        Kind::Passage => format!("harmonics of order {base:.4}"),
        Kind::ModulatedPassage(shaft) => {
            format!("harmonics of order {base:.4} modulated by {}", shaft.phrase())
        }
        Kind::AboutMesh => format!("order {base:.4} about the mesh"),
        Kind::FixedFrequency => format!("line at {base:.3} Hz"),
        Kind::Alias => "folded mesh harmonics".into(),
        Kind::Clipping => "clipping".into(),
        Kind::Swing => "slow swing".into(),
        Kind::Train(own) => scene.gearing.as_ref().map_or_else(String::new, |gearing| gearing.words(own)),
    }
}

fn further_orders(candidate: &Candidate, scene: &Scene) -> String {
    match candidate.kind {
        Kind::Pattern(shaft) => format!("further orders of the {}'s shaft", shaft.word()),
        _ => words(candidate, scene),
    }
}

fn judged(candidate: &Candidate, verdict: &Verdict, scene: &Scene) -> Judged {
    Judged {
        family: words(candidate, scene),
        base: candidate.base,
        ln_bayes: verdict.ln_bayes,
        refused: verdict.refused.clone(),
        surrogates: verdict.surrogates.clone(),
    }
}

fn effect(
    parts: &Parts,
    adopted: &Adopted,
    worth: &HoldoutResult,
    bearing: Option<(&Bearing, &[f64])>,
    ghosts: &[f64],
) -> Effect {
    let (candidate, verdict) = (&adopted.candidate, &adopted.verdict);
    let part = bearing.and_then(|(b, bases)| {
        let own = bases.iter().position(|base| *base == candidate.base)?;
        b.parts.iter().find(|p| p.0 == own).map(|p| (b, p.1))
    });
    let naming = naming::name(adopted, part, ghosts, parts.scene);
    let is_frequency = candidate.domain == Domain::Frequency;
    let mut lines: Vec<(f64, (String, f64))> = candidate
        .places
        .iter()
        .zip(&verdict.score.of_places)
        .filter(|(_, ln)| **ln > 0.0)
        .map(|(p, ln)| (*ln, (p.label.clone(), p.order)))
        .collect();
    lines.sort_by(|a, b| b.0.total_cmp(&a.0));
    Effect {
        verdict: naming.verdict.into(),
        name: naming.name,
        family: naming.family.into(),
        shaft: naming.shaft.into(),
        order_of_pinion: (!is_frequency).then_some(candidate.base),
        frequency_hz: is_frequency.then_some(candidate.base),
        parameters: parameters(parts, adopted),
        evidence: Evidence {
            held_out_gain: worth.gain,
            held_out_ln_bayes: worth.ln_bayes,
            p_value: verdict.surrogates.false_alarm,
            ln_bayes: verdict.ln_bayes,
            surrogates: Some(verdict.surrogates.clone()),
            domain: Some(candidate.domain.word()),
            ..Evidence::default()
        },
        predicts: if holdout_test::predicts_waveform(adopted, worth) { "waveform" } else { "power" },
        remark: naming.remark.map(str::to_owned),
        carries: adopted.carries.iter().map(further).collect(),
        lines: lines.into_iter().take(LINES).map(|(_, line)| line).collect(),
    }
}

/// Whether a family of lines is what impacts leave in the signal itself: a base or a frequency at one of their lines.
fn is_of(adopted: &Adopted, own: &Impacts, scene: &Scene) -> bool {
    let candidate = &adopted.candidate;
    let speed_hz = scene.runs.first().map_or(1.0, |run| run.angle.speed.mean_hz);
    match candidate.kind {
        Kind::FixedFrequency => own.explains(candidate.base / speed_hz),
        _ => candidate.is_base() && own.explains(candidate.base),
    }
}

/// Whether a comb of squared envelopes is the image of lines about the mesh: what modulates the mesh excites nothing
/// at random.
pub fn modulates_the_mesh(adopted: &Adopted, own: &Impacts) -> bool {
    adopted.candidate.kind == Kind::AboutMesh && own.has_base(adopted.candidate.base)
}

/// Whether a bearing read from lines is no other than what the impacts are of, at its very base (a sideband of a half
/// is near any order), and none is declared; a rig without gears has no mesh that
/// tells a stiffness from impacts.
fn agrees(bearing: &Bearing, impacts: &[Impacts], scene: &Scene) -> bool {
    scene.has_gears()
        || impacts.first().filter(|own| own.bearing.is_none()).is_some_and(|own| {
            let at = |part: Part| own.has_base(part.order(bearing.elements, bearing.ratio));
            match own.reading.parts.as_slice() {
                ["outer ring"] => at(Part::Outer),
                ["inner ring"] => at(Part::Inner),
                _ => false,
            }
        })
}

/// A comb of impacts, with the number of families of lines that it explains.
fn of_comb(own: &Impacts, families: usize, scene: &Scene) -> Effect {
    let naming = naming::impacts(own, scene);
    let value =
        |value: f64, half: f64, unit: &str| Value { value, ci95: [value - half, value + half], unit: unit.into() };
    let channel = &scene.channels[own.place.1];
    let [low, high] = own.hz;
    let over = if own.meaned > 1 { format!("over {} bands ", own.meaned) } else { String::new() };
    let band = format!("in channel {} {over}from {low:.0} to {high:.0} Hz", channel.index);
    let parameters = BTreeMap::from([
        ("channel".into(), value(channel.index as f64, 0.0, "from 0")),
        ("band_low".into(), value(low, 0.0, "Hz")),
        ("band_high".into(), value(high, 0.0, "Hz")),
        ("depth".into(), value(own.depth, 0.0, "of the band's mean power")),
        ("order".into(), value(own.reading.base, own.bin / own.comb.harmonics as f64, "of the pinion")),
    ]);
    let carries =
        if families > 0 { vec![format!("{families} families of lines in the signal itself")] } else { Vec::new() };
    Effect {
        verdict: naming.verdict.into(),
        name: naming.name,
        family: naming.family.into(),
        shaft: naming.shaft.into(),
        order_of_pinion: Some(own.reading.base),
        parameters,
        evidence: Evidence {
            held_out_ln_bayes: own.comb.again,
            p_value: (-own.comb.nats).exp(),
            ln_bayes: own.comb.nats,
            domain: Some("envelope"),
            ..Evidence::default()
        },
        predicts: "nothing",
        remark: Some(format!("{band}; {}", own.reading.remark)),
        carries,
        lines: own.lines(),
        ..Effect::default()
    }
}

impl Effect {
    /// The words of a rig of one shaft.
    fn forget_gears(&mut self) {
        for text in [&mut self.name, &mut self.shaft].into_iter().chain(&mut self.remark).chain(&mut self.carries) {
            *text = naming::without_gears(text);
        }
        self.lines.iter_mut().for_each(|(label, _)| *label = naming::without_gears(label));
        self.parameters.values_mut().for_each(|value| value.unit = naming::without_gears(&value.unit));
    }
}

/// Further lines of a family, in words.
fn further(carries: &search::Carries) -> String {
    let v = &carries.verdict;
    let lines = v.score.of_places.iter().filter(|ln| **ln > 0.0).count();
    format!("{}: {lines} lines, {:.1} nats, best surrogate {:.1}", carries.words, v.ln_bayes, v.surrogates.highest)
}

/// The strongest line over all channels: amplitude with its interval, and as a share of the mesh line beside it.
fn parameters(parts: &Parts, adopted: &Adopted) -> BTreeMap<String, Value> {
    let mut values = BTreeMap::new();
    let candidate = &adopted.candidate;
    if let Some(pulse) = adopted.pulse {
        let tooth = pulse.tooth as f64;
        values.insert(
            "tooth".into(),
            Value { value: tooth, ci95: [tooth - 1.0, tooth + 1.0], unit: "from angle 0".into() },
        );
    }
    if adopted.slip.share != 0.0 {
        let [value, step] = [adopted.slip.share, adopted.slip.step].map(|share| 100.0 * share);
        let unit = "% of its order".into();
        values.insert(
            "slip_on_held_out_turns".into(),
            Value { value, ci95: [value - 2.0 * step, value + 2.0 * step], unit },
        );
    }
    if candidate.domain != Domain::Orders {
        return values;
    }
    let level = adopted.verdict.score.level;
    let mut strongest: Option<(f64, f64, f64)> = None;
    for r in 0..parts.scene.runs.len() {
        for c in 0..parts.scene.channels.len() {
            for (place, _) in candidate.places.iter().zip(&adopted.verdict.score.of_places).filter(|(_, ln)| **ln > 0.0)
            {
                let amplitude = (2.0 * parts.views.orders.excess(r, c, level, place.order, 3).max(0.0)).sqrt();
                let mesh = parts.baseline.nearest_mesh(parts.scene, r, c, place.order);
                if strongest.is_none_or(|(a, _, _)| amplitude > a) {
                    let floor = parts.views.orders.levels[r][c][0].floor_amplitude(place.order);
                    strongest = Some((amplitude, mesh, floor));
                }
            }
        }
    }
    let Some((amplitude, mesh, floor)) = strongest else { return values };
    let half = 1.96 * floor;
    let unit = parts.scene.unit.clone();
    values.insert(
        "strongest_line".into(),
        Value { value: amplitude, ci95: [(amplitude - half).max(0.0), amplitude + half], unit },
    );
    if mesh > 0.0 {
        let share = |a: f64| (a / mesh).max(0.0);
        let value = Value {
            value: share(amplitude),
            ci95: [share(amplitude - half), share(amplitude + half)],
            unit: "of the mesh line beside it".into(),
        };
        values.insert("strongest_line_share".into(), value);
    }
    values
}

fn read(bearing: &Bearing, adopted: &[Adopted]) -> BearingRead {
    let bases = search::bases(adopted);
    BearingRead {
        shaft: bearing.shaft.word(),
        elements: bearing.elements,
        ratio: bearing.ratio,
        parts: bearing.parts.iter().map(|(i, part, _)| (bases[*i], part.word())).collect(),
        worst: bearing.worst,
    }
}

fn headline(effects: &[Effect], bearing: Option<&Bearing>, errors: &Errors, scene: &Scene) -> String {
    let mut found: Vec<String> = effects.iter().map(|e| format!("{}: {}", e.verdict, e.name)).collect();
    if let Some(b) = bearing {
        let ratio = b.ratio;
        found.push(format!("one bearing on the {}'s shaft, {} elements, ratio {ratio:.3}", b.shaft.word(), b.elements));
    }
    let found = if found.is_empty() { "nothing beyond the mesh".to_owned() } else { found.join("; ") };
    let found = if scene.has_gears() { found } else { naming::without_gears(&found) };
    let held = errors.held_out;
    if held.declared.is_nan() {
        return format!("{found}; nothing was held out to try it on: too few turns");
    }
    format!(
        "{found}; held-out error {:.4} declared, {:.4} calibrated, {:.4} corrected, noise {:.4}",
        held.declared, held.calibrated, held.corrected, held.noise_floor
    )
}

fn split(scene: &Scene) -> SplitUsed {
    let blocks = scene.runs.iter().map(|run| run.split.held_out.len()).max().unwrap_or(0);
    let channels = if scene.searched < scene.channels.len() { "; every second channel" } else { "" };
    let kind = match blocks {
        0 => "nothing held out in time: too short".to_owned(),
        n => format!(
            "a quarter of the turns of every run, {n} block{} inside it, gaps on both sides{channels}",
            if n > 1 { "s" } else { "" }
        ),
    };
    SplitUsed {
        kind,
        runs: scene.runs.iter().map(|run| (run.index, run.split.clone())).collect(),
        searched_channels: scene.channels[..scene.searched].iter().map(|c| c.index).collect(),
        held_out_channels: scene.channels[scene.searched..].iter().map(|c| c.index).collect(),
    }
}

fn unexplained(errors: &Errors) -> Vec<Unexplained> {
    let power = errors.held_out_power;
    if power.noise_floor.is_nan() {
        return Vec::new();
    }
    let mut all = vec![Unexplained {
        description: "broadband floor between lines, held-out turns".into(),
        variance_share: power.noise_floor.min(power.corrected),
    }];
    if power.corrected > power.noise_floor {
        all.push(Unexplained {
            description: "above the floor, neither mesh nor a family found, held-out turns".into(),
            variance_share: power.corrected - power.noise_floor,
        });
    }
    all
}

fn pictures(parts: &Parts) -> Vec<Picture> {
    let scene = parts.scene;
    let top = (PICTURE_HARMONICS * scene.mesh_order()).min(scene.highest_order);
    let Some(run) = scene.runs.first() else { return Vec::new() };
    let amplitudes = |grids: &Grids, c: usize| spectrum(&grids[0][c], run.angle.per_turn[0], top);
    let picture = |c: usize| Picture {
        place: (run.index, scene.channels[c].index),
        name: scene.channels[c].name.clone(),
        spectra: [
            spectrum(&run.samples[c], run.angle.per_turn[0], top),
            amplitudes(&parts.baseline.calibrated, c),
            amplitudes(&parts.corrected.residual, c),
        ],
    };
    (0..scene.channels.len()).map(picture).collect()
}

fn spectrum(samples: &[f64], per_turn: usize, top: f64) -> Vec<(f64, f64)> {
    let spectrum = amplitude_spectrum(samples, per_turn as f64, WINDOW);
    let points = spectrum.values.iter().enumerate().map(|(i, a)| (spectrum.frequency(i), *a));
    points.skip(4).take_while(|(order, _)| *order <= top).collect()
}
