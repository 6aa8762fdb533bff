//! The acquisition's anti-alias filter: an oversampled signal to the record's rate.
//!
//! A gear mesh excites far beyond any record's rate (harmonics fall only as 1/n), so point sampling would
//! fold. Linear-phase Kaiser-windowed sinc at 16 times the rate, flat (1e-5) to 0.4 of the output rate,
//! 100 dB down from 0.6 on, delay removed. Cost: 512 products per output sample.

use std::f64::consts::PI;

/// Input samples per output sample.
pub const OVERSAMPLING: usize = 16;
/// Filter length on either side of its middle, input samples.
const HALF: usize = 280;
/// Kaiser parameter for 100 dB.
const BETA: f64 = 10.06;

/// The filter.
pub struct Decimator {
    taps: Vec<f64>,
}

impl Default for Decimator {
    fn default() -> Self {
        Self::new()
    }
}

impl Decimator {
    /// Designs the filter.
    pub fn new() -> Self {
        let cut = 1.0 / OVERSAMPLING as f64;
        let mut taps: Vec<f64> = (0..=2 * HALF)
            .map(|i| {
                let x = i as f64 - HALF as f64;
                let sinc = if x == 0.0 { cut } else { (PI * cut * x).sin() / (PI * x) };
                sinc * bessel_i0(BETA * (1.0 - (x / HALF as f64).powi(2)).max(0.0).sqrt())
            })
            .collect();
        let sum: f64 = taps.iter().sum();
        taps.iter_mut().for_each(|t| *t /= sum);
        Self { taps }
    }

    /// Input indices `first..end` (0 at the first output sample) needed for `count` outputs.
    pub fn span(&self, count: usize) -> (i64, i64) {
        (-(HALF as i64), ((count - 1) * OVERSAMPLING + HALF + 1) as i64)
    }

    /// The filtered signal at the output rate; `input` covers [`Decimator::span`].
    pub fn apply(&self, input: &[f64], count: usize) -> Vec<f64> {
        (0..count).map(|i| input[i * OVERSAMPLING..].iter().zip(&self.taps).map(|(x, t)| x * t).sum()).collect()
    }
}

/// Modified Bessel function of order 0 by its power series.
fn bessel_i0(x: f64) -> f64 {
    let quarter = 0.25 * x * x;
    let (mut term, mut sum, mut k) = (1.0, 1.0, 1.0);
    while term > 1e-17 * sum {
        term *= quarter / (k * k);
        sum += term;
        k += 1.0;
    }
    sum
}
