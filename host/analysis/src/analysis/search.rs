//! Lines over their local floor, at a stated probability of any false one.
//!
//! Power spectra of all turns at once and as Welch means of a quarter and a sixteenth: a line that a slipping bearing
//! smears loses in the first and stands in the others. In noise a mean of K spectra is Gamma(K) about the floor, so
//! every bin has a probability by chance; Bonferroni over the bins of all three holds the probability of one false
//! line in the whole spectrum below [`FALSE_ALARM`]. The floor is the highest of the medians to the left, to the
//! right and of both, raised by two of its standard errors: a slope or a step of the noise makes no lines. Limits:
//! noise that is not stationary in angle (knocks, a resonance swept through) is no such noise; neighbouring bins
//! share a window and are counted as independent, which is on the safe side.

use super::lines::{LOBE_BINS, WINDOW};
use crate::spectral::{Spectrum, power_density};
use serde::Serialize;
use statrs::distribution::{ContinuousCDF, Gamma};

/// Probability that noise gives one or more lines in a spectrum.
pub const FALSE_ALARM: f64 = 0.01;
/// Parts of the record per Welch segment.
const PARTS: [usize; 3] = [1, 4, 16];
/// Turns of the slower shaft that a segment must hold.
const FEWEST_TURNS: f64 = 12.0;
/// Half the width over which the floor is taken, orders, and its bounds in bins.
const FLOOR_ORDERS: f64 = 2.0;
const FLOOR_BINS: (usize, usize) = (60, 400);
/// Bins without a known line from which a median is taken.
const FEWEST_BINS: usize = 20;
/// Most lines kept.
const MOST_LINES: usize = 300;
/// Mean power over the floor to which a line's foot reaches, and bins of the shortest stretch over which it is taken.
const FOOT_FLOOR_RATIO: f64 = 1.8;
const STRETCH_BINS: usize = 12;
/// Ratio of the two sides from which a neighbour stands on one.
const MAX_SIDE_RATIO: f64 = 10.0;
/// Farthest that a foot of a line reaches, share of its order and orders: slip smears in proportion.
const FOOT: (f64, f64) = (0.02, 0.5);

/// A line over the floor.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Line {
    /// Order of the pinion.
    pub order: f64,
    /// Peak amplitude of a sine with the power of the line and its foot above the floor; record's unit, or share of
    /// the band's mean power.
    pub amplitude: f64,
    /// Highest bin over the floor, dB.
    pub over_floor_db: f64,
    /// Logarithm of the probability by chance, all bins counted; 0 is certain.
    pub ln_probability: f64,
    /// Bin of the spectrum it was found in, orders: how well its place is known.
    pub bin: f64,
}

/// A spectrum of one resolution with its floor.
#[derive(Debug, Clone)]
pub struct Level {
    /// Power density, unit^2 per order.
    pub density: Spectrum,
    /// Spectra averaged.
    pub averages: usize,
    /// Expected density of the noise.
    pub floor: Vec<f64>,
    /// Relative standard error of the floor.
    pub floor_error: f64,
}

/// What may be looked at.
pub struct Range<'a> {
    /// Lowest order.
    pub lowest: f64,
    /// Highest order.
    pub highest: f64,
    /// Whether an order within a half width (both in orders) is spoken for; such bins neither count nor carry the
    /// floor.
    pub known: &'a dyn Fn(f64, f64) -> bool,
}

/// Spectra of the samples, finest first. `slower_order` is that of the slower shaft.
pub fn levels(samples: &[f64], per_turn: usize, slower_order: f64, range: &Range) -> Vec<Level> {
    let densities = densities(samples, per_turn, slower_order);
    densities.into_iter().map(|density| density.with_floor(range)).collect()
}

/// A spectrum of one resolution without its floor, which depends on what is known.
#[derive(Debug, Clone)]
pub struct Density {
    density: Spectrum,
    averages: usize,
}

/// Densities of the samples, finest first: what [`levels`] puts floors under.
pub fn densities(samples: &[f64], per_turn: usize, slower_order: f64) -> Vec<Density> {
    let turns = samples.len() / per_turn;
    let enough = |part: &usize| *part == 1 || (turns / part) as f64 * slower_order >= FEWEST_TURNS;
    let density = |part: usize| {
        let segment = turns / part * per_turn;
        let density = power_density(samples, per_turn as f64, segment, WINDOW);
        Density { density, averages: 1 + (samples.len() - segment) / (segment / 2).max(1) }
    };
    PARTS.into_iter().filter(enough).map(density).collect()
}

impl Density {
    /// With the floor between what is known.
    pub fn with_floor(self, range: &Range) -> Level {
        let (floor, floor_error) = floor(&self.density, self.averages, range);
        Level { density: self.density, averages: self.averages, floor, floor_error }
    }
}

impl Level {
    /// Amplitude of a sine that has the floor's power in this window.
    pub fn floor_amplitude(&self, order: f64) -> f64 {
        let bin = ((order / self.density.bin).round() as usize).min(self.floor.len().saturating_sub(1));
        (2.0 * self.floor[bin] * WINDOW.enbw_bins() * self.density.bin).sqrt()
    }

    /// Amplitude of a sine with the power above the floor between two orders.
    fn amplitude_within(&self, (from, to): (f64, f64)) -> f64 {
        let bin = self.density.bin;
        let last = ((to / bin).round() as usize).min(self.floor.len() - 1);
        let first = ((from / bin).round().max(0.0) as usize).min(last);
        let power: f64 = (first..=last).map(|i| (self.density.values[i] - self.floor[i]) * bin).sum();
        (2.0 * power.max(0.0)).sqrt()
    }

    /// Length of what lies over the floor on both sides of `centre` (of zero: above it), orders, at most `reach`; 0
    /// where nothing does.
    ///
    /// A smeared or swinging line falls off alike to both sides: where one side is ten times the other, a neighbour
    /// begins. Stretches grow with the distance, so that a fade of noise within a foot does not end it.
    pub fn foot(&self, centre: f64, reach: f64) -> f64 {
        let bin = self.density.bin;
        let centre = (centre / bin).round() as isize;
        let shortest = STRETCH_BINS.min((0.5 * reach / bin) as usize).max(2);
        let (mut length, mut end) = (0, 0);
        while (length as f64) * bin < reach {
            let stretch = shortest.max(length / 2);
            let over = |side: isize| self.mean_over_floor(centre, side, length..length + stretch);
            let (above, below) = (over(1), if centre > 0 { over(-1) } else { over(1) });
            if above.min(below) <= FOOT_FLOOR_RATIO || above.max(below) > MAX_SIDE_RATIO * above.min(below) {
                break;
            }
            end = length + stretch;
            length += stretch / 2;
        }
        (end as f64 * bin).min(reach)
    }

    /// Mean power over mean floor of the bins so many away from `centre` on one side.
    fn mean_over_floor(&self, centre: isize, side: isize, away: std::ops::Range<usize>) -> f64 {
        let (mut power, mut floor) = (0.0, 0.0);
        let bins = away.filter_map(|d| usize::try_from(centre + side * d as isize).ok());
        for i in bins.filter(|i| *i < self.floor.len()) {
            power += self.density.values[i];
            floor += self.floor[i];
        }
        if floor > 0.0 { power / floor } else { 0.0 }
    }

    fn looked_at<'a>(&'a self, range: &'a Range) -> impl Iterator<Item = usize> + 'a {
        let bin = self.density.bin;
        let first = ((range.lowest.max(2.0 * LOBE_BINS * bin)) / bin).ceil() as usize;
        let last = ((range.highest / bin) as usize).min(self.density.values.len().saturating_sub(3));
        (first..=last).filter(move |&i| !(range.known)(i as f64 * bin, 1.5 * bin))
    }
}

/// Expected density of the noise at every bin, and its relative standard error.
fn floor(density: &Spectrum, averages: usize, range: &Range) -> (Vec<f64>, f64) {
    let values = &density.values;
    let half = ((FLOOR_ORDERS / density.bin) as usize).clamp(FLOOR_BINS.0, FLOOR_BINS.1);
    let free: Vec<usize> = (2..values.len())
        .filter(|&i| {
            let order = i as f64 * density.bin;
            order <= range.highest && !(range.known)(order, 1.5 * density.bin)
        })
        .collect();
    let mean_over_median = averages as f64 / gamma(averages).inverse_cdf(0.5);
    let hop = (half / 8).max(1);
    let mut sides = Sides::default();
    let knots: Vec<f64> = (0..values.len().div_ceil(hop) + 1)
        .map(|k| mean_over_median * sides.highest_median(values, &free, (k * hop) as f64, 2 * half))
        .collect();
    let between = |i: usize| {
        let (k, u) = (i / hop, (i % hop) as f64 / hop as f64);
        (1.0 - u) * knots[k] + u * knots[k + 1]
    };
    // A median of n exponential values has 1.44 / sqrt(n); the window ties about two bins together.
    let error = 1.44 / (averages as f64 * half as f64).sqrt();
    ((0..values.len()).map(between).collect(), error)
}

/// Buffers of the values on both sides of a bin.
#[derive(Default)]
struct Sides {
    left: Vec<f64>,
    right: Vec<f64>,
    both: Vec<f64>,
}

impl Sides {
    /// Highest of the medians of `reach` free bins to the left, to the right and on both sides of `centre`.
    fn highest_median(&mut self, values: &[f64], free: &[usize], centre: f64, reach: usize) -> f64 {
        let middle = free.partition_point(|&i| (i as f64) < centre);
        let within = |i: &&usize| (**i as f64 - centre).abs() <= reach as f64;
        // So near to zero that too few lie to the left: the first ones, which a hump there fills.
        let before = middle.max(FEWEST_BINS.min(free.len()));
        let near = reach / 2;
        self.left.clear();
        self.left.extend(free[..before].iter().rev().take_while(within).map(|&i| values[i]));
        self.right.clear();
        self.right.extend(free[middle..].iter().take_while(within).map(|&i| values[i]));
        self.both.clear();
        self.both.extend(self.left.iter().take(near).chain(self.right.iter().take(near)));
        median(&mut self.left).max(median(&mut self.right)).max(median(&mut self.both))
    }
}

/// Median, which puts the values into another order; 0 of too few.
fn median(values: &mut [f64]) -> f64 {
    let middle = values.len() / 2;
    if values.len() < FEWEST_BINS { 0.0 } else { *values.select_nth_unstable_by(middle, f64::total_cmp).1 }
}

fn gamma(averages: usize) -> Gamma {
    Gamma::new(averages as f64, averages as f64).expect("positive shape and rate")
}

/// Logarithm of the probability that a mean of `averages` spectra of noise exceeds `ratio` times its expectation.
fn ln_exceeds(averages: usize, ratio: f64) -> f64 {
    let exact = gamma(averages).sf(ratio);
    if exact > 1e-250 {
        return exact.ln();
    }
    // Leading term of the incomplete gamma function, where that underflows.
    let (k, x) = (averages as f64, averages as f64 * ratio);
    (k - 1.0) * x.ln() - x - statrs::function::gamma::ln_gamma(k)
}

/// Power over the floor from which a bin of the finest spectrum is a line.
pub fn least_ratio(levels: &[Level], range: &Range) -> f64 {
    let Some(finest) = levels.first() else { return f64::INFINITY };
    let tests: usize = levels.iter().map(|level| level.looked_at(range).count()).sum();
    gamma(finest.averages).inverse_cdf(1.0 - FALSE_ALARM / tests.max(1) as f64)
}

/// Lines within the range, strongest evidence first, none within another's main lobe or foot.
pub fn lines(levels: &[Level], range: &Range) -> Vec<Line> {
    let tests: usize = levels.iter().map(|level| level.looked_at(range).count()).sum();
    let ln_tests = (tests.max(1) as f64).ln();
    let mut all: Vec<(Line, &Level)> = levels
        .iter()
        .flat_map(|level| peaks(level, range, ln_tests).into_iter().map(move |line| (line, level)))
        .collect();
    all.sort_by(|a, b| a.0.ln_probability.total_cmp(&b.0.ln_probability));
    let mut kept: Vec<Line> = Vec::new();
    let mut feet: Vec<(f64, f64)> = Vec::new();
    for (line, level) in all {
        let apart = |other: &Line| (other.order - line.order).abs() > LOBE_BINS * line.bin.max(other.bin);
        let in_foot = feet.iter().any(|(from, to)| (*from..=*to).contains(&line.order));
        if kept.len() < MOST_LINES && !in_foot && kept.iter().all(apart) {
            let reach = (FOOT.0 * line.order).min(FOOT.1);
            let foot = level.foot(line.order, reach).max((LOBE_BINS - 1.0) * line.bin);
            feet.push((line.order - foot, line.order + foot));
            kept.push(Line { amplitude: level.amplitude_within(feet[feet.len() - 1]), ..line });
        }
    }
    kept
}

/// Order and power over floor of the highest bin within `reach` bins, to a fraction of a bin; none at the edge of the
/// reach.
pub fn peak(level: &Level, order: f64, reach: f64) -> Option<(f64, f64)> {
    let values = &level.density.values;
    let centre = order / level.density.bin;
    let range = (centre - reach).ceil().max(1.0) as usize
        ..=((centre + reach).floor() as usize).min(values.len().checked_sub(2)?);
    let top = range.max_by(|&a, &b| values[a].total_cmp(&values[b]))?;
    let [left, middle, right] = [top - 1, top, top + 1].map(|i| values[i].max(f64::MIN_POSITIVE).ln());
    let bend = left - 2.0 * middle + right;
    let is_peak = middle >= left && middle >= right && bend < 0.0;
    let ratio = values[top] / level.floor[top].max(f64::MIN_POSITIVE);
    is_peak.then(|| ((top as f64 + 0.5 * (left - right) / bend) * level.density.bin, ratio))
}

fn peaks(level: &Level, range: &Range, ln_tests: f64) -> Vec<Line> {
    let values = &level.density.values;
    let raised = 1.0 + 2.0 * level.floor_error;
    let is_peak = |&i: &usize| (1..=2).all(|d| values[i] >= values[i - d] && values[i] >= values[i + d]);
    let line = |i: usize| {
        let ratio = values[i] / (level.floor[i] * raised).max(f64::MIN_POSITIVE);
        // What hardly exceeds the floor needs no exact probability.
        let ln_probability = if ratio < 1.1 { 0.0 } else { (ln_exceeds(level.averages, ratio) + ln_tests).min(0.0) };
        (ln_probability < FALSE_ALARM.ln()).then(|| measured(level, i, ln_probability))
    };
    level.looked_at(range).filter(is_peak).filter_map(line).collect()
}

fn measured(level: &Level, i: usize, ln_probability: f64) -> Line {
    let (values, bin) = (&level.density.values, level.density.bin);
    // A parabola through the logarithms: exact for a Gaussian lobe, a hundredth of a bin for this window's.
    let [left, centre, right] = [i - 1, i, i + 1].map(|j| values[j].max(f64::MIN_POSITIVE).ln());
    let bend = left - 2.0 * centre + right;
    let offset = if bend < 0.0 { (0.5 * (left - right) / bend).clamp(-0.5, 0.5) } else { 0.0 };
    let order = (i as f64 + offset) * bin;
    Line {
        order,
        amplitude: level.amplitude_within((order - (LOBE_BINS - 1.0) * bin, order + (LOBE_BINS - 1.0) * bin)),
        over_floor_db: 10.0 * (values[i] / level.floor[i].max(f64::MIN_POSITIVE)).log10(),
        ln_probability,
        bin,
    }
}
