//! Windowed spectra and the kernel of a line in them.
//!
//! Window: Tukey with half of its length tapered; a least-squares fit over its bins keeps 74 % of the information of the
//! record (Hann: 51 %) and its side lobes fall with the cube of the distance. Bins are scaled so that a line of complex
//! amplitude `a` on a bin centre reads `a`. Bins of white noise are correlated by the taper; `OVERDISPERSION` restores calibrated chi-square.

use crate::model::forward::Line;
use rustfft::{
    FftPlanner,
    num_complex::{Complex32, Complex64 as C},
};
use std::f64::consts::PI;

/// Comparison stops here: the acquisition filter rolls off above, Hz.
pub const BAND_HZ: f64 = 15_000.0;
/// Half width of a line's kernel, bins.
pub const REACH: i64 = 12;
/// Half width used for the strong lines of the declared machine, whose far tails would pass for sidebands, bins.
pub const WIDE: i64 = 160;
const FINE: usize = 64;
/// Bins that are looked at together for any other than zero.
const GROUP: usize = 16;
/// Mean w^4 over squared mean w^2 of the window: variance inflation of fits over bins taken as independent.
pub const OVERDISPERSION: f64 = 1.347;

/// Spectrum of one channel of one run: complex bins from 0 to 15 kHz.
pub type Bins = Vec<C>;

/// Non-zero bins of a template: stretches of neighbours in single precision.
///
/// Templates are most of what the loop keeps: 8 bytes per bin here, 24 with each bin's place in double precision. Rounding (6e-8 of a
/// template) lies far below the noise that any template is weighed against.
#[derive(Debug, Clone, Default)]
pub struct Sparse {
    /// First bin and number of bins of each stretch, ascending.
    stretches: Box<[(u32, u32)]>,
    /// Values of all stretches, one after the other.
    values: Box<[Complex32]>,
}

impl Sparse {
    /// Non-zero entries of dense bins.
    pub fn of(bins: &[C]) -> Self {
        let used = |x: &C| (x.re != 0.0) | (x.im != 0.0);
        // As large as needed: many are kept for long.
        let mut values = Vec::with_capacity(bins.iter().map(|x| usize::from(used(x))).sum());
        let mut stretches: Vec<(u32, u32)> = Vec::new();
        for (group, near) in bins.chunks(GROUP).enumerate() {
            // Most are wholly zero, which is seen without looking at each.
            if !near.iter().fold(false, |any, x| any | used(x)) {
                continue;
            }
            for (i, x) in near.iter().enumerate().filter(|(_, x)| used(x)) {
                let bin = (group * GROUP + i) as u32;
                match stretches.last_mut() {
                    Some((first, count)) if *first + *count == bin => *count += 1,
                    _ => stretches.push((bin, 1)),
                }
                values.push(Complex32::new(x.re as f32, x.im as f32));
            }
        }
        Self { stretches: stretches.into(), values: values.into() }
    }

    /// Whether no bin is other than zero.
    pub fn is_empty(&self) -> bool {
        self.values.is_empty()
    }

    /// First bin and values of each stretch.
    pub fn stretches(&self) -> impl Iterator<Item = (usize, &[Complex32])> {
        let mut rest = &self.values[..];
        self.stretches.iter().map(move |&(first, count)| {
            let (own, after) = rest.split_at(count as usize);
            rest = after;
            (first as usize, own)
        })
    }

    /// Each bin with its value.
    pub fn iter(&self) -> impl Iterator<Item = (usize, C)> {
        self.stretches().flat_map(|(first, values)| values.iter().enumerate().map(move |(i, x)| (first + i, wide(x))))
    }

    /// `p a + q b`.
    pub fn mixed(a: &Self, p: f64, b: &Self, q: f64) -> Self {
        let bins = [a, b].iter().filter_map(|x| x.stretches.last()).map(|(first, count)| first + count).max();
        let mut sum = vec![C::ZERO; bins.unwrap_or(0) as usize];
        for (part, factor) in [(a, p), (b, q)] {
            part.iter().for_each(|(bin, x)| sum[bin] += x * factor);
        }
        Self::of(&sum)
    }
}

/// In double precision.
pub fn wide(x: &Complex32) -> C {
    C::new(f64::from(x.re), f64::from(x.im))
}

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
        buffer.shrink_to_fit();
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ref_bins_and_mixtures_are_what_the_dense_ones_are() {
        let bins = |seed: usize| -> Vec<C> {
            let value = |i: usize| C::new((i * seed % 7) as f64 - 3.0, (i % 5) as f64 * 0.25);
            (0..40).map(|i| if i * seed % 11 < 5 { value(i) } else { C::ZERO }).collect()
        };
        let dense = |sparse: &Sparse| {
            let mut all = vec![C::ZERO; 40];
            sparse.iter().for_each(|(bin, x)| all[bin] += x);
            all
        };
        let (a, b) = (bins(3), bins(8));
        assert_eq!(dense(&Sparse::of(&a)), a);
        let mixed = Sparse::mixed(&Sparse::of(&a), 0.5, &Sparse::of(&b), -2.0);
        let expected: Vec<C> = a.iter().zip(&b).map(|(a, b)| a * 0.5 - b * 2.0).collect();
        assert_eq!(dense(&mixed), expected);
        assert!(Sparse::default().is_empty() && Sparse::of(&[C::ZERO; 3]).is_empty() && !mixed.is_empty());
    }

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
