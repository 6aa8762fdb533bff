//! Windowed spectra and the kernel of a line in them.
//!
//! Window: Tukey with half of its length tapered; a least-squares fit over its bins keeps 74 % of the information of
//! the record (Hann: 51 %) and its side lobes fall with the cube of the distance. Bins are scaled so that a line of
//! complex amplitude `a` on a bin centre reads `a`. Bins of white noise are correlated by the taper; `OVERDISPERSION`
//! restores calibrated chi-square.

use crate::model::forward::Line;
use crate::spectral;
use realfft::RealToComplex;
use rustfft::num_complex::{Complex32, Complex64 as C};
use std::f64::consts::PI;
use std::ops::Range;
use std::sync::Arc;

/// Comparison stops here: the acquisition filter rolls off above, Hz.
pub const BAND_HZ: f64 = 15_000.0;
/// Half width of a line's kernel, bins.
pub const REACH: i64 = 12;
/// Half width used for the strong lines of the declared machine, whose far tails would pass for sidebands, bins.
pub const STRONG_HALF_WIDTH_BINS: i64 = 160;
/// Least distance of a line from a bin's centre, bins: the kernel is a quotient whose parts both vanish at 0 and at 2.
const LEAST_DISTANCE: f64 = 1e-7;
/// Bins that are looked at together for any other than zero.
const GROUP: usize = 16;
/// Mean w^4 over squared mean w^2 of the window: variance inflation of fits over bins taken as independent.
pub const OVERDISPERSION: f64 = 1.347;

/// Spectrum of one channel of one run: complex bins from 0 to 15 kHz.
pub type Bins = Vec<C>;

/// Non-zero bins of a template: stretches of neighbours in single precision.
///
/// Templates are most of what the loop keeps: 8 bytes per bin here, 24 with each bin's place in double precision.
/// Rounding (6e-8 of a template) lies far below the noise that any template is weighed against.
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
        Self::from_parts(bins, std::iter::once((0, bins.len())))
    }

    /// Non-zero entries of parts of a spectrum, of first bins and lengths `parts` and with `values` one after the
    /// other.
    fn from_parts(values: &[C], parts: impl Iterator<Item = (usize, usize)>) -> Self {
        let used = |x: &C| (x.re != 0.0) | (x.im != 0.0);
        // As large as needed: many are kept for long.
        let mut kept = Vec::with_capacity(values.iter().map(|x| usize::from(used(x))).sum());
        let mut stretches: Vec<(u32, u32)> = Vec::new();
        let mut rest = values;
        for (first, length) in parts {
            let (own, after) = rest.split_at(length);
            rest = after;
            for (group, near) in own.chunks(GROUP).enumerate() {
                // Most are wholly zero, which is seen without looking at each.
                if !near.iter().fold(false, |any, x| any | used(x)) {
                    continue;
                }
                for (i, x) in near.iter().enumerate().filter(|(_, x)| used(x)) {
                    let bin = (first + group * GROUP + i) as u32;
                    match stretches.last_mut() {
                        Some((first, count)) if *first + *count == bin => *count += 1,
                        _ => stretches.push((bin, 1)),
                    }
                    kept.push(Complex32::new(x.re as f32, x.im as f32));
                }
            }
        }
        Self { stretches: stretches.into(), values: kept.into() }
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
#[derive(Clone)]
pub struct Analyser {
    /// Samples per run.
    pub samples: usize,
    /// Sampling rate, Hz.
    pub rate_hz: f64,
    /// Bins from 0 up to the band limit.
    pub bins: usize,
    window: Vec<f64>,
    scale: f64,
    /// Phase factor of the kernel from bin to bin.
    turn_per_bin: C,
    transform: Arc<dyn RealToComplex<f64>>,
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
        let bins = ((BAND_HZ.min(0.45 * rate_hz)) * samples as f64 / rate_hz) as usize;
        let turn_per_bin = C::cis(-PI * (samples as f64 - 1.0) / samples as f64);
        let transform = spectral::forward(samples);
        Self { samples, rate_hz, bins, window, scale: 2.0 / sum, turn_per_bin, transform }
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
        let mut windowed: Vec<f64> = signal.iter().zip(&self.window).map(|(x, w)| x * w * self.scale).collect();
        let mut bins = self.transform.make_output_vec();
        self.transform.process(&mut windowed, &mut bins).expect("matching lengths");
        bins.truncate(self.bins);
        bins.shrink_to_fit();
        bins
    }

    /// Phase factor of the kernel `distance` bins from the line.
    fn phase_at(&self, distance: f64) -> C {
        C::cis(-PI * (self.samples as f64 - 1.0) / self.samples as f64 * distance)
    }

    /// Those of `bins` bins that a line at `position` bins reaches.
    fn reached(position: f64, bins: usize, reach: i64) -> Range<usize> {
        // Lines that no bin sees, however far they lie, would leave the range of whole numbers.
        if position.is_nan() || position.abs() > bins as f64 + reach as f64 {
            return 0..0;
        }
        let first = (position.ceil() as i64 - reach).max(0);
        let end = (position.floor() as i64 + reach + 1).min(bins as i64);
        first as usize..end.max(first) as usize
    }

    /// Values of the kernel of a line at `position` bins in the bins of `range`.
    ///
    /// A 3/4-length rectangle convolved with a quarter-length half cosine: at `d` bins
    /// `(sin(pi d) + sin(pi d / 2)) / (1.5 pi d (1 - d^2 / 4))`. From bin to bin the numerator goes through four
    /// values, so it is exact at the price of one division. A table with straight lines between its points errs in
    /// proportion to the kernel's curvature, which is a gain that bends over the run.
    fn kernel(&self, position: f64, range: Range<usize>) -> impl Iterator<Item = C> {
        let first = range.start as f64 - position;
        let whole = first.round();
        let part = first - whole;
        let part = if part.abs() < LEAST_DISTANCE { LEAST_DISTANCE.copysign(part) } else { part };
        let (sine, half_sine, half_cosine) = ((PI * part).sin(), (0.5 * PI * part).sin(), (0.5 * PI * part).cos());
        let over_four = [sine + half_sine, half_cosine - sine, sine - half_sine, -half_cosine - sine];
        let mut turn = self.phase_at(first);
        (whole as i64..).zip(range).map(move |(bins, _)| {
            let distance = bins as f64 + part;
            let denominator = 1.5 * PI * distance * (1.0 - 0.25 * distance * distance);
            let value = turn * (over_four[(bins & 3) as usize] / denominator);
            turn *= self.turn_per_bin;
            value
        })
    }

    /// Adds a line of complex amplitude `a` at `hz` (either sign) to `bins`.
    pub fn add_line(&self, bins: &mut [C], hz: f64, a: C, reach: i64) {
        let duration = self.duration_s();
        for (position, amplitude) in [(hz * duration, a), (-hz * duration, a.conj())] {
            let range = Self::reached(position, bins.len(), reach);
            if !range.is_empty() {
                let near = bins[range.clone()].iter_mut();
                near.zip(self.kernel(position, range)).for_each(|(bin, value)| *bin += amplitude * value);
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

    /// [`Self::bins_of_lines`] of both channels, without the bins that no line reaches.
    ///
    /// A spectrum has thousands of bins, a template's lines reach some hundreds.
    pub fn templates_of_lines(&self, lines: &[Line], offset_rad: f64, shaft_hz: f64, reach: i64) -> [Sparse; 2] {
        let duration = self.duration_s();
        let position = |line: &Line| line.order * shaft_hz * duration;
        let range = |position: f64| Self::reached(position, self.bins, reach);
        let both = lines.iter().flat_map(|line| [range(position(line)), range(-position(line))]);
        let parts = joined(both.filter(|range| !range.is_empty()).collect());
        let place = |bin: usize| {
            let (range, before) = &parts[parts.partition_point(|(range, _)| range.end <= bin)];
            before + bin - range.start
        };
        let size = parts.last().map_or(0, |(range, before)| before + range.len());
        let mut values = [vec![C::ZERO; size], vec![C::ZERO; size]];
        for line in lines {
            let amplitude = line.amplitude.map(|a| a * C::cis(line.order * offset_rad));
            for (position, sign) in [(position(line), 1.0), (-position(line), -1.0)] {
                let range = range(position);
                if range.is_empty() {
                    continue;
                }
                let from = place(range.start);
                let [a, b] = amplitude.map(|a| C::new(a.re, sign * a.im));
                let [one, other] = values.each_mut().map(|values| values[from..from + range.len()].iter_mut());
                for ((one, other), value) in one.zip(other).zip(self.kernel(position, range)) {
                    *one += a * value;
                    *other += b * value;
                }
            }
        }
        let lengths = || parts.iter().map(|(range, _)| (range.start, range.len()));
        values.map(|values| Sparse::from_parts(&values, lengths()))
    }

    /// Least-squares complex amplitude of a line at `hz` in `bins`, and the sum of squared kernel values used.
    pub fn amplitude(&self, bins: &[C], hz: f64) -> (C, f64) {
        let position = hz * self.duration_s();
        let range = Self::reached(position, bins.len(), 3);
        let (mut sum, mut energy) = (C::ZERO, 1e-30);
        if !range.is_empty() {
            for (bin, value) in bins[range.clone()].iter().zip(self.kernel(position, range)) {
                sum += value.conj() * bin;
                energy += value.norm_sqr();
            }
        }
        (sum / energy, energy)
    }
}

/// Ranges that touch or overlap made one, ascending, each with the number of bins in those before it.
fn joined(mut ranges: Vec<Range<usize>>) -> Vec<(Range<usize>, usize)> {
    ranges.sort_unstable_by_key(|range| range.start);
    let mut parts: Vec<(Range<usize>, usize)> = Vec::new();
    for range in ranges {
        match parts.last_mut() {
            Some((last, _)) if range.start <= last.end => last.end = last.end.max(range.end),
            last => {
                let before = last.map_or(0, |(last, before)| *before + last.len());
                parts.push((range, before));
            }
        }
    }
    parts
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
    fn ref_templates_of_lines_are_their_dense_bins() {
        let analyser = Analyser::new(4096, 1000.0);
        let amplitude = |i: usize| [C::new(1.0, i as f64), if i == 3 { C::ZERO } else { C::new(-0.5, 0.25) }];
        // Neighbours that overlap, one beside zero, one beside the last bin, one out of sight.
        let orders = [0.01, 3.1, 3.3, 20.0, 43.9, 1e6];
        let lines: Vec<Line> =
            orders.iter().enumerate().map(|(i, &order)| Line { order, amplitude: amplitude(i) }).collect();
        let templates = analyser.templates_of_lines(&lines, 0.7, 10.2, REACH);
        for (channel, template) in templates.iter().enumerate() {
            let dense = analyser.bins_of_lines(&lines, 0.7, 10.2, channel, REACH);
            let mut found = vec![C::ZERO; analyser.bins];
            template.iter().for_each(|(bin, x)| found[bin] += x);
            let worst = dense.iter().zip(&found).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
            assert!(worst < 1e-6, "channel {channel}: {worst}");
            assert_eq!(template.iter().count(), dense.iter().filter(|x| **x != C::ZERO).count());
        }
    }

    /// Lines on a bin, beside one and between two, near the band's ends: what the window makes of them, sample by
    /// sample.
    #[test]
    fn ref_kernel_is_the_transform_of_the_window() {
        let mut analyser = Analyser::new(4000, 1000.0);
        analyser.bins = 1800;
        for hz in [90.0, 90.0 + 1e-9, 101.0313, 111.125, 60.2499] {
            let signal: Vec<f64> = (0..4000).map(|i| (2.0 * PI * hz * i as f64 / 1000.0 + 0.4).cos()).collect();
            let measured = analyser.bins_of(&signal);
            let mut line = vec![C::ZERO; analyser.bins];
            analyser.add_line(&mut line, hz, C::cis(0.4), STRONG_HALF_WIDTH_BINS);
            let place = (hz * 4.0) as usize;
            let worst = (place - 100..place + 100).map(|b| (measured[b] - line[b]).norm()).fold(0.0, f64::max);
            assert!(worst < 1e-6, "{hz} Hz: {worst:e}");
        }
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
