//! Coloured noise: white noise shaped in the frequency domain, so that its power falls as `1 / f^slope` over the
//! whole band.

use crate::spectral::shaped;
use rand_chacha::ChaCha12Rng;
use rand_distr::{Distribution, StandardNormal};

/// Below this frequency the power stays level: drifts of a second are no vibration, Hz.
const LEVEL_BELOW_HZ: f64 = 1.0;

/// Adds noise of this root mean square and slope to a signal.
pub fn add(signal: &mut [f64], rate_hz: f64, rms: f64, slope: f64, random: &mut ChaCha12Rng) {
    if rms == 0.0 || signal.is_empty() {
        return;
    }
    let mut noise: Vec<f64> = StandardNormal.sample_iter(random).take(signal.len()).collect();
    if slope > 0.0 {
        shape(&mut noise, rate_hz, slope);
    }
    let own = (noise.iter().map(|x| x * x).sum::<f64>() / noise.len() as f64).sqrt().max(f64::MIN_POSITIVE);
    signal.iter_mut().zip(&noise).for_each(|(x, n)| *x += rms / own * n);
}

fn shape(noise: &mut [f64], rate_hz: f64, slope: f64) {
    let total = noise.len() as f64;
    shaped(noise, |bin| match bin {
        0 => 0.0,
        bin => (bin as f64 * rate_hz / total).max(LEVEL_BELOW_HZ).powf(-0.5 * slope),
    });
}
