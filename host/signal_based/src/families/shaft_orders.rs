//! Additive shaft orders: the first few orders of a shaft, far below the mesh.
//!
//! Unknowns: one complex amplitude per order. What decides: low orders without sidebands about the mesh. Imbalance, a
//! bent shaft, misalignment of a coupling and a torque of the drive have them alike; one path per channel cannot
//! tell. A gear's order on a whole order of the pinion is left to the pinion.

use super::Context;
use crate::candidate::{Candidate, Domain, Kind, Place, Shaft};

/// Orders, nested shapes.
const SHAPES: [usize; 3] = [1, 2, 4];
/// Share of the mesh order up to which an order is low.
const LOW_ORDER_SHARE: f64 = 0.4;

/// Low orders of either shaft.
pub fn candidates(context: &Context) -> Vec<Candidate> {
    let shaped = |shaft: Shaft| SHAPES.into_iter().map(move |most| candidate(context, shaft, most));
    Shaft::PAIR_SHAFTS.into_iter().flat_map(shaped).filter(|c| !c.places.is_empty()).collect()
}

/// Orders of one shaft up to number `most`.
pub fn candidate(context: &Context, shaft: Shaft, most: usize) -> Candidate {
    let own = context.scene.shaft_order(shaft as usize);
    let place =
        |n: usize| Place { order: n as f64 * own, spacing: n as f64 * own, label: format!("{n} {}", shaft.word()) };
    let fits = |p: &Place| {
        p.order < LOW_ORDER_SHARE * context.scene.mesh_order() && !(shaft == Shaft::Gear && context.on_pinion(p.order))
    };
    Candidate {
        kind: Kind::ShaftOrders(shaft),
        base: own,
        domain: Domain::Orders,
        places: (1..=most).map(place).filter(fits).collect(),
        locked: true,
        alternatives: SHAPES.len() as f64,
    }
}
