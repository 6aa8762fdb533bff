//! One angle from all mesh lines of all channels at once, where none of them is steady throughout.
//!
//! A line that moves through a resonance changes its phase by up to half a turn, and between two resonances it
//! vanishes. From one point in time to the next each line that stands over its noise, and is not on its way through
//! nothing, gives an advance of the mesh; those near their median are averaged. The weight is what a line's phase is
//! worth as an angle: its power over the noise (no more than a bound: the structure's error does not fall with the
//! noise) times its harmonic. Errors of the structure return with the speed and stay within a share of a tooth. A
//! line that passes on either side of nothing on its way out and back turns by a whole cycle: with heavier weights of
//! the high harmonics one such line moved the angle by a third of a tooth.

use rustfft::num_complex::Complex;
use std::f64::consts::TAU;

/// Power over noise below which a line says nothing at a point, and above which more says no more.
const SNR: [f64; 2] = [10.0, 100.0];
/// Amplitude, over the line's median, below which it is on its way through nothing.
const MIN_AMPLITUDE_RATIO: f64 = 0.1;
/// Advances, mesh cycles beside the nominal ones, this near to the median are those of the mesh; the course followed
/// is good to less.
const MAX_ADVANCE_ERROR_CYCLES: f64 = 0.01;
/// Share of the points that may have no line.
const MAX_BLIND_POINT_SHARE: f64 = 0.05;

/// A harmonic of one channel, mixed down.
pub(super) struct Line {
    pub channel: usize,
    pub harmonic: u32,
    /// Filtered signal about the line's nominal frequency.
    pub baseband: Vec<Complex<f64>>,
    /// Power of the noise in the filter.
    pub noise: f64,
    /// Median amplitude of the baseband.
    typical: f64,
}

impl Line {
    /// A line with its filtered signal (at least one point) and the noise's power in it.
    pub fn new(channel: usize, harmonic: u32, baseband: Vec<Complex<f64>>, noise: f64) -> Self {
        let mut sizes: Vec<f64> = baseband.iter().map(|z| z.norm()).collect();
        sizes.sort_by(f64::total_cmp);
        let typical = sizes.get(sizes.len() / 2).copied().unwrap_or(0.0);
        Self { channel, harmonic, baseband, noise, typical }
    }

    /// Mean power over noise.
    pub fn snr(&self) -> f64 {
        let power = self.baseband.iter().map(Complex::norm_sqr).sum::<f64>() / self.baseband.len() as f64;
        power / self.noise.max(f64::MIN_POSITIVE)
    }

    /// Advance in mesh cycles from point `i` to the next beside the nominal one, and its weight; `None` where the
    /// line is too weak.
    fn advance(&self, i: usize) -> Option<(f64, f64)> {
        let (from, to) = (self.baseband[i], self.baseband[i + 1]);
        let snr = from.norm_sqr().min(to.norm_sqr()) / self.noise.max(f64::MIN_POSITIVE);
        let least = MIN_AMPLITUDE_RATIO * self.typical;
        if snr < SNR[0] || from.norm() < least || to.norm() < least {
            return None;
        }
        let harmonic = f64::from(self.harmonic);
        Some(((to * from.conj()).arg() / TAU / harmonic, snr.min(SNR[1]) * harmonic))
    }
}

/// Mesh cycles beside the nominal ones at every point, and the share of points without a line; `None` where that is
/// too large.
pub(super) fn together(lines: &[Line]) -> Option<(Vec<f64>, f64)> {
    let count = lines.first()?.baseband.len();
    let (mut cycles, mut blind) = (vec![0.0], 0);
    for i in 0..count - 1 {
        let mut advances: Vec<(f64, f64)> = lines.iter().filter_map(|line| line.advance(i)).collect();
        blind += usize::from(advances.is_empty());
        cycles.push(cycles[i] + middle(&mut advances));
    }
    let share = blind as f64 / (count - 1).max(1) as f64;
    (share <= MAX_BLIND_POINT_SHARE).then_some((cycles, share))
}

/// Weighted mean of the advances near their weighted median; zero of nothing.
fn middle(advances: &mut [(f64, f64)]) -> f64 {
    advances.sort_by(|a, b| a.0.total_cmp(&b.0));
    let half = 0.5 * advances.iter().map(|a| a.1).sum::<f64>();
    let mut before = 0.0;
    let median = advances.iter().find(|(_, weight)| {
        before += weight;
        before >= half
    });
    let Some(&(median, _)) = median else { return 0.0 };
    let near = advances.iter().filter(|(advance, _)| (advance - median).abs() <= MAX_ADVANCE_ERROR_CYCLES);
    let (sum, weights) = near.fold((0.0, 0.0), |(sum, weights), (a, w)| (sum + a * w, weights + w));
    if weights > 0.0 { sum / weights } else { median }
}
