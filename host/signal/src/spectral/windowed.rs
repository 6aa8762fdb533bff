//! Weighted transforms of many signals of one length: weights, plan and buffers are made once.

use super::{Spectrum, Window, plans};
use realfft::RealToComplex;
use rustfft::num_complex::Complex64;
use std::sync::Arc;

/// A window of one length with its transform.
pub struct Windowed {
    weights: Vec<f64>,
    gain: f64,
    plan: Arc<dyn RealToComplex<f64>>,
    input: Vec<f64>,
    scratch: Vec<Complex64>,
    bins: Vec<Complex64>,
}

impl Windowed {
    /// For signals of `length` samples, at least one.
    pub fn new(length: usize, window: Window) -> Self {
        let weights = window.weights(length);
        let plan = plans::forward(length);
        let gain = weights.iter().sum();
        Self {
            gain,
            weights,
            input: plan.make_input_vec(),
            scratch: plan.make_scratch_vec(),
            bins: plan.make_output_vec(),
            plan,
        }
    }

    /// Sum of the weights.
    pub fn gain(&self) -> f64 {
        self.gain
    }

    /// Sum of the squared weights.
    pub fn power(&self) -> f64 {
        self.weights.iter().map(|w| w * w).sum()
    }

    /// 2 for bins that stand for both signs of a frequency, 1 for zero and half the rate.
    pub fn sides(&self, bin: usize) -> f64 {
        let alone = bin == 0 || (self.weights.len().is_multiple_of(2) && bin + 1 == self.bins.len());
        if alone { 1.0 } else { 2.0 }
    }

    /// The signal less its mean, weighted.
    ///
    /// # Panics
    /// If the signal is not of this length.
    pub fn weighted(&self, signal: &[f64]) -> Vec<f64> {
        assert_eq!(signal.len(), self.weights.len(), "a signal of the window's length");
        weighed(signal, &self.weights).collect()
    }

    /// Weighted transform of a signal less its mean, not scaled.
    ///
    /// # Panics
    /// If the signal is not of this length.
    pub fn bins(&mut self, signal: &[f64]) -> &[Complex64] {
        assert_eq!(signal.len(), self.weights.len(), "a signal of the window's length");
        self.input.iter_mut().zip(weighed(signal, &self.weights)).for_each(|(to, x)| *to = x);
        self.plan
            .process_with_scratch(&mut self.input, &mut self.bins, &mut self.scratch)
            .expect("buffers have the planned lengths");
        &self.bins
    }

    /// What the latest transform gave.
    pub fn into_bins(self) -> Vec<Complex64> {
        self.bins
    }

    /// Peak-amplitude spectrum of a signal of this length, sampled at `rate` (Hz, or samples per turn).
    ///
    /// # Panics
    /// If the signal is not of this length.
    pub fn amplitudes(&mut self, signal: &[f64], rate: f64) -> Spectrum {
        self.bins(signal);
        let scaled = |(i, bin): (usize, &Complex64)| bin.norm_sqr().sqrt() * self.sides(i) / self.gain;
        Spectrum { bin: rate / signal.len() as f64, values: self.bins.iter().enumerate().map(scaled).collect() }
    }
}

/// A signal less its mean, times weights.
fn weighed(signal: &[f64], weights: &[f64]) -> impl Iterator<Item = f64> {
    let mean = signal.iter().sum::<f64>() / signal.len() as f64;
    signal.iter().zip(weights).map(move |(x, w)| (x - mean) * w)
}
