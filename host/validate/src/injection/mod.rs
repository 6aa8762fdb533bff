//! Known effects put into measured backgrounds: what the loop finds of them, and whether its printed limits hold there.
//!
//! The background is a record as it is, with everything that the loop has adopted in it (`background`). A known
//! effect is added to its signals, channel by channel as strong as the mesh line that its limit refers to times a
//! strength (`effects`); then one more round of the same search runs, gate included. Strengths are multiples of the
//! limit that the loop prints for that family in that record, so the strength found in half of the positions compares
//! with it directly, also where several records are counted together. Positions are drawn from where limits draw
//! theirs, with another seed. A record declared with tooth counts that are not its own has shafts at whose orders it
//! has no lines: so runouts go into machines that have some of their own. Limits: injected lines do not slip and are
//! not in an envelope; a family that a background has already, or that has no limit there, is left out and listed.

mod background;
mod count;
mod effects;
mod noise;
mod surrogates;

use crate::Result;
use crate::record::Record;
use background::Background;
pub use count::{Count, Effect, STRENGTHS};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use serde::Serialize;
use std::time::{Duration, Instant};

/// What to do.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Positions of every effect and strength, all backgrounds that can have it together.
    pub positions: usize,
    /// Surrogates without any effect, all backgrounds together.
    pub surrogates: usize,
    /// Parts of families' names that are injected; all where there is none.
    pub only: Vec<String>,
    /// Seed of positions and phases.
    pub seed: u64,
    /// Time after which no further position is tried.
    pub longest: Duration,
}

/// A background as the loop sees it.
#[derive(Debug, Clone, Serialize)]
pub struct Seen {
    /// Record.
    pub record: String,
    /// Teeth that it is declared with.
    pub teeth: [u32; 2],
    /// Runs, channels searched.
    pub runs_and_channels: [usize; 2],
    /// Families in it already.
    pub families: Vec<String>,
    /// Families of the library that cannot be injected: in the background, on its lines, or without a limit.
    pub left_out: Vec<String>,
    /// Surrogates tried, and what was adopted in them.
    pub surrogates: usize,
    /// See `surrogates`.
    pub added: Vec<String>,
}

/// The answer.
#[derive(Debug, Clone, Serialize)]
pub struct Outcome {
    /// Backgrounds.
    pub backgrounds: Vec<Seen>,
    /// Effects.
    pub effects: Vec<Effect>,
    /// Surrogates tried, and those in which a family was adopted.
    pub surrogates: [usize; 2],
    /// Whether time ended it.
    pub cut_short: bool,
    /// Seed.
    pub seed: u64,
}

/// Runs the injections on some records.
///
/// # Errors
/// A record that signal-based inference refuses.
pub fn run(records: &[Record], options: &Options) -> Result<Outcome> {
    let end = Instant::now() + options.longest;
    let backgrounds: Vec<Background> = records.iter().map(Background::new).collect::<Result<_>>()?;
    let mut effects = Effect::planned(&backgrounds, &options.only);
    let injected = inject(&backgrounds, &mut effects, options, end);
    let mut seen: Vec<Seen> = backgrounds.iter().map(|own| seen(own, &effects)).collect();
    let tried = add_to_nothing(&backgrounds, &mut seen, options, end);
    effects.iter_mut().for_each(Effect::conclude);
    let added = seen.iter().map(|own| own.added.len()).sum();
    Ok(Outcome {
        surrogates: [tried, added],
        backgrounds: seen,
        effects,
        cut_short: !injected || tried < options.surrogates,
        seed: options.seed,
    })
}

/// Position by position over all effects and strengths, so that a cut leaves every cell with as many; whether all
/// were tried.
fn inject(backgrounds: &[Background], effects: &mut [Effect], options: &Options, end: Instant) -> bool {
    let mut random: Vec<ChaCha8Rng> =
        (0..backgrounds.len()).map(|i| ChaCha8Rng::seed_from_u64(options.seed.wrapping_add(1000 * i as u64))).collect();
    for position in 0..options.positions {
        for effect in effects.iter_mut() {
            let of = effect.background(position);
            let (own, random) = (&backgrounds[of], &mut random[of]);
            let Some(placed) = own.drawn(&effect.family, random) else { continue };
            let phases = effects::Phases::drawn(random);
            for (i, strength) in STRENGTHS.iter().enumerate() {
                if Instant::now() > end {
                    return false;
                }
                effect.count(of, i, own.with(&placed, strength * effect.limit(of), &phases));
            }
        }
    }
    true
}

/// Surrogates of each background in turn, as many as time allows.
fn add_to_nothing(backgrounds: &[Background], seen: &mut [Seen], options: &Options, end: Instant) -> usize {
    for i in 0..options.surrogates {
        if Instant::now() > end {
            return i;
        }
        let of = i % backgrounds.len();
        seen[of].surrogates += 1;
        seen[of].added.extend(backgrounds[of].adds_to_nothing(options.seed.wrapping_add(i as u64)));
    }
    options.surrogates
}

fn seen(background: &Background, effects: &[Effect]) -> Seen {
    let scene = &background.scene;
    let record = scene.title.clone();
    let is_injected = |family: &str| effects.iter().any(|e| e.family == family && e.is_of(&record));
    let left_out = background.injectable().filter(|family| !is_injected(family)).map(str::to_owned).collect();
    Seen {
        teeth: scene.teeth,
        runs_and_channels: [scene.runs.len(), scene.searched],
        families: background.families(),
        left_out,
        surrogates: 0,
        added: Vec::new(),
        record,
    }
}
