//! Uniformly sampled output from the steps' polynomials, at any rate, without storing what is not asked for.
//!
//! Where many samples fall into a step, its polynomial is re-expanded about the middle of short blocks:
//! there a few terms give full precision, and the evaluation is a short loop over independent samples that
//! the compiler vectorises. Cost: about 2 ns per sample and channel at 100 MHz.

use super::series::Series;
use super::taylor::Step;

/// Samples evaluated about one expansion point.
const BLOCK: usize = 256;
/// Terms of a block's expansion below this share of the acceleration are dropped.
const NEGLIGIBLE: f64 = 1e-14;

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
    pub fn take(&mut self, step: &Step, channels: &[usize], mut sink: impl FnMut(usize, i64, &[f64])) {
        let (count, first, spacing) = self.span(step);
        if count == 0 {
            return;
        }
        let mut values = [0.0; BLOCK];
        for (channel, &coordinate) in channels.iter().enumerate() {
            let series = step.acceleration(coordinate);
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
    if values.len() < 24 {
        for (i, value) in values.iter_mut().enumerate() {
            *value = series.value(first + i as f64 * spacing);
        }
        return;
    }
    let half = 0.5 * (values.len() - 1) as f64;
    let mut local = [0.0; super::series::LENGTH];
    let terms = expand_about(series, first + half * spacing, half * spacing, &mut local);
    let unit = 1.0 / half;
    match terms {
        0..=4 => fixed::<4>(&local, unit, values),
        5..=6 => fixed::<6>(&local, unit, values),
        7..=8 => fixed::<8>(&local, unit, values),
        9..=12 => fixed::<12>(&local, unit, values),
        _ => fixed::<{ super::series::LENGTH }>(&local, unit, values),
    }
}

/// Coefficients of the series in `u`, `tau = middle + radius u`; returns how many matter for `|u| <= 1`.
fn expand_about(series: &Series, middle: f64, radius: f64, local: &mut [f64; super::series::LENGTH]) -> usize {
    let c = series.coefficients();
    local[..c.len()].copy_from_slice(c);
    let size: f64 = c.iter().map(|c| c.abs()).fold(0.0, f64::max);
    let mut power = 1.0;
    let mut terms = c.len();
    for i in 0..c.len() {
        for j in (i..c.len() - 1).rev() {
            local[j] += middle * local[j + 1];
        }
        local[i] *= power;
        power *= radius;
        // The rest is smaller still: its own radius power shrinks faster than its coefficients can grow.
        if i > 2 && local[i].abs() < NEGLIGIBLE * size && local[i - 1].abs() < NEGLIGIBLE * size / radius.min(1.0) {
            terms = i;
            break;
        }
    }
    local[terms..].fill(0.0);
    terms
}

fn fixed<const TERMS: usize>(c: &[f64; super::series::LENGTH], unit: f64, values: &mut [f64]) {
    for (i, value) in values.iter_mut().enumerate() {
        let u = i as u32 as f64 * unit - 1.0;
        let mut sum = c[TERMS - 1];
        for n in (0..TERMS - 1).rev() {
            sum = sum * u + c[n];
        }
        *value = sum;
    }
}
