//! Takes a part of channels that were read whole.
//!
//! Readers that can find a place in their file take the part alone, whatever the file's size (WAV); of the others the
//! channels are cut here. Edge times that a file of their own counts from the recording's first sample are moved to
//! the part's where they are read.

use super::{Columns, Reading};
use crate::part::first_sample;
use crate::{Error, Result};
use std::path::Path;

/// Takes the part that `reading` names out of channels that were read whole.
///
/// # Errors
/// No rate to find seconds by; a recording that ends before.
pub(super) fn take(path: &Path, mut columns: Columns, reading: &Reading) -> Result<Columns> {
    let Some(part) = reading.part.filter(|_| columns.cut.is_none()) else { return Ok(columns) };
    let rate_hz = columns.rate_hz.or(reading.rate_hz);
    let no_rate = || Error::invalid(path.display(), "states no sampling rate: --from and --to need --rate HZ");
    let rate_hz = rate_hz.filter(|rate| *rate > 0.0).ok_or_else(no_rate)?;
    let samples = columns.channels.first().map_or(0, Vec::len);
    let (range, cut) = part.of(path.display(), samples, rate_hz)?;
    for channel in &mut columns.channels {
        channel.truncate(range.end);
        channel.drain(..range.start);
        channel.shrink_to_fit();
    }
    // Signals of their own rate; those without one are edge times, or no signals.
    for signal in columns.apart.iter_mut().filter(|signal| signal.rate_hz.is_some()) {
        let rate_hz = signal.rate_hz.unwrap_or(rate_hz);
        let later_s = signal.start_s.unwrap_or(0.0) - columns.start_s.unwrap_or(0.0);
        let at = |second: f64| first_sample(second - later_s, rate_hz).min(signal.values.len());
        let own = at(cut.from_s)..at(cut.to_s);
        let moved_s = own.start as f64 / rate_hz - cut.from_s;
        signal.values.truncate(own.end);
        signal.values.drain(..own.start);
        signal.start_s = Some(signal.start_s.unwrap_or(0.0) + moved_s);
    }
    columns.cut = Some(cut);
    Ok(columns)
}
