//! Ghost order: one whole order of a shaft that is no multiple of its teeth.
//!
//! What a machine tool leaves on the flanks: a line at the number of teeth of its worm wheel, locked to the gear.
//! Unknowns: which order (all are tried and paid for), one amplitude. What decides: one order, locked, no sidebands
//! of its own about the mesh. Orders next to a mesh harmonic are sidebands of the shaft, low ones its orders.

use super::Context;
use crate::candidate::{Candidate, Domain, Kind, Place, Shaft};

/// Orders of the shaft next to a mesh harmonic that are its sidebands.
const MESH_SIDEBAND_ORDERS: f64 = 5.5;
/// Lowest order of a shaft that is a ghost.
const MIN_GHOST_ORDER: f64 = 5.5;

/// Every whole order of either shaft that is neither the mesh nor beside it.
pub fn candidates(context: &Context) -> Vec<Candidate> {
    let all: Vec<Candidate> = Shaft::PAIR_SHAFTS.into_iter().flat_map(|shaft| of_shaft(context, shaft)).collect();
    let alternatives = all.len() as f64;
    all.into_iter().map(|c| Candidate { alternatives, ..c }).collect()
}

fn of_shaft(context: &Context, shaft: Shaft) -> Vec<Candidate> {
    let scene = context.scene;
    let (z, own) = (scene.mesh_order(), scene.shaft_order(shaft as usize));
    let beside_mesh = |order: f64| {
        let k = (order / z).round();
        k >= 1.0 && (order - k * z).abs() < MESH_SIDEBAND_ORDERS * own
    };
    let fits = |order: &f64| !(beside_mesh(*order) || shaft == Shaft::Gear && context.on_pinion(*order));
    (1..=(scene.highest_order / own) as usize)
        .map(|n| (n, n as f64 * own))
        .filter(|(n, order)| *n as f64 > MIN_GHOST_ORDER && fits(order))
        .map(|(n, order)| Candidate {
            kind: Kind::Ghost,
            base: order,
            domain: Domain::Orders,
            places: vec![Place { order, spacing: own, label: format!("{n} {}", shaft.word()) }],
            locked: true,
            alternatives: 1.0,
        })
        .collect()
}
