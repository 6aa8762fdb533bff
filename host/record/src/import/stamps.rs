//! Time stamps as numbers: whether they go on evenly, how fast, and how well that is known.
//!
//! Printed stamps are rounded. Where the rounding is finer than a step the grid is seen directly; where it is coarser
//! (milliseconds at
//! 12.8 kHz) stamps repeat, and the rate is the slope of a straight line through them, known to
//! `SIGMAS r / (T sqrt(T / r))` for a resolution `r` over a time `T`. Anything that leaves the line by more than the
//! resolution is a gap, a repetition or a step back.

/// Steps equal to this share are regular.
const STEP_TOLERANCE_SHARE: f64 = 0.01;
/// Rounded stamps lie no more than this share of a step from an even grid.
const MAX_ROUNDING_SHARE: f64 = 0.25;
/// Share of steps of nothing from which on stamps are coarser than the samples.
const MIN_REPEATED_STEP_SHARE: f64 = 0.2;
/// Resolutions that a coarse stamp may lie from the straight line.
const MAX_OFFSET_RESOLUTIONS: f64 = 1.1;
/// Standard deviations of the slope that bound the rate.
const SIGMAS: f64 = 4.0;
/// Share of forward steps of anything that is time.
const MIN_FORWARD_STEP_SHARE: f64 = 0.9;
/// Jitter of stamps, share of a step, that is the stamps' own and no sample's.
const JITTER: f64 = 0.5;
/// Fewest values by whose steps a column that is not called time can be told to be broken time.
pub(super) const MIN_STAMPS: usize = 20;
/// Share of equal steps above which such a column is time although some steps differ.
const MIN_EQUAL_STEP_SHARE: f64 = 0.9;
/// Values whose rate is round to this share had a round rate.
const ROUND_RATE_SHARE: f64 = 1e-5;

/// What a sequence of numbers is like.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Stamps {
    /// Goes on evenly: step of one sample, share that the step is uncertain by, resolution where stamps repeat.
    Even { step: f64, uncertain: f64, coarse: Option<f64> },
    /// Goes forward on the whole, but not evenly: index of the worst value, its step, the usual one, and whether most
    /// steps are equal.
    Uneven { index: usize, step: f64, usual: f64, mostly: bool, jitter: bool },
    /// Does not go forward.
    Other,
}

/// Looks at the steps of a column.
pub(super) fn look(column: &[f64]) -> Stamps {
    let n = column.len();
    if n < 3 || column.iter().any(|x| !x.is_finite()) {
        return Stamps::Other;
    }
    let steps: Vec<f64> = column.windows(2).map(|w| w[1] - w[0]).collect();
    let count = steps.len() as f64;
    let mean = (column[n - 1] - column[0]) / count;
    let share = |is: &dyn Fn(f64) -> bool| steps.iter().filter(|s| is(**s)).count() as f64 / count;
    if mean.is_nan() || mean <= 0.0 || share(&|s| s >= 0.0) < MIN_FORWARD_STEP_SHARE {
        return Stamps::Other;
    }
    // Large numbers (seconds since 1970) are themselves rounded.
    let grain = 4.0 * f64::EPSILON * column[0].abs().max(column[n - 1].abs());
    let even = |step: f64, usual: f64| (step - usual).abs() < STEP_TOLERANCE_SHARE * usual + grain;
    if steps.iter().all(|&s| (s - mean).abs() < STEP_TOLERANCE_SHARE * mean) {
        return Stamps::Even { step: mean, uncertain: ROUND_RATE_SHARE, coarse: None };
    }
    let (slope, most) = line(column);
    let finest = steps.iter().copied().filter(|s| *s > grain).fold(f64::INFINITY, f64::min);
    let forward = steps.iter().all(|s| *s >= -grain);
    let repeated = share(&|s| s <= grain);
    let span = column[n - 1] - column[0];
    if forward && n >= MIN_STAMPS && most < MAX_ROUNDING_SHARE * slope + grain {
        let uncertain = (SIGMAS * most / (span * (n as f64).sqrt())).max(ROUND_RATE_SHARE);
        return Stamps::Even { step: slope, uncertain, coarse: None };
    }
    if forward
        && repeated > MIN_REPEATED_STEP_SHARE
        && n >= MIN_STAMPS
        && most <= MAX_OFFSET_RESOLUTIONS * finest.max(slope)
    {
        let distinct = (span / finest.max(slope)).max(1.0);
        let uncertain = SIGMAS * finest.max(slope) / (span * distinct.sqrt());
        return Stamps::Even { step: slope, uncertain, coarse: Some(finest) };
    }
    let usual = *steps.clone().select_nth_unstable_by(steps.len() / 2, f64::total_cmp).1;
    let usual = if usual > 0.0 { usual } else { mean };
    let worst = |i: &usize| (steps[*i] / usual - 1.0).abs();
    let index = (0..steps.len()).max_by(|a, b| worst(a).total_cmp(&worst(b))).unwrap_or(0);
    let mostly = n >= MIN_STAMPS && share(&|s| even(s, usual)) > MIN_EQUAL_STEP_SHARE;
    let jitter = forward
        && !mostly
        && repeated < 1e-3
        && steps.iter().all(|s| (s / slope - 1.0).abs() < 2.0 * JITTER)
        && most < slope;
    Stamps::Uneven { index: index + 1, step: steps[index], usual, mostly, jitter }
}

/// Slope of the straight line of least squares, and the largest distance from it.
fn line(column: &[f64]) -> (f64, f64) {
    let n = column.len() as f64;
    let middle = 0.5 * (n - 1.0);
    let first = column[0];
    let mean = column.iter().map(|x| x - first).sum::<f64>() / n;
    let (mut xy, mut xx) = (0.0, 0.0);
    for (i, x) in column.iter().enumerate() {
        let at = i as f64 - middle;
        xy += at * (x - first - mean);
        xx += at * at;
    }
    let slope = xy / xx;
    let away = column.iter().enumerate().map(|(i, x)| (x - first - mean - slope * (i as f64 - middle)).abs());
    (slope, away.fold(0.0, f64::max))
}

/// A rate from a step: round where it is round within what it is known to.
pub(super) fn rate_hz(step_s: f64, uncertain: f64) -> f64 {
    let rate = 1.0 / step_s;
    let within = uncertain.clamp(ROUND_RATE_SHARE, 10.0 * ROUND_RATE_SHARE);
    // A coarser grid of rates first: 12 800 and not 12 801.
    let round = [100.0, 10.0, 1.0].into_iter().map(|grid| (rate / grid).round() * grid);
    round.into_iter().find(|round| *round > 0.0 && (rate / round - 1.0).abs() < within).unwrap_or(rate)
}
