//! Combs of lines in squared envelopes, and the probability that a record's own background shows one by chance.
//!
//! A line counts by its rank: the share of all bins of that very spectrum, but for the comb's own lines and those
//! that are known, that stand as high. The background needs no distribution: other combs and tones in it are its
//! tail. A line above all of it goes on by the slope that the background's own highest peaks have in their logarithm
//! ([`super::tail`]). The product of `k` such shares has the survival function of a Gamma variable of order `k`
//! (Fisher's combination); every choice (band, base, number of harmonics, sidebands, smear) is paid for by Bonferroni.
//! One line is no comb: without its highest the others have to stand as well.

use super::bands::{Band, Spectrum};
use super::tail::Background;
use super::thresholds::{FINALISTS, HARMONICS, MAX_FINALISTS, SIDEBAND_HARMONICS, SLIP, SMEARS};
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
const STANDING_HARMONICS: usize = 3;

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
    /// Nats without the highest line.
    pub others: f64,
    /// Nats on the held-out turns.
    pub again: f64,
}

/// Lines that are spoken for: whole orders of the shafts and combs found before, with the shafts that modulate them.
#[derive(Debug, Clone)]
pub struct Known {
    /// Orders of the shafts that may modulate a comb.
    pub shafts: Vec<f64>,
    /// Rates of the other parts of a train.
    pub rates: Vec<f64>,
    /// Base of each comb, and sidebands on each side.
    pub combs: Vec<(f64, i32)>,
}

impl Known {
    /// Rates of shafts and parts.
    pub fn all_rates(&self) -> impl Iterator<Item = &f64> {
        self.shafts.iter().chain(&self.rates)
    }

    /// Which bins of a spectrum are spoken for.
    fn mask(&self, spectrum: &Spectrum) -> Vec<bool> {
        let mut mask = vec![false; spectrum.over.len()];
        let low = ((LOWEST_ORDER * self.shafts[0].min(1.0) / spectrum.bin) as usize).min(mask.len());
        mask[..low].fill(true);
        for own in self.all_rates() {
            cover(&mut mask, spectrum.bin, *own, (KNOWN_BINS, 0.0), &[], 0);
        }
        for (base, sides) in &self.combs {
            cover(&mut mask, spectrum.bin, *base, (KNOWN_BINS, 0.0), &self.shafts, *sides);
        }
        mask
    }
}

/// Marks the multiples of a base with sidebands of shafts, each so many bins, and half of a smear, wide.
fn cover(mask: &mut [bool], bin: f64, base: f64, (half_bins, smear): (f64, f64), shafts: &[f64], sides: i32) {
    let count = (mask.len() as f64 * bin / base) as usize + 1;
    let mut mark = |order: f64| {
        let centre = order / bin;
        let half_bins = half_bins.max(0.5 * smear * centre);
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

    /// What is neither known nor the comb's own.
    fn background(&self, own: Option<&[bool]>) -> Background {
        let is_own = |i: usize| self.known[i] || own.is_some_and(|own| own[i]);
        Background::of(&self.values, is_own)
    }

    fn index(&self, order: f64) -> Option<usize> {
        let index = (order / self.bin).round() as usize;
        self.known.get(index).is_some_and(|known| !known).then_some(index)
    }

    /// Nats of lines at orders, against what is neither known nor a line of the comb of `base`; and without the
    /// highest.
    pub fn nats(&self, orders: impl Iterator<Item = f64>, base: f64, shafts: &[f64]) -> (f64, f64) {
        self.nats_on(&self.background_of(base, shafts), orders)
    }

    /// The background of a comb.
    fn background_of(&self, base: f64, shafts: &[f64]) -> Background {
        let mut own = vec![false; self.values.len()];
        cover(&mut own, self.bin, base, (OWN_BINS, SMEARS[1]), shafts, SIDES - 1);
        self.background(Some(&own))
    }

    fn nats_on(&self, background: &Background, orders: impl Iterator<Item = f64>) -> (f64, f64) {
        let read: Vec<f64> = orders.filter_map(|o| self.index(o)).map(|i| background.nats(self.values[i])).collect();
        let (sum, most) = (read.iter().sum::<f64>(), read.iter().copied().fold(0.0, f64::max));
        (combined(sum, read.len()), combined(sum - most, read.len().saturating_sub(1)))
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
    all.truncate(MAX_FINALISTS);
    let patterns = (HARMONICS.len() + SIDEBAND_HARMONICS.len() * known.shafts.len()) as f64;
    let choices = (bands.len() * SMEARS.len()) as f64 * patterns;
    let closely = |comb: &Comb| {
        let band = &bands[comb.band];
        let ranked = Ranked::of(&band.parts[0], known, comb.smear);
        let bases = bases(ranges, ranked.bin, comb.smear).count() as f64;
        let background = ranked.background_of(comb.base, &known.shafts);
        let sided = known.shafts.iter().filter(|_| SIDEBAND_HARMONICS.contains(&comb.harmonics)).map(Some);
        let read = |own: Option<&f64>| ranked.nats_on(&background, lines(comb.base, comb.harmonics, own));
        let (nats, others) =
            std::iter::once(None).chain(sided).map(read).max_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or_default();
        Comb { nats: nats - (choices * bases).ln(), others, again: again(comb, comb.base, band, known), ..comb.clone() }
    };
    let judged: Vec<Comb> = all.par_iter().map(|(_, comb)| closely(comb)).collect();
    judged.into_iter().max_by(|a, b| a.nats.total_cmp(&b.nats))
}

/// Orders of so many harmonics, and of their first sidebands of a shaft.
fn lines(base: f64, harmonics: usize, own: Option<&f64>) -> impl Iterator<Item = f64> + '_ {
    let beside = move |order: f64| own.into_iter().flat_map(move |own| [order - own, order + own]);
    (1..=harmonics).map(move |h| h as f64 * base).flat_map(move |order| std::iter::once(order).chain(beside(order)))
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
    let nats: Vec<f64> = ranked.values.iter().map(|x| background.nats(*x)).collect();
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
        let comb = |(score, base): (f64, f64)| {
            let comb = Comb { base, band: index, smear, harmonics: *harmonics, nats: score, others: 0.0, again: 0.0 };
            (score, comb)
        };
        apart(found, ranked.bin).into_iter().map(comb).collect::<Vec<_>>()
    };
    found.iter_mut().zip(&HARMONICS).flat_map(best).collect()
}

/// The first so many whose bases are bins apart.
fn apart(sorted: &[(f64, f64)], bin: f64) -> Vec<(f64, f64)> {
    let mut chosen: Vec<(f64, f64)> = Vec::new();
    for one in sorted {
        if chosen.iter().all(|own| (own.1 - one.1).abs() > bin) {
            chosen.push(*one);
        }
        if chosen.len() == FINALISTS {
            break;
        }
    }
    chosen
}

/// Nats of a comb read as one of `base` on the held-out turns, where it may have slipped, which is paid for.
pub fn again(comb: &Comb, base: f64, band: &Band, known: &Known) -> f64 {
    let ranked = Ranked::of(&band.parts[1], known, comb.smear);
    let step = (0.5 * ranked.bin / STANDING_HARMONICS as f64).max(1e-9);
    let steps = (SLIP * base / step) as i32;
    let at = |i: i32| {
        let base = base + f64::from(i) * step;
        ranked.nats((1..=STANDING_HARMONICS).map(|h| h as f64 * base), base, &known.shafts).0
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
}
