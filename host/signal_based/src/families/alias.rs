//! Mesh harmonics beyond half the sampling rate, folded: no filter stands before the converter.
//!
//! At the instants of sampling a folded harmonic still has the phase `k z1` turns of the pinion; multiplied by twice
//! the cosine of the sampling frequency's own phase and read at equal angles (`residual_spectra`), it stands at its
//! true order again, while everything else of the record is smeared there. Unknowns: one amplitude per harmonic. What
//! decides: whole mesh orders in that spectrum and nothing beside them. Orders between 0.62 and 0.97 of the rate over
//! the speed are looked at, in a run-up each stretch's own. Limit: where the speed hardly moves, a folded line may
//! stand on an order by chance and be taken for one of neither shaft first; and harmonics that fold beside mesh lines
//! are not looked at there.

use super::{Context, clipping};
use crate::candidate::{Candidate, Domain, Kind, Place};
use crate::line_axis;
use crate::scene::SceneRun;

/// All folded harmonics that the spectrum reaches; none where a channel is limited, since that makes harmonics behind
/// any filter.
pub fn candidates(context: &Context) -> Vec<Candidate> {
    if !clipping::limited(context.scene).is_empty() {
        return Vec::new();
    }
    let (spectra, z) = (context.folded, context.scene.mesh_order());
    let (first, last) = ((spectra.lowest / z).ceil() as usize, (spectra.highest / z) as usize);
    let place = |k: usize| Place { order: k as f64 * z, spacing: z, label: format!("{k} mesh, folded") };
    let places: Vec<Place> = (first.max(1)..=last).filter(|k| !meets_the_mesh(context, *k)).map(place).collect();
    let candidate =
        Candidate { kind: Kind::Alias, base: z, domain: Domain::Folded, places, locked: false, alternatives: 1.0 };
    Some(candidate).filter(|c| !c.places.is_empty()).into_iter().collect()
}

/// Whether a folded harmonic falls beside a mesh harmonic that is not, nearer than the slower shaft's sidebands, in a
/// run whose speed hardly moves: where the rate is nearly a multiple of the mesh frequency, all of them do, and what
/// a wandering speed leaves of the mesh lines looks folded. Where it moves, the rate's own order does, and no mesh
/// line is sharp beside it.
fn meets_the_mesh(context: &Context, k: usize) -> bool {
    let (z, beside) = (context.scene.mesh_order(), context.scene.gear_order.min(1.0));
    let hardly_moves = |run: &&SceneRun| {
        !line_axis::is_smeared(run.usual_speeds_hz().map(|hz| run.rate_hz / hz), context.folded.bin(0))
    };
    context.scene.runs.iter().filter(hardly_moves).any(|run| {
        let speed = run.angle.speed;
        let folded = |hz: f64| (run.rate_hz - k as f64 * z * hz).abs();
        let (a, b) = (folded(speed.slowest_hz), folded(speed.fastest_hz));
        let (low, high) = (a.min(b), a.max(b));
        let harmonics = (context.orders.highest / z).ceil() as usize;
        (1..=harmonics)
            .map(|j| j as f64 * z)
            .any(|order| high > (order - beside) * speed.slowest_hz && low < (order + beside) * speed.fastest_hz)
    })
}
