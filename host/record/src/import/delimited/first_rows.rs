//! Rows of equal whole numbers above the data: a sampling rate, or the time of the start and then the rate.
//!
//! Wearables and small loggers write them so. Taken for a sample, a rate would be the record's largest peak and set
//! its full scale.

use crate::import::Reading;
use crate::import::signals::Signals;
use crate::{Error, Result, text};
use std::path::Path;

/// Smallest rate that a first row is taken for, Hz.
const LEAST_HZ: f64 = 100.0;
/// How far a rate stands above all that follows.
const MIN_RATE_RATIO: f64 = 20.0;
/// Rows that it is compared with.
const COMPARED_ROWS: usize = 10_000;
/// Seconds since 1970 of the years 2001 to 2049.
const SINCE_1970: std::ops::Range<f64> = 1e9..2.5e9;

pub(super) fn take(path: &Path, found: &mut Signals, reading: &Reading) -> Result<()> {
    let row = |i: usize| -> Option<f64> {
        let first = *found.signals.first()?.values.get(i)?;
        let equal = found.signals.iter().all(|signal| signal.values.get(i) == Some(&first));
        (equal && first.fract() == 0.0 && first >= 1.0).then_some(first)
    };
    let rows = found.signals.first().map_or(0, |signal| signal.values.len());
    if rows < 8 || found.signals.iter().any(|signal| signal.unit.as_deref() == Some("s")) {
        return Ok(());
    }
    let start = row(0).filter(|start| SINCE_1970.contains(start) && row(1).is_some());
    let at = usize::from(start.is_some());
    let Some(rate) = row(at) else { return Ok(()) };
    let values = found.signals.iter().flat_map(|signal| signal.values.iter().skip(at + 1).take(COMPARED_ROWS));
    let most = values.fold(0.0_f64, |most, x| most.max(x.abs()));
    let stands_out = rate >= LEAST_HZ && rate > MIN_RATE_RATIO * most;
    if start.is_none() && !stands_out && !(reading.rate_hz == Some(rate) && rate > most) {
        return Ok(());
    }
    if found.rate_hz.or(reading.rate_hz).is_some_and(|other| (other / rate - 1.0).abs() > 1e-4) {
        let other = text::number(found.rate_hz.or(reading.rate_hz).unwrap_or(f64::NAN));
        let what = format!(
            "row {} holds {rate} in every column like a sampling rate, which is stated as {other} Hz; take the row out",
            at + 1
        );
        return Err(Error::invalid(path.display(), what));
    }
    found.signals.iter_mut().for_each(|signal| drop(signal.values.drain(..=at)));
    found.rate_hz = Some(rate);
    let behind = if start.is_some() { " behind the time of the start" } else { "" };
    found
        .remarks
        .push(format!("the first row{behind} holds {rate} in every column and is taken for the sampling rate, Hz"));
    Ok(())
}
