//! Columns by name or number: which of a file's columns are read (`--columns`), and which are not looked at (`--skip`).
//!
//! Numbers count all columns of the file from 1, time included. What is skipped is skipped before anything is looked
//! at; what is selected is selected after the time column has given its rate. The tachometer stays in any case.

use super::Reading;
use super::signals::{Signal, Signals};
use crate::{Error, Result, text};
use std::path::Path;

/// Names listed in a refusal.
const MAX_LISTED_NAMES: usize = 12;

/// Leaves out what is skipped.
///
/// # Errors
/// A column that does not exist.
pub(super) fn skip(path: &Path, found: &mut Signals, reading: &Reading) -> Result<()> {
    for wanted in &reading.skip {
        let before = found.signals.len();
        let known = listed(&found.signals);
        found.signals.retain(|signal| !signal.is_called(wanted));
        if found.signals.len() == before {
            return Err(unknown(path, "--skip", wanted, &known));
        }
    }
    Ok(())
}

/// Keeps what is selected, and the tachometer; in the order of the file.
///
/// # Errors
/// A column that does not exist.
pub(super) fn keep(path: &Path, found: &mut Signals, reading: &Reading) -> Result<()> {
    if reading.columns.is_empty() {
        return Ok(());
    }
    for wanted in &reading.columns {
        if !found.signals.iter().any(|signal| signal.is_called(wanted)) {
            return Err(unknown(path, "--columns", wanted, &listed(&found.signals)));
        }
    }
    let before: Vec<String> = found.signals.iter().map(|signal| signal.name.clone()).collect();
    // The tachometer's number counts the channels that are left when time has gone.
    let tach = |i: usize, signal: &Signal| {
        let is = |source: &String| {
            source.parse() == Ok(i + 1) || (source.parse::<usize>().is_err() && signal.is_called(source))
        };
        reading.tach.iter().any(is)
    };
    let wanted: Vec<bool> = found
        .signals
        .iter()
        .enumerate()
        .map(|(i, signal)| tach(i, signal) || reading.columns.iter().any(|wanted| signal.is_called(wanted)))
        .collect();
    let mut wanted = wanted.into_iter();
    found.signals.retain(|_| wanted.next().unwrap_or(false));
    let left: Vec<String> =
        before.into_iter().filter(|name| !found.signals.iter().any(|signal| signal.name == *name)).collect();
    if !left.is_empty() {
        found.remarks.push(format!("left out by --columns: {}", left.join(", ")));
    }
    Ok(())
}

fn unknown(path: &Path, option: &str, wanted: &str, known: &str) -> Error {
    Error::invalid(option, format!("{} is no column of {} ({known})", text::quoted(wanted), path.display()))
}

fn listed(signals: &[Signal]) -> String {
    let names =
        signals.iter().take(MAX_LISTED_NAMES).map(|signal| format!("{} {}", signal.number, text::quoted(&signal.name)));
    let more = signals.len().saturating_sub(MAX_LISTED_NAMES);
    let list = names.collect::<Vec<_>>().join(", ");
    if more > 0 { format!("{list} and {more} more") } else { list }
}
