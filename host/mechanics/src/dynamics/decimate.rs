//! The acquisition's anti-alias filter: an oversampled signal to the record's rate.
//!
//! A gear mesh excites far beyond any record's rate (harmonics fall only as 1/n), so point sampling would
//! fold. Linear-phase Kaiser-windowed sinc at 16 times the rate, flat (1e-5) to 0.4 of the output rate,
//! 100 dB down from 0.6 on, delay removed. Cost: 512 products per output sample.

use crate::spectral::bessel_i0;
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

    /// Response at `cycles` per output sample.
    pub fn response(&self, cycles: f64) -> f64 {
        let step = 2.0 * PI * cycles / OVERSAMPLING as f64;
        let pairs = (1..=HALF).map(|i| 2.0 * self.taps[HALF + i] * (step * i as f64).cos());
        self.taps[HALF] + pairs.sum::<f64>()
    }

    /// Input indices `first..end` (0 at the first output sample) needed for `count` outputs.
    pub fn span(&self, count: usize) -> (i64, i64) {
        (-(HALF as i64), ((count - 1) * OVERSAMPLING + HALF + 1) as i64)
    }

    /// The filtered signal at the output rate; `input` covers [`Decimator::span`].
    pub fn apply(&self, input: &[f64], count: usize) -> Vec<f64> {
        (0..count).map(|i| self.output(&input[i * OVERSAMPLING..])).collect()
    }

    /// One output from the inputs that begin with its first.
    fn output(&self, input: &[f64]) -> f64 {
        // Eight partial sums: a single one would wait for itself.
        let mut sums = [0.0; 8];
        let (taps, input) = (self.taps.chunks_exact(8), input[..self.taps.len()].chunks_exact(8));
        let rest: f64 = taps.remainder().iter().zip(input.remainder()).map(|(t, x)| t * x).sum();
        for (t, x) in taps.zip(input) {
            for i in 0..8 {
                sums[i] += t[i] * x[i];
            }
        }
        sums.iter().sum::<f64>() + rest
    }
}

/// Filters a signal that arrives in parts, so that the oversampled signal is never stored whole.
pub struct Stream<'f> {
    filter: &'f Decimator,
    pending: Vec<f64>,
    output: Vec<f64>,
    count: usize,
}

/// Inputs gathered before they are filtered.
const BATCH_INPUTS: usize = 1 << 16;

impl<'f> Stream<'f> {
    /// A stream that gives `count` outputs.
    pub fn new(filter: &'f Decimator, count: usize) -> Self {
        Self { filter, pending: Vec::new(), output: Vec::with_capacity(count), count }
    }

    /// Takes inputs in order, the first being [`Decimator::span`]'s first.
    pub fn push(&mut self, input: &[f64]) {
        self.pending.extend_from_slice(input);
        if self.pending.len() >= BATCH_INPUTS {
            self.drain();
        }
    }

    /// The outputs.
    pub fn finish(mut self) -> Vec<f64> {
        self.drain();
        self.output
    }

    fn drain(&mut self) {
        let taps = self.filter.taps.len();
        let mut start = 0;
        while start + taps <= self.pending.len() && self.output.len() < self.count {
            self.output.push(self.filter.output(&self.pending[start..]));
            start += OVERSAMPLING;
        }
        self.pending.drain(..start.min(self.pending.len()));
    }
}
