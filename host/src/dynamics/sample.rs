//! Uniformly sampled output from the steps' polynomials, at any rate, without storing what is not asked for.
//!
//! Where many samples fall into a step, its polynomial is re-expanded about the middle of short blocks:
//! there a few terms give full precision, and the evaluation is a short loop over independent samples that
//! the compiler vectorises. Cost: about 1.5 ns per sample and channel at 100 MHz.

use super::series::{LENGTH, Series};
use super::taylor::Step;

/// Samples evaluated about one expansion point.
const BLOCK: usize = 256;
/// Terms of a block's expansion below this share of the largest coefficient are dropped.
const NEGLIGIBLE: f64 = 1e-13;
/// Fewer samples than this are evaluated one by one.
const FEW: usize = 24;

/// A uniform sampling grid that walks along with the integration.
#[derive(Debug, Clone, Copy)]
pub struct Sampler {
    rate_hz: f64,
    next: i64,
    end: i64,
}

impl Sampler {
    /// Samples `0..count` at times `index / rate_hz`.
    pub fn new(rate_hz: f64, count: usize) -> Self {
        Self { rate_hz, next: 0, end: count as i64 }
    }

    /// Samples `first..end`; a negative index lies before time 0.
    pub fn spanning(rate_hz: f64, first: i64, end: i64) -> Self {
        Self { rate_hz, next: first, end }
    }

    /// Number of samples that fall into a step, and the first one's normalised time and spacing.
    fn span(&self, step: &Step) -> (usize, f64, f64) {
        let until = ((step.start_s + step.end * step.length_s) * self.rate_hz).ceil() as i64;
        let count = (until.min(self.end) - self.next).max(0) as usize;
        let first = (self.next as f64 / self.rate_hz - step.start_s) / step.length_s;
        (count, first, 1.0 / (self.rate_hz * step.length_s))
    }

    /// Hands every channel's samples that fall into `step` to `sink(channel, first index, values)`.
    pub fn take(&mut self, step: &Step, channels: &[usize], sink: impl FnMut(usize, i64, &[f64])) {
        self.take_of(step, channels.len(), |channel| step.acceleration(channels[channel]), sink);
    }

    /// [`Sampler::take`] of any quantities, given as series over the step.
    pub fn take_of(
        &mut self,
        step: &Step,
        quantities: usize,
        of: impl Fn(usize) -> Series,
        mut sink: impl FnMut(usize, i64, &[f64]),
    ) {
        let (count, first, spacing) = self.span(step);
        if count == 0 {
            return;
        }
        let mut values = [0.0; BLOCK];
        for channel in 0..quantities {
            let series = of(channel);
            let mut done = 0;
            while done < count {
                let n = BLOCK.min(count - done);
                evaluate(&series, first + done as f64 * spacing, spacing, &mut values[..n]);
                sink(channel, self.next + done as i64, &values[..n]);
                done += n;
            }
        }
        self.next += count as i64;
    }
}

/// Values of the series at `first, first + spacing, ...`.
pub fn evaluate(series: &Series, first: f64, spacing: f64, values: &mut [f64]) {
    if values.len() < FEW {
        for (i, value) in values.iter_mut().enumerate() {
            *value = series.value(first + i as f64 * spacing);
        }
        return;
    }
    let c = series.coefficients();
    let size: f64 = c.iter().fold(0.0, |size, c| size.max(c.abs()));
    let mut start = first;
    for block in values.chunks_mut(BLOCK) {
        let half = 0.5 * (block.len() - 1) as f64;
        let (middle, radius) = (start + half * spacing, half * spacing);
        let expanded = block_of::<6>(c, size, middle, radius, block)
            || block_of::<8>(c, size, middle, radius, block)
            || block_of::<12>(c, size, middle, radius, block)
            || block_of::<LENGTH>(c, size, middle, radius, block);
        debug_assert!(expanded, "all terms are enough");
        start += block.len() as f64 * spacing;
    }
}

/// Evaluates a block from `TERMS` terms about its middle; does nothing where they are not enough.
fn block_of<const TERMS: usize>(c: &[f64], size: f64, middle: f64, radius: f64, values: &mut [f64]) -> bool {
    // Horner's rule for the value and all derivatives at once: the inner steps are independent.
    let mut d = [0.0; TERMS];
    for &c in c.iter().rev() {
        for k in (1..TERMS).rev() {
            d[k] = d[k] * middle + d[k - 1];
        }
        d[0] = d[0] * middle + c;
    }
    let mut power = 1.0;
    for d in &mut d {
        *d *= power;
        power *= radius;
    }
    let enough = NEGLIGIBLE * size;
    if TERMS < LENGTH && TERMS < c.len() && (d[TERMS - 1].abs() > enough || d[TERMS - 2].abs() > enough / radius) {
        return false;
    }
    if values.len() == 1 {
        values[0] = d[0];
        return true;
    }
    let unit = 2.0 / (values.len() - 1) as f64;
    for (i, value) in values.iter_mut().enumerate() {
        let u = f64::from(i as u32) * unit - 1.0;
        let mut sum = d[TERMS - 1];
        for n in (0..TERMS - 1).rev() {
            sum = sum * u + d[n];
        }
        *value = sum;
    }
    true
}
