//! Whether a pattern of a train's gear is one tooth: the signal folded at the family's own rate, less the mesh and
//! low orders, on fitted and held-out turns.
//!
//! The fold has `POINTS` places per period; what other parts of the train leave falls with the number of periods.
//! Limit: a set's gears are folded at one rate, without windows for single planets.

use super::tooth::{Pulse, add_normalised};
use crate::candidate::{Candidate, Kind};
use crate::scene::Scene;
use crate::split::{Split, Stretch};
use crate::train::families::What;
use realfft::RealFftPlanner;

/// Places of a fold.
const POINTS: usize = 2048;
/// Low orders of the rate, and orders beside a mesh harmonic, that are no tooth's.
const LOW_ORDERS: usize = 2;
const MESH_SIDE_ORDERS: i64 = 1;

/// The pulse of a pattern, where it is one tooth's: the same or a neighbour on the turns not fitted.
pub fn is_single(scene: &Scene, candidate: &Candidate) -> Option<Pulse> {
    let (Kind::Train(own), Some(gearing)) = (candidate.kind, &scene.gearing) else { return None };
    if gearing.family(own).what != What::Local {
        return None;
    }
    let pitches = (gearing.mesh_of(own) / candidate.base).round().max(1.0) as usize;
    let of = |stretches: &dyn Fn(&Split) -> Vec<Stretch>| pulse(scene, candidate.base, pitches, stretches);
    of(&|split| split.fit.clone())?.on_one_tooth(pitches, || of(&|split| split.held_out.clone()))
}

fn pulse(scene: &Scene, base: f64, pitches: usize, stretches: &dyn Fn(&Split) -> Vec<Stretch>) -> Option<Pulse> {
    let mut energy = vec![0.0; pitches];
    for run in &scene.runs {
        for samples in &run.samples {
            let per_turn = run.angle.per_turn[0];
            let (mut sums, mut counts) = (vec![0.0; POINTS], vec![0usize; POINTS]);
            for stretch in stretches(&run.split) {
                for (i, x) in samples[stretch.samples(per_turn)].iter().enumerate() {
                    let turns = run.angle.from_turn + stretch.from as f64 + i as f64 / per_turn as f64;
                    let place = ((turns * base).rem_euclid(1.0) * POINTS as f64) as usize % POINTS;
                    sums[place] += x;
                    counts[place] += 1;
                }
            }
            if counts.contains(&0) {
                continue;
            }
            let mean: Vec<f64> = sums.iter().zip(&counts).map(|(sum, count)| sum / *count as f64).collect();
            add_normalised(&mut energy, &difference(&mean, pitches));
        }
    }
    Pulse::of(&energy)
}

/// A fold without low orders, mesh harmonics and what stands beside them.
fn difference(fold: &[f64], pitches: usize) -> Vec<f64> {
    let mut planner = RealFftPlanner::new();
    let forward = planner.plan_fft_forward(fold.len());
    let (mut input, mut bins) = (fold.to_vec(), forward.make_output_vec());
    forward.process(&mut input, &mut bins).expect("buffers have the planned lengths");
    for (i, bin) in bins.iter_mut().enumerate() {
        let k = (i as f64 / pitches as f64).round() as i64;
        if i <= LOW_ORDERS || (i as i64 - k * pitches as i64).abs() <= MESH_SIDE_ORDERS && k > 0 {
            *bin = Default::default();
        }
    }
    let mut out = vec![0.0; fold.len()];
    planner.plan_fft_inverse(fold.len()).process(&mut bins, &mut out).expect("buffers have the planned lengths");
    out
}
