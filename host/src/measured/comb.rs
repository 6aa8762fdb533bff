//! Combs of lines in a power spectrum: finding a spacing, naming its lines, the share of variance they hold.
//!
//! The search works on power over the local floor (median of 129 bins), averaged over channels and capped, so that neither a loud
//! channel nor one strong line decides. A spacing `s` predicts lines at `c + j s` around carriers `c`; its score is the mean excess
//! times the square root of the number of lines, which is largest at the true spacing: half of it wastes lines,
//! twice of it misses them. Shares are sums of Hann-windowed periodogram bins. Cost: spacings x lines look-ups.

use crate::spectral::{Window, amplitude_spectrum, running_median};
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

/// One-sided power per bin; the values sum to the windowed variance.
#[derive(Debug, Clone)]
pub struct Power {
    /// Spacing of bins, Hz or orders.
    pub bin: f64,
    /// Power per bin.
    pub values: Vec<f64>,
}

impl Power {
    /// Periodogram with a Hann window, mean removed, of samples taken at `rate` (per second or per turn).
    pub fn new(signal: &[f64], rate: f64) -> Self {
        let spectrum = amplitude_spectrum(signal, rate, Window::Hann);
        let values = spectrum.values.iter().map(|a| 0.5 * a * a / Window::Hann.enbw_bins()).collect();
        Self { bin: spectrum.bin, values }
    }

    /// Sum over all bins.
    pub fn total(&self) -> f64 {
        self.values.iter().sum()
    }

    /// Sum over the marked bins.
    pub fn within(&self, mask: &[bool]) -> f64 {
        self.values.iter().zip(mask).filter(|(_, m)| **m).map(|(v, _)| v).sum()
    }

    /// Marks the bins within `half_width` of `at`.
    pub fn mark(&self, mask: &mut [bool], at: f64, half_width: f64) {
        let first = ((at - half_width) / self.bin).ceil().max(0.0) as usize;
        let last = ((at + half_width) / self.bin).floor();
        if last >= 0.0 {
            let last = (last as usize).min(mask.len().saturating_sub(1));
            if first <= last {
                mask[first..=last].fill(true);
            }
        }
    }

    /// A mask of the bins within `half_width` of any line.
    pub fn mask(&self, lines: &[f64], half_width: f64) -> Vec<bool> {
        let mut mask = vec![false; self.values.len()];
        lines.iter().for_each(|&at| self.mark(&mut mask, at, half_width));
        mask
    }

    /// Power over its local floor: 1 on average in noise.
    pub fn over_floor(&self) -> Vec<f64> {
        // The median of an exponential variable is ln 2 of its mean.
        let floor = |median: f64| (median / std::f64::consts::LN_2).max(f64::MIN_POSITIVE);
        self.values.iter().zip(running_median(&self.values, 32)).map(|(x, median)| x / floor(median)).collect()
    }
}

/// Mean over channels of power over floor, on the bins of the first channel.
pub fn mean_excess(channels: &[Power]) -> Vec<f64> {
    let mut mean = vec![0.0; channels.first().map_or(0, |c| c.values.len())];
    for channel in channels {
        for (m, e) in mean.iter_mut().zip(channel.over_floor()) {
            *m += e / channels.len() as f64;
        }
    }
    mean
}

/// What a comb search looks through.
#[derive(Debug, Clone)]
pub struct Search {
    /// Least and largest spacing.
    pub spacing: [f64; 2],
    /// Lines on each side of a carrier.
    pub multiples: i32,
    /// Carriers; 0 stands for the comb `j s` itself.
    pub carriers: Vec<f64>,
    /// Highest line.
    pub top: f64,
}

/// A spacing found.
#[derive(Debug, Clone, Copy)]
pub struct Found {
    /// Spacing, unit of the spectrum.
    pub spacing: f64,
    /// Standard deviations of the score of all spacings tried (robust) above their median.
    pub sigma: f64,
}

/// Excess of one line counts up to this: 20 dB.
const CAP: f64 = 100.0;

impl Search {
    fn lines(&self, spacing: f64) -> Vec<f64> {
        let mut lines = Vec::new();
        for &carrier in &self.carriers {
            let first = if carrier == 0.0 { 1 } else { -self.multiples };
            let around = (first..=self.multiples).filter(|j| *j != 0).map(|j| carrier + f64::from(j) * spacing);
            lines.extend(around.filter(|at| *at > 0.0 && *at < self.top));
        }
        lines
    }

    fn score(&self, bin: f64, height: &[f64], spacing: f64) -> f64 {
        let (mut sum, mut count) = (0.0, 0.0);
        for at in self.lines(spacing) {
            if let Some(h) = height.get((at / bin).round() as usize)
                && h.is_finite()
            {
                sum += h;
                count += 1.0;
            }
        }
        if count > 3.0 { sum / f64::sqrt(count) } else { f64::NEG_INFINITY }
    }

    /// The spacing whose comb stands highest above the local floor outside `named` bins.
    pub fn best(&self, bin: f64, excess: &[f64], named: &[bool]) -> Option<Found> {
        // Logarithm of the excess, centred: a comb through noise scores zero on average.
        let mut height: Vec<f64> = excess.iter().map(|e| e.clamp(0.1, CAP).ln()).collect();
        let free: Vec<f64> = height.iter().zip(named).filter(|(_, n)| !**n).map(|(h, _)| *h).collect();
        let mean = free.iter().sum::<f64>() / free.len().max(1) as f64;
        for (h, n) in height.iter_mut().zip(named) {
            *h = if *n { f64::NAN } else { *h - mean };
        }
        let step = 0.4 * bin / f64::from(self.multiples);
        let count = ((self.spacing[1] - self.spacing[0]) / step) as usize;
        let scores: Vec<(f64, f64)> = (0..=count)
            .map(|i| self.spacing[0] + step * i as f64)
            .map(|s| (s, self.score(bin, &height, s)))
            .filter(|s| s.1.is_finite())
            .collect();
        let best = scores.iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
        let mut sorted: Vec<f64> = scores.iter().map(|s| s.1).collect();
        sorted.sort_by(f64::total_cmp);
        let quantile = |q: f64| sorted[((sorted.len() - 1) as f64 * q) as usize];
        let (median, spread) = (quantile(0.5), quantile(0.84) - quantile(0.5));
        Some(Found { spacing: best.0, sigma: (best.1 - median) / spread.max(1e-12) })
    }
}

impl Search {
    /// Largest score that chance gives: the best comb of 20 spectra with the same lines at shuffled places (blocks of four bins, so that
    /// main lobes stay whole). Exceeding it has a family-wise probability of about 5 %.
    pub fn chance(&self, bin: f64, excess: &[f64], named: &[bool]) -> f64 {
        (0..20_u64)
            .into_par_iter()
            .filter_map(|seed| {
                let top = ((self.top / bin) as usize).min(excess.len());
                let free: Vec<usize> = (0..top).filter(|&i| !named[i]).collect();
                let mut blocks: Vec<&[usize]> = free.chunks(4).collect();
                blocks.shuffle(&mut ChaCha8Rng::seed_from_u64(seed));
                let mut shuffled = excess.to_vec();
                for (to, from) in free.iter().zip(blocks.concat()) {
                    shuffled[*to] = excess[from];
                }
                self.best(bin, &shuffled, named).map(|f| f.sigma)
            })
            .reduce(|| f64::NEG_INFINITY, f64::max)
    }
}

/// Lines `carrier + j spacing` that stand at least `least` times above the floor within one bin.
pub fn standing(bin: f64, excess: &[f64], candidates: &[f64], least: f64) -> Vec<f64> {
    let stands = |at: f64| {
        let i = (at / bin).round() as usize;
        let near = i.saturating_sub(1)..=(i + 1).min(excess.len().saturating_sub(1));
        at > 0.0 && excess.get(near).is_some_and(|part| part.iter().any(|e| *e > least))
    };
    candidates.iter().copied().filter(|&at| stands(at)).collect()
}

/// Refines a spacing by the power-weighted position of lines `(carrier, multiple)` that stand out.
pub fn refine(bin: f64, excess: &[f64], carriers: &[f64], spacing: f64, multiples: i32) -> f64 {
    let (mut sum, mut weight) = (0.0, 0.0);
    for &carrier in carriers {
        for j in (-multiples..=multiples).filter(|j| *j != 0) {
            let at = carrier + f64::from(j) * spacing;
            let i = (at / bin).round();
            if i < 2.0 || (carrier == 0.0 && j < 0) || i as usize + 2 >= excess.len() {
                continue;
            }
            let near = &excess[i as usize - 1..=i as usize + 1];
            let power: f64 = near.iter().sum();
            if near.iter().all(|e| *e < 10.0) {
                continue;
            }
            let centre = (i - 1.0) + near.iter().enumerate().map(|(k, e)| k as f64 * e).sum::<f64>() / power;
            // Position error falls with the line's height, and the spacing's with its multiple.
            let w = f64::from(j * j) * power.min(CAP);
            sum += w * (centre * bin - carrier) / f64::from(j);
            weight += w;
        }
    }
    if weight > 0.0 { sum / weight } else { spacing }
}
