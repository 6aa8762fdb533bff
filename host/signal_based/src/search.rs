//! Families one after the other: the strongest that the gate lets pass, then the rest without its lines.

use super::accept::{self, Verdict};
use super::candidate::{Candidate, Domain, Field, Kind, Place, TakenOf, score};
use super::excluded_lines::{mesh_taken, relatives, take_folded, take_frequencies, take_orders};
use super::families::fixed_frequency::supply_hz;
use super::families::{self, Context, bearing, passage, swing, tooth, train, train_tooth};
use super::full_record_check::over_all_turns;
use super::line_axis::{self, Sharper};
use super::plausibility::{as_modulation, by_higher_base, higher_base, is_slow, says_too_little, simpler, unsound};
use super::residual_spectra::Views;
use super::scene::{Scene, SceneRun};
use crate::analysis::lines::LOBE_BINS;
use crate::analysis::search::Level;
use crate::analysis::skirts::Skirts;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Most families adopted.
const MAX_FAMILIES: usize = 8;
/// Two bases are the same within this share, and where the first one slips (a rolling bearing by up to 1 or 2 %, by
/// less within a record).
const SAME_BASE: f64 = 3e-3;
const SLIPPING_BASE_SHARE: f64 = 7e-3;
/// Candidates of a round that are judged before it is given up.
pub const MAX_CANDIDATES: usize = 60;
/// And of one kind in one spectrum: a skirt that looks like many swings must not hide the rest.
pub const MAX_CANDIDATES_OF_KIND: usize = 3;
/// Multiples and sidebands of an adopted base that are no base of their own.
const DERIVED_LINE_COUNTS: (u32, i32) = (6, 3);
/// Multiples above them that are its own as well, but for their sidebands.
const MAX_MULTIPLE: u32 = 12;
/// Lines of a family that a supply with its harmonics may have as well.
const LONE_LINES: usize = 3;
/// Share of a family's evidence that makes it what was vetoed.
const MIN_VETOED_SHARE: f64 = 0.5;
/// Sidebands of an adopted modulation that are its own, on each side.
const SIDES: i32 = 8;

/// A family adopted on the fitted part.
#[derive(Debug, Clone)]
pub struct Adopted {
    /// The family.
    pub candidate: Candidate,
    /// The gate's answer.
    pub verdict: Verdict,
    /// The tooth of a single-tooth family.
    pub pulse: Option<tooth::Pulse>,
    /// Further harmonics and sidebands that the gate let pass; their lines are among the candidate's.
    pub carries: Vec<Carries>,
    /// Frequency at which its few lines may stand as well, Hz: the speed does not move enough to tell.
    pub either_hz: Option<f64>,
    /// What its base moves by on the held-out turns.
    pub slip: Slip,
    /// Families of a train that say the same as well.
    pub or_else: Vec<u16>,
}

/// What a base moves by on the turns not used.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Slip {
    /// Share of the base; 0 where none is worth its choice.
    pub share: f64,
    /// Step of the choices: half a bin of the line that moves most.
    pub step: f64,
    /// Logarithm of the number of choices, where one was taken.
    pub cost: f64,
}

impl Adopted {
    /// Places of the lines that stand.
    pub fn standing(&self) -> impl Iterator<Item = &Place> {
        let lines = self.candidate.places.iter().zip(&self.verdict.score.of_places);
        lines.filter(|(_, ln)| **ln > 0.0).map(|(place, _)| place)
    }

    /// What a line's order moves by on the held-out turns.
    pub fn off(&self, place: &Place) -> f64 {
        if self.slip.share == 0.0 { 0.0 } else { self.slip.share * self.candidate.lever(place) }
    }

    /// Whether a candidate is what this family has explained.
    pub fn explains(&self, candidate: &Candidate, scene: &Scene) -> bool {
        let own = &self.candidate;
        let same_kind = match (own.kind, candidate.kind) {
            (Kind::Train(a), Kind::Train(b)) => scene.gearing.as_ref().is_some_and(|g| g.covers(a, b)),
            (Kind::SingleTooth(a) | Kind::Pattern(a), Kind::Modulation(b) | Kind::Pattern(b)) => a == b,
            (a @ (Kind::Modulation(_) | Kind::ShaftOrders(_) | Kind::Swing), b) => a == b,
            _ => false,
        };
        same_kind || (candidate.is_base() && own.is_base() && derived(candidate.base, own, scene))
    }
}

/// Further lines of a family of neither shaft.
#[derive(Debug, Clone)]
pub struct Carries {
    /// Which, in words.
    pub words: String,
    /// The gate's answer.
    pub verdict: Verdict,
}

/// What the search found.
#[derive(Clone)]
pub struct Search {
    /// Families adopted, in this order.
    pub adopted: Vec<Adopted>,
    /// Best of each kind that was refused.
    pub refused: Vec<(Candidate, Verdict)>,
    /// Orders spoken for, by domain.
    pub taken: TakenOf,
    /// Candidates scored.
    pub tried: usize,
    /// Whether a family that was judged came close ([`Verdict::is_close`]).
    pub had_close: bool,
    /// Feet of the pair's lines.
    pub feet: Vec<Skirts>,
    /// Families that the held-out turns vetoed: they and what they would explain are not asked for again.
    pub vetoed: Vec<Adopted>,
}

/// Index of a domain among the views.
pub fn index(domain: Domain) -> usize {
    domain as usize
}

/// A search that was not made.
pub fn nothing(scene: &Scene, views: &Views) -> Search {
    let feet = |(run, channels): (&SceneRun, &Vec<Vec<Level>>)| -> Vec<Skirts> {
        let levels = channels[..scene.searched].iter().filter_map(|levels| levels.first());
        if let Some(g) = &scene.gearing {
            return levels.map(|level| Skirts::of_train(level, scene.gear_order, &g.shafts, &g.sound)).collect();
        }
        levels.map(|level| Skirts::of(level, &run.angle, scene.teeth[0], scene.highest_order)).collect()
    };
    Search {
        adopted: Vec::new(),
        refused: Vec::new(),
        taken: mesh_taken(scene, views),
        tried: 0,
        had_close: false,
        feet: scene.runs.iter().zip(&views.orders.levels).flat_map(feet).collect(),
        vetoed: Vec::new(),
    }
}

/// Searches on the fitted part of the searched channels.
pub fn search(scene: &Scene, views: &Views) -> Search {
    let mut search = nothing(scene, views);
    search.rounds(scene, views, None);
    search
}

/// A family of neither shaft with its base as finely as its standing lines say; any other as it is.
fn placed(context: &Context, candidate: Candidate, verdict: &Verdict) -> Candidate {
    if !candidate.is_base() {
        return candidate;
    }
    let standing: Vec<bool> = verdict.score.of_places.iter().map(|ln| *ln > 0.0).collect();
    passage::placed(context, &candidate, &standing, context.scene.searched)
}

/// Context of the families.
pub fn context<'a>(scene: &'a Scene, views: &'a Views, taken: &'a TakenOf, feet: &'a [Skirts]) -> Context<'a> {
    Context {
        scene,
        orders: &views.orders,
        frequency: &views.frequency,
        folded: &views.folded,
        strength: &views.strength.spectra,
        taken,
        feet,
    }
}

impl Search {
    /// The family that one more round on these views would adopt.
    pub fn next(&self, scene: &Scene, views: &Views) -> Option<Adopted> {
        self.clone().round(scene, views, None)
    }

    /// Logarithm of a candidate's Bayes factor after the choice.
    fn strength(&self, candidate: &Candidate, scene: &Scene, views: &Views) -> f64 {
        let field = views.field(&self.taken, candidate.domain, 0..scene.searched);
        score(candidate, &field, 0.0).ln_bayes - candidate.alternatives.max(1.0).ln()
    }

    /// Candidates of a round for which the record speaks at all, strongest first, with the logarithm of the Bayes
    /// factor after the choice; and how many were scored.
    pub fn ranked(&self, scene: &Scene, views: &Views) -> (Vec<(f64, Candidate)>, usize) {
        let context = context(scene, views, &self.taken, &self.feet);
        let candidates: Vec<Candidate> =
            families::all(&context).into_iter().filter(|c| !self.knows(c, scene)).collect();
        let count = candidates.len();
        let mut ranked: Vec<(f64, Candidate)> =
            candidates.into_par_iter().map(|c| (self.strength(&c, scene, views), c)).collect();
        ranked.retain(|(s, _)| *s > 0.0);
        ranked.sort_by(|a, b| b.0.total_cmp(&a.0));
        (ranked, count)
    }

    /// Rounds until no family is found, or there are enough; what is close passes on the held-out turns alone, where
    /// they are given.
    pub fn rounds(&mut self, scene: &Scene, views: &Views, held: Option<(&Views, &TakenOf)>) {
        while self.adopted.len() < MAX_FAMILIES {
            let Some(found) = self.round(scene, views, held) else { break };
            self.take(scene, views, found);
        }
    }

    fn round(&mut self, scene: &Scene, views: &Views, held: Option<(&Views, &TakenOf)>) -> Option<Adopted> {
        let (ranked, count) = self.ranked(scene, views);
        // Asked again on the held-out turns they are no further ones.
        self.tried += if held.is_some() { 0 } else { count };
        let context = context(scene, views, &self.taken, &self.feet);
        let strength = |c: &Candidate| self.strength(c, scene, views);
        // What is close may pass on the held-out turns.
        let pass_there = |candidate: &Candidate, verdict: &mut Verdict, judge: fn(&Candidate, &Field) -> Verdict| {
            let Some((held, taken)) = held.filter(|_| verdict.is_close) else { return };
            let there = held.field(taken, candidate.domain, 0..scene.searched);
            verdict.passed_by(&judge(&placed(&context, candidate.clone(), verdict), &there));
        };
        let (mut refused, mut had_close) = (Vec::new(), false);
        let mut found = None;
        for (_, candidate) in of_every_kind(&ranked) {
            let candidate = candidate.clone();
            let refined = passage::refinements(&context, &candidate);
            let best = refined.into_iter().map(|c| (strength(&c), c)).max_by(|a, b| a.0.total_cmp(&b.0));
            let mut candidate = best.map_or(candidate, |(_, c)| c);
            let field = views.field(&self.taken, candidate.domain, 0..scene.searched);
            let mut verdict = accept::judge(&candidate, &field);
            had_close |= verdict.is_close;
            pass_there(&candidate, &mut verdict, accept::judge_alone);
            if verdict.refused.is_none() {
                verdict.refused = unsound(&candidate, &verdict, scene, views);
            }
            if let (None, false, Some(why)) =
                (&verdict.refused, verdict.is_close, says_too_little(&candidate, &verdict))
            {
                verdict.is_close = true;
                had_close = true;
                verdict.refused = Some(why);
                pass_there(&candidate, &mut verdict, accept::agrees_alone);
            }
            if verdict.refused.is_none() {
                verdict.refused = self.by_another_name(&candidate, &verdict, views);
            }
            if verdict.refused.is_none() {
                let higher = higher_base(&candidate, &verdict, &context, views, &self.taken).map(|(higher, _)| higher);
                verdict.refused =
                    by_higher_base(&candidate, &verdict, higher.as_ref(), |higher| self.knows(higher, scene));
            }
            if verdict.refused.is_none() {
                verdict.refused = as_modulation(&candidate, &verdict, &context, views, &self.taken);
            }
            if verdict.refused.is_none() && is_slow(&candidate, scene) {
                match over_all_turns(&candidate, &verdict, scene, &self.taken[0], &views.all_turns) {
                    Ok(there) => candidate = there,
                    Err(why) => verdict.refused = Some(why),
                }
            }
            if verdict.refused.is_none() && candidate.kind == Kind::Swing {
                let base = views.strength.refined(scene, 0..scene.searched, candidate.base);
                candidate = swing::lines(&context, &Candidate { base, ..candidate });
                let field = Field { spectra: &views.all_turns, taken: &self.taken[0], channels: 0..scene.searched };
                verdict.score.of_places = score(&candidate, &field, 0.0).of_places;
            }
            if verdict.refused.is_none() {
                found = Some((candidate, verdict));
                break;
            }
            refused.push((candidate, verdict));
        }
        found = found.map(|found| simpler(found, &context, views, &self.taken));
        self.had_close |= had_close;
        for (candidate, verdict) in refused {
            if self.refused.iter().all(|(c, _)| c.kind != candidate.kind) {
                self.refused.push((candidate, verdict));
            }
        }
        let (mut candidate, verdict) = found?;
        let mut verdict = verdict;
        if let Some((higher, judged)) = higher_base(&candidate, &verdict, &context, views, &self.taken) {
            (candidate, verdict) = (higher, judged);
        }
        candidate = placed(&context, candidate, &verdict);
        let pulse = match candidate.kind {
            Kind::Train(_) => train_tooth::is_single(scene, &candidate),
            Kind::Pattern(shaft) => tooth::is_single(scene, shaft),
            _ => None,
        };
        if let (Kind::Pattern(shaft), Some(_)) = (candidate.kind, pulse) {
            candidate.kind = Kind::SingleTooth(shaft);
        }
        let either_hz = either_hz(&candidate, &verdict, scene, views);
        let field = views.field(&self.taken, candidate.domain, 0..scene.searched);
        let or_else = train::rivals(&candidate, &verdict.score.of_places, &context, &field);
        Some(Adopted { candidate, verdict, pulse, carries: Vec::new(), either_hz, slip: Slip::default(), or_else })
    }

    /// Whether a candidate is what an adopted family has explained already, or one that was vetoed.
    pub fn knows(&self, candidate: &Candidate, scene: &Scene) -> bool {
        let is_same = |own: &Adopted| own.candidate.kind == candidate.kind && own.candidate.base == candidate.base;
        self.adopted.iter().any(|own| own.explains(candidate, scene))
            || self.vetoed.iter().any(|own| own.explains(candidate, scene) || is_same(own))
    }

    /// Why a family is what was vetoed by another name: most of its evidence is that of lines of a vetoed one which
    /// has no more lines than it. A part of what was vetoed may hold by itself.
    fn by_another_name(&self, candidate: &Candidate, verdict: &Verdict, views: &Views) -> Option<String> {
        let lines = candidate.places.iter().zip(&verdict.score.of_places);
        let standing: Vec<(f64, f64)> = lines.filter(|(_, ln)| **ln > 0.0).map(|(p, ln)| (p.order, *ln)).collect();
        let all: f64 = standing.iter().map(|(_, ln)| ln).sum();
        let near = 0.5 * views.of(candidate.domain).bin(0);
        let is_it = |own: &Adopted| {
            let has = |order: f64| own.standing().any(|place| (place.order - order).abs() < near);
            let shared: f64 = standing.iter().filter(|(order, _)| has(*order)).map(|(_, ln)| ln).sum();
            let is_no_part = own.standing().count() <= standing.len();
            own.candidate.domain == candidate.domain && is_no_part && shared > MIN_VETOED_SHARE * all
        };
        self.vetoed.iter().any(is_it).then(|| "most of it is what the held-out turns vetoed".into())
    }

    /// Adopts a family: its lines are spoken for.
    pub fn take(&mut self, scene: &Scene, views: &Views, found: Adopted) {
        let candidate = &found.candidate;
        let own = index(candidate.domain);
        let spectra = views.of(candidate.domain);
        let steps = if candidate.locked { 0 } else { (spectra.bin(found.verdict.score.level) / spectra.bin(0)) as i32 };
        for (place, ln) in candidate.places.iter().zip(&found.verdict.score.of_places) {
            if *ln <= 0.0 {
                continue;
            }
            self.taken[own].extend((-steps..=steps).map(|i| place.order + f64::from(i) * spectra.bin(0) * LOBE_BINS));
            match candidate.domain {
                Domain::Orders => {
                    take_frequencies(&mut self.taken[index(Domain::Frequency)], scene, views, place.order)
                }
                Domain::Frequency => take_orders(&mut self.taken[0], scene, views, place.order),
                Domain::Folded => take_folded(&mut self.taken, scene, views, place.order),
                Domain::Strength => {}
            }
        }
        self.take_relatives(scene, views, candidate);
        self.adopted.push(found);
    }

    /// Lines that come with a family though they are not listed: orders it shares with the other shaft, and its base
    /// in the other spectra.
    fn take_relatives(&mut self, scene: &Scene, views: &Views, candidate: &Candidate) {
        let z = scene.mesh_order();
        let mesh = (scene.highest_order / z) as i32;
        match candidate.kind {
            Kind::Train(own) => {
                let gearing = scene.gearing.as_ref();
                self.taken[0].extend(gearing.into_iter().flat_map(|gearing| gearing.of_seat(own)));
            }
            Kind::SingleTooth(shaft) | Kind::Pattern(shaft) => {
                let own = scene.shaft_order(shaft as usize);
                self.taken[0].extend((1..=(scene.highest_order / own) as usize).map(|n| n as f64 * own));
            }
            Kind::Modulation(shaft) => {
                let own = scene.shaft_order(shaft as usize);
                let beside = |k: i32| (-SIDES..=SIDES).map(move |n| f64::from(k) * z + f64::from(n) * own);
                self.taken[0].extend((1..=mesh).flat_map(beside));
            }
            _ if candidate.is_base() || candidate.kind == Kind::Swing => {
                let orders: Vec<f64> = relatives(candidate.base, scene).collect();
                orders.iter().for_each(|&order| {
                    take_frequencies(&mut self.taken[index(Domain::Frequency)], scene, views, order)
                });
                self.taken[0].extend(orders);
            }
            _ => {}
        }
    }
}

/// The frequency of a family of few lines that may stand at a frequency as well as at an order.
fn either_hz(candidate: &Candidate, verdict: &Verdict, scene: &Scene, views: &Views) -> Option<f64> {
    let (sharper, speed_hz) = line_axis::read(candidate, verdict, scene, views);
    let hz = candidate.base * speed_hz;
    let lines = verdict.score.of_places.iter().filter(|ln| **ln > 0.0).count();
    let is_lone = match candidate.kind {
        Kind::FixedFrequency => true,
        // Harmonics of anything but a supply are those of something that turns.
        Kind::Passage => lines <= if supply_hz(hz).is_some() { LONE_LINES } else { 1 },
        _ => false,
    };
    let can_be_either = match sharper {
        Sharper::Neither => true,
        Sharper::Hump => supply_hz(hz).is_some(),
        Sharper::OverFrequency | Sharper::OverOrders => false,
    };
    (is_lone && can_be_either).then_some(hz)
}

/// The strongest candidates, few of each kind.
pub fn of_every_kind(ranked: &[(f64, Candidate)]) -> impl Iterator<Item = &(f64, Candidate)> {
    let mut judged: BTreeMap<(Kind, Domain), usize> = BTreeMap::new();
    let few = move |(_, candidate): &&(f64, Candidate)| {
        let count = judged.entry((candidate.kind, candidate.domain)).or_default();
        *count += 1;
        *count <= MAX_CANDIDATES_OF_KIND
    };
    ranked.iter().filter(few).take(MAX_CANDIDATES)
}

/// Whether a base is a multiple, a part or a sideband of another; one that slips is smeared, and its skirts look like
/// bases beside it.
fn derived(base: f64, own: &Candidate, scene: &Scene) -> bool {
    let half = scene.resolution();
    let share = if own.locked { SAME_BASE } else { SLIPPING_BASE_SHARE };
    let near = |a: f64, b: f64| (a - b).abs() <= half.max(share * b);
    let own = own.base;
    let z = scene.mesh_order();
    let is_higher = |j: u32| (base / (f64::from(j) * own) - 1.0).abs() <= SAME_BASE;
    (DERIVED_LINE_COUNTS.0 + 1..=MAX_MULTIPLE).any(is_higher)
        || (1..=DERIVED_LINE_COUNTS.0).map(f64::from).any(|j| {
            let of_shafts = (-DERIVED_LINE_COUNTS.1..=DERIVED_LINE_COUNTS.1)
                .any(|n| [1.0, scene.gear_order].iter().any(|s| near(base, (j * own + f64::from(n) * s).abs())));
            of_shafts || near(base * j, own) || (1..=4).any(|k| near(base, (f64::from(k) * z - j * own).abs()))
        })
}

/// Bases of the adopted families of neither shaft.
pub fn bases(adopted: &[Adopted]) -> Vec<f64> {
    adopted.iter().filter(|a| a.candidate.is_base()).map(|a| a.candidate.base).collect()
}

/// The bearing that the adopted orders of neither shaft make together.
pub fn bearing(adopted: &[Adopted], scene: &Scene) -> Option<bearing::Bearing> {
    bearing::read(&bases(adopted), scene.gear_order).filter(|b| b.others == 0)
}
