//! Combs of lines in squared envelopes, and the probability that a record's own background shows one by chance.
//!
//! A line counts by its rank: the share of all bins of that very spectrum, but for the comb's own lines and those
//! that are known, that stand as high. The background needs no distribution: other combs and tones in it are its
//! tail. The product of `k` such shares has the survival function of a Gamma variable of order `k` (Fisher's
//! combination); every choice (band, base, number of harmonics, smear) is paid for by Bonferroni. Limit: a rank is
//! never below one in the number of bins.

use super::bands::{Band, Spectrum};
use super::thresholds::{FINALISTS, HARMONICS, LOOKED_AT, SLIP, SMEARS};
use rayon::prelude::*;

/// Lowest order that carries a line of a comb.
const LOWEST_ORDER: f64 = 0.6;
/// Bins on each side of a shaft's order, or of a comb known, that are theirs; of its own lines.
const KNOWN_BINS: f64 = 2.0;
const OWN_BINS: f64 = 1.5;
/// Sidebands of a comb that are its own on each side, where a shaft modulates it and where not.
pub const SIDES: i32 = 3;
/// Step of trial bases, bins.
const STEP_BINS: f64 = 0.25;
/// Harmonics that must stand again.
const AGAIN: usize = 3;

/// A comb.
#[derive(Debug, Clone, PartialEq)]
pub struct Comb {
    /// Base, order of the pinion.
    pub base: f64,
    /// Index of the band that shows it best.
    pub band: usize,
    /// Smear, share of the order.
    pub smear: f64,
    /// Harmonics read.
    pub harmonics: usize,
    /// Nats after all choices.
    pub nats: f64,
    /// Nats on the held-out turns.
    pub again: f64,
}

/// Lines that are spoken for: whole orders of the shafts and combs found before, with the shafts that modulate them.
#[derive(Debug, Clone)]
pub struct Known {
    /// Orders of the shafts.
    pub shafts: Vec<f64>,
    /// Base of each comb, and sidebands on each side.
    pub combs: Vec<(f64, i32)>,
}

impl Known {
    /// Which bins of a spectrum are spoken for.
    fn mask(&self, spectrum: &Spectrum) -> Vec<bool> {
        let mut mask = vec![false; spectrum.over.len()];
        let low = ((LOWEST_ORDER * self.shafts[0].min(1.0) / spectrum.bin) as usize).min(mask.len());
        mask[..low].fill(true);
        for own in &self.shafts {
            cover(&mut mask, spectrum.bin, *own, KNOWN_BINS, &[], 0);
        }
        for (base, sides) in &self.combs {
            cover(&mut mask, spectrum.bin, *base, KNOWN_BINS, &self.shafts, *sides);
        }
        mask
    }
}

/// Marks the multiples of a base with sidebands of shafts.
fn cover(mask: &mut [bool], bin: f64, base: f64, half_bins: f64, shafts: &[f64], sides: i32) {
    let count = (mask.len() as f64 * bin / base) as usize + 1;
    let mut mark = |order: f64| {
        let centre = order / bin;
        let from = (centre - half_bins).ceil().max(0.0) as usize;
        let to = ((centre + half_bins).floor() + 1.0).max(0.0) as usize;
        let to = to.min(mask.len());
        if from < to {
            mask[from..to].fill(true);
        }
    };
    for multiple in (1..=count).map(|h| h as f64 * base) {
        mark(multiple);
        for own in shafts {
            (1..=sides).for_each(|n| [-1.0, 1.0].into_iter().for_each(|s| mark(multiple + s * f64::from(n) * own)));
        }
    }
}

/// A spectrum as ranks are taken from it.
pub struct Ranked {
    /// Reading at each bin: highest neighbour, or mean over the smear.
    values: Vec<f64>,
    known: Vec<bool>,
    bin: f64,
}

impl Ranked {
    /// Of a spectrum, what is known left out.
    pub fn of(spectrum: &Spectrum, known: &Known, smear: f64) -> Self {
        let mask = known.mask(spectrum);
        let clean: Vec<f64> = spectrum.over.iter().zip(&mask).map(|(x, m)| if *m { 0.0 } else { *x }).collect();
        Self {
            values: if smear > 0.0 { meaned(&clean, smear) } else { highest(&clean) },
            known: mask,
            bin: spectrum.bin,
        }
    }

    /// Values of the background, ascending.
    fn background(&self, own: Option<&[bool]>) -> Vec<f64> {
        let is_own = |i: usize| self.known[i] || own.is_some_and(|own| own[i]);
        let mut all: Vec<f64> = (0..self.values.len()).filter(|i| !is_own(*i)).map(|i| self.values[i]).collect();
        all.sort_unstable_by(f64::total_cmp);
        all
    }

    fn index(&self, order: f64) -> Option<usize> {
        let index = (order / self.bin).round() as usize;
        self.known.get(index).is_some_and(|known| !known).then_some(index)
    }

    /// Nats of lines at orders, against what is neither known nor a line of the comb of `base`.
    pub fn nats(&self, orders: impl Iterator<Item = f64>, base: f64, shafts: &[f64]) -> f64 {
        let mut own = vec![false; self.values.len()];
        cover(&mut own, self.bin, base, OWN_BINS, shafts, SIDES - 1);
        let background = self.background(Some(&own));
        let read: Vec<f64> = orders.filter_map(|o| self.index(o)).map(|i| rank(&background, self.values[i])).collect();
        combined(read.iter().sum(), read.len())
    }
}

/// Highest of each bin and its two neighbours.
fn highest(values: &[f64]) -> Vec<f64> {
    let near = |i: usize| values[i.saturating_sub(1)..(i + 2).min(values.len())].iter().copied().fold(0.0, f64::max);
    (0..values.len()).map(near).collect()
}

/// Mean over a share of each bin's own order.
fn meaned(values: &[f64], smear: f64) -> Vec<f64> {
    let sums: Vec<f64> = std::iter::once(0.0)
        .chain(values.iter().scan(0.0, |sum, x| {
            *sum += x;
            Some(*sum)
        }))
        .collect();
    let mean = |i: usize| {
        let half = ((0.5 * smear * i as f64) as usize).max(1);
        let (from, to) = (i.saturating_sub(half), (i + half + 1).min(values.len()));
        (sums[to] - sums[from]) / (to - from) as f64
    };
    (0..values.len()).map(mean).collect()
}

/// Minus the logarithm of the share of the background that stands as high.
fn rank(background: &[f64], value: f64) -> f64 {
    let above = background.len() - background.partition_point(|x| *x < value);
    ((background.len() as f64 + 1.0) / (above as f64 + 1.0)).ln()
}

/// Fisher's combination: nats of `count` independent shares whose nats add up to `sum`.
pub fn combined(sum: f64, count: usize) -> f64 {
    let terms = (1..count).scan(1.0, |term, i| {
        *term *= sum / i as f64;
        Some(*term)
    });
    if count == 0 { 0.0 } else { sum - (1.0 + terms.sum::<f64>()).ln() }
}

/// The best comb with a base in any of the ranges; none where no band holds three harmonics.
pub fn best(bands: &[Band], known: &Known, ranges: &[(f64, f64)]) -> Option<Comb> {
    let screened = |(index, band): (usize, &Band)| -> Vec<(f64, Comb)> {
        SMEARS.into_iter().flat_map(|smear| screen(index, band, known, ranges, smear)).collect()
    };
    let mut all: Vec<(f64, Comb)> = bands.par_iter().enumerate().flat_map(screened).collect();
    all.sort_by(|a, b| b.0.total_cmp(&a.0));
    all.truncate(LOOKED_AT);
    let choices = (bands.len() * SMEARS.len() * HARMONICS.len()) as f64;
    let closely = |comb: &Comb| {
        let band = &bands[comb.band];
        let ranked = Ranked::of(&band.parts[0], known, comb.smear);
        let orders = (1..=comb.harmonics).map(|h| h as f64 * comb.base);
        let bases = bases(ranges, ranked.bin, comb.smear).count() as f64;
        let nats = ranked.nats(orders, comb.base, &known.shafts) - (choices * bases).ln();
        Comb { nats, again: again(comb, band, known), ..comb.clone() }
    };
    let judged: Vec<Comb> = all.par_iter().map(|(_, comb)| closely(comb)).collect();
    judged.into_iter().max_by(|a, b| a.nats.total_cmp(&b.nats))
}

/// Trial bases: so fine that the eighth harmonic is missed by two bins at most, or by half of its smear.
fn bases(ranges: &[(f64, f64)], bin: f64, smear: f64) -> impl Iterator<Item = f64> + '_ {
    ranges.iter().flat_map(move |(low, high)| {
        let step = (STEP_BINS * bin).max(0.125 * smear * low);
        (0..=((high - low) / step) as usize).map(move |i| low + i as f64 * step)
    })
}

fn screen(index: usize, band: &Band, known: &Known, ranges: &[(f64, f64)], smear: f64) -> Vec<(f64, Comb)> {
    let ranked = Ranked::of(&band.parts[0], known, smear);
    let background = ranked.background(None);
    let nats: Vec<f64> = ranked.values.iter().map(|x| rank(&background, *x)).collect();
    let mut found: Vec<Vec<(f64, f64)>> = vec![Vec::new(); HARMONICS.len()];
    for base in bases(ranges, ranked.bin, smear) {
        if ranked.index(base).is_none() && ranked.index(2.0 * base).is_none() {
            continue;
        }
        let (mut sum, mut count, mut from) = (0.0, 0, 1);
        for (harmonics, found) in HARMONICS.iter().zip(&mut found) {
            for i in (from..=*harmonics).filter_map(|h| ranked.index(h as f64 * base)) {
                sum += nats[i];
                count += 1;
            }
            from = harmonics + 1;
            if count >= 2 {
                found.push((combined(sum, count), base));
            }
        }
    }
    let best = |(found, harmonics): (&mut Vec<(f64, f64)>, &usize)| {
        found.sort_by(|a, b| b.0.total_cmp(&a.0));
        let comb = |(score, base): &(f64, f64)| {
            (*score, Comb { base: *base, band: index, smear, harmonics: *harmonics, nats: *score, again: 0.0 })
        };
        found.iter().take(FINALISTS).map(comb).collect::<Vec<_>>()
    };
    found.iter_mut().zip(&HARMONICS).flat_map(best).collect()
}

/// Nats of a comb on the held-out turns, where its base may have slipped, which is paid for.
fn again(comb: &Comb, band: &Band, known: &Known) -> f64 {
    let ranked = Ranked::of(&band.parts[1], known, comb.smear);
    let step = (0.5 * ranked.bin / AGAIN as f64).max(1e-9);
    let steps = (SLIP * comb.base / step) as i32;
    let at = |i: i32| {
        let base = comb.base + f64::from(i) * step;
        ranked.nats((1..=AGAIN).map(|h| h as f64 * base), base, &known.shafts)
    };
    (-steps..=steps).map(at).fold(0.0, f64::max) - f64::from(2 * steps + 1).ln()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ref_fishers_combination_is_the_gamma_survival_function() {
        // scipy.stats.gamma.logsf(20, 3).
        assert!((combined(20.0, 3) - 14.601_837_298_482).abs() < 1e-9, "{}", combined(20.0, 3));
        assert!((combined(10.0, 1) - 10.0).abs() < 1e-12);
        assert_eq!(combined(0.0, 0), 0.0);
    }

    #[test]
    fn theory_a_rank_is_the_share_that_stands_as_high() {
        let background: Vec<f64> = (0..99).map(f64::from).collect();
        assert!((rank(&background, 98.0) - 50.0_f64.ln()).abs() < 1e-12);
        assert!((rank(&background, 1e9) - 100.0_f64.ln()).abs() < 1e-12);
        assert!(rank(&background, -1.0).abs() < 1e-12);
    }
}
