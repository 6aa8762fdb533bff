//! Squared envelopes over orders in a bank of bands, of what is deterministic in none.
//!
//! 1. What repeats with either shaft is taken off in time, and every narrow line that stands over its own
//!    neighbourhood (supply, inverter, another machine) is cut down to it: discrete and random separation in one
//!    transform of the record.
//! 2. Each band's complex envelope by the inverse transform of its bins under a Hann window; its square, low-passed,
//!    at equal angles.
//! 3. Spectrum over orders of the fitted and of the held-out turns, over a running median of about one order.
//! 4. The mean of the spectra of all bands of one width: damage that excites many bands a little stands there.
//!
//! Sources: Antoni 2007 (bank), Randall and Antoni 2011 (order of the steps), Abboud and others 2017 (the spectrum
//! integrated over the carriers). Cost: one transform of the record and eight for the bank. Limit: in a run-up the
//! highest order falls by the ratio of the speeds.

use super::thresholds::{
    FIT_TURN_SHARE, HELD_OUT_START_SHARE, HIGHEST_ORDER, LEAST_WIDTH, LINE_FLOOR_RATIO, MIN_MEAN_BANDS, PARTS, PER_TURN,
};
use crate::analysis::average::locked_part;
use crate::analysis::envelope::not_locked;
use crate::baseline::Grids;
use crate::mesh_line_tracking::followed;
use crate::scene::{Scene, SceneRun};
use crate::spectral::{self, Window, resample_by_angle, running_median};
use rayon::prelude::*;
use rustfft::num_complex::Complex64;

/// Bins about a line that its floor is the median of: as the running median has them.
const FLOOR_HOP: usize = 16;
/// Fewest bins of a floor over orders.
const FEWEST_BINS: usize = 31;

/// One spectrum over orders.
#[derive(Debug, Clone)]
pub struct Spectrum {
    /// Width of a bin, orders.
    pub bin: f64,
    /// Power over the floor.
    pub over: Vec<f64>,
    /// Amplitude as a share of the band's mean power.
    pub depth: Vec<f64>,
}

/// A band of a channel.
#[derive(Debug, Clone)]
pub struct Band {
    /// Run of the scene.
    pub run: usize,
    /// Channel of the scene.
    pub channel: usize,
    /// Edges, Hz.
    pub hz: [f64; 2],
    /// Bands of one width that it is the mean of.
    pub meaned: usize,
    /// Fitted and held-out turns.
    pub parts: [Spectrum; 2],
}

/// The bank of every run and channel searched.
pub fn bank(scene: &Scene, left: &Grids) -> Vec<Band> {
    let followed = followed(scene, left);
    let places: Vec<(usize, usize)> =
        (0..scene.runs.len()).flat_map(|r| (0..scene.searched).map(move |c| (r, c))).collect();
    let of_channel = |&(r, c): &(usize, usize)| {
        let run = &scene.runs[r];
        let random = Random::of(run, c, &followed[r][c]);
        let half = 0.5 * run.rate_hz;
        let of_width = |n: usize| -> Vec<Band> {
            let edges = (0..n).map(|i| [i, i + 1].map(|e| e as f64 * half / n as f64));
            let wide = edges.filter(|[low, high]| high - low >= LEAST_WIDTH * run.angle.speed.fastest_hz);
            let edges: Vec<[f64; 2]> = wide.collect();
            let band = |hz: [f64; 2]| Band { run: r, channel: c, hz, meaned: 1, parts: random.spectra(run, hz) };
            let mut bands: Vec<Band> = edges.into_par_iter().map(band).collect();
            bands.extend(Band::mean(&bands));
            bands
        };
        PARTS.into_iter().flat_map(of_width).collect::<Vec<Band>>()
    };
    places.par_iter().flat_map(of_channel).collect()
}

impl Band {
    /// The mean of bands side by side; none of too few.
    fn mean(bands: &[Self]) -> Option<Self> {
        let [first, .., last] = bands else { return None };
        let part = |p: usize| Spectrum::mean(&bands.iter().map(|band| &band.parts[p]).collect::<Vec<_>>());
        let hz = [first.hz[0], last.hz[1]];
        let is_many = bands.len() >= MIN_MEAN_BANDS;
        is_many.then(|| Self { hz, meaned: bands.len(), parts: [part(0), part(1)], ..*first })
    }
}

/// Transform of what is random in a channel.
struct Random {
    bins: Vec<Complex64>,
    samples: usize,
    rate_hz: f64,
}

impl Random {
    fn of(run: &SceneRun, channel: usize, followed: &[f64]) -> Self {
        let locked = locked_part(followed, &run.angle);
        let samples = &run.samples[channel];
        let known: Vec<f64> = samples.iter().zip(followed).zip(&locked).map(|((x, f), l)| x - f + l).collect();
        let mut rest = not_locked(&run.signals[channel], run.rate_hz, &known, &run.angle);
        let count = rest.len();
        let forward = spectral::forward(count);
        let mut bins = forward.make_output_vec();
        forward.process(&mut rest, &mut bins).expect("buffers have the planned lengths");
        let power: Vec<f64> = bins.iter().map(Complex64::norm_sqr).collect();
        // The median of an exponential variable is ln 2 of its mean.
        let floor = running_median(&power, FLOOR_HOP);
        for ((bin, power), floor) in bins.iter_mut().zip(&power).zip(&floor) {
            let most = LINE_FLOOR_RATIO * floor / std::f64::consts::LN_2;
            *bin *= (most / power.max(f64::MIN_POSITIVE)).sqrt().min(1.0);
        }
        Self { bins, samples: count, rate_hz: run.rate_hz }
    }

    fn spectra(&self, run: &SceneRun, hz: [f64; 2]) -> [Spectrum; 2] {
        let (squared, rate_hz) = self.squared_envelope(hz, run.angle.speed.slowest_hz);
        let angle = &run.angle;
        let samples = resample_by_angle(&squared, rate_hz, &angle.map, angle.from_turn, angle.turns, PER_TURN);
        let at = |share: f64| (share * angle.turns as f64) as usize * PER_TURN;
        let speed = angle.speed;
        let highest = (HIGHEST_ORDER * speed.slowest_hz / speed.fastest_hz).min((hz[1] - hz[0]) / speed.fastest_hz);
        [&samples[..at(FIT_TURN_SHARE)], &samples[at(HELD_OUT_START_SHARE)..]].map(|part| Spectrum::of(part, highest))
    }

    /// Squared envelope of a band, low-passed, and its rate.
    fn squared_envelope(&self, hz: [f64; 2], slowest_hz: f64) -> (Vec<f64>, f64) {
        let at = |hz: f64| ((hz * self.samples as f64 / self.rate_hz) as usize).min(self.bins.len() - 1);
        let band = &self.bins[at(hz[0])..at(hz[1])];
        let length = 2 * band.len();
        let mut work = vec![Complex64::default(); length];
        for (i, (slot, bin)) in work.iter_mut().zip(band).enumerate() {
            *slot = *bin * Window::Hann.weight((i as f64 + 0.5) / band.len() as f64);
        }
        spectral::inverse(length).process(&mut work);
        let mut squared: Vec<f64> = work.iter().map(Complex64::norm_sqr).collect();
        let seconds = self.samples as f64 / self.rate_hz;
        let wanted = (2.0 * PER_TURN as f64 * slowest_hz * seconds) as usize;
        if wanted >= length {
            return (squared, length as f64 / seconds);
        }
        let forward = spectral::forward(length);
        let mut bins = forward.make_output_vec();
        forward.process(&mut squared, &mut bins).expect("buffers have the planned lengths");
        let inverse = spectral::backward(wanted);
        let mut low = inverse.make_input_vec();
        // Three quarters of the grid's own Nyquist order pass, nothing above: the resampling has room between.
        let pass = 3 * low.len() / 8;
        low[..pass].copy_from_slice(&bins[..pass]);
        low[0].im = 0.0;
        let mut out = inverse.make_output_vec();
        inverse.process(&mut low, &mut out).expect("buffers have the planned lengths");
        (out, wanted as f64 / seconds)
    }
}

impl Spectrum {
    fn of(samples: &[f64], highest: f64) -> Self {
        let count = samples.len().max(1);
        let mean = samples.iter().sum::<f64>() / count as f64;
        let weights = Window::Hann.weights(samples.len());
        let sum: f64 = weights.iter().sum();
        let mut weighted: Vec<f64> = samples.iter().zip(&weights).map(|(x, w)| (x - mean) * w).collect();
        let bin = PER_TURN as f64 / count as f64;
        let mut power = Vec::new();
        if !weighted.is_empty() {
            let forward = spectral::forward(weighted.len());
            let mut bins = forward.make_output_vec();
            forward.process(&mut weighted, &mut bins).expect("buffers have the planned lengths");
            power = bins.iter().take((highest / bin) as usize).map(Complex64::norm_sqr).collect();
        }
        let floor = floor(&power, ((1.0 / bin) as usize).max(FEWEST_BINS));
        let over = power.iter().zip(&floor).map(|(p, f)| p / f.max(f64::MIN_POSITIVE)).collect();
        let scale = 2.0 / (sum * mean).max(f64::MIN_POSITIVE);
        Self { bin, over, depth: power.iter().map(|p| scale * p.sqrt()).collect() }
    }

    /// The mean of spectra with one width of bins.
    fn mean(all: &[&Self]) -> Self {
        let count = all.iter().map(|own| own.over.len()).min().unwrap_or(0);
        let mean = |of: fn(&Self) -> &[f64]| -> Vec<f64> {
            (0..count).map(|i| all.iter().map(|own| of(own)[i]).sum::<f64>() / all.len() as f64).collect()
        };
        Self { bin: all[0].bin, over: mean(|own| &own.over), depth: mean(|own| &own.depth) }
    }

    /// Highest bin next to an order.
    pub fn at(&self, order: f64) -> f64 {
        highest_beside(&self.over, order / self.bin)
    }

    /// Depth of a line at an order.
    pub fn depth_at(&self, order: f64) -> f64 {
        highest_beside(&self.depth, order / self.bin)
    }
}

fn highest_beside(values: &[f64], place: f64) -> f64 {
    let centre = place.round().max(0.0) as usize;
    let near = centre.saturating_sub(1)..(centre + 2).min(values.len());
    values.get(near).map_or(0.0, |near| near.iter().copied().fold(0.0, f64::max))
}

/// Mean of the noise about each bin: the median of so many, taken anew every eighth of them.
fn floor(power: &[f64], width: usize) -> Vec<f64> {
    let hop = (width / 8).max(1);
    let block = |b: usize| {
        let centre = b * hop + hop / 2;
        let from = centre.saturating_sub(width / 2);
        let mut near = power[from..(centre + width / 2 + 1).min(power.len())].to_vec();
        let middle = near.len() / 2;
        *near.select_nth_unstable_by(middle, f64::total_cmp).1 / std::f64::consts::LN_2
    };
    let blocks: Vec<f64> = (0..power.len().div_ceil(hop)).map(block).collect();
    (0..power.len()).map(|i| blocks[i / hop]).collect()
}
