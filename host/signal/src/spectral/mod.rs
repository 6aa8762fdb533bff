//! Reference spectra in f64: the yardstick for what the node computes in f32.
//!
//! Amplitude spectra show *peak* amplitudes of lines (a sine of amplitude 1 shows as 1); power spectral
//! densities are one-sided, unit^2/Hz. FFTs of any length (`realfft`), so whole records are used without
//! padding. Source: Heinzel, Ruediger, Schilling, "Spectrum and spectral density estimation by the DFT"
//! (2002), for windows, ENBW and scaling; Welch (1967) for averaging.

mod bessel;
mod interpolated;
mod line;
mod noise;
mod order;
mod shape;

pub use bessel::bessel_i0;
pub use interpolated::{interpolated, through};
pub use line::{Line, line_near};
pub use noise::{noise_power, running_median};
pub use order::{AngleMap, order_spectrum, resample_by_angle, synchronous_average};
pub use order::{Kaiser, natural_spline};
pub use shape::shaped;

use realfft::RealFftPlanner;
use std::f64::consts::TAU;

/// Cosine-sum windows, periodic form.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Window {
    /// No weighting: only for an integer number of periods.
    Rectangular,
    /// -31 dB side lobes, ENBW 1.5 bins.
    Hann,
    /// Four-term Blackman-Harris: -92 dB side lobes, ENBW 2.0044 bins, zeros at every bin from the fourth.
    BlackmanHarris,
    /// HFT95: amplitude of a line between bins right to 0.04 %, ENBW 3.81 bins.
    FlatTop,
}

impl Window {
    fn coefficients(self) -> &'static [f64] {
        match self {
            Window::Rectangular => &[1.0],
            Window::Hann => &[0.5, 0.5],
            Window::BlackmanHarris => &[0.35875, 0.48829, 0.14128, 0.01168],
            Window::FlatTop => &[1.0, 1.9383379, 1.3045202, 0.4028270, 0.0350665],
        }
    }

    /// Weight at `position` in `[0, 1)` of the window.
    pub fn weight(self, position: f64) -> f64 {
        let term = |(k, c): (usize, &f64)| {
            let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
            sign * c * (TAU * k as f64 * position).cos()
        };
        self.coefficients().iter().enumerate().map(term).sum()
    }

    /// The `n` weights of a block.
    pub fn weights(self, n: usize) -> Vec<f64> {
        (0..n).map(|i| self.weight(i as f64 / n as f64)).collect()
    }

    /// Equivalent noise bandwidth, bins.
    pub fn enbw_bins(self) -> f64 {
        let c = self.coefficients();
        1.0 + 0.5 * c[1..].iter().map(|a| a * a).sum::<f64>() / (c[0] * c[0])
    }
}

/// A one-sided spectrum on equally spaced bins from 0.
#[derive(Debug, Clone, PartialEq)]
pub struct Spectrum {
    /// Spacing of the bins, Hz (or orders, for order spectra).
    pub bin: f64,
    /// One value per bin: peak amplitude, or density.
    pub values: Vec<f64>,
}

impl Spectrum {
    /// Frequency (or order) of bin `i`.
    pub fn frequency(&self, i: usize) -> f64 {
        self.bin * i as f64
    }

    /// Index of the largest value between two frequencies (orders), ends included; `None` where no bin lies.
    pub fn peak_between(&self, from: f64, to: f64) -> Option<usize> {
        let first = (from / self.bin).ceil().max(0.0) as usize;
        let last = ((to / self.bin).floor().max(-1.0) as isize).min(self.values.len() as isize - 1);
        (first as isize..=last).map(|i| i as usize).max_by(|&a, &b| self.values[a].total_cmp(&self.values[b]))
    }

    /// Median of the values between two frequencies: the local floor under lines.
    pub fn median_between(&self, from: f64, to: f64) -> f64 {
        let first = ((from / self.bin).ceil().max(0.0) as usize).min(self.values.len());
        let last = ((to / self.bin).floor().max(0.0) as usize + 1).clamp(first, self.values.len());
        let mut part = self.values[first..last].to_vec();
        part.sort_by(f64::total_cmp);
        part.get(part.len() / 2).copied().unwrap_or(0.0)
    }
}

/// Peak-amplitude spectrum of the whole signal, sampled at `rate` (Hz, or samples per turn).
///
/// The mean is removed first, so bin 0 is zero. Cost n log n; an empty signal gives an empty spectrum.
pub fn amplitude_spectrum(signal: &[f64], rate: f64, window: Window) -> Spectrum {
    let n = signal.len();
    if n == 0 {
        return Spectrum { bin: rate, values: Vec::new() };
    }
    let weights = window.weights(n);
    let gain: f64 = weights.iter().sum();
    let magnitudes = magnitudes(signal, &weights, &mut RealFftPlanner::new());
    let last = magnitudes.len() - 1;
    let scale = |(i, m): (usize, f64)| {
        let alone = i == 0 || (n.is_multiple_of(2) && i == last);
        m * if alone { 1.0 } else { 2.0 } / gain
    };
    Spectrum { bin: rate / n as f64, values: magnitudes.into_iter().enumerate().map(scale).collect() }
}

/// Welch's power spectral density with half-overlapping segments, unit^2/Hz.
///
/// `segment` samples per segment, clamped to the signal; each segment's mean is removed.
pub fn power_density(signal: &[f64], rate: f64, segment: usize, window: Window) -> Spectrum {
    let n = segment.clamp(1, signal.len().max(1));
    let weights = window.weights(n);
    let power: f64 = weights.iter().map(|w| w * w).sum();
    let mut planner = RealFftPlanner::new();
    let mut sum = vec![0.0; n / 2 + 1];
    let mut count = 0;
    let mut start = 0;
    while start + n <= signal.len() {
        for (s, m) in sum.iter_mut().zip(magnitudes(&signal[start..start + n], &weights, &mut planner)) {
            *s += m * m;
        }
        count += 1;
        start += (n / 2).max(1);
    }
    let last = sum.len() - 1;
    for (i, s) in sum.iter_mut().enumerate() {
        let alone = i == 0 || (n.is_multiple_of(2) && i == last);
        *s *= if alone { 1.0 } else { 2.0 } / (rate * power * f64::from(count.max(1)));
    }
    Spectrum { bin: rate / n as f64, values: sum }
}

fn magnitudes(signal: &[f64], weights: &[f64], planner: &mut RealFftPlanner<f64>) -> Vec<f64> {
    let mean = signal.iter().sum::<f64>() / signal.len() as f64;
    let mut input: Vec<f64> = signal.iter().zip(weights).map(|(x, w)| (x - mean) * w).collect();
    let fft = planner.plan_fft_forward(input.len());
    let mut output = fft.make_output_vec();
    fft.process(&mut input, &mut output).expect("buffers have the planned lengths");
    output.iter().map(|c| c.norm()).collect()
}
