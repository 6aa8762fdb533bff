//! The period of the pulses over a run: from intervals whose numbers of periods are assumed, to the places of all
//! edges in periods.
//!
//! The logarithm of the period is read twice: a running median, which a fifth of wrong intervals does not move, then
//! a straight line by least squares through those of the fifteen intervals around that lie near their own median. A
//! line follows a run-up, and in its mean the independent errors of the inner edges cancel. Where intervals go on
//! smoothly among themselves and the line does not follow (a step of the speed, the ends of a hard run-up), they are
//! believed. Cost: linear in the edges.

/// Intervals to either side for the line, and for the median.
const REACH: usize = 7;
const MEDIAN_REACH: usize = 10;
/// Departure of a logarithm from its running median within which an interval takes part in the line.
const MAX_LN_DEPARTURE: f64 = 0.22;
/// Intervals that go on smoothly: fewest in a row, most that the logarithm may change from one to the next, most that
/// this change may change. A lost pulse changes it by 0.69 and back.
const MIN_SMOOTH_INTERVALS: usize = 5;
const SMOOTH_STEP: f64 = 0.4;
const SMOOTH_BEND: f64 = 0.15;
/// Departure of a smooth stretch from the line around it from which its own line holds.
const MIN_LN_SHIFT: f64 = 0.08;
/// Intervals to either side for that line.
const SMOOTH_REACH: usize = 2;
/// How near to a whole ratio a short stretch lies from what is around it where every so many pulses may be lost.
const WHOLE_RATIO: f64 = 0.1;
/// Most periods of an interval that takes part: what lies within longer ones is not known.
const MOST_PERIODS: usize = 3;
/// Intervals over which the spread is taken, to either side.
const SPREAD_REACH: usize = 32;
/// Smallest spread that is believed, periods, and over that of the whole run: what the line does not follow looks
/// like it.
const LEAST_SPREAD: f64 = 0.004;
const MIN_RUN_SPREAD_SHARE: f64 = 0.4;
/// What the speed may do from one pulse to the next within a gap without being seen, at least.
const UNSEEN_SPEED_SHARE: f64 = 0.002;
/// Error of the mean period beside a gap, in spreads of an interval.
const MEAN_ERROR: f64 = 1.0 / 12.0;
/// Share of gaps of a length over which the speed did what is taken for one standard deviation.
const GAP_QUANTILE: f64 = 0.9;

/// From an edge to the next one that counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Interval {
    /// Edges at its ends.
    pub from: usize,
    pub to: usize,
    /// Periods between them.
    pub periods: usize,
}

/// Where the edges are, in periods.
#[derive(Debug, Clone)]
pub(super) struct Course {
    /// Periods from the first edge to each, not whole.
    pub places: Vec<f64>,
    /// Standard deviation of an interval of one period at each edge, periods.
    pub spread: Vec<f64>,
    /// Whether the interval behind each edge goes on smoothly with those around it.
    pub smooth: Vec<bool>,
    /// What the mean speed over 1, 2, 4 ... periods departs from that of its ends, as a share.
    bends: Vec<f64>,
}

impl Course {
    /// By `intervals` (at least three, in order, of at least one period each).
    pub(super) fn of(edges_s: &[f64], intervals: &[Interval]) -> Self {
        let length = |i: &Interval| edges_s[i.to] - edges_s[i.from];
        let logs: Vec<f64> = intervals.iter().map(|i| (length(i) / i.periods as f64).ln()).collect();
        let medians: Vec<f64> = (0..logs.len()).map(|i| median_line(&logs, i)).collect();
        let take_part: Vec<bool> = intervals
            .iter()
            .zip(logs.iter().zip(&medians))
            .map(|(i, (log, median))| i.periods <= MOST_PERIODS && (log - median).abs() < MAX_LN_DEPARTURE)
            .collect();
        let mut levels: Vec<f64> = (0..logs.len()).map(|i| line(&logs, &take_part, i).unwrap_or(medians[i])).collect();
        let mut smooth = vec![false; edges_s.len()];
        for run in smooth_runs(&logs).into_iter().filter(|run| is_believed(&logs[run.clone()], &medians[run.clone()])) {
            for i in run.clone() {
                let own = own_line(&logs, &run, i);
                if (own - levels[i]).abs() > MIN_LN_SHIFT {
                    levels[i] = own;
                }
                let Interval { from, to, periods } = intervals[i];
                smooth[from.min(to)] = periods == 1 && from.abs_diff(to) == 1;
            }
        }
        let places = places(edges_s, intervals, &levels);
        let spread = spread(&places, intervals);
        Self { places, spread, smooth, bends: bends(&levels) }
    }

    /// Standard deviation of an interval of `periods` that begins or ends at edge `at`, periods.
    pub(super) fn deviation(&self, at: usize, periods: usize) -> f64 {
        let spread = self.spread[at];
        if periods < 2 {
            return spread;
        }
        // Beyond the longest gap that was looked at the departure goes on as it grew.
        let octave = (periods as f64).log2();
        let last = self.bends.len() - 1;
        let bend = self.bends[(octave.ceil() as usize).min(last)] * 2.0_f64.powf((octave - last as f64).max(0.0));
        let share = UNSEEN_SPEED_SHARE.max(bend).max(MEAN_ERROR * spread);
        (spread * spread + (periods as f64 * share).powi(2)).sqrt()
    }
}

/// The `2 reach + 1` indices nearest to `at`, fewer where there are not as many.
fn around(at: usize, reach: usize, count: usize) -> std::ops::Range<usize> {
    let width = (2 * reach + 1).min(count);
    let from = at.saturating_sub(reach).min(count - width);
    from..from + width
}

/// The running median at `at`; towards the ends, where as many do not lie on both sides, the median line (Theil and
/// Sen).
fn median_line(logs: &[f64], at: usize) -> f64 {
    let window = around(at, MEDIAN_REACH, logs.len());
    let centred = at - window.start == window.end - 1 - at;
    if centred {
        return median(&mut logs[window].to_vec());
    }
    let mut slopes = Vec::new();
    for i in window.clone() {
        slopes.extend((i + 1..window.end).map(|j| (logs[j] - logs[i]) / (j - i) as f64));
    }
    let slope = median(&mut slopes);
    median(&mut window.map(|i| logs[i] - slope * (i as f64 - at as f64)).collect::<Vec<_>>())
}

/// The straight line through those that take part, at `at`; `None` where they are too few.
fn line(logs: &[f64], take_part: &[bool], at: usize) -> Option<f64> {
    fitted(logs, around(at, REACH, logs.len()).filter(|i| take_part[*i]), at)
}

/// The straight line by least squares through the logarithms at `indices`, at `at`; `None` of fewer than four.
fn fitted(logs: &[f64], indices: impl Iterator<Item = usize>, at: usize) -> Option<f64> {
    let (mut n, mut x, mut y, mut xx, mut xy) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for i in indices {
        let (dx, dy) = (i as f64 - at as f64, logs[i] - logs[at]);
        n += 1.0;
        x += dx;
        y += dy;
        xx += dx * dx;
        xy += dx * dy;
    }
    let determinant = n * xx - x * x;
    (n >= 4.0 && determinant > 0.0).then(|| logs[at] + (y * xx - x * xy) / determinant)
}

/// Stretches of intervals that go on smoothly.
fn smooth_runs(logs: &[f64]) -> Vec<std::ops::Range<usize>> {
    let step = |k: usize| logs[k + 1] - logs[k];
    let mut runs = Vec::new();
    let mut from = 0;
    for k in 0..logs.len() {
        let goes_on = k + 1 < logs.len()
            && step(k).abs() <= SMOOTH_STEP
            && (k == from || (step(k) - step(k - 1)).abs() <= SMOOTH_BEND);
        if !goes_on {
            if k + 1 - from >= MIN_SMOOTH_INTERVALS {
                runs.push(from..k + 1);
            }
            from = k + 1;
        }
    }
    runs
}

/// Whether a smooth stretch is what it looks like: not one of which every second or third pulse is lost.
fn is_believed(logs: &[f64], medians: &[f64]) -> bool {
    let mut off: Vec<f64> = logs.iter().zip(medians).map(|(log, median)| log - median).collect();
    let near = off.iter().filter(|off| off.abs() < MAX_LN_DEPARTURE).count();
    let ratio = median(&mut off).abs();
    2 * near >= logs.len() || [2.0_f64, 3.0].iter().all(|whole| (ratio - whole.ln()).abs() > WHOLE_RATIO)
}

/// The straight line through the nearest intervals of a smooth stretch, at `at`.
fn own_line(logs: &[f64], run: &std::ops::Range<usize>, at: usize) -> f64 {
    let near = around(at - run.start, SMOOTH_REACH, run.len());
    fitted(logs, near.map(|i| run.start + i), at).unwrap_or(logs[at])
}

/// Integral over time of one over the period, at every edge.
fn places(edges_s: &[f64], intervals: &[Interval], levels: &[f64]) -> Vec<f64> {
    let middle = |i: usize| 0.5 * (edges_s[intervals[i].from] + edges_s[intervals[i].to]);
    let last = intervals.len() - 1;
    let mut behind = 0;
    let rate = |t: f64, behind: &mut usize| {
        while *behind + 2 < intervals.len() && middle(*behind + 1) <= t {
            *behind += 1;
        }
        let next = (*behind + 1).min(last);
        let width = middle(next) - middle(*behind);
        // Straight on over half an interval at either end.
        let share = if width > 0.0 { ((t - middle(*behind)) / width).clamp(-1.0, 2.0) } else { 0.0 };
        (-(levels[*behind] + share * (levels[next] - levels[*behind]))).exp()
    };
    let rates: Vec<f64> = edges_s.iter().map(|t| rate(*t, &mut behind)).collect();
    let mut places = vec![0.0; edges_s.len()];
    for i in 1..edges_s.len() {
        places[i] = places[i - 1] + 0.5 * (rates[i - 1] + rates[i]) * (edges_s[i] - edges_s[i - 1]);
    }
    places
}

/// Local spread of the intervals of one period, at every edge.
fn spread(places: &[f64], intervals: &[Interval]) -> Vec<f64> {
    let off: Vec<(usize, f64)> = intervals
        .iter()
        .filter(|i| i.periods == 1)
        .map(|i| (i.from, (places[i.to] - places[i.from] - 1.0).abs()))
        .filter(|(_, off)| *off < 0.5)
        .collect();
    if off.is_empty() {
        return vec![0.5; places.len()];
    }
    let of = |part: &[(usize, f64)]| 1.4826 * median(&mut part.iter().map(|(_, off)| *off).collect::<Vec<_>>());
    let all = of(&off);
    let blocks: Vec<(usize, f64)> = (0..off.len())
        .step_by(SPREAD_REACH)
        .map(|at| (off[at].0, of(&off[around(at, SPREAD_REACH, off.len())])))
        .collect();
    let mut block = 0;
    let local = |edge: usize, block: &mut usize| {
        while *block + 1 < blocks.len() && blocks[*block + 1].0 <= edge {
            *block += 1;
        }
        blocks[*block].1
    };
    (0..places.len()).map(|edge| local(edge, &mut block).max(MIN_RUN_SPREAD_SHARE * all).max(LEAST_SPREAD)).collect()
}

/// Usual departure of the mean over 1, 2, 4 ... periods from the mean of the two ends.
fn bends(levels: &[f64]) -> Vec<f64> {
    let mut sums = vec![0.0];
    for level in levels {
        sums.push(sums[sums.len() - 1] + level);
    }
    let mut bends = vec![0.0];
    let mut width = 2;
    while 4 * width <= levels.len() {
        let step = (levels.len() / 4096).max(1);
        let departure = |k: usize| {
            let mean = (sums[k + width] - sums[k]) / width as f64;
            (mean - 0.5 * (levels[k] + levels[k + width - 1])).abs()
        };
        let mut all: Vec<f64> = (0..=levels.len() - width).step_by(step).map(departure).collect();
        let at = ((all.len() - 1) as f64 * GAP_QUANTILE) as usize;
        let (_, usual, _) = all.select_nth_unstable_by(at, f64::total_cmp);
        bends.push(usual.max(bends[bends.len() - 1]));
        width *= 2;
    }
    bends
}

/// Median; 0 of none.
pub(super) fn median(values: &mut [f64]) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}
