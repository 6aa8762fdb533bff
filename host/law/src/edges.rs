//! Engagement edges of an acceleration given by polynomials, and their rise time.
//!
//! Mesh pulses have neither a base nor a top plateau: every engagement rides on the ring of those before
//! it. Timing from extremum to extremum therefore times the ring (the result jumps by a factor of eight
//! from speed to speed). The definition used everywhere in this project needs only the slope:
//!
//! > An edge is the stretch around a local maximum of |slope| over which the slope keeps its sign and
//! > stays above one third of that maximum. Its levels are the values at the two ends; its rise time
//! > is the 10-90 % time between them.
//!
//! A linear ramp gives 0.8 of its width exactly, whatever ring with less than a third of its slope it rides
//! on. The same definition is computable from samples, so the node's estimator (`meshband::rise_time`)
//! and this one measure the same thing. Between samples nothing is lost here: slopes, levels and crossings
//! are roots of the polynomials themselves.
//!
//! Source of the 10-90 % convention: IEEE Std 181; of the factor 0.35: the paper, `physics.md` 1.2 (a).

use crate::piecewise::horner;

/// Share of the greatest slope at which an edge begins and ends.
pub const SLOPE_THRESHOLD: f64 = 1.0 / 3.0;

/// Subdivisions of one step in the search for sign changes. Steps of the solver are shorter than the
/// fastest mode's period, so a sixty-fourth resolves every feature of the polynomial.
const SUBDIVISIONS: usize = 64;

/// A stretch of time over which the acceleration is one polynomial.
#[derive(Debug, Clone, PartialEq)]
pub struct Step {
    /// Start, s.
    pub start_s: f64,
    /// Length, s, above zero.
    pub length_s: f64,
    /// Acceleration, m/s2, in powers of `t - start_s`.
    pub coefficients: Vec<f64>,
}

impl Step {
    fn value(&self, u: f64) -> f64 {
        horner(&self.coefficients, u)
    }

    fn slope(&self, u: f64) -> f64 {
        self.coefficients.iter().enumerate().skip(1).rev().fold(0.0, |sum, (n, c)| sum * u + n as f64 * c)
    }
}

/// One engagement edge.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Edge {
    /// Time at which the slope is greatest, s.
    pub steepest_s: f64,
    /// Begin and end, s.
    pub ends_s: [f64; 2],
    /// Acceleration at begin and end, m/s2.
    pub levels: [f64; 2],
    /// 10-90 % rise (or fall) time, s.
    pub rise_time_s: f64,
}

impl Edge {
    /// Height between the two levels, m/s2, positive.
    pub fn height(&self) -> f64 {
        (self.levels[1] - self.levels[0]).abs()
    }
}

/// Direction of the edges looked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Polarity {
    /// Upward only.
    Rising,
    /// Downward only.
    Falling,
    /// The steepest of either direction.
    Either,
}

/// The edge whose steepest point lies in `window_s` (absolute time), of either direction.
///
/// `steps` are consecutive and should reach beyond the window by more than one edge on both sides. `None`
/// when the window is not covered, the acceleration is constant in it, or the edge does not end within `steps`.
pub fn edge_in_window(steps: &[Step], window_s: [f64; 2]) -> Option<Edge> {
    steepest_edge(steps, window_s, Polarity::Either)
}

/// The steepest edge of the polarity given whose steepest point lies in `window_s`; otherwise as [`edge_in_window`].
pub fn steepest_edge(steps: &[Step], window_s: [f64; 2], polarity: Polarity) -> Option<Edge> {
    let size = |slope: f64| match polarity {
        Polarity::Rising => slope,
        Polarity::Falling => -slope,
        Polarity::Either => slope.abs(),
    };
    let (mut at, mut best) = (None, 0.0_f64);
    for (index, step) in steps.iter().enumerate() {
        let from = (window_s[0] - step.start_s).max(0.0);
        let to = (window_s[1] - step.start_s).min(step.length_s);
        if from >= to {
            continue;
        }
        for k in 0..=SUBDIVISIONS {
            let u = from + (to - from) * k as f64 / SUBDIVISIONS as f64;
            if size(step.slope(u)) > best {
                best = size(step.slope(u));
                at = Some((index, u));
            }
        }
    }
    let (index, mut u) = at?;
    // Parabola through three neighbouring slopes: the maximum is flat, so one refinement is ample.
    let spacing = (steps[index].length_s / SUBDIVISIONS as f64).min(0.5 * (window_s[1] - window_s[0]));
    if u > spacing && u + spacing < steps[index].length_s {
        let s = [-spacing, 0.0, spacing].map(|d| size(steps[index].slope(u + d)));
        let curvature = s[0] - 2.0 * s[1] + s[2];
        if curvature < 0.0 {
            u += (0.5 * spacing * (s[0] - s[2]) / curvature).clamp(-spacing, spacing);
        }
    }
    let steepest = steps[index].slope(u);
    let level = |i: usize, u: f64| steps[i].slope(u) * steepest.signum() - SLOPE_THRESHOLD * steepest.abs();
    let begin = walk(steps, index, u, Direction::Backward, &level)?;
    let end = walk(steps, index, u, Direction::Forward, &level)?;
    let value = |(i, u): (usize, f64)| steps[i].value(u);
    let (low, high) = (value(begin), value(end));
    let crossing = |share: f64| {
        let wanted = low + share * (high - low);
        let past = |i: usize, u: f64| (wanted - steps[i].value(u)) * (high - low).signum();
        walk(steps, begin.0, begin.1, Direction::Forward, &past)
    };
    let time = |(i, u): (usize, f64)| steps[i].start_s + u;
    Some(Edge {
        steepest_s: time((index, u)),
        ends_s: [time(begin), time(end)],
        levels: [low, high],
        rise_time_s: time(crossing(0.9)?) - time(crossing(0.1)?),
    })
}

#[derive(Clone, Copy, PartialEq)]
enum Direction {
    Forward,
    Backward,
}

/// From a point where `f` is positive to the first point where it is not, across step borders.
fn walk(
    steps: &[Step],
    mut index: usize,
    mut u: f64,
    direction: Direction,
    f: &dyn Fn(usize, f64) -> f64,
) -> Option<(usize, f64)> {
    loop {
        let limit = if direction == Direction::Forward { steps[index].length_s } else { 0.0 };
        let stride = (limit - u) / SUBDIVISIONS as f64;
        if stride != 0.0 {
            for k in 1..=SUBDIVISIONS {
                let next = if k == SUBDIVISIONS { limit } else { u + stride * k as f64 };
                if f(index, next) <= 0.0 {
                    return Some((index, bisect(|x| f(index, x), u + stride * (k - 1) as f64, next)));
                }
            }
        }
        // A kink: the next polynomial may begin below the threshold.
        let border = (index, limit);
        (index, u) = match direction {
            Direction::Forward if index + 1 < steps.len() => (index + 1, 0.0),
            Direction::Backward if index > 0 => (index - 1, steps[index - 1].length_s),
            _ => return None,
        };
        if f(index, u) <= 0.0 {
            return Some(border);
        }
    }
}

fn bisect(f: impl Fn(f64) -> f64, mut positive: f64, mut other: f64) -> f64 {
    for _ in 0..60 {
        let middle = 0.5 * (positive + other);
        if f(middle) > 0.0 {
            positive = middle;
        } else {
            other = middle;
        }
    }
    0.5 * (positive + other)
}
