//! Amplitude and phase of lines whose order is known.
//!
//! A Blackman-Harris weighted Fourier sum at the very order, no bin: right for one line however it lies between bins,
//! neighbours four bins away weigh in at -92 dB. Cost: one transform of all samples; lines between its bins (those of
//! the gear, unless the record holds whole turns of it) one more pass over the samples each.

use crate::spectral::{Spectrum, Window, Windowed, dot};
use rustfft::num_complex::Complex64;
use std::f64::consts::TAU;
use std::sync::OnceLock;

/// Bins from a line's centre to the end of its main lobe.
pub const LOBE_BINS: f64 = 4.0;

/// Window of every spectrum here.
pub const WINDOW: Window = Window::BlackmanHarris;

/// Samples over which a rotation is tabulated: both tables of a line stay in the nearest cache.
const BLOCK: usize = 1024;
/// Distance from a bin within which a line stands on it, bins.
const MAX_BIN_OFFSET: f64 = 1e-9;

/// Samples at equal angles, weighted, ready to be asked for lines.
#[derive(Debug, Clone)]
pub struct OrderLines<'a> {
    samples: &'a [f64],
    /// Made for the first line that is no bin.
    weighted: OnceLock<Vec<f64>>,
    bins: Vec<Complex64>,
    spectrum: Spectrum,
    gain: f64,
    per_turn: f64,
}

impl<'a> OrderLines<'a> {
    /// Takes whole turns; their mean is removed.
    pub fn new(samples: &'a [f64], per_turn: usize) -> Self {
        let mut windowed = Windowed::new(samples.len(), WINDOW);
        let spectrum = windowed.amplitudes(samples, per_turn as f64);
        Self {
            samples,
            weighted: OnceLock::new(),
            gain: windowed.gain(),
            bins: windowed.into_bins(),
            spectrum,
            per_turn: per_turn as f64,
        }
    }

    /// Peak amplitudes over orders.
    pub fn spectrum(&self) -> &Spectrum {
        &self.spectrum
    }

    /// Peak amplitude and phase of the cosine at the first sample, as a complex number.
    pub fn at(&self, order: f64) -> Complex64 {
        let cycles = order / self.per_turn;
        let place = cycles * self.samples.len() as f64;
        let bin = place.round();
        let on_bin = (place - bin).abs() < MAX_BIN_OFFSET && bin >= 1.0;
        let sum = match self.bins.get(bin as usize).filter(|_| on_bin) {
            Some(value) => *value,
            None => self.between_bins(cycles),
        };
        sum * (2.0 / self.gain)
    }

    /// The sum at `cycles` per sample, which is no bin.
    fn between_bins(&self, cycles: f64) -> Complex64 {
        let turn = |i: usize| -TAU * (cycles * i as f64).fract();
        let (sine, cosine): (Vec<f64>, Vec<f64>) = (0..BLOCK).map(|i| turn(i).sin_cos()).unzip();
        let block = |(number, samples): (usize, &[f64])| {
            Complex64::cis(turn(BLOCK * number)) * Complex64::new(dot(samples, &cosine), dot(samples, &sine))
        };
        let weighted = self.weighted.get_or_init(|| Windowed::new(self.samples.len(), WINDOW).weighted(self.samples));
        weighted.chunks(BLOCK).enumerate().map(block).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ref_lines_on_bins_and_between_them_are_the_weighted_sum() {
        let per_turn = 60;
        let samples: Vec<f64> = (0..per_turn * 40)
            .map(|i| (TAU * 3.0 * i as f64 / 60.0 + 0.3).cos() + 0.5 * (TAU * 7.123 * i as f64 / 60.0).sin())
            .collect();
        let lines = OrderLines::new(&samples, per_turn);
        let weights = WINDOW.weights(samples.len());
        let mean = samples.iter().sum::<f64>() / samples.len() as f64;
        let gain: f64 = weights.iter().sum();
        for order in [3.0, 7.123, 0.05, 12.4, 2.975] {
            let turn = |i: usize| Complex64::cis(-TAU * order * i as f64 / 60.0);
            let terms = samples.iter().zip(&weights).enumerate().map(|(i, (x, w))| turn(i) * ((x - mean) * w));
            let exact = terms.sum::<Complex64>() * (2.0 / gain);
            assert!((lines.at(order) - exact).norm() < 1e-11, "order {order}");
        }
    }
}
