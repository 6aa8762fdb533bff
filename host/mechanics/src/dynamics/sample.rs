//! Uniformly sampled output from the steps' polynomials, at any rate, without storing what is not asked for.
//!
//! Where many samples fall into a step, its polynomial is re-expanded about the middle of short blocks:
//! there a few terms give full precision, and the evaluation is a short loop over independent pairs of samples that
//! the compiler vectorises; four blocks are expanded side by side. Cost: `cargo xtask bench`.

use super::series::{LENGTH, Series};
use super::taylor::Step;
use crate::lanes::{LANES, Lane, Several};

/// Samples evaluated about one expansion point.
const BLOCK: usize = 320;
/// Terms of a block's expansion below this share of the largest coefficient are dropped.
const NEGLIGIBLE_TERM_SHARE: f64 = 1e-13;
/// Pairs of samples evaluated side by side.
const PAIRS_PER_BATCH: usize = 8;
/// Fewer samples than this are evaluated one by one.
const MIN_BATCH_SAMPLES: usize = 24;

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
        let mut values = [0.0; BLOCK * LANES];
        for channel in 0..quantities {
            let series = of(channel);
            let mut done = 0;
            while done < count {
                let n = values.len().min(count - done);
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
    if values.len() < MIN_BATCH_SAMPLES {
        for (i, value) in values.iter_mut().enumerate() {
            *value = series.value(first + i as f64 * spacing);
        }
        return;
    }
    pulp::Arch::new().dispatch(Evaluation { c: series.coefficients(), first, spacing, values });
}

/// [`evaluate`] of many samples as what the vector units' dispatch takes: everything it calls must be compiled into
/// it. The results do not depend on the units, because sums and products are not fused.
struct Evaluation<'a> {
    c: &'a [f64],
    first: f64,
    spacing: f64,
    values: &'a mut [f64],
}

impl pulp::WithSimd for Evaluation<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let Self { c, first, spacing, values } = self;
        let size: f64 = c.iter().fold(0.0, |size, c| size.max(c.abs()));
        let mut start = first;
        for blocks in values.chunks_mut(BLOCK * LANES) {
            let (mut middles, mut radii) = ([0.0; LANES], [0.0; LANES]);
            for ((middle, radius), block) in middles.iter_mut().zip(&mut radii).zip(blocks.chunks(BLOCK)) {
                let half = 0.5 * (block.len() - 1) as f64;
                (*middle, *radius) = (start + half * spacing, half * spacing);
                start += block.len() as f64 * spacing;
            }
            let at = Blocks { middle: Several(middles), radius: Several(radii) };
            let expanded = at.evaluate::<8>(c, size, blocks)
                || at.evaluate::<12>(c, size, blocks)
                || at.evaluate::<LENGTH>(c, size, blocks);
            debug_assert!(expanded, "all terms are enough");
        }
    }
}

/// Middles and half lengths of [`LANES`] blocks, expanded side by side: one expansion is a long chain of dependent
/// operations.
struct Blocks {
    middle: Several,
    radius: Several,
}

impl Blocks {
    /// Evaluates the blocks from `TERMS` terms about their middles; does nothing where they are not enough.
    #[inline(always)]
    fn evaluate<const TERMS: usize>(&self, c: &[f64], size: f64, values: &mut [f64]) -> bool {
        // Horner's rule for the value and all derivatives at once: the inner steps are independent.
        let mut d = [Several::of(0.0); TERMS];
        for &c in c.iter().rev() {
            for k in (1..TERMS).rev() {
                d[k] = d[k] * self.middle + d[k - 1];
            }
            d[0] = d[0] * self.middle + Several::of(c);
        }
        let mut power = Several::of(1.0);
        for d in &mut d {
            *d = *d * power;
            power = power * self.radius;
        }
        let enough = NEGLIGIBLE_TERM_SHARE * size;
        let short = |lane: usize| {
            let radius = self.radius.0[lane];
            d[TERMS - 1].0[lane].abs() > enough || d[TERMS - 2].0[lane].abs() * radius > enough
        };
        if TERMS < LENGTH && TERMS < c.len() && (0..LANES).any(short) {
            return false;
        }
        for (lane, block) in values.chunks_mut(BLOCK).enumerate() {
            symmetric(&d.map(|d| d.0[lane]), block);
        }
        true
    }
}

/// Values of a polynomial at as many points between -1 and 1, ends included: powers of even and odd order are summed
/// once for both points of a pair, which halves the work.
#[inline(always)]
fn symmetric<const TERMS: usize>(d: &[f64; TERMS], values: &mut [f64]) {
    let unit = 2.0 / (values.len() - 1).max(1) as f64;
    let (head, tail) = values.split_at_mut(values.len() / 2);
    let odd_count = tail.len() - head.len();
    tail[..odd_count].fill(d[0]);
    let mut heads = head.chunks_exact_mut(PAIRS_PER_BATCH);
    let mut tails = tail[odd_count..].rchunks_exact_mut(PAIRS_PER_BATCH);
    let mut first = 0;
    for (head, tail) in heads.by_ref().zip(tails.by_ref()) {
        let (lower, upper) = pairs(d, first, unit);
        head.copy_from_slice(&lower);
        tail.copy_from_slice(&upper);
        first += PAIRS_PER_BATCH as u32;
    }
    let (head, tail) = (heads.into_remainder(), tails.into_remainder());
    let (lower, upper) = pairs(d, first, unit);
    head.copy_from_slice(&lower[..head.len()]);
    tail.copy_from_slice(&upper[PAIRS_PER_BATCH - tail.len()..]);
}

/// Values at `unit i - 1` for `i` from `first`, ascending, and at the mirrored points, ascending, too.
#[inline(always)]
fn pairs<const TERMS: usize>(
    d: &[f64; TERMS],
    first: u32,
    unit: f64,
) -> ([f64; PAIRS_PER_BATCH], [f64; PAIRS_PER_BATCH]) {
    let u: [f64; PAIRS_PER_BATCH] = std::array::from_fn(|l| 1.0 - f64::from(first + l as u32) * unit);
    let square: [f64; PAIRS_PER_BATCH] = std::array::from_fn(|l| u[l] * u[l]);
    let mut even = [d[(TERMS - 1) & !1]; PAIRS_PER_BATCH];
    let mut odd = [d[(TERMS - 2) | 1]; PAIRS_PER_BATCH];
    for n in (0..TERMS - 2).rev() {
        let sum = if n % 2 == 0 { &mut even } else { &mut odd };
        for l in 0..PAIRS_PER_BATCH {
            sum[l] = sum[l] * square[l] + d[n];
        }
    }
    let odd: [f64; PAIRS_PER_BATCH] = std::array::from_fn(|l| odd[l] * u[l]);
    let lower = std::array::from_fn(|l| even[l] - odd[l]);
    (lower, std::array::from_fn(|l| even[PAIRS_PER_BATCH - 1 - l] + odd[PAIRS_PER_BATCH - 1 - l]))
}
