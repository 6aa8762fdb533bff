//! Engagement edges of a measured stretch, timed by the node's estimator.
//!
//! A tone has slopes too, and the estimator times them as well as an edge's: an edge is only what is much steeper
//! than the signal is on the whole, in nearly every tooth pitch, with rise times that agree. Limit: of a pitch's two
//! edges the steeper is timed; a sensor's sign does not tell them apart.

use super::stretches::Stretch;
use crate::forms::RISE_TIME_PRODUCT;
use meshband::rise_time::{Polarity, RiseTime, RiseTimeConfig};

/// Longest edge, samples (as the node's).
const WINDOW: usize = 256;
/// Edges lower than this share of the signal's RMS are not timed (as the node's).
const HEIGHT_SHARE: f64 = 0.5;
/// Steepest slope of the median tooth pitch over the slope's RMS; 1.4 in a tone, about 3 in noise of a whole pitch.
const LEAST_STEEPNESS: f64 = 4.0;
/// Largest median absolute deviation of the rise times over their median.
const MOST_SCATTER: f64 = 0.15;
/// Fewest teeth.
const FEWEST_TEETH: u16 = 20;

/// Bandwidth of the edges of a stretch, Hz; `None` where they cannot be timed.
pub fn edge_bandwidth_hz(signal: &[f64], rate_hz: f64, stretch: &Stretch, teeth: u32) -> Option<f64> {
    let [from, to] = stretch.time_s.map(|t| ((t * rate_hz).round() as usize).min(signal.len()));
    let samples = &signal[from..to];
    let pitch = rate_hz / (stretch.speed_hz * f64::from(teeth));
    if steepness(samples, pitch)? < LEAST_STEEPNESS {
        return None;
    }
    let rms = (samples.iter().map(|x| x * x).sum::<f64>() / samples.len() as f64).sqrt();
    let config = RiseTimeConfig { polarity: Polarity::Either, minimum_height: (HEIGHT_SHARE * rms) as f32 };
    let mut estimator = RiseTime::<WINDOW>::new(config, pitch as f32);
    for &x in samples {
        estimator.push(x as f32);
    }
    let result = estimator.result().ok()?;
    let agree = f64::from(result.deviation_samples) <= MOST_SCATTER * f64::from(result.samples_per_edge);
    (result.count >= FEWEST_TEETH && agree).then(|| RISE_TIME_PRODUCT * rate_hz / f64::from(result.samples_per_edge))
}

/// Steepest slope of the median tooth pitch over the RMS of all slopes.
fn steepness(samples: &[f64], pitch: f64) -> Option<f64> {
    let slopes: Vec<f64> = samples.windows(2).map(|pair| (pair[1] - pair[0]).abs()).collect();
    let length = pitch as usize;
    if length < 2 || slopes.len() < length {
        return None;
    }
    let rms = (slopes.iter().map(|s| s * s).sum::<f64>() / slopes.len() as f64).sqrt();
    let mut steepest: Vec<f64> =
        slopes.chunks_exact(length).map(|pitch| pitch.iter().copied().fold(0.0, f64::max)).collect();
    steepest.sort_by(f64::total_cmp);
    Some(steepest[steepest.len() / 2] / rms.max(f64::MIN_POSITIVE))
}
