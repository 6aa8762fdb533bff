//! Gaussian noise with the floor of a record: its colour, its resonances and what its channels share, but no line of
//! it.
//!
//! The power of every channel is a running median over a width that many lines and sidebands fall into, so neither
//! they nor the skirts that a wandering speed gives them lift it; the median of an exponential variable is ln 2 of
//! its mean; a Hann window keeps the foot of a strong line from lifting all bins between it and the next. Between
//! channels the mean product of bins brought to length one counts every bin alike, so that lines weigh what their few
//! bins do; of Gaussian bins with coherence g its expectation is nearly g pi/4 for small g and 1 at 1 (`coherence`).
//! Drawn are independent complex normal bins, mixed by a Cholesky factor of the matrix of coherences. Limits: what is
//! narrower than the width is flattened; the noise is stationary. Cost: one transform of every channel to prepare,
//! one back for every drawing.

use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use realfft::RealFftPlanner;
use rustfft::num_complex::Complex64;
use std::f64::consts::{FRAC_PI_4, LN_2, PI};

/// Steps of the running medians per width.
const STEPS: usize = 4;
/// What every channel keeps to itself at least, so that the matrix has a factor.
const MIN_OWN_SHARE: f64 = 1e-3;

/// The floors of channels of one length, and what they share.
pub struct Noise {
    samples: usize,
    hop: usize,
    /// By knot and channel: logarithm of the mean power of a bin.
    floors: Vec<Vec<f64>>,
    /// By knot: lower triangular factor of the coherences.
    factors: Vec<Vec<Vec<Complex64>>>,
}

impl Noise {
    /// Of channels over time, smoothed over `width` bins of their whole length.
    pub fn of(channels: &[Vec<f64>], width: usize) -> Self {
        let samples = channels.first().map_or(0, Vec::len);
        let bins: Vec<Vec<Complex64>> = channels.iter().map(|x| transform(&windowed(x))).collect();
        let hop = (width / STEPS).max(1);
        let count = samples / 2 + 1;
        let knots = count.div_ceil(hop) + 1;
        let range = |knot: usize| {
            let centre = (knot * hop).min(count);
            centre.saturating_sub(width / 2)..(centre + width / 2).min(count)
        };
        let floor = |knot: usize| bins.iter().map(|own| median(&own[range(knot)]).ln()).collect();
        let factor = |knot: usize| {
            let parts: Vec<&[Complex64]> = bins.iter().map(|own| &own[range(knot)]).collect();
            factor(&coherences(&parts))
        };
        Self { samples, hop, floors: (0..knots).map(floor).collect(), factors: (0..knots).map(factor).collect() }
    }

    /// Channels drawn anew.
    pub fn drawn(&self, random: &mut ChaCha8Rng) -> Vec<Vec<f64>> {
        let channels = self.floors.first().map_or(0, Vec::len);
        let count = self.samples / 2 + 1;
        let mut bins: Vec<Vec<Complex64>> = (0..channels).map(|_| Vec::with_capacity(count)).collect();
        for i in 0..count {
            let (knot, part) = (i / self.hop, (i % self.hop) as f64 / self.hop as f64);
            let nearest = &self.factors[if part < 0.5 { knot } else { knot + 1 }];
            let own: Vec<Complex64> = (0..channels).map(|_| normal(random)).collect();
            for (c, mixed) in nearest.iter().enumerate() {
                let ln = (1.0 - part) * self.floors[knot][c] + part * self.floors[knot + 1][c];
                let sum: Complex64 = mixed.iter().zip(&own).map(|(l, x)| l * x).sum();
                bins[c].push(sum * (0.5 * ln).exp());
            }
        }
        bins.into_iter().map(|own| self.over_time(own)).collect()
    }

    fn over_time(&self, mut bins: Vec<Complex64>) -> Vec<f64> {
        let inverse = RealFftPlanner::new().plan_fft_inverse(self.samples);
        // A real signal has no phase at the ends of its spectrum.
        if let Some(first) = bins.first_mut() {
            first.im = 0.0;
        }
        if let (Some(last), true) = (bins.last_mut(), self.samples.is_multiple_of(2)) {
            last.im = 0.0;
        }
        let mut out = inverse.make_output_vec();
        inverse.process(&mut bins, &mut out).expect("buffers have the planned lengths");
        out.iter_mut().for_each(|x| *x /= self.samples as f64);
        out
    }
}

/// Through a Hann window that keeps the power of noise.
fn windowed(samples: &[f64]) -> Vec<f64> {
    let scale = (8.0_f64 / 3.0).sqrt();
    let window = |i: usize| scale * (PI * (i as f64 + 0.5) / samples.len() as f64).sin().powi(2);
    samples.iter().enumerate().map(|(i, x)| x * window(i)).collect()
}

fn transform(samples: &[f64]) -> Vec<Complex64> {
    let forward = RealFftPlanner::new().plan_fft_forward(samples.len());
    let (mut input, mut bins) = (samples.to_vec(), forward.make_output_vec());
    forward.process(&mut input, &mut bins).expect("buffers have the planned lengths");
    bins
}

/// Complex normal of mean power one.
fn normal(random: &mut ChaCha8Rng) -> Complex64 {
    let [re, im]: [f64; 2] = [StandardNormal.sample(random), StandardNormal.sample(random)];
    Complex64::new(re, im) * 0.5_f64.sqrt()
}

/// Mean power of noise with this median.
fn median(bins: &[Complex64]) -> f64 {
    let mut power: Vec<f64> = bins.iter().map(Complex64::norm_sqr).collect();
    let middle = power.len() / 2;
    let median = if power.is_empty() { 0.0 } else { *power.select_nth_unstable_by(middle, f64::total_cmp).1 };
    (median / LN_2).max(f64::MIN_POSITIVE)
}

/// Coherence of Gaussian bins from the mean product of bins of length one: between pi/4 of it and all of it, by the
/// square.
fn coherence(product: Complex64) -> Complex64 {
    product / (FRAC_PI_4 + (1.0 - FRAC_PI_4) * product.norm_sqr())
}

fn coherences(channels: &[&[Complex64]]) -> Vec<Vec<Complex64>> {
    let length_one = |x: &Complex64| x / x.norm().max(f64::MIN_POSITIVE);
    let between = |a: &[Complex64], b: &[Complex64]| {
        let sum: Complex64 = a.iter().zip(b).map(|(x, y)| length_one(x) * length_one(y).conj()).sum();
        coherence(sum / a.len().max(1) as f64)
    };
    let entry = |i: usize, j: usize| if i == j { Complex64::from(1.0) } else { between(channels[i], channels[j]) };
    (0..channels.len()).map(|i| (0..channels.len()).map(|j| entry(i, j)).collect()).collect()
}

/// Lower triangular factor of a matrix with ones on its diagonal; what estimates leave below [`MIN_OWN_SHARE`] there is
/// raised to it.
fn factor(matrix: &[Vec<Complex64>]) -> Vec<Vec<Complex64>> {
    let size = matrix.len();
    let mut lower = vec![vec![Complex64::default(); size]; size];
    for i in 0..size {
        for j in 0..i {
            let known: Complex64 = (0..j).map(|k| lower[i][k] * lower[j][k].conj()).sum();
            lower[i][j] = (matrix[i][j] - known) / lower[j][j];
        }
        let shared: f64 = (0..i).map(|k| lower[i][k].norm_sqr()).sum();
        // Rows keep the length one, so that the floor is the channel's.
        let scale = if shared > 1.0 - MIN_OWN_SHARE { ((1.0 - MIN_OWN_SHARE) / shared).sqrt() } else { 1.0 };
        lower[i].iter_mut().for_each(|x| *x *= scale);
        lower[i][i] = (1.0 - shared * scale * scale).max(MIN_OWN_SHARE).sqrt().into();
    }
    lower
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_chacha::rand_core::SeedableRng;

    const LENGTH: usize = 1 << 15;
    const WIDTH: usize = 800;

    fn power(samples: &[f64], bins: std::ops::Range<usize>) -> f64 {
        let count = bins.len() as f64;
        transform(samples)[bins].iter().map(Complex64::norm_sqr).sum::<f64>() / count
    }

    #[test]
    fn fault_lines_and_sidebands_do_not_survive() {
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let mut samples: Vec<f64> = (0..LENGTH).map(|_| StandardNormal.sample(&mut random)).collect();
        for (i, x) in samples.iter_mut().enumerate() {
            let line = |bin: f64| (std::f64::consts::TAU * bin * i as f64 / LENGTH as f64).cos();
            *x += (40..60).map(|n| line(100.0 * f64::from(n) + 0.5)).sum::<f64>();
        }
        let drawn = Noise::of(&[samples.clone()], WIDTH).drawn(&mut random);
        let (with, without) = (power(&samples, 4500..4502), power(&drawn[0], 4200..5800));
        // White noise of variance one has the length as power.
        assert!(with > 100.0 * without && (without / LENGTH as f64 - 1.0).abs() < 0.2, "{with} {without}");
    }

    #[test]
    fn theory_channels_keep_their_power_and_what_they_share() {
        let mut random = ChaCha8Rng::seed_from_u64(4);
        let mut white = || -> Vec<f64> { (0..LENGTH).map(|_| StandardNormal.sample(&mut random)).collect() };
        let (common, own) = (white(), white());
        // A coherence of 0.8, three times as strong in the second channel.
        let second: Vec<f64> = common.iter().zip(&own).map(|(a, b)| 3.0 * (0.8 * a + 0.6 * b)).collect();
        let noise = Noise::of(&[common, second], WIDTH);
        let drawn = noise.drawn(&mut ChaCha8Rng::seed_from_u64(5));
        let product: f64 = drawn[0].iter().zip(&drawn[1]).map(|(a, b)| a * b).sum();
        let squares = [0, 1].map(|c: usize| drawn[c].iter().map(|x| x * x).sum::<f64>());
        let shared = product / (squares[0] * squares[1]).sqrt();
        assert!((shared - 0.8).abs() < 0.03, "{shared}");
        assert!((squares[1] / squares[0] / 9.0 - 1.0).abs() < 0.06, "{squares:?}");
    }
}
