//! Backgrounds with nothing in them: noise of the record's own colour.
//!
//! Every channel's residual keeps the floor of its spectrum, smoothed over neighbouring bins by a running median, and gets random amplitudes and phases: no line, no
//! locking, the same slopes and resonances. Limit: stationary, which a machine's background is not quite.

use crate::kinematic::baseline::Baseline;
use crate::kinematic::residual::Views;
use crate::kinematic::scene::Scene;
use crate::kinematic::spectra::Spectra;
use crate::spectral::running_median;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;
use realfft::RealFftPlanner;
use rustfft::num_complex::Complex64;

/// Bins between two medians.
const HOP: usize = 32;

/// The views with an order spectrum of noise; the other two are the record's.
pub fn views(scene: &Scene, baseline: &Baseline, views: &Views, seed: u64) -> Views {
    let of_channel = |r: usize, c: usize| {
        let own = seed.wrapping_mul(1_000_003).wrapping_add((r * 64 + c) as u64);
        noise(&baseline.calibrated[r][c], &mut ChaCha8Rng::seed_from_u64(own))
    };
    let grids: Vec<Vec<Vec<f64>>> = (0..scene.runs.len())
        .map(|r| (0..scene.searched).into_par_iter().map(|c| of_channel(r, c)).collect())
        .collect();
    Views {
        orders: Spectra::over_orders(scene, &grids, |r| scene.runs[r].split.fit.clone()),
        envelope: views.envelope.clone(),
        whole_envelope: views.whole_envelope.clone(),
        frequency: views.frequency.clone(),
        folded: views.folded.clone(),
        bands: views.bands.clone(),
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
