//! One angle from all mesh lines of all channels at once, where none of them is steady throughout.
//!
//! A line that moves through a resonance changes its phase by up to half a turn, and between two resonances it vanishes. From one point in time to
//! the next each line that stands over its noise gives an advance of the mesh; the middle half of them, by weight, is averaged. The weight is what a
//! line's phase is worth as an angle: its power over the noise (no more than a bound: the structure's error does not fall with the noise) times
//! the square of its harmonic. Errors of the structure return with the speed and stay within a share of a tooth.

use rustfft::num_complex::Complex;
use std::f64::consts::TAU;

/// Power over noise below which a line says nothing at a point, and above which more says no more.
const SNR: [f64; 2] = [10.0, 1000.0];
/// Share of the points that may have no line.
const MOST_BLIND: f64 = 0.05;

/// A harmonic of one channel, mixed down.
pub(super) struct Line {
    pub channel: usize,
    pub harmonic: u32,
    /// Filtered signal about the line's nominal frequency.
    pub baseband: Vec<Complex<f64>>,
    /// Power of the noise in the filter.
    pub noise: f64,
}

impl Line {
    /// Mean power over noise.
    pub fn snr(&self) -> f64 {
        let power = self.baseband.iter().map(Complex::norm_sqr).sum::<f64>() / self.baseband.len() as f64;
        power / self.noise.max(f64::MIN_POSITIVE)
    }

    /// Advance in mesh cycles from point `i` to the next beside the nominal one, and its weight; `None` where the line is too weak.
    fn advance(&self, i: usize) -> Option<(f64, f64)> {
        let (from, to) = (self.baseband[i], self.baseband[i + 1]);
        let snr = from.norm_sqr().min(to.norm_sqr()) / self.noise.max(f64::MIN_POSITIVE);
        if snr < SNR[0] {
            return None;
        }
        let harmonic = f64::from(self.harmonic);
        Some(((to * from.conj()).arg() / TAU / harmonic, snr.min(SNR[1]) * harmonic * harmonic))
    }
}

/// Mesh cycles beside the nominal ones at every point, and the share of points without a line; `None` where that is too large.
pub(super) fn together(lines: &[Line]) -> Option<(Vec<f64>, f64)> {
    let count = lines.first()?.baseband.len();
    let (mut cycles, mut blind) = (vec![0.0], 0);
    for i in 0..count - 1 {
        let mut advances: Vec<(f64, f64)> = lines.iter().filter_map(|line| line.advance(i)).collect();
        blind += usize::from(advances.is_empty());
        cycles.push(cycles[i] + middle(&mut advances));
    }
    let share = blind as f64 / (count - 1).max(1) as f64;
    (share <= MOST_BLIND).then_some((cycles, share))
}

/// Mean of the middle half by weight; zero of nothing.
fn middle(advances: &mut [(f64, f64)]) -> f64 {
    advances.sort_by(|a, b| a.0.total_cmp(&b.0));
    let total: f64 = advances.iter().map(|a| a.1).sum();
    let (mut before, mut sum, mut weights) = (0.0, 0.0, 0.0);
    for (advance, weight) in advances.iter() {
        let inside = (before + weight).min(0.75 * total) - before.max(0.25 * total);
        before += weight;
        if inside > 0.0 {
            sum += inside * advance;
            weights += inside;
        }
    }
    if weights > 0.0 { sum / weights } else { 0.0 }
}
