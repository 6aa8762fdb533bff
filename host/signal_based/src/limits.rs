//! What would have been found: for every family that was not, the strength that this search, with its gate, would
//! have shown in this record.
//!
//! An injected line adds to the projection that the search reads: power `|Z + a|^2` with an unknown phase between
//! them. So injection and recovery need no second run: at places drawn ([`injection_sites`]) and with phases drawn,
//! from a fixed seed, the readings of this very record are changed as lines of strength `a` would, and everything is
//! asked that keeps the search from a family: the gate's threshold of its own surrogates there, and that enough of them
//! find a place; that it is among the candidates judged, and that the order spectrum of a channel proposes its base
//! ([`super::screening`]). The strength is a share of the mean amplitude of the neighbouring mesh line, channel by
//! channel (what the path passes there), or of the channel's strongest mesh line for orders far from the mesh. In
//! half, and in nine of ten of the places it is found; where it would be at no strength, the place counts as not
//! found. A limited channel's strength is the share of its largest value that is cut off. Checked against real
//! injections into measured records (`book/src/results/injection.md`). Limits: lines do not slip and are not looked
//! for in envelopes; the veto of the held-out turns is not asked. Cost: one more round of the search, and some fifty
//! scores per family and place.

use super::accept::{self, FEWEST_COPIES, Surrogates};
use super::baseline::Baseline;
use super::candidate::{Candidate, Field, Kind, Place, Shaft, at_level};
use super::evidence::Reading;
use super::families::{Context, alias, clipping, ghost, modulation, passage, shaft_orders, tooth, train};
use super::injection_sites;
use super::outcome::Limit;
use super::residual_spectra::Views;
use super::scene::Scene;
use super::screening::{Proposals, Rivals};
use super::search::{Adopted, Search, context};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use std::f64::consts::TAU;

/// Strengths tried, from the weakest: steps of an eighth of a factor of two.
pub const MIN_STRENGTH: f64 = 1e-4;
const STEPS: i32 = 128;
const STEP: f64 = 0.125;
/// Places drawn of every family.
pub const PLACES: usize = 32;
/// Phases drawn for each.
const PHASES: usize = 512;
/// Seed of places and phases.
const SEED: u64 = 16;
/// Alternatives of a base where no other was proposed.
const FEW_BASES: f64 = 100.0;
/// Row of a channel that stands still at the end of its range.
pub const LIMITED_CHANNEL: &str = "channel limited at the end of its range";

/// What limits are worked out from.
struct Bench<'a> {
    context: Context<'a>,
    baseline: &'a Baseline,
    views: &'a Views,
    found: &'a Search,
    rivals: Rivals,
    proposals: Proposals,
}

/// Limits of every family of the library that was not adopted, nor is part of one that was.
pub fn limits(scene: &Scene, baseline: &Baseline, views: &Views, found: &Search, adopted: &[&Adopted]) -> Vec<Limit> {
    let context = context(scene, views, &found.taken, &found.feet);
    let is_found = |c: &Candidate| adopted.iter().any(|a| a.candidate.kind == c.kind || a.explains(c, scene));
    let (ranked, _) = found.ranked(scene, views);
    let library = library(&context, &ranked);
    let missing = library.into_iter().filter(|(_, c)| !is_found(c));
    let (rivals, proposals) = (Rivals::of(&ranked), Proposals::of(&context));
    let bench = Bench { context, baseline, views, found, rivals, proposals };
    missing.map(|(family, c)| bench.limit(&family, &c)).chain(limited(scene)).collect()
}

/// One typical candidate of each family, with the alternatives that its search has; `ranked` are candidates of the
/// last round.
pub fn library(context: &Context, ranked: &[(f64, Candidate)]) -> Vec<(String, Candidate)> {
    let mut all = Vec::new();
    for shaft in Shaft::PAIR_SHAFTS.into_iter().filter(|_| context.scene.gearing.is_none()) {
        let word = shaft.word();
        all.push((
            format!("modulation of the mesh by the {word}'s shaft, first sidebands"),
            modulation::candidate(context, shaft, 1),
        ));
        all.push((format!("first order of the {word}'s shaft"), shaft_orders::candidate(context, shaft, 1)));
        all.push((
            format!("pulse once per turn of the {word} (all its orders alike)"),
            tooth::candidate(context, shaft),
        ));
    }
    all.extend(train::typical(context));
    let ghosts = if context.scene.gearing.is_some() { Vec::new() } else { ghost::candidates(context) };
    if !ghosts.is_empty() {
        all.push(("ghost order".into(), ghosts[ghosts.len() / 3].clone()));
    }
    // Bases of ordinary bearings, on no order of either shaft.
    let alternatives = ranked.iter().find(|(_, c)| c.is_base()).map_or(FEW_BASES, |(_, c)| c.alternatives);
    let outer = passage::harmonics(context, 3.587, passage::LONE_HARMONICS[0]);
    all.push(("harmonics of an order of neither shaft".into(), Candidate { alternatives, ..outer }));
    for &shaft in context.scene.shafts() {
        let own = context.scene.shaft_order(shaft as usize);
        let inner = passage::modulated(context, 5.413 * own, shaft);
        let family = format!("harmonics of such an order modulated by {}", shaft.phrase());
        all.push((family, Candidate { alternatives, ..inner }));
    }
    if context.scene.gearing.is_some() {
        all.retain(|(_, c)| !c.places.is_empty());
        return all;
    }
    all.extend(
        alias::candidates(context).into_iter().map(|c| ("mesh harmonics folded at the sampling rate".into(), c)),
    );
    all.retain(|(_, c)| !c.places.is_empty());
    all
}

/// Row of a family from the strengths at which it is found at the places tried, infinite where it is at none.
fn row(family: &str, unit: &str, mut strengths: Vec<f64>) -> Limit {
    strengths.sort_by(f64::total_cmp);
    let count = strengths.len();
    let at = |share: f64| {
        let own = strengths.get(((share * count as f64).ceil() as usize).saturating_sub(1));
        own.copied().filter(|strength| strength.is_finite())
    };
    Limit {
        family: family.to_owned(),
        found_in_half: at(0.5),
        found_in_90_percent: at(0.9),
        unit: unit.into(),
        places: count,
    }
}

/// Of every channel and either end of its range; none where one is limited already.
fn limited(scene: &Scene) -> Option<Limit> {
    if !clipping::limited(scene).is_empty() {
        return None;
    }
    let places = (0..scene.channels.len()).flat_map(|c| clipping::SIDES.map(|side| (c, side)));
    let strengths = places.map(|(c, side)| clipping::least_share(scene, c, side).unwrap_or(f64::INFINITY)).collect();
    Some(row(LIMITED_CHANNEL, "of its largest value cut off", strengths))
}

impl Bench<'_> {
    fn limit(&self, family: &str, typical: &Candidate) -> Limit {
        let scene = self.context.scene;
        let beside_mesh = matches!(typical.kind, Kind::Modulation(_) | Kind::Train(_));
        let path = paths(scene, self.baseline, typical, beside_mesh);
        let mut random = ChaCha8Rng::seed_from_u64(SEED);
        // One place: its copies need no second look.
        let mut fixed = None;
        let mut strengths = Vec::new();
        for _ in 0..PLACES {
            let Some(place) = injection_sites::drawn(&self.context, self.found, typical, &mut random) else { continue };
            let phases: Vec<f64> = (0..PHASES).map(|_| TAU * random.random::<f64>()).collect();
            let needed = if place.base == typical.base {
                *fixed.get_or_insert_with(|| self.needed(&place))
            } else {
                self.needed(&place)
            };
            let weakest = needed.and_then(|needed| self.weakest(&place, needed, &path, &phases));
            strengths.push(weakest.unwrap_or(f64::INFINITY));
        }
        row(family, if beside_mesh { "of the neighbouring mesh line" } else { "of the strongest mesh line" }, strengths)
    }

    /// Score from which a candidate is judged and let pass; none where too few surrogates find a place.
    fn needed(&self, candidate: &Candidate) -> Option<f64> {
        let field = self.field(candidate);
        let copies = Surrogates::of(accept::copies(candidate, &field), 0.0);
        if copies.copies < FEWEST_COPIES {
            return None;
        }
        let refined = if candidate.is_base() { passage::TRIAL_BASES } else { 1.0 };
        let gate = accept::needed(&copies, candidate.alternatives * refined);
        let judged = self.rivals.least(candidate) + candidate.alternatives.max(1.0).ln();
        // The choice of the resolution is paid for.
        let depth = if candidate.locked { 1 } else { field.spectra.depth().max(1) };
        Some(gate.max(judged) + (depth as f64).ln())
    }

    fn field(&self, candidate: &Candidate) -> Field<'_> {
        self.views.field(&self.found.taken, candidate.domain, 0..self.context.scene.searched)
    }

    /// The weakest strength from which on a family is found.
    fn weakest(&self, place: &Candidate, needed: f64, path: &[Vec<Vec<f64>>], phases: &[f64]) -> Option<f64> {
        let field = self.field(place);
        let strength = |step: i32| MIN_STRENGTH * 2.0_f64.powf(STEP * f64::from(step));
        let mesh = |run: usize, channel: usize, line: usize| {
            let own = &path[run][channel];
            own.get(line).or(own.last()).copied().unwrap_or(0.0)
        };
        let passes = |step: i32| {
            let amplitude = |run: usize, channel: usize, line: usize| strength(step) * mesh(run, channel, line);
            let change = |own: &Place, (run, channel): (usize, usize), reading: Reading| {
                let line = place.places.iter().position(|p| p.order == own.order).unwrap_or(0);
                let level = &field.spectra.levels[run][channel][0];
                // The search raises the floor by what it may be wrong.
                let floor = level.floor_amplitude(own.order).max(f64::MIN_POSITIVE);
                let signal = (amplitude(run, channel, line) / floor).powi(2) / (1.0 + 2.0 * level.floor_error);
                injected(reading, signal, phases[(line * 7 + channel * 3 + run) % PHASES])
            };
            let proposed = !place.is_base() || self.proposals.propose(&self.context, place, &amplitude);
            proposed && at_level(place, &field, 0.0, 0, &change).ln_bayes > needed
        };
        // Passing grows with the strength but for the phase: bisection finds one crossing.
        let (mut low, mut high) = (-1, STEPS);
        if !passes(high) {
            return None;
        }
        while high - low > 1 {
            let middle = (low + high) / 2;
            if passes(middle) { high = middle } else { low = middle }
        }
        Some(strength(high))
    }
}

/// Amplitude of the mesh line that a strength is a share of, by run, channel and place.
fn paths(scene: &Scene, baseline: &Baseline, candidate: &Candidate, beside_mesh: bool) -> Vec<Vec<Vec<f64>>> {
    let of_channel = |run: usize, channel: usize| -> Vec<f64> {
        if beside_mesh {
            return candidate
                .places
                .iter()
                .map(|place| baseline.nearest_mesh(scene, run, channel, place.order))
                .collect();
        }
        vec![baseline.strongest_mesh(scene, run, channel); candidate.places.len()]
    };
    (0..scene.runs.len()).map(|r| (0..scene.channels.len()).map(|c| of_channel(r, c)).collect()).collect()
}

/// A reading with a line of power `signal` (over the floor) at a phase against what is there.
fn injected(reading: Reading, signal: f64, phase: f64) -> Reading {
    // A line's power against the floor's in the window's noise bandwidth, at its centre.
    let cross = 2.0 * (signal * reading.ratio / reading.averages).sqrt() * phase.cos();
    Reading { ratio: (reading.ratio + signal + cross).max(0.0), ..reading }
}
