//! Mesh lines followed turn by turn: what families are searched in in a run-up, and what envelopes are of.
//!
//! A path turns and swells every mesh line as a run-up sweeps it through resonances. The calibrated model, which must
//! predict turns not used, leaves several times the noise of it, beside the mesh lines, where sidebands stand. For a
//! search nothing need be predicted: each line's amplitude is followed by a moving average over two turns of the
//! slower shaft (triangular: its response vanishes at every whole order of that shaft, so no sideband of it is
//! touched; of the other shaft 2 % at most), applied twice for lines that turn within it, and taken off. Order
//! spectra only in run-ups: where the speed is steady, swings and cages stand as near to the mesh lines as this
//! reaches. Envelopes always: they are of what knocks, in wide bands, and a mesh line that swings fills them. The
//! average reaches into the gap before held-out turns, not beyond it, but for the half that the second round adds; it
//! takes the mesh off and adds nothing.

use super::baseline::Grids;
use super::scene::{Scene, SceneRun};
use rayon::prelude::*;
use rustfft::num_complex::Complex64;
use std::f64::consts::TAU;

/// Rounds: what is left of a slow change falls with its square.
const ROUNDS: usize = 2;

/// What a model leaves, less what mesh lines have of it that moves slowly; a rig without gears has no mesh.
pub fn followed(scene: &Scene, left: &Grids) -> Grids {
    let of_run = |(run, channels): (&SceneRun, &Vec<Vec<f64>>)| -> Vec<Vec<f64>> {
        if scene.teeth[0] == 1 {
            return channels.clone();
        }
        channels.par_iter().map(|samples| without_mesh(scene, run, samples)).collect()
    };
    scene.runs.iter().zip(left).map(of_run).collect()
}

/// In run-ups what is left of followed lines, otherwise what the model leaves.
pub fn followed_in_run_ups(scene: &Scene, left: &Grids, followed: &Grids) -> Grids {
    let of_run = |r: usize| if scene.runs[r].runs_up() { followed[r].clone() } else { left[r].clone() };
    (0..scene.runs.len()).map(of_run).collect()
}

fn without_mesh(scene: &Scene, run: &SceneRun, samples: &[f64]) -> Vec<f64> {
    let per_turn = run.angle.per_turn[0];
    let length = (per_turn as f64 / scene.gear_order.min(1.0)).round() as usize;
    if let Some(gearing) = &scene.gearing {
        return without_lines(&gearing.fitted, per_turn, length, samples);
    }
    let turn: Vec<Complex64> =
        (0..per_turn).map(|i| Complex64::from_polar(1.0, TAU * i as f64 / per_turn as f64)).collect();
    let mut left = samples.to_vec();
    let z = scene.teeth[0] as usize;
    for order in (1..).map(|k| k * z).take_while(|order| (*order as f64) < scene.highest_order) {
        for _ in 0..ROUNDS {
            // Whole orders: phases repeat with the turn.
            let phase = |i: usize| turn[order * (i % per_turn) % per_turn];
            let turned: Vec<Complex64> = left.iter().enumerate().map(|(i, x)| phase(i).conj() * *x).collect();
            let slow = averaged(&averaged(&turned, length), length);
            left.iter_mut().zip(&slow).enumerate().for_each(|(i, (x, a))| *x -= 2.0 * (a * phase(i)).re);
        }
    }
    left
}

/// The same of lines at any order: phases are turned sample by sample, anew every turn.
fn without_lines(orders: &[f64], per_turn: usize, length: usize, samples: &[f64]) -> Vec<f64> {
    let mut left = samples.to_vec();
    for order in orders {
        let step = Complex64::from_polar(1.0, TAU * order / per_turn as f64);
        let turning: Vec<Complex64> = (0..samples.len().div_ceil(per_turn))
            .flat_map(|turn| {
                let mut phase = Complex64::from_polar(1.0, TAU * (order * turn as f64).fract());
                (0..per_turn).map(move |_| {
                    let now = phase;
                    phase *= step;
                    now
                })
            })
            .collect();
        for _ in 0..ROUNDS {
            let turned: Vec<Complex64> = left.iter().zip(&turning).map(|(x, phase)| phase.conj() * *x).collect();
            let slow = averaged(&averaged(&turned, length), length);
            left.iter_mut().zip(&slow).zip(&turning).for_each(|((x, a), phase)| *x -= 2.0 * (a * phase).re);
        }
    }
    left
}

/// Moving average over `length` values about each; over those that there are at the ends.
fn averaged(values: &[Complex64], length: usize) -> Vec<Complex64> {
    let mut sums = Vec::with_capacity(values.len() + 1);
    let mut sum = Complex64::default();
    sums.push(sum);
    for value in values {
        sum += value;
        sums.push(sum);
    }
    let (before, after) = (length / 2, length - length / 2);
    let mean = |i: usize| {
        let (from, to) = (i.saturating_sub(before), (i + after).min(values.len()));
        (sums[to] - sums[from]) / (to - from).max(1) as f64
    };
    (0..values.len()).map(mean).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn averages_take_whole_orders_off_and_keep_constants() {
        let line = |i: usize, order: f64| Complex64::from_polar(1.0, TAU * order * i as f64 / 100.0);
        let kept = averaged(&(0..1000).map(|i| line(i, 0.0)).collect::<Vec<_>>(), 100);
        assert!(kept.iter().all(|a| (a - 1.0).norm() < 1e-12));
        let gone = averaged(&(0..1000).map(|i| line(i, 3.0)).collect::<Vec<_>>(), 100);
        assert!(gone[50..950].iter().all(|a| a.norm() < 1e-12));
    }
}
