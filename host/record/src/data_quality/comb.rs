//! Finds the mesh frequency of a pair with known teeth by its comb.
//!
//! Every spectrum is first divided by its own local floor (running median), in dB, and averaged over the
//! channels, so that neither loud channels nor resonances decide. A mesh frequency f predicts lines at h f
//! (h = 1..5), at f +- n shaft rates, and at the pinion's rate; lines halfway between harmonics speak against
//! it (they would be harmonics of f / 2). Each line counts at most 30 dB, so that one strong foreign line (supply,
//! bearing) cannot win alone.

use crate::spectral::{Spectrum, Window, line_near, power_density, running_median};
use crate::{Error, Result};

/// Lowest mesh frequency searched without a guess, Hz.
const LOWEST_HZ: f64 = 30.0;
/// A guess is good to this share.
const GUESS_TOLERANCE: f64 = 0.03;
/// Most that one line counts, dB.
const LINE_CAP_DB: f64 = 30.0;

/// The mesh comb found.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Comb {
    /// Mesh frequency, Hz.
    pub mesh_hz: f64,
    /// Mean excess of its lines over the local floor, dB, less that of the places between.
    pub excess_db: f64,
    /// The pinion's own line, where one stands out within 0.2 % of mesh / teeth.
    pub pinion_line_hz: Option<f64>,
}

/// Searches the comb near `guess_hz`, or everywhere.
pub(crate) fn find(
    place: &str,
    channels: &[Vec<f64>],
    rate_hz: f64,
    teeth: [u32; 2],
    guess_hz: Option<f64>,
) -> Result<Comb> {
    let combs = Combs::new(place, channels, rate_hz, teeth)?;
    let excess = &combs.excess;
    let (from, to) = match guess_hz {
        Some(guess) => ((1.0 - GUESS_TOLERANCE) * guess, (1.0 + GUESS_TOLERANCE) * guess),
        None => (LOWEST_HZ.max(20.0 * excess.bin), 0.2 * rate_hz),
    };
    if !(combs.can_see(from) && combs.can_see(to)) {
        let samples = channels.first().map_or(0, Vec::len);
        let what =
            format!("a mesh line from {from:.1} to {to:.1} Hz cannot be seen at {rate_hz} Hz over {samples} samples");
        return Err(Error::invalid(place, what));
    }
    let (mesh_hz, score) = combs.best_between(from, to);
    // Half the sideband spacing keeps the neighbour out; the comb is good to a bin or so.
    let slower_hz = mesh_hz / f64::from(teeth[0].max(teeth[1]));
    let width = combs.line_width_hz().min(0.4 * slower_hz);
    let mesh_hz = refine(channels, rate_hz, mesh_hz, width).unwrap_or(mesh_hz);
    let pinion_hz = mesh_hz / f64::from(teeth[0]);
    let pinion_line_hz = if at(excess, pinion_hz) > 10.0 {
        refine(channels, rate_hz, pinion_hz, (0.002 * pinion_hz).max(2.0 * excess.bin))
    } else {
        None
    };
    Ok(Comb { mesh_hz, excess_db: score, pinion_line_hz })
}

/// Spectrum over its local floor, and how well combs fit it.
pub(crate) struct Combs {
    excess: Spectrum,
    teeth: [u32; 2],
    rate_hz: f64,
}

impl Combs {
    /// Of channels sampled at `rate_hz`.
    pub(crate) fn new(place: &str, channels: &[Vec<f64>], rate_hz: f64, teeth: [u32; 2]) -> Result<Self> {
        let samples = channels.first().map_or(0, Vec::len);
        let segment = ((4.0 * rate_hz) as usize).min(samples);
        if segment < 1024 {
            return Err(Error::impossible(place, format!("{samples} samples are too few to find a mesh line")));
        }
        Ok(Self { excess: excess_db(channels, rate_hz, segment), teeth, rate_hz })
    }

    /// Of a spectrum over its floor.
    pub(super) fn of(excess: Spectrum, teeth: [u32; 2], rate_hz: f64) -> Self {
        Self { excess, teeth, rate_hz }
    }

    /// Whether a mesh frequency lies where lines can be told from each other.
    pub(crate) fn can_see(&self, mesh_hz: f64) -> bool {
        mesh_hz > 10.0 * self.excess.bin && mesh_hz < 0.45 * self.rate_hz
    }

    /// Distance within which a line belongs to the place where the comb was found, Hz.
    pub(crate) fn line_width_hz(&self) -> f64 {
        3.0 * self.excess.bin
    }

    /// Mean excess of the comb at this mesh frequency, dB per line.
    pub(crate) fn score(&self, mesh_hz: f64) -> f64 {
        score(&self.excess, mesh_hz, self.teeth, self.rate_hz)
    }

    /// The same with another number of teeth of the pinion.
    pub(crate) fn score_with(&self, mesh_hz: f64, pinion_teeth: u32) -> f64 {
        score(&self.excess, mesh_hz, [pinion_teeth, self.teeth[1]], self.rate_hz)
    }

    /// How many of the comb's own harmonics, without its sidebands, stand `least_db` over their surroundings.
    pub(crate) fn harmonics(&self, mesh_hz: f64, least_db: f64) -> usize {
        let harmonics = (1..=5).map(|h| f64::from(h) * mesh_hz).filter(|hz| *hz < 0.45 * self.rate_hz);
        harmonics.filter(|hz| at(&self.excess, *hz) >= least_db).count()
    }

    /// Mesh frequency of the best comb in a range, and its score.
    pub(crate) fn best_between(&self, from_hz: f64, to_hz: f64) -> (f64, f64) {
        let step = 0.5 * self.excess.bin;
        let candidates = (0..=((to_hz - from_hz) / step) as usize).map(|i| from_hz + step * i as f64);
        let scored = candidates.map(|hz| (hz, self.score(hz)));
        scored.max_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or((from_hz, 0.0))
    }
}

/// Mean over the channels of the spectrum over its local floor, dB.
pub(super) fn excess_db(channels: &[Vec<f64>], rate_hz: f64, segment: usize) -> Spectrum {
    let mut mean: Option<Spectrum> = None;
    for channel in channels {
        let density = power_density(channel, rate_hz, segment, Window::BlackmanHarris);
        let floor = running_median(&density.values, 16);
        let sum = mean.get_or_insert_with(|| Spectrum { bin: density.bin, values: vec![0.0; density.values.len()] });
        for ((s, d), f) in sum.values.iter_mut().zip(&density.values).zip(&floor) {
            let db = 10.0 * (d.max(f64::MIN_POSITIVE) / f.max(f64::MIN_POSITIVE)).log10();
            *s += db.clamp(-10.0, 2.0 * LINE_CAP_DB) / channels.len() as f64;
        }
    }
    mean.unwrap_or(Spectrum { bin: rate_hz / segment as f64, values: Vec::new() })
}

/// Excess at a frequency, the best of the nearest three bins.
fn at(excess: &Spectrum, hz: f64) -> f64 {
    let i = (hz / excess.bin).round() as usize;
    let last = excess.values.len().saturating_sub(1);
    let range = i.saturating_sub(1)..=(i + 1).min(last);
    excess.values.get(range).map_or(0.0, |part| part.iter().copied().fold(f64::NEG_INFINITY, f64::max)).min(LINE_CAP_DB)
}

/// Mean dB of the comb's lines less the mean of the places between; shaft sidebands weigh half.
fn score(excess: &Spectrum, mesh_hz: f64, teeth: [u32; 2], rate_hz: f64) -> f64 {
    let [pinion_hz, gear_hz] = teeth.map(|z| mesh_hz / f64::from(z));
    let (mut sum, mut weight) = (0.0, 0.0);
    for harmonic in (1..=5).map(f64::from).filter(|h| h * mesh_hz < 0.45 * rate_hz) {
        sum += at(excess, harmonic * mesh_hz) - 0.5 * at(excess, (harmonic - 0.5) * mesh_hz).max(0.0);
        weight += 1.0;
    }
    for offset in [pinion_hz, -pinion_hz, gear_hz, -gear_hz] {
        sum += 0.25 * at(excess, mesh_hz + offset);
        weight += 0.25;
    }
    sum += 0.5 * at(excess, pinion_hz);
    sum / (weight + 0.5)
}

/// Refines a frequency by least squares on the channel where it is strongest; `None` where no line is near.
fn refine(channels: &[Vec<f64>], rate_hz: f64, guess_hz: f64, half_width_hz: f64) -> Option<f64> {
    let lines = channels.iter().filter_map(|channel| line_near(channel, rate_hz, guess_hz, half_width_hz));
    lines.max_by(|a, b| a.amplitude.total_cmp(&b.amplitude)).map(|line| line.frequency_hz)
}
