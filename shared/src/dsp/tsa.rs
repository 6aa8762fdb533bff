//! Time-synchronous average over turns, and its split into regular, residual and difference signals.
//!
//! Averaging n turns keeps what repeats with the shaft and lowers everything else: noise by sqrt(n), the lines of
//! another shaft by the comb of n turns. Averaging over the hunting period ([`crate::zoom::common_turns`]) or a
//! multiple of it removes the other gear's pattern exactly, because its turns are whole as well (McFadden 1987).
//!
//! Of a pinion's average: the *regular* signal is its constant, low shaft orders and mesh harmonics; the *residual* is
//! the rest; the *difference* signal also lacks the first-order sidebands of the harmonics (Stewart 1977; Zakrajsek,
//! Townsend, Decker 1993). Variants differ in the shaft orders and the number of sidebands removed, so both are
//! parameters ([`RegularLines`]).
//!
//! Cost (Cortex-M4F in QEMU): averaging 6 instructions per sample on top of resampling; a split of 1024 points 133 k.

use crate::math;
use crate::spectrum::{self, SpectrumError};
use microfft::Complex32;

/// Running sum of turns of at most `N` samples each.
#[derive(Debug, Clone)]
pub struct SynchronousAverage<const N: usize> {
    sum: [f32; N],
    turns: u32,
    /// Samples per turn; 0 stands for `N`, so that an empty average is all zero bytes.
    points: usize,
}

impl<const N: usize> Default for SynchronousAverage<N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const N: usize> SynchronousAverage<N> {
    /// Nothing averaged yet.
    pub const fn new() -> Self {
        Self { sum: [0.0; N], turns: 0, points: 0 }
    }

    /// Samples per turn.
    pub fn points(&self) -> usize {
        if self.points == 0 { N } else { self.points }
    }

    /// Changes the samples per turn (1 to `N`, clamped) and starts anew.
    pub fn set_points(&mut self, points: usize) {
        self.points = points.clamp(1, N);
        self.reset();
    }

    /// Starts anew.
    pub fn reset(&mut self) {
        self.sum.fill(0.0);
        self.turns = 0;
    }

    /// Adds one turn given in parts: `part(first, out)` fills `out` with the samples from `first` on.
    ///
    /// Parts keep the stack small; [`crate::order::OrderTracker::resample`] fits.
    pub fn add_turn(&mut self, mut part: impl FnMut(u32, &mut [f32])) {
        let mut scratch = [0.0f32; 64];
        let points = self.points();
        for (i, sums) in self.sum.get_mut(..points).unwrap_or_default().chunks_mut(64).enumerate() {
            let values = scratch.get_mut(..sums.len()).unwrap_or_default();
            part(i as u32 * 64, values);
            for (sum, &x) in sums.iter_mut().zip(values.iter()) {
                *sum += x;
            }
        }
        self.turns += 1;
    }

    /// Turns the sum into the average in place, for those short of memory; reset it after use. `None` before the
    /// first turn.
    pub fn finish(&mut self) -> Option<&[f32]> {
        if self.turns == 0 {
            return None;
        }
        let scale = 1.0 / self.turns as f32;
        self.turns = 1;
        let points = self.points();
        for sum in self.sum.iter_mut().take(points) {
            *sum *= scale;
        }
        self.sum.get(..points)
    }

    /// Turns added since the start.
    pub fn turns(&self) -> u32 {
        self.turns
    }

    /// The average, [`SynchronousAverage::points`] samples; `None` before the first turn or for an output of another
    /// length.
    pub fn average(&self, out: &mut [f32]) -> Option<()> {
        if self.turns == 0 || out.len() != self.points() {
            return None;
        }
        let scale = 1.0 / self.turns as f32;
        for (y, sum) in out.iter_mut().zip(&self.sum) {
            *y = sum * scale;
        }
        Some(())
    }
}

/// Which lines of a synchronous average count as regular.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct RegularLines {
    /// Teeth of the gear whose turns were averaged; mesh harmonics are its multiples.
    pub teeth: u16,
    /// Shaft orders 0..=this are regular (0 removes the constant only; 2 is usual).
    pub shaft_orders: u16,
    /// Sidebands on each side of a mesh harmonic the difference signal lacks (1 is usual).
    pub sidebands: u16,
}

impl RegularLines {
    /// Whether an order lies within `sidebands` of a mesh harmonic, or among the shaft orders.
    fn contains(&self, order: usize, sidebands: usize) -> bool {
        let teeth = usize::from(self.teeth).max(1);
        let distance = (order % teeth).min(teeth - order % teeth);
        order <= usize::from(self.shaft_orders) || (order >= teeth - sidebands.min(teeth) && distance <= sidebands)
    }
}

/// Root mean square of the regular signal about its mean, from the average's spectrum (packed line at half the rate).
pub fn regular_rms(bins: &[Complex32], lines: &RegularLines) -> f32 {
    let regular = |order: usize| lines.contains(order, 0);
    let inner =
        bins.iter().enumerate().skip(1).filter(|(order, _)| regular(*order)).map(|(_, bin)| 2.0 * bin.norm_sqr());
    let nyquist = bins.first().filter(|_| regular(bins.len())).map_or(0.0, |packed| packed.im * packed.im);
    math::sqrt(inner.sum::<f32>() + nyquist) / (2 * bins.len().max(1)) as f32
}

/// The residual signal from the average's spectrum, which is overwritten; `out` takes twice as many samples as there
/// are bins.
pub fn residual_of(bins: &mut [Complex32], lines: &RegularLines, out: &mut [f32]) -> Result<(), SpectrumError> {
    clear_lines(bins, |order| lines.contains(order, 0));
    spectrum::real_ifft(bins, out)
}

/// Removes constant, shaft orders and mesh harmonics: the residual signal. `work` and `out` as long as `average`.
pub fn residual(average: &[f32], lines: &RegularLines, work: &mut [f32], out: &mut [f32]) -> Result<(), SpectrumError> {
    keep_lines(average, work, out, |order| !lines.contains(order, 0))
}

/// Removes the sidebands next to the mesh harmonics as well: the difference signal.
pub fn difference(
    average: &[f32],
    lines: &RegularLines,
    work: &mut [f32],
    out: &mut [f32],
) -> Result<(), SpectrumError> {
    keep_lines(average, work, out, |order| !lines.contains(order, usize::from(lines.sidebands)))
}

/// What the residual lacks: the regular signal.
pub fn regular(average: &[f32], lines: &RegularLines, work: &mut [f32], out: &mut [f32]) -> Result<(), SpectrumError> {
    keep_lines(average, work, out, |order| lines.contains(order, 0))
}

/// Copies `samples` to `out` with only the orders for which `keep` holds.
fn keep_lines(
    samples: &[f32],
    work: &mut [f32],
    out: &mut [f32],
    keep: impl Fn(usize) -> bool,
) -> Result<(), SpectrumError> {
    let count = samples.len();
    if work.len() != count || out.len() != count {
        return Err(SpectrumError::Output);
    }
    work.copy_from_slice(samples);
    let bins = spectrum::real_fft(work)?;
    clear_lines(bins, |order| !keep(order));
    spectrum::real_ifft(bins, out)
}

/// Clears orders of a spectrum with packed line at half the rate.
fn clear_lines(bins: &mut [Complex32], clear: impl Fn(usize) -> bool) {
    let nyquist = bins.len();
    if let Some(packed) = bins.first_mut() {
        if clear(0) {
            packed.re = 0.0;
        }
        if clear(nyquist) {
            packed.im = 0.0;
        }
    }
    for (order, bin) in bins.iter_mut().enumerate().skip(1) {
        if clear(order) {
            *bin = Complex32::new(0.0, 0.0);
        }
    }
}
