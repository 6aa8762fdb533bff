//! Known effects put into a measured background: what the loop finds of them, and whether its printed limits hold there.
//!
//! The background is the record as it is, with everything that the loop has adopted in it. A known effect is added to what the mesh leaves, at equal
//! angles, channel by channel as strong as the mesh line that its limit refers to times a strength; then one more round of the same search
//! runs, gate included. Strengths are multiples of the limit that the loop prints for that family, so the strength found in half of the
//! positions compares with it directly. Limits: the injected lines do not slip and are not in the envelope; a family that the background has already cannot be found a
//! second time and is left out; the veto of the held-out turns is not asked (nor is it by the printed limits).

mod effects;
mod surrogates;

use crate::kinematic::baseline::Baseline;
use crate::kinematic::candidate::{Candidate, Kind};
use crate::kinematic::carry;
use crate::kinematic::following::followed;
use crate::kinematic::limits;
use crate::kinematic::outcome::Limit;
use crate::kinematic::residual::{self, Views};
use crate::kinematic::scene::Scene;
use crate::kinematic::search::{self, Adopted, Search};
use crate::kinematic::spectra::Spectra;
use crate::record::Record;
use crate::{Error, Result};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use serde::Serialize;
use std::time::{Duration, Instant};
use surrogates::Surrogate;

/// Multiples of the printed limit that are injected.
pub const STRENGTHS: [f64; 5] = [0.4, 0.63, 1.0, 1.6, 2.5];
/// Relative distance within which a found base is the injected one.
const SAME: f64 = 5e-3;

/// What to do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Positions of every effect and strength.
    pub positions: usize,
    /// Surrogates of the background without any effect.
    pub surrogates: usize,
    /// Seed of positions and phases.
    pub seed: u64,
    /// Time after which no further position is tried.
    pub longest: Duration,
}

/// One strength of one effect.
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub struct Count {
    /// Times the printed limit.
    pub of_limit: f64,
    /// Positions tried.
    pub tried: usize,
    /// Adopted as the effect that it is.
    pub found: usize,
    /// Adopted as something else.
    pub wrong: usize,
}

/// One effect.
#[derive(Debug, Clone, Serialize)]
pub struct Effect {
    /// Family, as the limits call it.
    pub family: String,
    /// Limit printed: found in half.
    pub limit: f64,
    /// What the strength is.
    pub unit: String,
    /// By strength.
    pub counts: Vec<Count>,
    /// Strength found in half of the positions, times the printed limit; none where that was not reached or always exceeded.
    pub half_over_limit: Option<f64>,
}

/// The answer.
#[derive(Debug, Clone, Serialize)]
pub struct Outcome {
    /// Families in the background already.
    pub background: usize,
    /// Effects.
    pub effects: Vec<Effect>,
    /// Families without a printed limit here.
    pub left_out: Vec<String>,
    /// Surrogates tried, and those in which a family was adopted.
    pub surrogates: [usize; 2],
    /// Whether time ended it.
    pub cut_short: bool,
    /// Seed.
    pub seed: u64,
}

/// The background.
struct Background<'a> {
    scene: &'a Scene,
    baseline: &'a Baseline,
    views: &'a Views,
    found: Search,
}

/// Runs the injections on a record.
///
/// # Errors
/// A record that the kinematic level refuses.
pub fn run(record: &Record, options: &Options) -> Result<Outcome> {
    let place = record.folder.join("record.toml");
    let teeth = record.declaration.teeth().ok_or_else(|| Error::invalid(place.display(), "has no tooth counts"))?;
    let scene = Scene::of(record, record.require_tach()?, teeth)?;
    let baseline = Baseline::of(&scene);
    let views = residual::views(&scene, &baseline.calibrated, |split| &split.fit, None);
    let mut found = search::search(&scene, &views);
    carry::carry(&mut found, &scene, &views);
    let adopted: Vec<&Adopted> = found.adopted.iter().collect();
    let printed = limits::limits(&scene, &baseline, &views, &found, &adopted);
    let background = Background { scene: &scene, baseline: &baseline, views: &views, found: found.clone() };
    let context = search::context(&scene, &views, &found.taken, &found.feet);
    let library = limits::library(&context);
    let end = Instant::now() + options.longest;
    let mut random = ChaCha8Rng::seed_from_u64(options.seed);
    let mut outcome = Outcome {
        background: adopted.len(),
        effects: Vec::new(),
        left_out: Vec::new(),
        surrogates: [0; 2],
        cut_short: false,
        seed: options.seed,
    };
    let mut planned: Vec<(Effect, Candidate)> = Vec::new();
    for (family, candidate) in library {
        match printed.iter().find(|limit| limit.family == family) {
            Some(Limit { found_in_half: Some(half), unit, .. }) if !found.knows(&candidate, &scene) => {
                let counts = STRENGTHS.map(|of_limit| Count { of_limit, ..Count::default() }).to_vec();
                let effect = Effect { family, limit: *half, unit: unit.clone(), counts, half_over_limit: None };
                planned.push((effect, candidate));
            }
            _ => outcome.left_out.push(family),
        }
    }
    // Position by position over all effects and strengths, so that a cut leaves every cell with as many.
    'positions: for _ in 0..options.positions {
        for (effect, typical) in &mut planned {
            let placed = effects::placed(&context, typical, &mut random);
            let phases = effects::Phases::drawn(&mut random);
            for count in &mut effect.counts {
                if Instant::now() > end {
                    outcome.cut_short = true;
                    break 'positions;
                }
                let strength = count.of_limit * effect.limit;
                let next = background.with(&placed, strength, &phases);
                count.tried += 1;
                match next {
                    Some(adopted) if is_it(&adopted, &placed) => count.found += 1,
                    Some(_) => count.wrong += 1,
                    None => {}
                }
            }
        }
    }
    for i in 0..options.surrogates {
        if Instant::now() > end {
            outcome.cut_short = true;
            break;
        }
        let Surrogate { scene, views } = Surrogate::new(&scene, &baseline, options.seed.wrapping_add(i as u64));
        let nothing = search::nothing(&scene, &views);
        outcome.surrogates[0] += 1;
        outcome.surrogates[1] += usize::from(nothing.next(&scene, &views).is_some());
    }
    outcome.effects = planned.into_iter().map(|(effect, _)| effect.concluded()).collect();
    Ok(outcome)
}

/// Whether what was adopted is what was injected.
fn is_it(adopted: &Adopted, placed: &Candidate) -> bool {
    let same_base = (adopted.candidate.base / placed.base - 1.0).abs() < SAME;
    same_base
        && match (adopted.candidate.kind, placed.kind) {
            (Kind::SingleTooth(a) | Kind::Pattern(a), Kind::SingleTooth(b) | Kind::Pattern(b)) => a == b,
            (a, b) => a == b,
        }
}

impl Background<'_> {
    /// What one more round adopts with an effect put in.
    fn with(&self, placed: &Candidate, strength: f64, phases: &effects::Phases) -> Option<Adopted> {
        let scene = self.scene;
        let mut grids: Vec<Vec<Vec<f64>>> =
            self.baseline.calibrated.iter().map(|run| run[..scene.searched].to_vec()).collect();
        let mut injected = scene.clone();
        for (r, channels) in grids.iter_mut().enumerate() {
            for (c, samples) in channels.iter_mut().enumerate() {
                let added = effects::waveform(scene, self.baseline, (r, c), placed, strength, phases);
                samples.iter_mut().zip(&added).for_each(|(x, a)| *x += a);
                injected.runs[r].samples[c].iter_mut().zip(&added).for_each(|(x, a)| *x += a);
            }
        }
        let orders = Spectra::searched(scene, &followed(scene, &grids), |r| scene.runs[r].split.fit.clone());
        let views = Views {
            orders,
            envelope: self.views.envelope.clone(),
            whole_envelope: self.views.whole_envelope.clone(),
            frequency: self.views.frequency.clone(),
            folded: self.views.folded.clone(),
            bands: self.views.bands.clone(),
        };
        self.found.next(&injected, &views)
    }
}

impl Effect {
    /// With the strength found in half of the positions, between the two that it lies between.
    fn concluded(mut self) -> Self {
        let share = |count: &Count| count.found as f64 / count.tried.max(1) as f64;
        let crossing = self.counts.windows(2).find(|w| share(&w[0]) < 0.5 && share(&w[1]) >= 0.5);
        self.half_over_limit = crossing.map(|w| {
            let (low, high) = (share(&w[0]), share(&w[1]));
            let part = (0.5 - low) / (high - low);
            w[0].of_limit * (w[1].of_limit / w[0].of_limit).powf(part)
        });
        self
    }
}
