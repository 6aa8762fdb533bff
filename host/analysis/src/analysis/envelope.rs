//! Squared envelope of the most impulsive band of what is locked to neither shaft, over orders.
//!
//! 1. What repeats with either shaft, and the feet of its lines, is taken off in time, so that resonances keep their
//!    frequency.
//! 2. Third-octave and octave bands, wide enough for several harmonics of a passage: each band's complex envelope by
//!    the Fourier transform, at twice the band's width. The band with the highest excess kurtosis of the squared
//!    envelope, in standard errors of Gaussian noise, is taken; the kurtosis is the median over eight stretches, so
//!    one knock does not decide.
//! 3. Its squared envelope, less its mean and over it, is read at equal angles: lines are shares of the band's mean
//!    power.
//!
//! Sources: Antoni 2006 and 2007 (spectral kurtosis, fast kurtogram: here fixed bands); Randall, Antoni 2011 (order
//! of the steps). Limits: a modulation that is not impulsive hardly raises the kurtosis and may stand in another
//! band; a run-up moves a band through orders, and carries its resonances along in time as it should.

use super::angle::Angle;
use super::coherence::Coherence;
use super::search::{self, Level, Line};
use crate::spectral::{self, Kaiser, resample_by_angle, smooth_length};
use rayon::prelude::*;
use rustfft::num_complex::Complex64;
use serde::Serialize;

/// Least width of a band, in turns of the pinion per second: four harmonics of a passage of order 5.
const LEAST_WIDTH: f64 = 20.0;
/// Stretches over which the kurtosis' median is taken.
const STRETCHES: usize = 8;
/// Highest order of the envelope.
const HIGHEST_ORDER: f64 = 50.0;
/// Highest order of the map of coherence.
const MAP_ORDERS: f64 = 20.0;
/// Samples that one thread takes at a time.
const BLOCK: usize = 1 << 15;
/// Share of the sampling rate that bands keep below.
const PASS_SHARE: f64 = 0.45;

/// A band and its score.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Band {
    /// Lower edge, Hz.
    pub low_hz: f64,
    /// Upper edge, Hz.
    pub high_hz: f64,
    /// Excess kurtosis of the squared envelope, 0 in Gaussian noise.
    pub kurtosis: f64,
    /// The same in standard errors of Gaussian noise.
    pub score: f64,
}

/// The envelope of the chosen band.
#[derive(Debug, Clone, Serialize)]
pub struct Envelope {
    /// The band.
    pub band: Band,
    /// Bands tried.
    pub bands_tried: usize,
    /// RMS of the band, record's unit.
    pub rms: f64,
    /// Highest order looked at.
    pub highest_order: f64,
    /// Lines of the squared envelope over the floor, strongest first; amplitudes are shares of the band's mean power.
    pub lines: Vec<Line>,
    /// Its spectra, for the picture.
    #[serde(skip)]
    pub levels: Vec<Level>,
}

/// The signal less what is known of it on the grid (`locked`), over time; zero outside the grid's turns.
pub fn not_locked(signal: &[f64], rate_hz: f64, locked: &[f64], angle: &Angle) -> Vec<f64> {
    let kernel = Kaiser::tabulated();
    let (from, to) = angle.time_range();
    let per_turn = angle.per_turn[0] as f64;
    let mut rest = signal.to_vec();
    rest.par_chunks_mut(BLOCK).enumerate().for_each(|(block, rest)| {
        let first_s = (block * BLOCK) as f64 / rate_hz;
        let turns = angle.map.turns_along(first_s, 1.0 / rate_hz);
        for ((i, x), turns) in rest.iter_mut().enumerate().zip(turns) {
            let time = first_s + i as f64 / rate_hz;
            let inside = (from..=to).contains(&time);
            *x = if inside { *x - kernel.interpolate(locked, (turns - angle.from_turn) * per_turn) } else { 0.0 };
        }
    });
    rest
}

/// Fourier transform of a signal, to cut bands from.
struct Bands {
    bins: Vec<Complex64>,
    bin_hz: f64,
    samples: usize,
    rate_hz: f64,
    /// Share of the record that the grid's turns cover.
    span: (f64, f64),
}

impl Bands {
    fn new(signal: &[f64], rate_hz: f64, angle: &Angle) -> Self {
        // Longer by zeros, for a length whose transform is cheap: finer bins of the same signal.
        let samples = smooth_length(signal.len());
        let mut input = signal.to_vec();
        input.resize(samples, 0.0);
        let forward = spectral::forward(samples);
        let mut bins = forward.make_output_vec();
        forward.process(&mut input, &mut bins).expect("buffers have the planned lengths");
        let duration = samples as f64 / rate_hz;
        let (from, to) = angle.time_range();
        Self { bins, bin_hz: 1.0 / duration, samples, rate_hz, span: (from / duration, to / duration) }
    }

    /// Squared envelope of a band over its mean, less one, and its sampling rate.
    fn relative(&self, low_hz: f64, high_hz: f64) -> (Vec<f64>, f64) {
        let (squared, rate) = self.squared_envelope(low_hz, high_hz);
        let inside = self.within(&squared);
        let mean = inside.iter().sum::<f64>() / inside.len().max(1) as f64;
        (squared.iter().map(|e| if mean > 0.0 { e / mean - 1.0 } else { 0.0 }).collect(), rate)
    }

    /// Squared envelope of a band and its sampling rate.
    fn squared_envelope(&self, low_hz: f64, high_hz: f64) -> (Vec<f64>, f64) {
        let first = (low_hz / self.bin_hz) as usize;
        let last = ((high_hz / self.bin_hz) as usize).min(self.bins.len() - 1);
        let count = last - first + 1;
        let length = smooth_length(2 * count);
        let mut work = vec![Complex64::default(); length];
        // Shifted so that the band's middle stands at zero.
        for (i, bin) in self.bins[first..=last].iter().enumerate() {
            work[(i + length - count / 2) % length] = *bin * (2.0 / self.samples as f64);
        }
        spectral::inverse(length).process(&mut work);
        let rate = self.rate_hz * length as f64 / self.samples as f64;
        (work.iter().map(Complex64::norm_sqr).collect(), rate)
    }

    /// The part of an envelope within the grid's turns.
    fn within<'a>(&self, envelope: &'a [f64]) -> &'a [f64] {
        let at = |share: f64| ((share * envelope.len() as f64) as usize).min(envelope.len());
        &envelope[at(self.span.0)..at(self.span.1)]
    }

    fn scored(&self, low_hz: f64, high_hz: f64) -> Band {
        let (envelope, _) = self.squared_envelope(low_hz, high_hz);
        let inside = self.within(&envelope);
        let mut parts: Vec<f64> =
            inside.chunks((inside.len() / STRETCHES).max(1)).take(STRETCHES).map(excess).collect();
        parts.sort_by(f64::total_cmp);
        let kurtosis = 0.5 * (parts[(parts.len() - 1) / 2] + parts[parts.len() / 2]);
        // Of n independent values of a complex Gaussian the variance is 4 / n; half the samples are independent, and a
        // median over the stretches has 1.25 times the error of a mean.
        let error = 1.25 * (8.0 / inside.len().max(1) as f64).sqrt();
        Band { low_hz, high_hz, kurtosis, score: kurtosis / error }
    }
}

/// Excess kurtosis of a complex signal from its squared envelope.
fn excess(envelope: &[f64]) -> f64 {
    let count = envelope.len().max(1) as f64;
    let mean = envelope.iter().sum::<f64>() / count;
    let squares = envelope.iter().map(|e| e * e).sum::<f64>() / count;
    if mean > 0.0 { squares / (mean * mean) - 2.0 } else { 0.0 }
}

/// Third octaves about 1 kHz and octaves made of three of them.
fn candidates(rate_hz: f64, fastest_hz: f64) -> Vec<(f64, f64)> {
    let edge = |k: i32| 1000.0 * 2.0_f64.powf((f64::from(k) - 0.5) / 3.0);
    let all = (-36..60).flat_map(|k| [(edge(k), edge(k + 1)), (edge(k), edge(k + 3))]);
    let fits: Vec<(f64, f64)> =
        all.filter(|(low, high)| *high <= PASS_SHARE * rate_hz && high - low >= LEAST_WIDTH * fastest_hz).collect();
    if fits.is_empty() { vec![(0.25 * PASS_SHARE * rate_hz, PASS_SHARE * rate_hz)] } else { fits }
}

/// RMS of a band of a signal within the grid's turns, in the signal's unit.
pub fn band_rms(signal: &[f64], rate_hz: f64, angle: &Angle, band: &Band) -> f64 {
    let bands = Bands::new(signal, rate_hz, angle);
    let (squared, _) = bands.squared_envelope(band.low_hz, band.high_hz);
    let inside = bands.within(&squared);
    (0.5 * inside.iter().sum::<f64>() / inside.len().max(1) as f64).sqrt()
}

/// The envelope of `rest` ([`not_locked`]), and the coherence of all bands.
pub fn envelope(rest: &[f64], rate_hz: f64, angle: &Angle) -> (Envelope, Coherence) {
    let bands = Bands::new(rest, rate_hz, angle);
    let tried = candidates(rate_hz, angle.speed.fastest_hz);
    let scored: Vec<Band> = tried.par_iter().map(|&(low, high)| bands.scored(low, high)).collect();
    let best = scored.iter().copied().max_by(|a, b| a.score.total_cmp(&b.score));
    let band = best.expect("at least one band is tried");
    let coherence = Coherence::of(&|low, high| bands.relative(low, high), angle, (PASS_SHARE * rate_hz, MAP_ORDERS));
    (Envelope { bands_tried: tried.len(), ..of_band(&bands, band, angle) }, coherence)
}

/// All that a record passes above the slow orders, unscored.
pub fn whole_band(rate_hz: f64, fastest_hz: f64) -> Band {
    let high_hz = PASS_SHARE * rate_hz;
    Band { low_hz: (LEAST_WIDTH * fastest_hz).min(0.5 * high_hz), high_hz, kurtosis: 0.0, score: 0.0 }
}

/// The envelope of `rest` in a band that was chosen elsewhere.
pub fn in_band(rest: &[f64], rate_hz: f64, angle: &Angle, band: Band) -> Envelope {
    of_band(&Bands::new(rest, rate_hz, angle), band, angle)
}

fn of_band(bands: &Bands, band: Band, angle: &Angle) -> Envelope {
    let (squared, rate) = bands.squared_envelope(band.low_hz, band.high_hz);
    let inside = bands.within(&squared);
    let mean = inside.iter().sum::<f64>() / inside.len().max(1) as f64;
    let relative: Vec<f64> = squared.iter().map(|e| if mean > 0.0 { e / mean - 1.0 } else { 0.0 }).collect();
    let per_turn = (1.25 * rate / angle.speed.slowest_hz).ceil() as usize;
    let samples = resample_by_angle(&relative, rate, &angle.map, angle.from_turn, angle.turns, per_turn);
    let highest_order = (0.8 * (band.high_hz - band.low_hz) / angle.speed.fastest_hz).min(HIGHEST_ORDER);
    // Shaft orders are lines of the envelope as well: all are listed, and told apart later.
    let range = search::Range { lowest: 0.0, highest: highest_order, known: &|_, _| false };
    let levels = search::levels(&samples, per_turn, angle.slower_order(), &range);
    let mut lines = search::lines(&levels, &range);
    lines.sort_by(|a, b| b.amplitude.total_cmp(&a.amplitude));
    Envelope { band, bands_tried: 1, rms: (0.5 * mean).sqrt(), highest_order, lines, levels }
}
