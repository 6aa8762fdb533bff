//! Reference spectra in f64: the yardstick for what the node computes in f32.
//!
//! Amplitude spectra show *peak* amplitudes of lines (a sine of amplitude 1 shows as 1); power spectral
//! densities are one-sided, unit^2/Hz. FFTs of any length (`realfft`), so whole records are used without
//! padding. Source: Heinzel, Ruediger, Schilling, "Spectrum and spectral density estimation by the DFT"
//! (2002), for windows, ENBW and scaling; Welch (1967) for averaging.

mod bessel;
mod dot;
mod interpolated;
mod kaiser;
mod line;
mod noise;
mod order;
mod plans;
mod shape;
mod windowed;

pub use bessel::bessel_i0;
pub use dot::dot;
pub use interpolated::{interpolated, through};
pub use kaiser::Kaiser;
pub use line::{Line, line_near};
pub use noise::{noise_power, running_median};
pub use order::{AngleMap, natural_spline, order_spectrum, resample_by_angle, synchronous_average};
pub use plans::{backward, forward, inverse, is_smooth, smooth_length};
pub use shape::shaped;
pub use windowed::Windowed;

use std::f64::consts::TAU;

/// Weights of a block that are made from one another.
const WEIGHTS: usize = 256;

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

    /// The `n` weights of a block: [`Window::weight`] to a few units in the last place, by sums of angles.
    pub fn weights(self, n: usize) -> Vec<f64> {
        let angle = |i: usize| TAU * i as f64 / n as f64;
        let steps: Vec<(f64, f64)> = (0..n.min(WEIGHTS)).map(|i| angle(i).sin_cos()).collect();
        let mut weights = Vec::with_capacity(n);
        for first in (0..n).step_by(WEIGHTS) {
            let (sine, cosine) = angle(first).sin_cos();
            let count = WEIGHTS.min(n - first);
            weights.extend(steps[..count].iter().map(|(s, c)| self.weight_of(cosine * c - sine * s)));
        }
        weights
    }

    /// Weight where the cosine of the position's angle is `x`: a sum of Chebyshev polynomials (Clenshaw 1955).
    fn weight_of(self, x: f64) -> f64 {
        let c = self.coefficients();
        let (mut next, mut after) = (0.0, 0.0);
        for (k, coefficient) in c.iter().enumerate().skip(1).rev() {
            let signed = if k % 2 == 0 { *coefficient } else { -*coefficient };
            (next, after) = (signed + 2.0 * x * next - after, next);
        }
        c[0] + x * next - after
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
    if signal.is_empty() {
        return Spectrum { bin: rate, values: Vec::new() };
    }
    Windowed::new(signal.len(), window).amplitudes(signal, rate)
}

/// Welch's power spectral density with half-overlapping segments, unit^2/Hz.
///
/// `segment` samples per segment, clamped to the signal; each segment's mean is removed.
pub fn power_density(signal: &[f64], rate: f64, segment: usize, window: Window) -> Spectrum {
    let n = segment.clamp(1, signal.len().max(1));
    let mut windowed = Windowed::new(n, window);
    let mut sum = vec![0.0; n / 2 + 1];
    let mut count = 0;
    let mut start = 0;
    while start + n <= signal.len() {
        for (s, bin) in sum.iter_mut().zip(windowed.bins(&signal[start..start + n])) {
            *s += bin.norm_sqr();
        }
        count += 1;
        start += (n / 2).max(1);
    }
    let scale = 1.0 / (rate * windowed.power() * f64::from(count.max(1)));
    for (i, s) in sum.iter_mut().enumerate() {
        *s *= windowed.sides(i) * scale;
    }
    Spectrum { bin: rate / n as f64, values: sum }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ref_weights_of_a_block_are_those_of_their_places() {
        for window in [Window::Rectangular, Window::Hann, Window::BlackmanHarris, Window::FlatTop] {
            for n in [1, 2, 255, 256, 1000] {
                let weights = window.weights(n);
                assert_eq!(weights.len(), n);
                let worst = |(i, w): (usize, &f64)| (w - window.weight(i as f64 / n as f64)).abs();
                assert!(weights.iter().enumerate().map(worst).fold(0.0, f64::max) < 1e-14, "{window:?} of {n}");
            }
        }
    }

    #[test]
    fn ref_turns_along_a_run_are_those_of_each_time() {
        let edges_s: Vec<f64> = (0..50).map(|i| f64::from(i) + 0.2 * (0.4 * f64::from(i)).sin()).collect();
        let map = AngleMap::new(&edges_s, 3, 0.5).unwrap();
        for (i, turns) in map.turns_along(-2.0, 0.013).take(4200).enumerate() {
            let time_s = -2.0 + i as f64 * 0.013;
            assert!((turns - map.turns_at(time_s)).abs() < 1e-12, "at {time_s}");
            assert!((map.time_at(turns) - time_s).abs() < 1e-12, "at {time_s}");
        }
    }
}
