//! Int16 codes of a record: acceleration = code / 32767 * full scale.
//!
//! The scale is symmetric; code -32768 is never written. Rounding is to nearest, so the error is uniform
//! within half a step and its variance step^2 / 12. Values beyond full scale are refused, never clipped.

use crate::{Error, Result};
use rayon::prelude::*;

/// Samples of all channels that are coded together.
const STRETCH: usize = 16_384;

/// Code of +full scale.
pub const CODE_MAX: f64 = 32767.0;

/// Interleaved codes (samples x channels) of equally long channels.
///
/// `place` names the run in messages; `full_scale` has the unit of the signals.
///
/// # Errors
/// Unequal lengths, no channel, a full scale that is not positive, NaN or infinity, or a value beyond full scale.
pub fn encode(place: &str, channels: &[Vec<f64>], full_scale: f64) -> Result<Vec<i16>> {
    if !(full_scale.is_finite() && full_scale > 0.0) {
        return Err(Error::invalid(place, format!("full scale {full_scale} is not a positive number")));
    }
    let samples = channels.first().map_or(0, Vec::len);
    if samples == 0 {
        return Err(Error::invalid(place, "has no samples"));
    }
    for (c, channel) in channels.iter().enumerate() {
        if channel.len() != samples {
            let what = format!("channel {c} has {} samples, channel 0 has {samples}", channel.len());
            return Err(Error::invalid(place, what));
        }
    }
    // Not a number is not within full scale either.
    let beyond = |channel: &Vec<f64>| channel.iter().position(|x| x.is_nan() || x.abs() > full_scale);
    let beyond: Vec<Option<usize>> = channels.par_iter().map(beyond).collect();
    if let Some((c, i)) = beyond.iter().enumerate().find_map(|(c, i)| Some((c, (*i)?))) {
        return Err(Error::invalid(
            place,
            match channels[c][i] {
                value if value.is_finite() => {
                    format!("channel {c}, sample {i}: {value:.6} would clip at full scale {full_scale}")
                }
                value => format!("channel {c}, sample {i} is {value}"),
            },
        ));
    }
    let count = channels.len();
    let mut codes = vec![0_i16; samples * count];
    codes.par_chunks_mut(STRETCH * count).enumerate().for_each(|(part, codes)| {
        for (c, channel) in channels.iter().enumerate() {
            let codes = codes.iter_mut().skip(c).step_by(count);
            codes.zip(&channel[part * STRETCH..]).for_each(|(code, value)| *code = coded(value / full_scale));
        }
    });
    Ok(codes)
}

/// Code of a share of the full scale. The cast cuts off; `f64::round` would be a call of the library.
fn coded(share: f64) -> i16 {
    let code = share * CODE_MAX;
    (code + 0.5_f64.copysign(code)) as i16
}

/// A full scale with 10 % head room over the largest magnitude, rounded up to two significant digits.
///
/// One for a silent signal.
pub fn suggested_full_scale(channels: &[Vec<f64>]) -> f64 {
    let peak = channels.iter().flatten().fold(0.0_f64, |peak, x| peak.max(x.abs()));
    if !(peak.is_finite() && peak > 0.0) {
        return 1.0;
    }
    let wanted = 1.1 * peak;
    let unit = 10.0_f64.powi(wanted.log10().floor() as i32 - 1);
    // Through decimal text, so that the TOML shows 0.29 and not 0.29000000000000004.
    format!("{:.1e}", (wanted / unit).ceil() * unit).parse().unwrap_or(wanted)
}
