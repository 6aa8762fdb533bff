//! Knots of a learned law: stretches of like speed together, each with the standard error that leaving out single
//! stretches tells.

use super::Seen;
use super::occupied::{Occupied, occupied};
use crate::file::Measured;
use crate::table;
use serde::Serialize;

/// Ratio of the fastest to the slowest speed of a knot.
pub const BIN_RATIO: f64 = 1.08;
/// Fewest stretches of a knot: fewer tell no scatter.
const FEWEST_STRETCHES: usize = 3;

/// Bandwidth at a speed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Knot {
    /// Pinion speed, Hz.
    pub speed_hz: f64,
    /// Bandwidth, Hz.
    pub bandwidth_hz: f64,
    /// Relative standard error of it.
    pub relative_error: f64,
    /// Stretches it was measured in.
    pub stretches: usize,
}

/// Knots by ascending speed, at most as many as a node's table holds; what makes none is noted.
pub fn knots(seen: &[Seen], measured: Measured, notes: &mut Vec<String>) -> Vec<Knot> {
    let mut by_speed: Vec<&Seen> = seen.iter().collect();
    by_speed.sort_by(|a, b| a.speed_hz.total_cmp(&b.speed_hz));
    let span = by_speed.last().map_or(1.0, |last| last.speed_hz / by_speed[0].speed_hz);
    let ratio = span.powf(1.0 / (meshband::law::MAX_KNOTS - 1) as f64).max(BIN_RATIO);
    let mut bins: Vec<Vec<&Seen>> = Vec::new();
    for stretch in by_speed {
        match bins.last_mut() {
            Some(bin) if stretch.speed_hz < ratio * bin[0].speed_hz => bin.push(stretch),
            _ => bins.push(vec![stretch]),
        }
    }
    bins.iter().filter_map(|bin| knot(bin, measured).map_err(|note| notes.push(note)).ok()).collect()
}

fn knot(bin: &[&Seen], measured: Measured) -> Result<Knot, String> {
    let usable: Vec<&Seen> = match measured {
        Measured::Edges => bin.iter().copied().filter(|s| s.edge_hz.is_some()).collect(),
        Measured::Occupied => bin.to_vec(),
    };
    let speed_hz = bin.iter().map(|s| s.speed_hz).sum::<f64>() / bin.len() as f64;
    let at = format!("at {speed_hz:.2} turns/s");
    if usable.len() < FEWEST_STRETCHES {
        let what = match measured {
            Measured::Edges => "with edges that can be timed",
            Measured::Occupied => "of nearly constant speed",
        };
        return Err(format!("{at} there are {} stretches {what}, {FEWEST_STRETCHES} make a knot", usable.len()));
    }
    let bandwidth_hz = match measured {
        Measured::Edges => mean(&usable, usize::MAX),
        Measured::Occupied => match occupied(usable.iter().map(|s| (&s.locked, s.speed_hz))) {
            Occupied::Measured(hz) => hz,
            Occupied::AtLeast(hz) => {
                return Err(format!("{at} the record's band ends before the vibration does: more than {hz:.0} Hz"));
            }
            Occupied::Noise => return Err(format!("{at} nothing repeats with the pinion above the noise")),
        },
    };
    let without = |left_out: usize| match measured {
        Measured::Edges => mean(&usable, left_out),
        Measured::Occupied => {
            let rest = usable.iter().enumerate().filter(move |(i, _)| *i != left_out);
            match occupied(rest.map(|(_, s)| (&s.locked, s.speed_hz))) {
                Occupied::Measured(hz) | Occupied::AtLeast(hz) => hz,
                Occupied::Noise => bandwidth_hz,
            }
        }
    };
    let count = usable.len() as f64;
    let logs: Vec<f64> = (0..usable.len()).map(|i| (without(i) / bandwidth_hz).ln()).collect();
    let mean = logs.iter().sum::<f64>() / count;
    // A bandwidth in whole orders cannot be known better than one of them.
    let step = match measured {
        Measured::Edges => 0.0,
        Measured::Occupied => speed_hz / bandwidth_hz / 12.0_f64.sqrt(),
    };
    let jackknife = ((count - 1.0) / count * logs.iter().map(|l| (l - mean) * (l - mean)).sum::<f64>()).sqrt();
    Ok(Knot { speed_hz, bandwidth_hz, relative_error: jackknife.hypot(step), stretches: usable.len() })
}

/// Geometric mean of the edges' bandwidths, the `left_out` stretch not counted: it is smooth, so that leaving out
/// tells its error.
fn mean(stretches: &[&Seen], left_out: usize) -> f64 {
    let logs: Vec<f64> = stretches
        .iter()
        .enumerate()
        .filter(|(i, _)| *i != left_out)
        .filter_map(|(_, s)| s.edge_hz.map(f64::ln))
        .collect();
    (logs.iter().sum::<f64>() / logs.len() as f64).exp()
}

/// Relative standard uncertainty of a bandwidth read from the table: the knots' errors, and how well neighbours
/// foretell each.
pub fn relative_uncertainty(knots: &[Knot]) -> f64 {
    let root_mean_square =
        |values: Vec<f64>| (values.iter().map(|v| v * v).sum::<f64>() / values.len().max(1) as f64).sqrt();
    let foretold = (1..knots.len().saturating_sub(1)).map(|i| {
        let others: Vec<(f64, f64)> =
            knots.iter().enumerate().filter(|(j, _)| *j != i).map(|(_, k)| (k.speed_hz, k.bandwidth_hz)).collect();
        (table::bandwidth_hz(&others, knots[i].speed_hz) / knots[i].bandwidth_hz).ln()
    });
    root_mean_square(knots.iter().map(|k| k.relative_error).collect()).max(root_mean_square(foretold.collect()))
}
