//! Backgrounds with nothing in them: the mesh lines as they are, and noise of the record's own colour in place of everything else.
//!
//! What the mesh leaves of every channel keeps the floor of its spectrum over frequency, smoothed over neighbouring bins by a running median, and gets random
//! amplitudes and phases: no line, no locking, no impulse, the same slopes and resonances, in every view that families are read from. Limit: stationary, which a
//! machine's background is not quite.

use crate::analysis::envelope::not_locked;
use crate::kinematic::baseline::{Baseline, Grids};
use crate::kinematic::residual::{self, Views};
use crate::kinematic::scene::Scene;
use crate::spectral::running_median;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;
use realfft::RealFftPlanner;
use rustfft::num_complex::Complex64;

/// Bins between two medians.
const HOP: usize = 32;

/// A record without an effect, and its views.
pub struct Surrogate {
    /// The record.
    pub scene: Scene,
    /// The views of its fitted turns.
    pub views: Views,
}

impl Surrogate {
    /// Of a record, with a seed.
    pub fn new(scene: &Scene, baseline: &Baseline, seed: u64) -> Self {
        let mut surrogate = scene.clone();
        let mut calibrated: Grids = baseline.calibrated.clone();
        for (r, run) in scene.runs.iter().enumerate() {
            let of_channel = |c: usize| {
                let mesh: Vec<f64> =
                    run.samples[c].iter().zip(&baseline.calibrated[r][c]).map(|(x, rest)| x - rest).collect();
                let rest = not_locked(&run.signals[c], run.rate_hz, &mesh, &run.angle);
                let own = seed.wrapping_mul(1_000_003).wrapping_add((r * 64 + c) as u64);
                let noise = noise(&rest, &mut ChaCha8Rng::seed_from_u64(own));
                let changed = run.signals[c].iter().zip(&rest).zip(&noise).map(|((x, rest), noise)| x - rest + noise);
                let signal: Vec<f64> = changed.collect();
                let samples = run.on_grid(&signal, scene.highest_order);
                let left: Vec<f64> = samples.iter().zip(&mesh).map(|(x, mesh)| x - mesh).collect();
                (signal, samples, left)
            };
            let channels: Vec<_> = (0..scene.channels.len()).into_par_iter().map(of_channel).collect();
            let own = &mut surrogate.runs[r];
            for (c, (signal, samples, left)) in channels.into_iter().enumerate() {
                (own.signals[c], own.samples[c], calibrated[r][c]) = (signal, samples, left);
            }
        }
        let views = residual::views(&surrogate, &calibrated, |split| &split.fit, None);
        Self { scene: surrogate, views }
    }
}

/// Noise with the floor of a signal's spectrum.
fn noise(samples: &[f64], random: &mut ChaCha8Rng) -> Vec<f64> {
    let mut planner = RealFftPlanner::new();
    let forward = planner.plan_fft_forward(samples.len());
    let (mut input, mut bins) = (samples.to_vec(), forward.make_output_vec());
    forward.process(&mut input, &mut bins).expect("buffers have the planned lengths");
    let power: Vec<f64> = bins.iter().map(Complex64::norm_sqr).collect();
    // The median of an exponential variable is ln 2 of its mean.
    let floor = running_median(&power, HOP);
    for (bin, floor) in bins.iter_mut().zip(floor) {
        let scale = (0.5 * floor / std::f64::consts::LN_2).sqrt();
        let [re, im]: [f64; 2] = [StandardNormal.sample(random), StandardNormal.sample(random)];
        *bin = Complex64::new(scale * re, scale * im);
    }
    // A real signal has no phase at its ends of the spectrum.
    for end in [0, bins.len() - 1] {
        bins[end].im = 0.0;
    }
    let inverse = planner.plan_fft_inverse(samples.len());
    let mut out = inverse.make_output_vec();
    inverse.process(&mut bins, &mut out).expect("buffers have the planned lengths");
    let length = samples.len() as f64;
    out.iter_mut().for_each(|x| *x /= length);
    out
}
