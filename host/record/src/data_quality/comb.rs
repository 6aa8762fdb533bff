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
pub(crate) const GUESS_TOLERANCE: f64 = 0.03;
/// Most that one line counts, dB.
const LINE_CAP_DB: f64 = 30.0;
/// Least excess of a harmonic that is measured by itself, dB.
const HARMONIC_DB: f64 = 10.0;
/// Error of a line's frequency by least squares under Blackman-Harris weights, bins, times its amplitude over the
/// floor's in a bin.
const LINE_ERROR_BINS: f64 = 0.6;
/// Difference of scores that is none, dB.
const SAME_DB: f64 = 1e-9;

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
        None => combs.everywhere(),
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

/// Mesh frequency, Hz, of the best comb anywhere, and its excess, dB per line.
pub(crate) fn strongest(place: &str, channels: &[Vec<f64>], rate_hz: f64, teeth: [u32; 2]) -> Result<(f64, f64)> {
    let combs = Combs::new(place, channels, rate_hz, teeth)?;
    let (from, to) = combs.everywhere();
    Ok(combs.best_between(from, to))
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
        let scores: Vec<f64> =
            (0..=((to_hz - from_hz) / step) as usize).map(|i| self.score(from_hz + step * i as f64)).collect();
        let top = scores.iter().copied().max_by(f64::total_cmp).unwrap_or(0.0);
        let at_top = |score: &f64| *score >= top - SAME_DB;
        let first = scores.iter().position(at_top).unwrap_or(0);
        // Lines are looked for in three bins and cut off at a height: the top is flat, its middle is the place.
        let run = scores[first..].iter().take_while(|score| at_top(score)).count().max(1);
        (from_hz + step * (first as f64 + 0.5 * (run - 1) as f64), top)
    }

    /// The comb's mesh frequency by least squares on each of its first harmonics, Hz, and the error of that; `None`
    /// where no harmonic stands out. `channels` are those of the spectrum.
    pub(crate) fn placed(&self, channels: &[Vec<f64>], mesh_hz: f64) -> Option<(f64, f64)> {
        let slower_hz = mesh_hz / f64::from(self.teeth[0].max(self.teeth[1]));
        let width = self.line_width_hz().min(0.4 * slower_hz);
        let measured = |harmonic: f64| {
            let hz = harmonic * mesh_hz;
            let db = height(&self.excess, hz);
            let found = if db < HARMONIC_DB { None } else { refine(channels, self.rate_hz, hz, width) }?;
            let error_hz = LINE_ERROR_BINS * self.excess.bin * 10.0_f64.powf(-0.05 * db);
            Some((found / harmonic, error_hz / harmonic))
        };
        let harmonics = (1..=3).map(f64::from).filter(|h| h * mesh_hz < 0.45 * self.rate_hz);
        let found: Vec<(f64, f64)> = harmonics.filter_map(measured).collect();
        let weights: f64 = found.iter().map(|(_, error)| error.powi(-2)).sum();
        if weights.is_nan() || weights <= 0.0 {
            return None;
        }
        let mean = |of: &dyn Fn(f64) -> f64| found.iter().map(|(hz, e)| of(*hz) * e.powi(-2)).sum::<f64>() / weights;
        let placed_hz = mean(&|hz| hz);
        // What the harmonics differ by counts where it is more: a wander that is left moves them all.
        let scatter_hz = (mean(&|hz| (hz - placed_hz).powi(2)) / found.len() as f64).sqrt();
        Some((placed_hz, weights.powf(-0.5).max(scatter_hz)))
    }

    /// Where a mesh frequency is looked for that nothing is known of, Hz.
    fn everywhere(&self) -> (f64, f64) {
        (LOWEST_HZ.max(20.0 * self.excess.bin), 0.2 * self.rate_hz)
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

/// What a line at a frequency counts, dB.
fn at(excess: &Spectrum, hz: f64) -> f64 {
    height(excess, hz).min(LINE_CAP_DB)
}

/// Excess at a frequency, the best of the nearest three bins; 0 beyond the spectrum.
fn height(excess: &Spectrum, hz: f64) -> f64 {
    let i = (hz / excess.bin).round() as usize;
    let last = excess.values.len().saturating_sub(1);
    let range = i.saturating_sub(1)..=(i + 1).min(last);
    excess.values.get(range).map_or(0.0, |part| part.iter().copied().fold(f64::NEG_INFINITY, f64::max))
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

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    #[test]
    fn theory_the_place_of_a_comb_is_found_to_parts_in_a_hundred_thousand() {
        let (rate_hz, mesh_hz) = (6400.0, 500.13);
        let mut state = 3_u64;
        let signal: Vec<f64> = (0..25_600)
            .map(|n| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                // 20 dB below the first line.
                let noise = 0.69 * ((state >> 33) as f64 / f64::from(1_u32 << 31) - 0.5);
                let turn = TAU * mesh_hz / 20.0 * f64::from(n) / rate_hz;
                let shafts = 1.0 + 0.2 * turn.cos() + 0.1 * (0.5 * turn).cos();
                shafts * ((20.0 * turn).cos() + 2.0 * (40.0 * turn + 1.0).cos()) * 2.0 + noise
            })
            .collect();
        let channels = [signal];
        let combs = Combs::new("x", &channels, rate_hz, [20, 40]).expect("long enough");
        let (rough_hz, _) = combs.best_between(497.0, 503.0);
        assert!((rough_hz - mesh_hz).abs() <= combs.excess.bin, "{rough_hz}");
        let (hz, error_hz) = combs.placed(&channels, rough_hz).expect("lines");
        assert!((hz / mesh_hz - 1.0).abs() < 1e-5 && error_hz < 1e-5 * mesh_hz, "{hz} +- {error_hz}");
    }
}
