//! What the families found have besides the lines that they were found by; asked once the search has ended, when
//! bases and spacings are known.
//!
//! Three kinds of parts: the shafts' further orders ([`remaining_shaft_orders`]), further harmonics of the orders of
//! neither shaft, and their sidebands ([`carried`]). After the search, because what a family's base explains of other
//! bases is decided without them. Every part has to pass the gate on its own: the spacing is known, so what is moved
//! for the null is the part and not what it belongs to. A part that is refused is asked again once others are let pass,
//! because their lines were among its surrogates; lines once taken are not taken again. A modulator takes the shape
//! (one, two or four sidebands on each side) that the gate lets pass with most evidence. Cost: a judgement per part
//! and round.

use super::accept::{self, Verdict};
use super::candidate::{Candidate, Domain, Place, Shaft, Taken, TakenOf};
use super::excluded_lines::mesh_taken;
use super::families::carried::{self, Modulator};
use super::remaining_shaft_orders;
use super::residual_spectra::Views;
use super::scene::Scene;
use super::search::{Adopted, Carries, Search};

/// Rounds in which parts that were refused are asked again.
const ROUNDS: usize = 3;
/// Words of the harmonics, which a base is asked for until they pass.
const HARMONICS_TEXT: &str = "further harmonics";

/// Completes the families of neither shaft in place; gives the further orders of the shafts, let pass or refused.
pub fn carry(search: &mut Search, scene: &Scene, views: &Views) -> Vec<Adopted> {
    let mut parts = Parts { scene, views, taken: mesh_taken(scene, views), rest: Vec::new() };
    for own in search.adopted.iter().filter(|own| own.candidate.domain == Domain::Orders) {
        parts.take(&own.candidate, &own.verdict);
    }
    parts.rounds(search);
    for own in bases(search) {
        parts.sidebands(search, own);
    }
    parts.rounds(search);
    parts.rest
}

/// Families of neither shaft that are seen in the signal itself.
fn bases(search: &Search) -> Vec<usize> {
    let of_the_signal = |own: &Adopted| own.candidate.is_base() && own.candidate.domain == Domain::Orders;
    (0..search.adopted.len()).filter(|own| of_the_signal(&search.adopted[*own])).collect()
}

struct Parts<'a> {
    scene: &'a Scene,
    views: &'a Views,
    taken: TakenOf,
    rest: Vec<Adopted>,
}

impl Parts<'_> {
    fn take(&mut self, candidate: &Candidate, verdict: &Verdict) {
        let lines = candidate.places.iter().zip(&verdict.score.of_places);
        self.taken[0].extend(lines.filter(|(_, ln)| **ln > 0.0).map(|(place, _)| place.order));
    }

    fn judge(&self, part: &Candidate, taken: &TakenOf) -> Verdict {
        accept::judge(part, &self.views.field(taken, Domain::Orders, 0..self.scene.searched))
    }

    /// Further orders of the shafts and further harmonics of the bases, until no more of them pass.
    fn rounds(&mut self, search: &mut Search) {
        for _ in 0..ROUNDS {
            let shafts = Shaft::PAIR_SHAFTS.map(|shaft| self.orders(search, shaft));
            let bases = bases(search).into_iter().map(|own| self.harmonics(search, own)).collect::<Vec<bool>>();
            if !shafts.into_iter().chain(bases).any(|passed| passed) {
                break;
            }
        }
    }

    /// Asks for the further orders of a shaft; whether they are let pass now.
    fn orders(&mut self, search: &Search, shaft: Shaft) -> bool {
        let Some(candidate) = remaining_shaft_orders::candidate(search, self.scene, self.views, shaft) else {
            return false;
        };
        let is_same = |own: &Adopted| own.candidate.kind == candidate.kind;
        if self.rest.iter().any(|own| is_same(own) && own.verdict.refused.is_none()) {
            return false;
        }
        let verdict = self.judge(&candidate, &self.taken);
        if verdict.score.readings == 0 {
            return false;
        }
        let passed = verdict.refused.is_none();
        if passed {
            self.take(&candidate, &verdict);
        }
        self.rest.retain(|own| !is_same(own));
        self.rest.push(remaining_shaft_orders::part(candidate, verdict));
        passed
    }

    /// Asks for the further harmonics of a base; whether they are let pass now.
    fn harmonics(&mut self, search: &mut Search, own: usize) -> bool {
        let found = &mut search.adopted[own];
        if found.carries.iter().any(|carries| carries.words == HARMONICS_TEXT) {
            return false;
        }
        let Some(part) = carried::further_harmonics(self.scene, &found.candidate) else { return false };
        let verdict = self.judge(&part, &self.taken);
        let passed = verdict.refused.is_none();
        if passed {
            self.take(&part, &verdict);
            add(found, part, verdict, HARMONICS_TEXT.into());
        }
        passed
    }

    /// Sidebands of the shafts and of the slower bases about a base's lines.
    fn sidebands(&mut self, search: &mut Search, own: usize) {
        let others = search.adopted.iter().filter(|a| a.candidate.is_base()).map(|a| a.candidate.base);
        let others: Vec<f64> = others.collect();
        let modulators = carried::modulators(self.scene, &others, search.adopted[own].candidate.base);
        for modulator in &modulators {
            let found = &search.adopted[own];
            let Some((verdict, shape)) = self.best_shape(found, modulator, &modulators) else { continue };
            self.take(&shape, &verdict);
            add(&mut search.adopted[own], shape, verdict, format!("modulated by {}", modulator.word));
        }
    }

    /// The shape of a modulator's sidebands that the gate lets pass with most evidence.
    fn best_shape(&self, found: &Adopted, modulator: &Modulator, all: &[Modulator]) -> Option<(Verdict, Candidate)> {
        let carriers: Vec<&Place> = found.standing().collect();
        let shapes = carried::candidates(self.scene, &found.candidate, &carriers, modulator);
        let others = all.iter().filter(|other| other.order != modulator.order);
        let theirs = others.flat_map(|other| carried::candidates(self.scene, &found.candidate, &carriers, other).pop());
        let mut excluded = self.taken.clone();
        excluded[0].extend(not_shared(theirs, shapes.last(), self.scene.resolution()));
        let judged = shapes.into_iter().map(|shape| (self.judge(&shape, &excluded), shape));
        let passed = judged.filter(|(verdict, _)| verdict.refused.is_none());
        passed.max_by(|a, b| a.0.ln_bayes.total_cmp(&b.0.ln_bayes))
    }
}

/// Orders of other modulators' sidebands that this one's widest shape has not: nothing is read there, neither the
/// sidebands nor their surrogates, because lines of two modulators close together would make each the other's null.
fn not_shared(theirs: impl Iterator<Item = Candidate>, own: Option<&Candidate>, apart: f64) -> Vec<f64> {
    let mut shared = Taken::default();
    shared.extend(own.iter().flat_map(|own| own.places.iter().map(|place| place.order)));
    theirs.flat_map(|c| c.places).map(|place| place.order).filter(|order| !shared.near(*order, apart)).collect()
}

fn add(adopted: &mut Adopted, part: Candidate, verdict: Verdict, words: String) {
    adopted.candidate.places.extend(part.places);
    adopted.verdict.score.of_places.extend(&verdict.score.of_places);
    adopted.carries.push(Carries { words, verdict });
}
