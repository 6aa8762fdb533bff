//! Orders and frequencies that are spoken for: the mesh's own, and where a line of one view stands in another.
//!
//! Neither a family nor a surrogate of one reads there. A speed that moves spreads an order over frequencies and a
//! frequency over orders: all of them are taken.

use super::candidate::{Domain, Taken, TakenOf};
use super::line_axis;
use super::residual_spectra::Views;
use super::scene::{Scene, SceneRun};

/// The mesh itself is spoken for.
pub fn mesh_taken(scene: &Scene, views: &Views) -> TakenOf {
    let mut taken: TakenOf = Default::default();
    let lines = scene.mesh_lines();
    taken[0].extend(lines.iter().copied());
    for order in lines {
        let is_line = |run: &SceneRun| {
            let swept = run.usual_speeds_hz().map(|hz| order * hz);
            !line_axis::is_smeared(swept, views.frequency.bin(0))
        };
        if scene.runs.iter().any(is_line) {
            take_frequencies(&mut taken[Domain::Frequency as usize], scene, views, order);
        }
    }
    taken
}

/// Takes the frequencies that an order sweeps.
pub fn take_frequencies(taken: &mut Taken, scene: &Scene, views: &Views, order: f64) {
    let bin = views.frequency.bin(0);
    for run in &scene.runs {
        let (low, high) = (order * run.angle.speed.slowest_hz, order * run.angle.speed.fastest_hz);
        taken.extend((0..=((high - low) / bin) as usize + 1).map(|i| low + i as f64 * bin));
    }
}

/// Multiples of a base with sidebands of both shafts, alone and about the first mesh harmonics.
pub fn relatives(base: f64, scene: &Scene) -> impl Iterator<Item = f64> {
    let (z, gear) = (scene.mesh_order(), scene.gear_order);
    let sidebands = move |order: f64| [0.0, 1.0, -1.0, gear, -gear].map(|own| (order + own).abs());
    let about =
        move |j: i32| (0..=6).flat_map(move |k| [1.0, -1.0].map(|side| f64::from(k) * z + side * f64::from(j) * base));
    (1..=5).flat_map(about).flat_map(sidebands).filter(|order| *order > 0.0)
}

/// Takes the orders over which the speed spreads a frequency.
pub fn take_orders(taken: &mut Taken, scene: &Scene, views: &Views, hz: f64) {
    let bin = views.orders.bin(0);
    for run in &scene.runs {
        let (low, high) = (hz / run.angle.speed.fastest_hz, hz / run.angle.speed.slowest_hz);
        taken.extend((0..=((high - low) / bin) as usize + 1).map(|i| low + i as f64 * bin));
    }
}

/// Takes the orders and frequencies that a folded order sweeps.
pub fn take_folded(taken: &mut TakenOf, scene: &Scene, views: &Views, order: f64) {
    for run in &scene.runs {
        let folded = |hz: f64| (run.rate_hz - order * hz).abs();
        let speed = run.angle.speed;
        let (a, b) = (folded(speed.slowest_hz), folded(speed.fastest_hz));
        let (low, high) = (a.min(b), a.max(b));
        let steps =
            |from: f64, to: f64, bin: f64| (0..=((to - from) / bin) as usize + 1).map(move |i| from + i as f64 * bin);
        taken[Domain::Frequency as usize].extend(steps(low, high, views.frequency.bin(0)));
        taken[0].extend(steps(low / speed.fastest_hz, high / speed.slowest_hz, views.orders.bin(0)));
    }
}
