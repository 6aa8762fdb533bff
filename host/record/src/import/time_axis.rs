//! Tells a time column from a channel, and takes the sampling rate from it.
//!
//! A column that ascends in equal steps is time, whatever it starts at. One that is called time, or whose steps are
//! nearly all equal, and yet jumps is time with samples missing: refused, because every angle and every frequency
//! behind the gap would be wrong. Anything else is a channel.

use super::Columns;
use crate::{Error, Result, text};
use std::path::Path;

/// Steps equal to this share are regular.
const REGULAR: f64 = 0.01;
/// Printed times are rounded: no more than this share of a step away from an even grid is regular, too.
const ROUNDED: f64 = 0.25;
/// Share of equal steps above which a column is taken for time although some steps differ.
const MOSTLY: f64 = 0.9;
/// Fewest values by whose steps alone a column can be told to be broken time.
const FEW: usize = 20;

/// What a column is.
#[derive(Debug, Clone, PartialEq)]
enum Kind {
    /// Time at this rate, Hz.
    Time(f64),
    /// Time whose step at this index is not like the others.
    Broken { index: usize, step: f64, usual: f64 },
    /// Not time.
    Channel,
}

/// Takes the time columns among `candidates` out of the channels and sets the rate.
///
/// # Errors
/// A time column with gaps or turning back, and one against the rate that the file states otherwise.
pub(super) fn take(path: &Path, mut columns: Columns, candidates: &[usize]) -> Result<Columns> {
    if columns.channels.len() < 2 {
        return Ok(columns);
    }
    let mut times = Vec::new();
    for &c in candidates {
        let name = columns.names[c].clone();
        match kind(&columns.channels[c], is_called_time(&name)) {
            Kind::Time(rate_hz) => {
                if columns.rate_hz.is_some_and(|other| (other / rate_hz - 1.0).abs() > 1e-4) {
                    let other = columns.rate_hz.map_or_else(String::new, text::number);
                    let what = format!(
                        "time column {} says {} Hz, the file {other} Hz elsewhere",
                        text::quoted(&name),
                        text::number(rate_hz)
                    );
                    return Err(Error::invalid(path.display(), what));
                }
                columns.rate_hz = Some(rate_hz);
                columns.remarks.push(format!("column {} is time at {rate_hz:.6} Hz", text::quoted(&name)));
                times.push(c);
            }
            Kind::Broken { index, step, usual } => {
                let missing = (step / usual).round() - 1.0;
                let gap = if (1.0..1e9).contains(&missing) {
                    format!("{missing} samples are missing")
                } else {
                    "it does not go on evenly".into()
                };
                let what = format!(
                    "time column {}: a step of {step:.4e} at value {} where steps are {usual:.4e}, {gap}; cut the \
                     file there, or give \
                     --no-time if it is a channel",
                    text::quoted(&name),
                    index + 1
                );
                return Err(Error::invalid(path.display(), what));
            }
            Kind::Channel => {}
        }
    }
    if times.len() == columns.channels.len() {
        return Err(Error::invalid(path.display(), "holds time and no channel"));
    }
    for c in times.into_iter().rev() {
        columns.channels.remove(c);
        columns.names.remove(c);
    }
    Ok(columns)
}

fn kind(column: &[f64], called_time: bool) -> Kind {
    let n = column.len();
    if n < 3 || column.iter().any(|x| !x.is_finite()) {
        return Kind::Channel;
    }
    let steps: Vec<f64> = column.windows(2).map(|w| w[1] - w[0]).collect();
    let mean = (column[n - 1] - column[0]) / steps.len() as f64;
    let even = |step: f64, usual: f64| (step / usual - 1.0).abs() < REGULAR;
    let on_grid = || {
        let away = column.iter().enumerate().map(|(i, x)| (x - column[0] - mean * i as f64).abs());
        steps.iter().all(|s| *s >= 0.0) && away.fold(0.0, f64::max) < ROUNDED * mean
    };
    if mean > 0.0 && (steps.iter().all(|&s| even(s, mean)) || (n >= FEW && on_grid())) {
        // Printed times are rounded: their mean step is a round rate to one part in 1e5 or better.
        let rate = 1.0 / mean;
        return Kind::Time(if (rate / rate.round() - 1.0).abs() < 1e-5 { rate.round() } else { rate });
    }
    let usual = *steps.clone().select_nth_unstable_by(steps.len() / 2, f64::total_cmp).1;
    let equal = steps.iter().filter(|&&s| even(s, usual)).count() as f64 / steps.len() as f64;
    if usual > 0.0 && (called_time || (n >= FEW && equal > MOSTLY)) {
        let uneven = |i: &usize| (steps[*i] / usual - 1.0).abs();
        let index = (0..steps.len()).max_by(|a, b| uneven(a).total_cmp(&uneven(b))).unwrap_or(0);
        return Kind::Broken { index: index + 1, step: steps[index], usual };
    }
    Kind::Channel
}

/// Whether a column's or variable's name says time, with or without a unit.
fn is_called_time(name: &str) -> bool {
    let name = name.to_lowercase();
    let words = || name.split(|c: char| !c.is_alphanumeric()).filter(|w| !w.is_empty());
    let last = words().rfind(|w| !["s", "sec", "seconds"].contains(w));
    last.is_some_and(|word| ["t", "time", "times", "timestamp", "zeit"].contains(&word))
}
