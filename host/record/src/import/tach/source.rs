//! Where the pulses of each run come from: a channel of the recording, another recording that holds only the tach,
//! or edge times.
//!
//! `--tach` is a number (from 1, in the order of the channels), a name, or a file, and is read in this order. A
//! channel's name is the file's own; of a name made of file and variable the variable is enough. The channel leaves
//! the record's accelerations. A file of one ascending column is edge times (`edge_times`).

use super::TachOptions;
use super::edge_times::{self, Column, Lasts};
use super::edges::{self, Levels};
use super::speed_trace;
use crate::import::grouped::{Group, short};
use crate::import::{Reading, Signal, read_as};
use crate::record::read_edges;
use crate::{Error, Result, text};
use std::path::Path;

/// Shares of the run's length by which another recording of the tach may be longer or shorter.
const LENGTH_TOLERANCE_SHARE: f64 = 1e-3;
/// Names listed in a refusal.
const MAX_LISTED_NAMES: usize = 12;
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
    /// Rate at which the signal was sampled, Hz; absent for edge times.
    pub sampled_at_hz: Option<f64>,
    /// Standard deviation of what sampling or rounding adds to an edge, s.
    pub resolution_s: f64,
}

impl Found {
    /// What of a whole recording belongs to the part of it that `run` is.
    ///
    /// # Errors
    /// Fewer than two edges in it.
    fn of_part(self, run: &Group) -> Result<Self> {
        let edges_s = run.moved(self.edges_s);
        match &run.cut {
            Some(cut) if edges_s.len() < 2 => {
                let what =
                    format!("{} has {} edges in {}; take a longer part", self.source, edges_s.len(), cut.described());
                Err(Error::invalid(&run.label, what))
            }
            _ => Ok(Self { edges_s, ..self }),
        }
    }

    /// Pulses made from a speed over time.
    fn of_speed(source: &str, edges_s: Vec<f64>) -> Self {
        let source = format!("{source}, a speed whose integral is the angle");
        Self { source, levels: None, edges_s, sampled_at_hz: None, resolution_s: 0.0 }
    }
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
            None if let Some(signal) = run.take_apart(source) => of_apart(options, run, &signal, rate_hz)?,
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
    let what = format!(
        "{} is neither a channel of {} ({}) nor a file; edge times are a file of their own, one ascending column \
          (csv, header edge_time_s)",
        text::quoted(source),
        run.label,
        listed(run)
    );
    Error::invalid("--tach", what)
}

/// The channels with their numbers.
fn listed(run: &Group) -> String {
    let names = run
        .names
        .iter()
        .enumerate()
        .take(MAX_LISTED_NAMES)
        .map(|(i, name)| format!("{} {}", i + 1, text::quoted(name)));
    let more = run.names.len().saturating_sub(MAX_LISTED_NAMES);
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
    let (unit, quantity) = (run.units.get(index).cloned().flatten(), run.quantities.get(index).copied().flatten());
    let name = run.names.remove(index);
    let signal = run.channels.remove(index);
    if let Some(factor) = speed_trace::turns_per_second(&name, unit.as_deref(), quantity, &signal) {
        let source = format!("channel {} {}", index + 1, text::quoted(&name));
        let edges_s = speed_trace::pulses(&run.label, &source, &signal, factor, rate_hz, options)?;
        return Ok(Found::of_speed(&source, edges_s));
    }
    let found = edges::edges(&run.label, &name, &signal, rate_hz, options.falling == Some(true), options.threshold)?;
    Ok(Found {
        source: format!("channel {} {}", index + 1, text::quoted(&name)),
        levels: Some(found.levels),
        edges_s: found.times_s,
        sampled_at_hz: Some(rate_hz),
        resolution_s: found.sampling_s,
    })
}

/// A signal of its own rate beside the channels, or edge times that are stored beside them.
fn of_apart(options: &TachOptions, run: &Group, signal: &Signal, rate_hz: f64) -> Result<Found> {
    let source = format!("signal {}", text::quoted(&signal.name));
    let values = &signal.values;
    let length_s = run.whole_s(rate_hz);
    let offset = signal.start_s.unwrap_or(0.0) - run.start_s.unwrap_or(0.0);
    let times = Column { name: signal.name.clone(), values: values.clone() };
    let lasts = Lasts { length_s, start_s: run.start_s };
    let factor = speed_trace::turns_per_second(&signal.name, signal.unit.as_deref(), signal.quantity(), values);
    if let Some((factor, own_rate_hz)) = factor.zip(signal.rate_hz) {
        let edges_s = speed_trace::pulses(&run.label, &source, values, factor, own_rate_hz, options)?;
        return Ok(Found::of_speed(&source, edges_s.iter().map(|edge| edge + offset).collect()));
    }
    if times.ascends() {
        return of_times(options, &times, &run.label, &source, &lasts, rate_hz)?.of_part(run);
    }
    let Some(own_rate_hz) = signal.rate_hz else {
        let what = format!(
            "{source} has {} values, the channels {}, states no rate, and its values are no edge times of {length_s} s",
            values.len(),
            run.channels[0].len()
        );
        return Err(Error::invalid("--tach", what));
    };
    let found =
        edges::edges(&run.label, &signal.name, values, own_rate_hz, options.falling == Some(true), options.threshold)?;
    let edges_s = found.times_s.iter().map(|time| time + offset).collect();
    Ok(Found {
        source: format!("{source} at {own_rate_hz} Hz"),
        levels: Some(found.levels),
        edges_s,
        sampled_at_hz: Some(own_rate_hz),
        resolution_s: found.sampling_s,
    })
}

fn of_file(options: &TachOptions, run: &Group, path: &Path, rate_hz: f64, reading: &Reading) -> Result<Found> {
    let source = short(path);
    let length_s = run.whole_s(rate_hz);
    let lasts = Lasts { length_s, start_s: run.start_s };
    if crate::budget::read(path)?.starts_with(HEADER) {
        if options.falling.is_some() || options.threshold.is_some() {
            let what = "has its edges already; --edge and --threshold are for signals";
            return Err(Error::invalid(path.display(), what));
        }
        let edges_s = lasts.placed(&path.display().to_string(), read_edges(path)?)?;
        let resolution_s = Column { name: String::new(), values: edges_s.clone() }.rounding();
        return Found { source, levels: None, edges_s, sampled_at_hz: None, resolution_s }.of_part(run);
    }
    if let Some(column) = edge_times::of_text(path)?.filter(Column::ascends) {
        return of_times(options, &column, &path.display().to_string(), &source, &lasts, rate_hz)?.of_part(run);
    }
    // Whole: edge times are only known by how they fill the recording.
    let reading = &Reading { part: None, ..reading.clone() };
    let columns = read_as(path, reading).or_else(|_| read_as(path, &Reading { no_time: true, ..reading.clone() }))?;
    let [signal] = columns.channels.as_slice() else {
        let what = format!("holds {} channels; a file for --tach holds the tach alone", columns.channels.len());
        return Err(Error::invalid(path.display(), what));
    };
    let times = Column { name: columns.names[0].clone(), values: signal.clone() };
    if times.ascends() {
        return of_times(options, &times, &path.display().to_string(), &source, &lasts, rate_hz)?.of_part(run);
    }
    let own_rate_hz = columns.rate_hz.unwrap_or(rate_hz);
    let own_length_s = signal.len() as f64 / own_rate_hz;
    if (own_length_s / length_s - 1.0).abs() > LENGTH_TOLERANCE_SHARE {
        let what = format!(
            "is {own_length_s:.3} s long, {} {length_s:.3} s; {}",
            run.label,
            edge_times::wanted(&columns.names[0])
        );
        return Err(Error::invalid(path.display(), what));
    }
    let place = path.display().to_string();
    let found =
        edges::edges(&place, &columns.names[0], signal, own_rate_hz, options.falling == Some(true), options.threshold)?;
    let found = Found {
        source,
        levels: Some(found.levels),
        edges_s: found.times_s,
        sampled_at_hz: Some(own_rate_hz),
        resolution_s: found.sampling_s,
    };
    found.of_part(run)
}

/// Edges of a column of times.
fn of_times(
    options: &TachOptions,
    column: &Column,
    place: &str,
    source: &str,
    lasts: &Lasts,
    rate_hz: f64,
) -> Result<Found> {
    if options.falling.is_some() || options.threshold.is_some() {
        return Err(Error::invalid(place, "has its edges already; --edge and --threshold are for signals"));
    }
    let (edges_s, unit) = column.seconds(place, lasts, rate_hz)?;
    let unit_s =
        (edges_s[edges_s.len() - 1] - edges_s[0]) / (column.values[column.values.len() - 1] - column.values[0]);
    Ok(Found {
        source: format!("{source} (edge times in {unit})"),
        levels: None,
        edges_s,
        sampled_at_hz: None,
        resolution_s: unit_s * column.rounding(),
    })
}
