//! Windowed spectra and the kernel of a line in them.
//!
//! Window: Tukey with half of its length tapered; a least-squares fit over its bins keeps 74 % of the information of the
//! record (Hann: 51 %) and its side lobes fall with the cube of the distance. Bins are scaled so that a line of complex
//! amplitude `a` on a bin centre reads `a`. Bins of white noise are correlated by the taper; `OVERDISPERSION` restores calibrated chi-square.

use crate::model::forward::Line;
use rustfft::{FftPlanner, num_complex::Complex64 as C};
use std::f64::consts::PI;

/// Comparison stops here: the acquisition filter rolls off above, Hz.
pub const BAND_HZ: f64 = 15_000.0;
/// Half width of a line's kernel, bins.
pub const REACH: i64 = 12;
/// Half width used for the strong lines of the declared machine, whose far tails would pass for sidebands, bins.
pub const WIDE: i64 = 160;
const FINE: usize = 64;
/// Mean w^4 over squared mean w^2 of the window: variance inflation of fits over bins taken as independent.
pub const OVERDISPERSION: f64 = 1.347;

/// Spectrum of one channel of one run: complex bins from 0 to 15 kHz.
pub type Bins = Vec<C>;
/// Non-zero bins of a template.
pub type Sparse = Vec<(u32, C)>;

/// Window and kernel for records of one length and rate.
pub struct Analyser {
    /// Samples per run.
    pub samples: usize,
    /// Sampling rate, Hz.
    pub rate_hz: f64,
    /// Bins from 0 up to the band limit.
    pub bins: usize,
    window: Vec<f64>,
    kernel: Vec<f64>,
    scale: f64,
}

impl Analyser {
    /// Analyser for `samples` at `rate_hz`.
    pub fn new(samples: usize, rate_hz: f64) -> Self {
        let taper = samples / 4;
        let window: Vec<f64> = (0..samples)
            .map(|k| {
                let edge = k.min(samples - 1 - k);
                if edge < taper { 0.5 - 0.5 * (PI * (edge as f64 + 0.5) / taper as f64).cos() } else { 1.0 }
            })
            .collect();
        let sum: f64 = window.iter().sum();
        // Tukey with half tapers: a 3/4-length rectangle convolved with a quarter-length half cosine.
        let kernel = (0..=(WIDE as usize + 1) * FINE)
            .map(|i| {
                let d = i as f64 / FINE as f64;
                let x = 0.75 * PI * d;
                let sinc = if i == 0 { 1.0 } else { x.sin() / x };
                let pole = 1.0 - 0.25 * d * d;
                sinc * if pole.abs() < 1e-9 { 0.25 * PI } else { (0.25 * PI * d).cos() / pole }
            })
            .collect();
        let bins = ((BAND_HZ.min(0.45 * rate_hz)) * samples as f64 / rate_hz) as usize;
        Self { samples, rate_hz, bins, window, kernel, scale: 2.0 / sum }
    }

    /// Leaves out the bins above `top_hz`, where one is given.
    pub fn up_to(&mut self, top_hz: Option<f64>) {
        let last = top_hz.map_or(self.bins, |hz| (hz * self.duration_s()) as usize);
        self.bins = self.bins.min(last.max(1));
    }

    /// Duration of a run, s.
    pub fn duration_s(&self) -> f64 {
        self.samples as f64 / self.rate_hz
    }

    /// Noise variance per sample that gives unit power per bin.
    pub fn bin_power_of_unit_variance(&self) -> f64 {
        self.scale * self.scale * self.window.iter().map(|w| w * w).sum::<f64>()
    }

    /// Windowed bins of a signal.
    pub fn bins_of(&self, signal: &[f64]) -> Bins {
        let mut buffer: Vec<C> =
            signal.iter().zip(&self.window).map(|(x, w)| C::new(x * w * self.scale, 0.0)).collect();
        FftPlanner::new().plan_fft_forward(self.samples).process(&mut buffer);
        buffer.truncate(self.bins);
        buffer
    }

    /// Magnitude of the kernel `distance` bins from the line.
    fn magnitude_at(&self, distance: f64) -> f64 {
        let x = distance.abs() * FINE as f64;
        let i = x as usize;
        if i + 1 >= self.kernel.len() {
            return 0.0;
        }
        self.kernel[i] + (x - i as f64) * (self.kernel[i + 1] - self.kernel[i])
    }

    /// Phase factor of the kernel `distance` bins from the line, and its step from bin to bin.
    fn phase_from(&self, distance: f64) -> (C, C) {
        let per_bin = -PI * (self.samples as f64 - 1.0) / self.samples as f64;
        (C::cis(per_bin * distance), C::cis(per_bin))
    }

    /// Adds a line of complex amplitude `a` at `hz` (either sign) to `bins`.
    pub fn add_line(&self, bins: &mut [C], hz: f64, a: C, reach: i64) {
        let duration = self.duration_s();
        // Lines that no bin sees, however far they lie, would leave the range of whole numbers.
        let farthest = bins.len() as f64 + reach as f64;
        let reached = |line: &(f64, C)| line.0.abs() <= farthest;
        for (position, amplitude) in [(hz * duration, a), (-hz * duration, a.conj())].into_iter().filter(reached) {
            let first = (position.ceil() as i64 - reach).max(0);
            let last = (position.floor() as i64 + reach).min(bins.len() as i64 - 1);
            let (mut turn, step) = self.phase_from(first as f64 - position);
            for b in first..=last {
                bins[b as usize] += amplitude * turn * self.magnitude_at(b as f64 - position);
                turn *= step;
            }
        }
    }

    /// Bins of a set of order lines at an angle `offset + 2 pi f t`, channel `channel`.
    pub fn bins_of_lines(&self, lines: &[Line], offset_rad: f64, shaft_hz: f64, channel: usize, reach: i64) -> Bins {
        let mut bins = vec![C::ZERO; self.bins];
        for line in lines {
            let amplitude = line.amplitude[channel] * C::cis(line.order * offset_rad);
            if amplitude.norm_sqr() > 0.0 {
                self.add_line(&mut bins, line.order * shaft_hz, amplitude, reach);
            }
        }
        bins
    }

    /// Least-squares complex amplitude of a line at `hz` in `bins`, and the sum of squared kernel values used.
    pub fn amplitude(&self, bins: &[C], hz: f64) -> (C, f64) {
        let position = hz * self.duration_s();
        if !position.is_finite() || position.abs() > bins.len() as f64 + 3.0 {
            return (C::ZERO, 1e-30);
        }
        let first = (position.ceil() as i64 - 3).max(0);
        let last = (position.floor() as i64 + 3).min(bins.len() as i64 - 1);
        let (mut sum, mut energy) = (C::ZERO, 1e-30);
        let (mut turn, step) = self.phase_from(first as f64 - position);
        for b in first..=last {
            let magnitude = self.magnitude_at(b as f64 - position);
            sum += turn.conj() * magnitude * bins[b as usize];
            energy += magnitude * magnitude;
            turn *= step;
        }
        (sum / energy, energy)
    }
}

/// Non-zero entries of dense bins.
pub fn sparse(bins: &[C]) -> Sparse {
    let used = || bins.iter().enumerate().filter(|(_, x)| x.norm_sqr() > 0.0);
    // As large as needed: many are kept for long.
    let mut sparse = Vec::with_capacity(used().count());
    sparse.extend(used().map(|(i, x)| (i as u32, *x)));
    sparse
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fault_lines_that_no_bin_sees_change_nothing() {
        let analyser = Analyser::new(1024, 1000.0);
        let mut bins = vec![C::ZERO; analyser.bins];
        for hz in [1e300, -1e300, f64::INFINITY, f64::NAN] {
            analyser.add_line(&mut bins, hz, C::ONE, REACH);
            assert_eq!(analyser.amplitude(&bins, hz).0, C::ZERO);
        }
        assert!(bins.iter().all(|bin| *bin == C::ZERO));
    }
}
