//! A slow swing of everything: sidebands closer to every mesh harmonic than either shaft's.
//!
//! Bases are a grid of distances between the resolution and the slower shaft's order; each is paid for. What decides: the same distance about several harmonics, both
//! sides; and that it stands on all turns at once ([`all_turns`](crate::kinematic::all_turns)). Whether strength or speed swings: what a tach follows is no swing of the angle any more, so what is left is mostly strength (load), or a swing faster than the tach resolves.
//! Phases follow neither shaft: power is predicted. Limit: what is slower than the resolution belongs to the calibrated amplitudes.

use super::Context;
use crate::kinematic::candidate::{Candidate, Domain, Kind, Place};
use crate::kinematic::scene::SceneRun;

/// Mesh harmonics.
const MESH: usize = 8;
/// Grid of bases, share of a main lobe.
const STEP: f64 = 0.125;
/// Least and largest distance: main lobes, share of the slower shaft's order.
const RANGE: (f64, f64) = (1.25, 0.85);

/// Every slow distance; none in a run-up, where the mesh lines' own course looks alike.
pub fn candidates(context: &Context) -> Vec<Candidate> {
    if context.scene.runs.iter().any(SceneRun::runs_up) {
        return Vec::new();
    }
    let lobe = context.scene.resolution();
    let highest = RANGE.1 * context.scene.gear_order.min(1.0);
    let steps = ((highest - RANGE.0 * lobe) / (STEP * lobe)).max(0.0) as usize;
    let of_step = |i: usize| candidate(context, (RANGE.0 + STEP * i as f64) * lobe);
    (0..steps).map(of_step).map(|c| Candidate { alternatives: steps as f64, ..c }).collect()
}

/// Sidebands at one distance.
pub fn candidate(context: &Context, base: f64) -> Candidate {
    let z = context.scene.mesh_order();
    let mut places = Vec::new();
    for k in 1..=MESH.min((context.scene.highest_order / z) as usize) {
        for (side, sign) in [(-1.0, "-"), (1.0, "+")] {
            places.push(Place {
                order: k as f64 * z + side * base,
                spacing: side * base,
                label: format!("{k} mesh {sign} swing"),
            });
        }
    }
    Candidate { kind: Kind::Swing, base, domain: Domain::Orders, places, locked: false, alternatives: 1.0 }
}
