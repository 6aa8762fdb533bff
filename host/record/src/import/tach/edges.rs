//! Edge instants of a tachometer signal that was sampled like any other channel.
//!
//! The two plateaus are medians: the samples are split half way between the levels, each side's median is its level,
//! until both stand still (the start is the range without its outermost ten-thousandth, so that one spike does not
//! decide). A short pulse per turn and a wheel of equal gaps are found alike. An edge counts when the signal has
//! gone from below a quarter to above three quarters of the way; its instant is where the straight line between two
//! samples meets the threshold, the mean of the first and the last such place where noise makes several.
//!
//! Limits: an edge that passes between two samples without any in between is known to half a sample. A sine is no
//! two-level signal; `--threshold` takes it all the same.

use crate::budget::EDGES;
use crate::{Error, Result, text};
use serde::Serialize;

/// Share of samples at either end that take no part in the first guess of the levels.
const SPIKES: f64 = 1e-4;
/// Rounds after which the levels stand still or wander for ever.
const ROUNDS: usize = 60;
/// Most samples between a quarter and three quarters of the way; noise and a sine have 23 % and more.
const MAX_BETWEEN_SHARE: f64 = 0.18;
/// Widest plateau: standard deviation over the distance of the levels. Noise over the hysteresis beyond that.
const WIDEST_PLATEAU: f64 = 0.15;
/// Most samples half the levels' distance outside them, over the samples of the rarer level.
const MAX_OUTSIDE_RATIO: f64 = 0.2;
/// Share of the levels' distance within which a sample lies on a plateau.
const PLATEAU_SHARE: f64 = 0.05;
/// Samples below which no hint is given, and of which the levels are taken for one.
const MIN_HINT_SAMPLES: usize = 1000;
const LEVEL_SAMPLES: usize = 100_000;
/// Range of 98 % of a normal variable, in standard deviations.
const RANGE: f64 = 4.653;

/// Levels of a tach signal, in its own unit.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Levels {
    /// Lower plateau.
    pub low: f64,
    /// Upper plateau.
    pub high: f64,
    /// Level at which edges are timed.
    pub threshold: f64,
}

/// Levels and edges of one channel.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Edges {
    pub levels: Levels,
    /// Seconds from the first sample, ascending.
    pub times_s: Vec<f64>,
    /// Standard deviation of what sampling alone adds to an edge, s: an edge between two samples is anywhere between
    /// them.
    pub sampling_s: f64,
}

/// Rising or falling edges of `signal`, timed half way between its levels or at `threshold`.
///
/// # Errors
/// A signal without two levels (nothing of the kind is asked where a threshold is given), and one that never crosses.
pub(super) fn edges(
    place: &str,
    name: &str,
    signal: &[f64],
    rate_hz: f64,
    falling: bool,
    threshold: Option<f64>,
) -> Result<Edges> {
    let mut sorted = signal.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    let levels = match threshold {
        Some(threshold) => around(&sorted, threshold).ok_or_else(|| {
            let (least, most) = (sorted[0], sorted[sorted.len() - 1]);
            let what = format!("channel {name} runs from {least:.4} to {most:.4} and never crosses {threshold}");
            Error::invalid(place, format!("{what} (--threshold)"))
        })?,
        None => plateaus(&sorted).map_err(|why| {
            let what = format!(
                "channel {} is no tachometer signal: {why}; if its pulses come faster than one in three samples, \
                 sample faster or use fewer marks; --threshold LEVEL takes it all the same",
                text::name(name)
            );
            Error::invalid(place, what)
        })?,
    };
    let crossings = crossings(signal, &levels, falling);
    let sharp = crossings.iter().filter(|at| is_sharp(signal, **at, &levels)).count();
    let sampling_s = (sharp as f64 / crossings.len().max(1) as f64 / 12.0).sqrt() / rate_hz;
    let times_s = crossings.into_iter().map(|at| at / rate_hz).collect::<Vec<_>>();
    EDGES.check(place, times_s.len() as f64, "cut the run into parts")?;
    if times_s.len() < 2 {
        let kind = if falling { "falling" } else { "rising" };
        let what = format!(
            "channel {} has {} {kind} edges through {:.4}; a speed needs two",
            text::name(name),
            times_s.len(),
            levels.threshold
        );
        return Err(Error::invalid(place, what));
    }
    Ok(Edges { levels, times_s, sampling_s })
}

/// Share of samples between the levels of what is taken for a tachometer without anybody saying so: a voltage on its
/// way up or down has 1 %, a mesh line with its second harmonic 16 %.
const MAX_HINT_BETWEEN_SHARE: f64 = 0.08;

/// Edges of a channel that looks like a tachometer's, for a hint; none of one that does not, or is too short to tell.
pub(super) fn hinted(signal: &[f64]) -> Vec<f64> {
    if signal.len() < MIN_HINT_SAMPLES {
        return Vec::new();
    }
    // Every so many samples are enough for levels.
    let mut some: Vec<f64> = signal.iter().step_by(signal.len().div_ceil(LEVEL_SAMPLES)).copied().collect();
    some.sort_unstable_by(f64::total_cmp);
    let Ok(levels) = plateaus(&some) else { return Vec::new() };
    let below = |level: f64| some.partition_point(|x| *x < level);
    let quarter = 0.25 * (levels.high - levels.low);
    let between = below(levels.high - quarter) - below(levels.low + quarter);
    if between as f64 > MAX_HINT_BETWEEN_SHARE * some.len() as f64 {
        Vec::new()
    } else {
        crossings(signal, &levels, false)
    }
}

/// Medians below and above a threshold.
fn around(sorted: &[f64], threshold: f64) -> Option<Levels> {
    let split = sorted.partition_point(|x| *x < threshold);
    let n = sorted.len();
    (split > 0 && split < n).then(|| Levels {
        low: sorted[split / 2],
        high: sorted[split + (n - split) / 2],
        threshold,
    })
}

/// The two levels of a two-level signal, or why it has none.
fn plateaus(sorted: &[f64]) -> std::result::Result<Levels, String> {
    let n = sorted.len();
    let skip = (SPIKES * n as f64) as usize;
    let (mut low, mut high) = (sorted[skip], sorted[n - 1 - skip]);
    for _ in 0..ROUNDS {
        let Some(found) = around(sorted, 0.5 * (low + high)) else { return Err("it is constant".into()) };
        let before = (low, high);
        (low, high) = (found.low, found.high);
        if before == (low, high) {
            break;
        }
    }
    let (threshold, apart) = (0.5 * (low + high), high - low);
    if apart <= 0.0 {
        return Err("it is constant".into());
    }
    let below = |level: f64| sorted.partition_point(|x| *x < level);
    let between = (below(high - 0.25 * apart) - below(low + 0.25 * apart)) as f64 / n as f64;
    if between > MAX_BETWEEN_SHARE {
        return Err(format!(
            "{:.0} % of its samples lie between the levels {low:.4} and {high:.4} (at most {:.0} %)",
            100.0 * between,
            100.0 * MAX_BETWEEN_SHARE
        ));
    }
    let split = below(threshold);
    let common = if split > n - split { &sorted[..split] } else { &sorted[split..] };
    let at = |share: f64| common[((common.len() - 1) as f64 * share).round() as usize];
    let width = (at(0.99) - at(0.01)) / RANGE / apart;
    if width > WIDEST_PLATEAU {
        return Err(format!(
            "its plateau is {:.0} % as wide as its levels {low:.4} and {high:.4} are apart (at most {:.0} %)",
            100.0 * width,
            100.0 * WIDEST_PLATEAU
        ));
    }
    let outside = below(low - 0.5 * apart) + n - below(high + 0.5 * apart);
    if outside as f64 > MAX_OUTSIDE_RATIO * split.min(n - split) as f64 {
        return Err(format!("{outside} of its samples lie far outside the levels {low:.4} and {high:.4}"));
    }
    Ok(Levels { low, high, threshold })
}

/// Whether an edge passes between two samples with neither on its way: nothing says where.
fn is_sharp(signal: &[f64], at: f64, levels: &Levels) -> bool {
    let i = at.floor() as usize;
    let margin = PLATEAU_SHARE * (levels.high - levels.low);
    let on_plateau = |x: f64| (x - levels.low).abs() < margin || (x - levels.high).abs() < margin;
    signal[i..].iter().take(2).all(|x| on_plateau(*x))
}

/// Positions of the edges, in samples.
fn crossings(signal: &[f64], levels: &Levels, falling: bool) -> Vec<f64> {
    let sign = if falling { -1.0 } else { 1.0 };
    let threshold = sign * levels.threshold;
    let (from, to) = if falling { (-levels.high, -levels.low) } else { (levels.low, levels.high) };
    let (armed_below, done_above) = (threshold - 0.5 * (threshold - from), threshold + 0.5 * (to - threshold));
    let (mut armed, mut met) = (false, None);
    let mut found = Vec::new();
    for (i, pair) in signal.windows(2).enumerate() {
        let (before, now) = (sign * pair[0], sign * pair[1]);
        if before <= armed_below {
            (armed, met) = (true, None);
        }
        if !armed {
            continue;
        }
        if before < threshold && now >= threshold {
            let at = i as f64 + (threshold - before) / (now - before);
            met = Some((met.map_or(at, |(first, _)| first), at));
        }
        if let (true, Some((first, last))) = (now >= done_above, met) {
            found.push(0.5 * (first + last));
            (armed, met) = (false, None);
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn theory_a_straight_edge_is_timed_where_it_crosses() {
        // 0, 0, 0.2, 0.6, 1, 1 ...: the line through 0.2 and 0.6 meets 0.5 at three quarters of the step.
        let pulse = [0.0, 0.0, 0.2, 0.6, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0];
        let signal: Vec<f64> = pulse.iter().copied().cycle().take(10 * 40).collect();
        let found = edges("here", "t", &signal, 1.0, false, None).expect("edges");
        assert_eq!((found.levels.low, found.levels.high), (0.0, 1.0));
        assert_eq!(found.times_s.len(), 40);
        assert!((found.times_s[3] - 32.75).abs() < 1e-12, "{:?}", &found.times_s[..4]);
        let falling = edges("here", "t", &signal, 1.0, true, None).expect("edges");
        assert!((falling.times_s[0] - 6.5).abs() < 1e-12);
    }

    #[test]
    fn theory_a_sine_is_taken_with_a_threshold_only() {
        let sine: Vec<f64> = (0..5000).map(|i| (0.05 * f64::from(i)).sin()).collect();
        let refused = edges("here", "t", &sine, 1.0, false, None).expect_err("no levels").to_string();
        assert!(refused.contains("between the levels"), "{refused}");
        let found = edges("here", "t", &sine, 1.0, false, Some(0.0)).expect("edges");
        // The signal begins at its threshold, not below: the first crossing is that of the second period.
        assert!((found.times_s[0] - std::f64::consts::TAU / 0.05).abs() < 1e-3, "{}", found.times_s[0]);
        assert!(
            edges("here", "t", &sine, 1.0, false, Some(2.0))
                .expect_err("never")
                .to_string()
                .contains("never crosses 2")
        );
    }
}
