//! What an order of neither shaft has besides the lines that it was found by: further harmonics, and sidebands of the
//! shafts or of its own cage.
//!
//! *Further harmonics*: `k z1 +- j o` beyond the middle between two mesh harmonics, about all of them. The search
//! leaves them out, because there every base has a line near every other one; with the base known they have no
//! unknown but their amplitudes.
//!
//! *Sidebands*: a passage about the mesh is itself modulated by whatever turns: `k z1 +- j o + n o_s`, and with the
//! cage `k z1 +- j o + n c`. Unknowns: none but the amplitudes, because carriers and spacing have been found before.
//! What decides: lines at that spacing about many carriers; the gate moves the sidebands about the carriers as they
//! are. On few turns close spacings fall together and are told no more. Phases follow no shaft (the carrier slips):
//! power is predicted.

use crate::candidate::{Candidate, Domain, Place, Shaft, Taken};
use crate::scene::Scene;

/// Sidebands on each side, nested shapes.
const SHAPES: [i32; 3] = [1, 2, 4];
/// Share of a carrier's spacing that a modulator may be at most: a wider one is no sideband of it.
const MAX_MODULATOR_SHARE: f64 = 0.5;

/// What modulates.
#[derive(Debug, Clone)]
pub struct Modulator {
    /// Its order of the pinion.
    pub order: f64,
    /// In words.
    pub word: String,
}

/// Both shafts, and the other orders found that are slower than the carrier's.
pub fn modulators(scene: &Scene, others: &[f64], carrier: f64) -> Vec<Modulator> {
    let shaft = |shaft: Shaft| Modulator { order: scene.shaft_order(shaft as usize), word: shaft.word().to_owned() };
    let mut all: Vec<Modulator> = scene.shafts().iter().map(|own| shaft(*own)).collect();
    all.extend(others.iter().map(|&order| Modulator { order, word: format!("order {order:.4}") }));
    all.retain(|modulator| modulator.order < MAX_MODULATOR_SHARE * carrier);
    all
}

/// Harmonics of a base alone and about all mesh harmonics.
const HARMONICS: usize = 8;

/// `k z1 +- j o` and `j o` that the family has not; none where it has them all.
pub fn further_harmonics(scene: &Scene, found: &Candidate) -> Option<Candidate> {
    let z = scene.mesh_order();
    let mut places: Vec<Place> = Vec::new();
    for k in 0..=(scene.highest_order / z) as usize + 1 {
        for (j, side) in (1..=HARMONICS).flat_map(|j| [(j, -1.0), (j, 1.0)]) {
            let spacing = side * j as f64 * found.base;
            let label = match (k, side < 0.0) {
                (0, _) => format!("{j} o"),
                (_, true) => format!("{k} mesh - {j} o"),
                (_, false) => format!("{k} mesh + {j} o"),
            };
            places.push(Place { order: k as f64 * z + spacing, spacing, label });
        }
    }
    let mut own = Taken::default();
    own.extend(found.places.iter().map(|place| place.order));
    places.retain(|place| !own.near(place.order, scene.resolution()));
    let further = of_neither_shaft(scene, found, places, 1.0);
    (further.places.len() > 1).then_some(further)
}

/// Sidebands of a modulator about the lines that stand, one to four on each side.
pub fn candidates(scene: &Scene, found: &Candidate, standing: &[&Place], modulator: &Modulator) -> Vec<Candidate> {
    let shaped = |most: i32| candidate(scene, found, standing, modulator, most);
    SHAPES.into_iter().map(shaped).filter(|c| c.places.len() > 1).collect()
}

fn candidate(scene: &Scene, found: &Candidate, standing: &[&Place], modulator: &Modulator, most: i32) -> Candidate {
    let mut places: Vec<Place> = Vec::new();
    for carrier in standing {
        for n in (-most..=most).filter(|n| *n != 0) {
            let spacing = f64::from(n) * modulator.order;
            let sign = if n < 0 { "-" } else { "+" };
            let label = format!("{} {sign} {} {}", carrier.label, n.abs(), modulator.word);
            places.push(Place { order: carrier.order + spacing, spacing, label });
        }
    }
    of_neither_shaft(scene, found, places, SHAPES.len() as f64)
}

/// A part of a family at the places that the record holds and that no shaft has.
fn of_neither_shaft(scene: &Scene, found: &Candidate, mut places: Vec<Place>, alternatives: f64) -> Candidate {
    let apart = scene.resolution();
    let own = scene.gear_order;
    let of_shaft = |order: f64| {
        if let Some(gearing) = &scene.gearing {
            return gearing.owned.at(order, apart);
        }
        (order - order.round()).abs() <= apart || (order - (order / own).round() * own).abs() <= apart.min(0.2 * own)
    };
    places.retain(|p| p.order > 0.0 && p.order < scene.highest_order && !of_shaft(p.order));
    places.sort_by(|a, b| a.order.total_cmp(&b.order));
    // Two carriers may share a sideband: it is one line.
    places.dedup_by(|a, b| a.order - b.order < apart);
    Candidate { kind: found.kind, base: found.base, domain: Domain::Orders, places, locked: false, alternatives }
}
