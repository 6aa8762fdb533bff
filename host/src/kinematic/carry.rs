//! Which sidebands the orders of neither shaft carry: asked once the search has ended, when carriers and spacings are known.
//!
//! After the search, because what a family's base explains of other bases is decided without them. A modulator takes the shape (one, two or four sidebands on each
//! side) that the gate lets pass with most evidence; lines once taken are not taken again.

use super::accept::{self, Verdict};
use super::candidate::{Candidate, Domain, Place, Taken, TakenOf};
use super::families::carried;
use super::residual::Views;
use super::scene::Scene;
use super::search::{Adopted, Carries, Search, mesh_taken};

/// Sidebands of the shafts and of each other about the orders of neither shaft, each let pass by the gate on its own: the spacing is known, so
/// what is moved for the null is the sideband, not its carrier.
pub fn carry(search: &mut Search, scene: &Scene, views: &Views) {
    let mut taken: TakenOf = mesh_taken(scene, views);
    for own in search.adopted.iter().filter(|a| a.candidate.domain == Domain::Orders) {
        taken[0].extend(standing_orders(own));
    }
    for own in 0..search.adopted.len() {
        let found = &search.adopted[own];
        if !found.candidate.is_base() || found.candidate.domain != Domain::Orders {
            continue;
        }
        let others = search.adopted.iter().filter(|a| a.candidate.is_base()).map(|a| a.candidate.base);
        let modulators = carried::modulators(scene, &others.collect::<Vec<f64>>(), found.candidate.base);
        for modulator in &modulators {
            let found = &search.adopted[own];
            let lines = found.candidate.places.iter().zip(&found.verdict.score.of_places);
            let standing: Vec<&Place> = lines.filter(|(_, ln)| **ln > 0.0).map(|(place, _)| place).collect();
            let shapes = carried::candidates(scene, &found.candidate, &standing, modulator);
            let others = modulators.iter().filter(|other| other.order != modulator.order);
            let theirs = others.flat_map(|other| carried::candidates(scene, &found.candidate, &standing, other).pop());
            let beside = not_shared(theirs, shapes.last(), scene.resolution());
            let mut spoken_for = taken.clone();
            spoken_for[0].extend(beside);
            let judged = shapes.into_iter().map(|shape| {
                let field = views.field(&spoken_for, Domain::Orders, 0..scene.searched);
                (accept::judge(&shape, &field), shape)
            });
            let passed = judged.filter(|(verdict, _)| verdict.refused.is_none());
            let Some((verdict, shape)) = passed.max_by(|a, b| a.0.ln_bayes.total_cmp(&b.0.ln_bayes)) else {
                continue;
            };
            let stands = shape.places.iter().zip(&verdict.score.of_places).filter(|(_, ln)| **ln > 0.0);
            taken[0].extend(stands.map(|(place, _)| place.order));
            add(&mut search.adopted[own], shape, verdict, modulator.word.clone());
        }
    }
}

/// Orders of other modulators' sidebands that this one's widest shape has not: nothing is read there, neither the sidebands nor their moved
/// copies, because lines of two modulators close together would make each the other's null.
fn not_shared(theirs: impl Iterator<Item = Candidate>, own: Option<&Candidate>, apart: f64) -> Vec<f64> {
    let mut shared = Taken::default();
    shared.extend(own.iter().flat_map(|own| own.places.iter().map(|place| place.order)));
    theirs.flat_map(|c| c.places).map(|place| place.order).filter(|order| !shared.near(*order, apart)).collect()
}

fn add(adopted: &mut Adopted, sidebands: Candidate, verdict: Verdict, modulator: String) {
    adopted.candidate.places.extend(sidebands.places);
    adopted.verdict.score.of_places.extend(&verdict.score.of_places);
    adopted.carries.push(Carries { modulator, verdict });
}

/// Orders of a family's lines that stand.
fn standing_orders(adopted: &Adopted) -> impl Iterator<Item = f64> {
    let lines = adopted.candidate.places.iter().zip(&adopted.verdict.score.of_places);
    lines.filter(|(_, ln)| **ln > 0.0).map(|(place, _)| place.order)
}
