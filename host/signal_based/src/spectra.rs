//! Spectra of a residual on some stretches, by run and channel, with their floors: what families are read from.
//!
//! Levels (whole stretch, quarters, sixteenths) and floors are the analysis' ([`search::levels`]); stretches of one
//! length are averaged. The floor is a median of quiet bins between lines of the same stretches, so it is no part of
//! what is judged. Orders or frequencies: the same code, with "order" in hertz.

use super::evidence::Reading;
use super::scene::Scene;
use super::split::Stretch;
use crate::analysis::search::{self, Level, Range};
use rayon::prelude::*;

/// Spectra by run and channel, finest first.
#[derive(Debug, Clone)]
pub struct Spectra {
    /// Levels of every run and channel.
    pub levels: Vec<Vec<Vec<Level>>>,
    /// Lowest order looked at.
    pub lowest: f64,
    /// Highest order looked at.
    pub highest: f64,
}

/// Fewest and most bins over which a median of the noise is taken.
const STRETCH_BINS: (usize, usize) = (9, 64);
/// Distance from a mesh harmonic within which skirts are followed, orders; bins beside a line that say how high one
/// is, past its own main lobe; floors by which it must exceed the wide one: beyond the scatter of so few bins.
const SKIRT_REACH: f64 = 2.5;
const SKIRT_BINS: std::ops::Range<usize> = 5..15;
const SKIRT: f64 = 1.8;
/// A place beside a line this many times as high, within so many bins, is that line's foot: a smeared line has one as
/// wide.
const FOOT: f64 = 3.0;
const FOOT_BINS: usize = 3;
/// Share of the slower shaft's order that is the lowest looked at.
const MIN_ORDER_SHARE: f64 = 0.25;

impl Spectra {
    /// Of samples at equal angles by run and channel, on the stretches that `stretches` chooses.
    pub fn over_orders(
        scene: &Scene,
        grids: &[impl AsRef<[Vec<f64>]> + Sync],
        stretches: impl Fn(usize) -> Vec<Stretch> + Sync,
    ) -> Self {
        Self::of_grids(scene, grids, stretches, false)
    }

    /// The same for a search: in a run-up every stretch counts by its own floor, which follows the skirts at every
    /// order.
    pub fn searched(
        scene: &Scene,
        grids: &[impl AsRef<[Vec<f64>]> + Sync],
        stretches: impl Fn(usize) -> Vec<Stretch> + Sync,
    ) -> Self {
        Self::of_grids(scene, grids, stretches, true)
    }

    fn of_grids(
        scene: &Scene,
        grids: &[impl AsRef<[Vec<f64>]> + Sync],
        stretches: impl Fn(usize) -> Vec<Stretch> + Sync,
        is_search: bool,
    ) -> Self {
        let lowest = MIN_ORDER_SHARE * scene.gear_order.min(1.0);
        let highest = scene.highest_order;
        let of_run = |r: usize| -> Vec<Vec<Level>> {
            let angle = &scene.runs[r].angle;
            let explained = scene.explained(angle, highest);
            let known = |order: f64, half: f64| explained.at(order, half);
            let range = Range { lowest, highest, known: &known };
            let of_stretch = |samples: &[f64], s: Stretch| {
                search::levels(&samples[s.samples(angle.per_turn[0])], angle.per_turn[0], angle.slower_order(), &range)
            };
            let followed = |mut levels: Vec<Level>, spacing: f64| {
                levels.iter_mut().for_each(|level| follow_skirts(level, spacing, SKIRT_REACH, highest));
                levels
            };
            let of_channel = |samples: &Vec<f64>| {
                let all = stretches(r).into_iter().map(|s| of_stretch(samples, s));
                if is_search && scene.runs[r].runs_up() {
                    evened(all.map(|levels| followed(levels, 2.0 * SKIRT_REACH)))
                } else {
                    scene.meshes().into_iter().fold(mean(all), followed)
                }
            };
            grids[r].as_ref().iter().map(of_channel).collect()
        };
        let levels = (0..scene.runs.len()).into_par_iter().map(of_run).collect();
        Self { levels, lowest, highest }
    }

    /// Power over floor of the highest bin within `reach` bins of `order` at one level; at the foot of a higher line,
    /// no more than the floor.
    pub fn reading(&self, run: usize, channel: usize, level: usize, order: f64, reach: usize) -> Option<Reading> {
        if order < self.lowest || order > self.highest {
            return None;
        }
        let level = self.levels[run][channel].get(level)?;
        let centre = (order / level.density.bin).round() as usize;
        let last = (centre + reach).min(level.floor.len().checked_sub(1)?);
        let raised = 1.0 + 2.0 * level.floor_error;
        let first = centre.saturating_sub(reach);
        let over = |i: usize| level.density.values[i] / (level.floor[i] * raised).max(f64::MIN_POSITIVE);
        let ratio = (first..=last).map(over).fold(0.0, f64::max);
        let outer = (last + FOOT_BINS).min(level.floor.len() - 1);
        let beside = (first.saturating_sub(FOOT_BINS)..first).chain(last + 1..=outer).map(over).fold(0.0, f64::max);
        let is_foot = reach > 0 && beside > FOOT * ratio;
        Some(Reading { ratio: if is_foot { ratio.min(1.0) } else { ratio }, averages: level.averages as f64 })
    }

    /// Density of the floor at an order at one level; one beyond the last bin.
    pub fn floor(&self, run: usize, channel: usize, level: usize, order: f64) -> f64 {
        let level = self.levels[run][channel].get(level);
        let floor = level.and_then(|level| level.floor.get((order / level.density.bin).round() as usize));
        floor.map_or(1.0, |floor| floor.max(f64::MIN_POSITIVE))
    }

    /// Width of a bin, orders, at one level of the first run and channel.
    pub fn bin(&self, level: usize) -> f64 {
        let levels = self.levels.first().and_then(|run| run.first());
        levels.and_then(|levels| levels.get(level).or(levels.last())).map_or(1.0, |level| level.density.bin)
    }

    /// Levels that every run and channel has.
    pub fn depth(&self) -> usize {
        self.levels.iter().flatten().map(Vec::len).min().unwrap_or(0)
    }

    /// Mean square of the noise up to the highest order: medians of short stretches of bins, so that lines weigh
    /// little. (The search's floor is on the safe side, the highest of three medians; it would say too much.)
    pub fn floor_power(&self, run: usize, channel: usize) -> f64 {
        let Some(level) = self.levels[run][channel].first() else { return 0.0 };
        let last = ((self.highest / level.density.bin) as usize).min(level.density.values.len());
        let k = level.averages.max(1) as f64;
        // Wilson and Hilferty's median of a Gamma variable over its mean.
        let median_over_mean = (1.0 - 1.0 / (9.0 * k)).powi(3);
        let (mut sum, mut from) = (0.0, 0);
        while from < last {
            // Short where the noise may be steep: near zero.
            let end = (from + (from / 2).clamp(STRETCH_BINS.0, STRETCH_BINS.1)).min(last);
            let mut sorted = level.density.values[from..end].to_vec();
            sorted.sort_by(f64::total_cmp);
            sum += sorted[sorted.len() / 2] * (end - from) as f64;
            from = end;
        }
        sum / median_over_mean * level.density.bin
    }

    /// Mean square above the floor within `bins` of an order; may be negative by chance.
    pub fn excess(&self, run: usize, channel: usize, level: usize, order: f64, bins: usize) -> f64 {
        let Some(level) = self.levels[run][channel].get(level) else { return 0.0 };
        let centre = (order / level.density.bin).round() as usize;
        let range = centre.saturating_sub(bins)..(centre + bins + 1).min(level.floor.len());
        range.map(|i| (level.density.values[i] - level.floor[i]) * level.density.bin).sum()
    }
}

/// Raises the floor at every bin to where its neighbours stand.
pub fn follow_everywhere(level: &mut Level) {
    let highest = level.floor.len() as f64 * level.density.bin;
    follow_skirts(level, highest, highest, 0.0);
}

/// Raises the floor within `reach` of the multiples of `spacing` to where a skirt lifts the bins beside each: a line
/// must stand out of what is next to it.
fn follow_skirts(level: &mut Level, spacing: f64, reach: f64, highest: f64) {
    let bin = level.density.bin;
    let k = level.averages.max(1) as f64;
    let mean_over_median = (1.0 - 1.0 / (9.0 * k)).powi(-3);
    let values = &level.density.values;
    let count = values.len().min(level.floor.len());
    let beside = |i: usize| -> f64 {
        let near = SKIRT_BINS.flat_map(|d| [i.checked_sub(d), Some(i + d).filter(|j| *j < count)]);
        let mut bins: Vec<f64> = near.flatten().map(|j| values[j]).collect();
        let middle = bins.len() / 2;
        if bins.is_empty() { 0.0 } else { mean_over_median * *bins.select_nth_unstable_by(middle, f64::total_cmp).1 }
    };
    for harmonic in 0..=(highest / spacing).ceil() as usize {
        let centre = harmonic as f64 * spacing;
        let (from, to) = (((centre - reach) / bin).max(0.0) as usize, ((centre + reach) / bin) as usize);
        for i in from..to.min(count) {
            let raised = beside(i);
            if raised > SKIRT * level.floor[i] {
                level.floor[i] = raised;
            }
        }
    }
}

/// Levels of several stretches of one length as one, each over its own floor: power over floor is the mean of theirs.
pub fn evened(stretches: impl Iterator<Item = Vec<Level>>) -> Vec<Level> {
    let all: Vec<Vec<Level>> = stretches
        .map(|mut levels| {
            for level in &mut levels {
                level.density.values.iter_mut().zip(&level.floor).for_each(|(x, f)| *x /= f.max(f64::MIN_POSITIVE));
                level.floor.iter_mut().for_each(|f| *f = 1.0 / f.max(f64::MIN_POSITIVE));
            }
            levels
        })
        .collect();
    let mut levels = mean(all.into_iter());
    for level in &mut levels {
        level.floor.iter_mut().for_each(|f| *f = 1.0 / *f);
        level.density.values.iter_mut().zip(&level.floor).for_each(|(x, f)| *x *= f);
    }
    levels
}

/// Levels of several stretches as one, from a frequency on without the stretch that stands highest over its own
/// floor: a mesh line of a run-up speckles over the frequencies that it sweeps, other ones in every stretch; a line
/// at a frequency stands in all. Of noise the rest's mean is never above that of all, so it counts as many averages.
pub fn without_the_highest(stretches: Vec<Vec<Level>>, from: f64) -> Vec<Level> {
    let count = stretches.len();
    let highest = |l: usize, i: usize| {
        let over = |levels: &Vec<Level>| {
            let level = levels.get(l)?;
            Some(level.density.values.get(i)? / level.floor.get(i)?.max(f64::MIN_POSITIVE))
        };
        stretches.iter().filter_map(over).fold(0.0, f64::max)
    };
    let mut levels = evened(stretches.iter().cloned());
    if count < 2 {
        return levels;
    }
    for (l, level) in levels.iter_mut().enumerate() {
        let first = (from / level.density.bin) as usize;
        for (i, (value, floor)) in level.density.values.iter_mut().zip(&level.floor).enumerate().skip(first) {
            *value = (*value * count as f64 - highest(l, i) * floor).max(0.0) / (count - 1) as f64;
        }
    }
    levels
}

/// Levels of several stretches of one length as one.
pub fn mean(stretches: impl Iterator<Item = Vec<Level>>) -> Vec<Level> {
    let all: Vec<Vec<Level>> = stretches.collect();
    let Some(first) = all.first() else { return Vec::new() };
    let count = all.len() as f64;
    let average = |l: usize, of: fn(&Level) -> &Vec<f64>| -> Vec<f64> {
        let length = all.iter().map(|levels| of(&levels[l]).len()).min().unwrap_or(0);
        (0..length).map(|i| all.iter().map(|levels| of(&levels[l])[i]).sum::<f64>() / count).collect()
    };
    (0..first.len())
        .map(|l| {
            let mut level = first[l].clone();
            level.density.values = average(l, |level| &level.density.values);
            level.floor = average(l, |level| &level.floor);
            level.averages *= all.len();
            level.floor_error /= count.sqrt();
            level
        })
        .collect()
}
