//! Modulation of the mesh by a shaft: sidebands `k z1 +- n o_s` of several mesh harmonics.
//!
//! Unknowns: one complex amplitude per sideband. What decides: sidebands of one shaft about several harmonics; how
//! far out they stand (runout is the first, a shape of the pitch more). Eccentricity, a bent shaft, misalignment and
//! a torque that turns with the shaft have the same lines behind an unknown path: names stay in question. A sideband
//! of the gear on a whole order of the pinion is left to the pinion.

use super::Context;
use crate::candidate::{Candidate, Domain, Kind, Place, Shaft};

/// Sidebands on each side, nested shapes.
const SHAPES: [usize; 4] = [1, 2, 3, 5];

/// Sidebands of either shaft, one to five on each side.
pub fn candidates(context: &Context) -> Vec<Candidate> {
    let shaped = |shaft: Shaft| SHAPES.into_iter().map(move |most| candidate(context, shaft, most));
    Shaft::PAIR_SHAFTS.into_iter().flat_map(shaped).filter(|c| !c.places.is_empty()).collect()
}

/// Sidebands of one shaft up to number `most`.
pub fn candidate(context: &Context, shaft: Shaft, most: usize) -> Candidate {
    let scene = context.scene;
    let (z, own) = (scene.mesh_order(), scene.shaft_order(shaft as usize));
    let mut places = Vec::new();
    for k in 1..=(scene.highest_order / z) as usize {
        for n in 1..=most {
            for side in [-1.0, 1.0] {
                let order = k as f64 * z + side * n as f64 * own;
                if shaft == Shaft::Gear && context.on_pinion(order) {
                    continue;
                }
                let sign = if side < 0.0 { "-" } else { "+" };
                let label = format!("{k} mesh {sign} {n} {}", shaft.word());
                places.push(Place { order, spacing: side * n as f64 * own, label });
            }
        }
    }
    Candidate {
        kind: Kind::Modulation(shaft),
        base: own,
        domain: Domain::Orders,
        places,
        locked: true,
        alternatives: SHAPES.len() as f64,
    }
}
