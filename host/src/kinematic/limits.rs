//! What would have been found: for every family that was not, the smallest strength that this record would have shown.
//!
//! An injected line adds to the projection that the search reads: power `|Z + a|^2` with an unknown phase between them. So injection and recovery need no second run: at
//! places moved by 1 to 6 % of the spacing the readings of this very record are changed as lines of strength `a` would, and the gate's own threshold is asked. The strength
//! is a share of the mean amplitude of the neighbouring mesh line, channel by channel (what the path passes there), or of the channel's strongest mesh line for orders far from the mesh. In
//! half, and in nine of ten of the places, it is found. Phases are drawn with a fixed seed. Checked against real injections (`host/tests/kinematic.rs`). Limit: for a family whose base is
//! searched, that the base is proposed at all is taken for granted where its lines are as strong as this.

use super::accept::{self, COPIES, Surrogates};
use super::baseline::Baseline;
use super::candidate::{Candidate, Domain, Kind, Place, Shaft, at_level, score};
use super::evidence::Reading;
use super::families::{Context, alias, ghost, modulation, passage, shaft_orders, tooth};
use super::outcome::Limit;
use super::residual::Views;
use super::scene::Scene;
use super::search::{Adopted, Search, context};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use std::f64::consts::TAU;

/// Strengths tried, from the weakest: steps of a quarter of a factor of two.
const WEAKEST: f64 = 1e-4;
const STEPS: i32 = 64;
/// Seed of the phases.
const SEED: u64 = 16;

/// Limits of every family of the library that was not adopted, nor is part of one that was.
pub fn limits(scene: &Scene, baseline: &Baseline, views: &Views, found: &Search, adopted: &[&Adopted]) -> Vec<Limit> {
    let context = context(scene, views, &found.taken, &found.feet);
    let is_found = |c: &Candidate| adopted.iter().any(|a| a.candidate.kind == c.kind || a.explains(c, scene));
    let library = library(&context);
    let missing = library.into_iter().filter(|(_, c)| !is_found(c));
    missing.map(|(family, c)| limit(scene, baseline, views, found, &family, &c)).collect()
}

/// One typical candidate of each family, with the alternatives that its search has.
pub fn library(context: &Context) -> Vec<(String, Candidate)> {
    let mut all = Vec::new();
    for shaft in Shaft::BOTH {
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
    let ghosts = ghost::candidates(context);
    if !ghosts.is_empty() {
        all.push(("ghost order".into(), ghosts[ghosts.len() / 3].clone()));
    }
    // Bases of ordinary bearings, on no order of either shaft.
    let alternatives = 100.0;
    let outer = passage::harmonics(context, 3.587, Domain::Orders, passage::ALONE[0]);
    all.push(("harmonics of an order of neither shaft".into(), Candidate { alternatives, ..outer }));
    for shaft in Shaft::BOTH {
        let own = context.scene.shaft_order(shaft as usize);
        let inner = passage::modulated(context, 5.413 * own, shaft, Domain::Orders);
        let family = format!("harmonics of such an order modulated by the {}'s shaft", shaft.word());
        all.push((family, Candidate { alternatives, ..inner }));
    }
    all.extend(
        alias::candidates(context).into_iter().map(|c| ("mesh harmonics folded at the sampling rate".into(), c)),
    );
    all.retain(|(_, c)| !c.places.is_empty());
    all
}

fn limit(
    scene: &Scene,
    baseline: &Baseline,
    views: &Views,
    found: &Search,
    family: &str,
    candidate: &Candidate,
) -> Limit {
    let field = views.field(&found.taken, candidate.domain, 0..scene.searched);
    let copies = accept::displacements().map(|moved| score(candidate, &field, moved).ln_bayes).collect();
    let surrogates = Surrogates::of(copies, 0.0);
    let needed = accept::needed(&surrogates, candidate.alternatives);
    let beside_mesh = matches!(candidate.kind, Kind::Modulation(_));
    let path: Vec<Vec<Vec<f64>>> = paths(scene, baseline, candidate, beside_mesh);
    let mut random = ChaCha8Rng::seed_from_u64(SEED);
    let mut strengths: Vec<f64> = accept::displacements()
        .filter_map(|moved| {
            let phases: Vec<f64> = (0..512).map(|_| TAU * random.random::<f64>()).collect();
            weakest(candidate, &field, moved, needed, &|place, run, channel, a, reading| {
                let level = &field.spectra.levels[run][channel][0];
                let amplitude = a * path[run][channel][place];
                let floor = level.floor_amplitude(candidate.places[place].order).max(f64::MIN_POSITIVE);
                injected(reading, (amplitude / floor).powi(2), phases[(place * 7 + channel * 3 + run) % 512])
            })
        })
        .collect();
    strengths.sort_by(f64::total_cmp);
    let at = |share: f64| strengths.get(((share * COPIES as f64).ceil() as usize).saturating_sub(1)).copied();
    let unit = if beside_mesh { "of the neighbouring mesh line" } else { "of the strongest mesh line" };
    Limit {
        family: family.to_owned(),
        found_in_half: at(0.5),
        found_in_90_percent: at(0.9),
        unit: unit.into(),
        places: COPIES,
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

type Inject<'a> = dyn Fn(usize, usize, usize, f64, Reading) -> Reading + 'a;

/// The weakest strength from which on the gate's threshold is passed at a displacement.
fn weakest(
    candidate: &Candidate,
    field: &super::candidate::Field,
    moved: f64,
    needed: f64,
    inject: &Inject,
) -> Option<f64> {
    let passes = |step: i32| {
        let a = WEAKEST * 2.0_f64.powf(0.25 * f64::from(step));
        let change = |place: &Place, (run, channel): (usize, usize), reading: Reading| {
            let index = candidate.places.iter().position(|p| p.order == place.order).unwrap_or(0);
            inject(index, run, channel, a, reading)
        };
        at_level(candidate, field, moved, 0, &change).ln_bayes > needed
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
    Some(WEAKEST * 2.0_f64.powf(0.25 * f64::from(high)))
}
