//! Where the pulses of each run come from: a channel of the recording, another recording that holds only the tach, or
//! edge times.
//!
//! `--tach` is a number (from 1, in the order of the channels), a name, or a file, and is read in this order. A
//! channel's name is the file's own; of a name made of file and variable the variable is enough. The channel leaves
//! the record's accelerations.

use super::TachOptions;
use super::edges::{self, Levels};
use crate::import::grouped::{Group, short};
use crate::import::{Reading, read_as};
use crate::record::read_edges;
use crate::{Error, Result, text};
use std::path::Path;

/// Shares of the run's length by which another recording of the tach may be longer or shorter.
const AS_LONG: f64 = 1e-3;
/// Names listed in a refusal.
const LISTED: usize = 12;
/// First line of a file of edge times.
const HEADER: &[u8] = b"edge_time_s";

/// Edge times of one run as they were found.
pub(super) struct Found {
    /// Channel or file, for people.
    pub source: String,
    /// Levels, where a signal was read.
    pub levels: Option<Levels>,
    /// Seconds from the run's first sample, ascending.
    pub edges_s: Vec<f64>,
}

/// Finds the edges of every run, and takes the channels they come from out of the runs.
///
/// # Errors
/// A source that is neither channel nor file, one that leaves no channel, unequal numbers of files and runs, and a
/// signal that is no tach's.
pub(super) fn take(options: &TachOptions, runs: &mut [Group], rate_hz: f64, reading: &Reading) -> Result<Vec<Found>> {
    let count = options.sources.len();
    if count != 1 && count != runs.len() {
        return Err(Error::invalid("--tach", format!("names {count} files for {} run(s)", runs.len())));
    }
    let several = runs.len() > 1;
    let mut found = Vec::new();
    for (i, run) in runs.iter_mut().enumerate() {
        let source = &options.sources[if count == 1 { 0 } else { i }];
        found.push(match channel(run, source)? {
            Some(index) => of_channel(options, run, index, rate_hz)?,
            None if !Path::new(source).exists() => return Err(unknown(run, source)),
            None if several && count == 1 => {
                let what = format!(
                    "{} is one file for {} runs; give one for each, separated by commas",
                    text::quoted(source),
                    runs.len()
                );
                return Err(Error::invalid("--tach", what));
            }
            None => of_file(options, run, Path::new(source), rate_hz, reading)?,
        });
    }
    Ok(found)
}

/// Index of the channel that `source` names.
fn channel(run: &Group, source: &str) -> Result<Option<usize>> {
    if let Ok(number) = source.parse::<usize>() {
        if (1..=run.names.len()).contains(&number) {
            return Ok(Some(number - 1));
        }
        return Err(unknown(run, source));
    }
    let named = |name: &String| name == source || name.split_once(' ').is_some_and(|(_, variable)| variable == source);
    let mut indices = run.names.iter().enumerate().filter(|(_, name)| named(name)).map(|(i, _)| i);
    match (indices.next(), indices.next()) {
        (Some(_), Some(_)) => {
            let what = format!("{} names several channels; give the number: {}", text::quoted(source), listed(run));
            Err(Error::invalid("--tach", what))
        }
        (first, _) => Ok(first),
    }
}

fn unknown(run: &Group, source: &str) -> Error {
    let what = format!("{} is neither a channel of {} ({}) nor a file", text::quoted(source), run.label, listed(run));
    Error::invalid("--tach", what)
}

/// The channels with their numbers.
fn listed(run: &Group) -> String {
    let names = run.names.iter().enumerate().take(LISTED).map(|(i, name)| format!("{} {}", i + 1, text::quoted(name)));
    let more = run.names.len().saturating_sub(LISTED);
    let list = names.collect::<Vec<_>>().join(", ");
    if more > 0 { format!("{list} and {more} more") } else { list }
}

fn of_channel(options: &TachOptions, run: &mut Group, index: usize, rate_hz: f64) -> Result<Found> {
    if run.channels.len() == 1 {
        let what = format!(
            "channel {} is the only one of {}; no acceleration would be left",
            text::quoted(&run.names[0]),
            run.label
        );
        return Err(Error::invalid("--tach", what));
    }
    let name = run.names.remove(index);
    let signal = run.channels.remove(index);
    let found = edges::edges(&run.label, &name, &signal, rate_hz, options.falling == Some(true), options.threshold)?;
    Ok(Found {
        source: format!("channel {} {}", index + 1, text::quoted(&name)),
        levels: Some(found.levels),
        edges_s: found.times_s,
    })
}

fn of_file(options: &TachOptions, run: &Group, path: &Path, rate_hz: f64, reading: &Reading) -> Result<Found> {
    let source = short(path);
    let length_s = run.channels[0].len() as f64 / rate_hz;
    if crate::budget::read(path)?.starts_with(HEADER) {
        if options.falling.is_some() || options.threshold.is_some() {
            let what = "has its edges already; --edge and --threshold are for signals";
            return Err(Error::invalid(path.display(), what));
        }
        let edges_s = read_edges(path)?;
        let (first, last) = (edges_s[0], edges_s[edges_s.len() - 1]);
        if first < -length_s || last > 2.0 * length_s {
            let what = format!("edges from {first} s to {last} s do not belong to a run of {length_s} s");
            return Err(Error::invalid(path.display(), what));
        }
        return Ok(Found { source, levels: None, edges_s });
    }
    let columns = read_as(path, reading)?;
    let [signal] = columns.channels.as_slice() else {
        let what = format!("holds {} channels; a file for --tach holds the tach alone", columns.channels.len());
        return Err(Error::invalid(path.display(), what));
    };
    let own_rate_hz = columns.rate_hz.unwrap_or(rate_hz);
    let own_length_s = signal.len() as f64 / own_rate_hz;
    if (own_length_s / length_s - 1.0).abs() > AS_LONG {
        let what = format!("is {own_length_s:.3} s long, {} {length_s:.3} s", run.label);
        return Err(Error::invalid(path.display(), what));
    }
    let place = path.display().to_string();
    let found =
        edges::edges(&place, &columns.names[0], signal, own_rate_hz, options.falling == Some(true), options.threshold)?;
    Ok(Found { source, levels: Some(found.levels), edges_s: found.times_s })
}
