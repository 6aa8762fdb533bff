//! A measured record as background: what the loop has of it, and what one more round adopts with an effect put in.
//!
//! The record stays as it is, with every family that the search has found in it. An effect is added to the signal
//! over time of every searched channel, all views are made anew, envelopes and their bands included, and the search
//! goes one round further, gate included. Limits: the mesh lines are those fitted without the effect (it has no line
//! on them; a limited channel's change by less than the effect), and the veto of the held-out turns is not asked, as
//! in the printed limits.

use super::effects::{Effect, Phases, injected};
use super::surrogates::Surrogates;
use crate::record::Record;
use crate::signal_based::baseline::{Baseline, Grids};
use crate::signal_based::candidate::{Candidate, Kind};
use crate::signal_based::families::clipping;
use crate::signal_based::outcome::Limit;
use crate::signal_based::residual_spectra::{self, Views};
use crate::signal_based::scene::Scene;
use crate::signal_based::search::{self, Adopted, Search};
use crate::signal_based::{injection_sites, limits, naming, outcome_builder, path_angle, secondary_lines};
use crate::{Error, Result};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// Relative distance within which a found base is the injected one.
const SAME_BASE_SHARE: f64 = 5e-3;

/// The background.
pub struct Background {
    /// The record.
    pub scene: Scene,
    baseline: Baseline,
    views: Views,
    found: Search,
    limits: Vec<Limit>,
    injectable: Vec<(String, Candidate)>,
    surrogates: Surrogates,
}

/// What a round says of an injected effect.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Answer {
    /// The effect's lines, or its limited channel, were adopted.
    pub found: bool,
    /// And the words name the effect, alone or among those in question.
    pub named: bool,
    /// Something else was adopted.
    pub wrong: bool,
}

impl Background {
    /// Of a record.
    ///
    /// # Errors
    /// A record that signal-based inference refuses.
    pub fn new(record: &Record) -> Result<Self> {
        let place = record.folder.join("record.toml");
        let teeth = record.declaration.teeth().ok_or_else(|| Error::invalid(place.display(), "has no tooth counts"))?;
        let mut scene = Scene::of(record, record.require_tach()?, teeth)?;
        let baseline = path_angle::fitted(&mut scene);
        let views = residual_spectra::views(&scene, &baseline.calibrated, |split| &split.fit, None);
        let mut found = search::search(&scene, &views);
        secondary_lines::carry(&mut found, &scene, &views);
        let adopted: Vec<&Adopted> = found.adopted.iter().collect();
        let limits = limits::limits(&scene, &baseline, &views, &found, &adopted);
        let (ranked, _) = found.ranked(&scene, &views);
        let injectable = limits::library(&search::context(&scene, &views, &found.taken, &found.feet), &ranked);
        let surrogates = Surrogates::of(&scene, &baseline);
        Ok(Self { scene, baseline, views, found, limits, injectable, surrogates })
    }

    /// Families found in it, in words.
    pub fn families(&self) -> Vec<String> {
        self.found.adopted.iter().map(|own| outcome_builder::words(&own.candidate, &self.scene)).collect()
    }

    /// Families with a limit printed here, all that can be injected.
    pub fn limits(&self) -> impl Iterator<Item = (&Limit, f64)> {
        self.limits.iter().filter_map(|limit| limit.found_in_half.map(|half| (limit, half)))
    }

    /// Families of the library.
    pub fn injectable(&self) -> impl Iterator<Item = &str> {
        self.injectable.iter().map(|(family, _)| family.as_str()).chain([limits::LIMITED_CHANNEL])
    }

    /// The family's effect at a place drawn; none where nothing is free.
    pub fn drawn(&self, family: &str, random: &mut ChaCha8Rng) -> Option<Effect> {
        if family == limits::LIMITED_CHANNEL {
            let channel = random.random_range(0..self.scene.searched);
            return Some(Effect::Limited(channel, clipping::SIDES[random.random_range(0..clipping::SIDES.len())]));
        }
        let (_, typical) = self.injectable.iter().find(|(own, _)| own == family)?;
        let context = search::context(&self.scene, &self.views, &self.found.taken, &self.found.feet);
        injection_sites::drawn(&context, &self.found, typical, random).map(Effect::Family)
    }

    /// What one more round says with an effect put in.
    pub fn with(&self, effect: &Effect, strength: f64, phases: &Phases) -> Answer {
        let scene = injected(&self.scene, &self.baseline, effect, strength, phases);
        let calibrated: Grids = scene
            .runs
            .iter()
            .zip(&self.scene.runs)
            .zip(&self.baseline.calibrated)
            .map(|((with, without), left)| {
                let channels = with.samples.iter().zip(&without.samples).zip(left);
                let changed = |((with, without), left): ((&Vec<f64>, &Vec<f64>), &Vec<f64>)| -> Vec<f64> {
                    left.iter().zip(with).zip(without).map(|((l, w), o)| l + (w - o)).collect()
                };
                channels.map(changed).collect()
            })
            .collect();
        let views = residual_spectra::views(&scene, &calibrated, |split| &split.fit, None);
        let next = self.found.next(&scene, &views);
        match effect {
            Effect::Limited(channel, _) => {
                let index = scene.channels[*channel].index;
                let found = clipping::limited(&scene).iter().any(|(own, _)| *own == index);
                Answer { found, named: found, wrong: next.is_some() }
            }
            Effect::Family(placed) => {
                let own = next.as_ref().filter(|adopted| is_it(&adopted.candidate, placed));
                let named = own.is_some_and(|adopted| {
                    let name = naming::name(adopted, None, &[], &scene).name;
                    name.contains(&word(placed))
                });
                Answer { found: own.is_some(), named, wrong: next.is_some() && own.is_none() }
            }
        }
    }

    /// Whether the search adopts a family where there is nothing.
    pub fn adds_to_nothing(&self, seed: u64) -> Option<String> {
        let (scene, views) = self.surrogates.drawn(&self.scene, seed);
        let next = search::nothing(&scene, &views).next(&scene, &views);
        next.map(|adopted| outcome_builder::words(&adopted.candidate, &scene))
    }
}

/// Whether what was adopted has the injected lines: those of the same shaft, or the same base.
fn is_it(adopted: &Candidate, placed: &Candidate) -> bool {
    if placed.is_base() {
        return adopted.is_base() && (adopted.base / placed.base - 1.0).abs() < SAME_BASE_SHARE;
    }
    let same_base = (adopted.base / placed.base - 1.0).abs() < SAME_BASE_SHARE;
    same_base
        && match (adopted.kind, placed.kind) {
            (Kind::SingleTooth(a) | Kind::Pattern(a) | Kind::Modulation(a), Kind::Pattern(b) | Kind::Modulation(b)) => {
                a == b
            }
            (a, b) => a == b,
        }
}

/// What a right name has in it.
fn word(placed: &Candidate) -> String {
    match placed.kind {
        Kind::Modulation(shaft) => format!("{}-eccentricity", shaft.word()),
        Kind::ShaftOrders(shaft) => format!("{}-imbalance", shaft.word()),
        Kind::Pattern(shaft) | Kind::SingleTooth(shaft) => format!("{}-tooth-crack", shaft.word()),
        Kind::Ghost => "ghost-order".into(),
        Kind::ModulatedPassage(shaft) => format!("inner ring of the {}'s shaft", shaft.word()),
        Kind::Alias => "aliasing".into(),
        // Lines without knocks are an order that one base alone does not explain.
        _ => "unexplained order".into(),
    }
}
