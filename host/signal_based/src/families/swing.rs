//! A slow swing of everything: how strongly the gears mesh moves at one order, slower than the slower shaft.
//!
//! Looked for in the course of strength ([`Strength`](crate::mesh_amplitude_demodulation::Strength)), common to all
//! mesh lines of a channel; bases are its bins, each is paid for. Its lines in the signal, sidebands at that distance
//! on both sides of every mesh harmonic, are read once it is found. Whether load or speed swings: what a tach follows
//! is no swing of the angle any more, so what is left is mostly the load, or a swing faster than the tach resolves.
//! Phases follow neither shaft: power is predicted. In a run-up orders are frequencies over its mean speed. Limit:
//! fewer than eight swings over the record, ten over a run-up, are a wander's.

use super::Context;
use crate::candidate::{Candidate, Domain, Kind, Place};
use crate::scene::SceneRun;

/// Mesh harmonics.
const MESH: usize = 8;
/// Fewest swings over the record: bins; in a run-up the path leaves more of a wander.
const MIN_SWINGS: f64 = 8.0;
const MIN_RUN_UP_SWINGS: f64 = 10.0;

/// Every slow order.
pub fn candidates(context: &Context) -> Vec<Candidate> {
    let bin = context.strength.bin(0);
    let fewest = if context.scene.runs.iter().any(SceneRun::runs_up) { MIN_RUN_UP_SWINGS } else { MIN_SWINGS };
    let steps = (context.strength.highest / bin - fewest).max(0.0) as usize;
    let of_step = |i: usize| {
        let base = (fewest + i as f64) * bin;
        let places = vec![Place { order: base, spacing: base, label: "swing".into() }];
        let alternatives = steps as f64;
        Candidate { kind: Kind::Swing, base, domain: Domain::Strength, places, locked: false, alternatives }
    };
    (0..steps).map(of_step).collect()
}

/// The lines of a swing in the signal: as orders none in a run-up, where they move.
pub fn lines(context: &Context, swing: &Candidate) -> Candidate {
    let (z, base) = (context.scene.mesh_order(), swing.base);
    let mut places = Vec::new();
    if context.scene.runs.iter().any(SceneRun::runs_up) {
        return Candidate { domain: Domain::Orders, places, ..swing.clone() };
    }
    for k in 1..=MESH.min((context.scene.highest_order / z) as usize) {
        for (side, sign) in [(-1.0, "-"), (1.0, "+")] {
            places.push(Place {
                order: k as f64 * z + side * base,
                spacing: side * base,
                label: format!("{k} mesh {sign} swing"),
            });
        }
    }
    Candidate { domain: Domain::Orders, places, ..swing.clone() }
}
