//! The tabulated law: knots in speed and bandwidth with a monotone cubic between their logarithms.
//!
//! Around the knee between the mode-limited and the ramp-limited range no form with two or three
//! coefficients follows the edges. A table does, and is the honest choice for a node that must not be wrong there:
//! piecewise cubic Hermite in log speed and log bandwidth (Fritsch and Carlson 1980, three-point slopes
//! with their limiter), which never overshoots its knots. Above its last knot the bandwidth is proportional to
//! speed, below its first constant: both continue the physics (ramp-limited, mode-limited).
//!
//! Knots are chosen greedily: the ends first, then always the point where the table errs most.

use super::point::Point;

/// Log-log monotone cubic through knots of ascending speed.
///
/// `knots` are (shaft Hz, bandwidth Hz), all positive, at least two.
pub fn bandwidth_hz(knots: &[(f64, f64)], shaft_hz: f64) -> f64 {
    let last = knots.len() - 1;
    if shaft_hz >= knots[last].0 {
        return knots[last].1 * shaft_hz / knots[last].0;
    }
    if shaft_hz <= knots[0].0 {
        return knots[0].1;
    }
    let i = knots.partition_point(|k| k.0 <= shaft_hz) - 1;
    let x = |k: usize| knots[k].0.ln();
    let y = |k: usize| knots[k].1.ln();
    let h = x(i + 1) - x(i);
    let secant = |k: usize| (y(k + 1) - y(k)) / (x(k + 1) - x(k));
    let slope = |k: usize| {
        if k == 0 || k == last {
            return secant(k.min(last - 1));
        }
        let (before, after) = (secant(k - 1), secant(k));
        if before * after <= 0.0 {
            return 0.0;
        }
        let (left, right) = (x(k) - x(k - 1), x(k + 1) - x(k));
        let (w1, w2) = (2.0 * right + left, right + 2.0 * left);
        (w1 + w2) / (w1 / before + w2 / after)
    };
    let t = (shaft_hz.ln() - x(i)) / h;
    let (d0, d1) = (slope(i), slope(i + 1));
    let cubic = y(i) * (1.0 + 2.0 * t) * (1.0 - t) * (1.0 - t)
        + h * d0 * t * (1.0 - t) * (1.0 - t)
        + y(i + 1) * t * t * (3.0 - 2.0 * t)
        - h * d1 * t * t * (1.0 - t);
    cubic.exp()
}

/// Greedily chosen knots: at most `most`, fewer where every point is within `tolerance` (relative).
///
/// # Panics
/// With fewer than two points.
pub fn choose_knots(points: &[Point], most: usize, tolerance: f64) -> Vec<(f64, f64)> {
    assert!(points.len() >= 2, "a table has two ends");
    let mut sorted = points.to_vec();
    sorted.sort_by(|a, b| a.shaft_hz.total_cmp(&b.shaft_hz));
    let knot = |p: &Point| (p.shaft_hz, p.bandwidth_hz);
    let mut knots = vec![knot(&sorted[0]), knot(&sorted[sorted.len() - 1])];
    while knots.len() < most {
        let worst = sorted
            .iter()
            .map(|p| (p, (bandwidth_hz(&knots, p.shaft_hz) / p.bandwidth_hz - 1.0).abs()))
            .max_by(|a, b| a.1.total_cmp(&b.1))
            .expect("there are points");
        if worst.1 <= tolerance {
            break;
        }
        knots.push(knot(worst.0));
        knots.sort_by(|a, b| a.0.total_cmp(&b.0));
    }
    knots
}
