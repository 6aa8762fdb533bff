//! Named arrays of a file as signals: what MATLAB and HDF5 files have in common.
//!
//! A single number called `fs`, `sr`, `sample_rate` or the like is the rate of the arrays beside it and below, not of
//! those elsewhere in the file; a text called `unit` their unit. Two rates of one place that differ are refused. Of a
//! name that is stored more than once the last array that is not all zeros wins.

use super::signals::{Signal, Signals};
use crate::{Error, Result, text};
use std::path::Path;

/// What a sampling rate is called, letters only.
const RATE_NAMES: [&str; 22] = [
    "fs",
    "fsamp",
    "fshz",
    "fsample",
    "sr",
    "srate",
    "samplerate",
    "samplingrate",
    "samplefrequency",
    "samplingfrequency",
    "sampleratehz",
    "samplingratehz",
    "samplefreq",
    "samplingfreq",
    "sampfreq",
    "fssamp",
    "samplingfrequencyhz",
    "ratehz",
    "acquisitionrate",
    "samplespersecond",
    "scanrate",
    "samplingrateinhz",
];
/// What a sampling interval in seconds is called, letters only.
const INTERVAL_NAMES: [&str; 13] = [
    "dt",
    "ts",
    "deltat",
    "tsample",
    "sampleinterval",
    "samplinginterval",
    "sampleperiod",
    "samplingperiod",
    "wfincrement",
    "timestep",
    "dts",
    "tsamp",
    "timeincrement",
];
/// What a unit is called, letters only.
const UNIT_NAMES: [&str; 8] =
    ["unit", "units", "yunit", "yunits", "unitstring", "engineeringunit", "engineeringunits", "physicalunit"];

/// A named array of two dimensions, stored column by column, or a text.
#[derive(Debug, Default)]
pub(super) struct Variable {
    /// Group or structure that it lies in, with `/` between; empty at the top.
    pub folder: String,
    /// Its own name.
    pub name: String,
    /// Its place for people.
    pub shown: String,
    pub rows: usize,
    pub columns: usize,
    pub values: Vec<f64>,
    pub text: Option<String>,
    /// What the array itself states.
    pub unit: Option<String>,
    pub rate_hz: Option<f64>,
    pub start_s: Option<f64>,
    /// What the user should know of it.
    pub note: Option<String>,
}

/// What the start of an array in seconds is called, letters only.
const START_NAMES: [&str; 11] = [
    "starttimes",
    "starttime",
    "starts",
    "start",
    "tstart",
    "t0",
    "wfstartoffset",
    "startoffset",
    "offsets",
    "timeoffset",
    "xstart",
];
/// What a factor is called whose sense is not known, letters only.
const FACTOR_NAMES: [&str; 8] = ["gain", "scale", "factor", "slope", "sensitivity", "lsb", "range", "fullscale"];

/// Whether a number of this name is the start of an array, s.
pub(super) fn is_start(name: &str) -> bool {
    START_NAMES.contains(&letters(name).as_str())
}

/// Whether a number of this name scales an array in a sense that its name does not tell.
pub(super) fn is_factor(name: &str) -> bool {
    FACTOR_NAMES.contains(&letters(name).as_str())
}

fn letters(name: &str) -> String {
    name.chars().filter(|c| c.is_alphanumeric()).flat_map(char::to_lowercase).collect()
}

/// The sampling rate that a number of this name is, Hz.
pub(super) fn rate_of(name: &str, value: f64) -> Option<f64> {
    let letters = letters(name);
    if RATE_NAMES.contains(&letters.as_str()) {
        return Some(value);
    }
    let is_interval = INTERVAL_NAMES.contains(&letters.as_str()) && value > 0.0 && value <= 1.0;
    is_interval.then(|| super::stamps::rate_hz(value, 1e-7))
}

/// Whether a text of this name is a unit.
pub(super) fn is_unit(name: &str) -> bool {
    UNIT_NAMES.contains(&letters(name).as_str())
}

/// What a folder states for what lies in it.
struct Said {
    folder: String,
    name: String,
    rate_hz: f64,
}

/// The arrays as signals, with the rates and units that are stated beside them.
pub(super) fn signals(path: &Path, variables: Vec<Variable>, skipped: usize, stem: &str) -> Result<Signals> {
    let mut found = Signals::default();
    let mut kept = last_of_each(variables, &mut found.remarks);
    found.remarks.extend(kept.iter().filter_map(|variable| variable.note.clone()));
    if skipped > 0 {
        found.remarks.push(format!("{skipped} variables that are no real numeric arrays were skipped"));
    }
    let rates = take_rates(path, &mut kept, &mut found.remarks)?;
    let mut units: Vec<(String, String)> = Vec::new();
    kept.retain(|variable| {
        let Some(text) = &variable.text else { return true };
        if is_unit(&variable.name) {
            units.push((variable.folder.clone(), text.clone()));
        }
        false
    });
    let arrays = kept.iter().filter(|variable| variable.values.len() > 1);
    if arrays.clone().count() == 0 {
        let objects =
            if skipped > 0 { "; tables, timetables and objects have to be saved as plain arrays" } else { "" };
        return Err(Error::invalid(path.display(), format!("holds no real numeric array{objects}")));
    }
    if arrays.flat_map(|variable| &variable.values).all(|&x| x == 0.0) {
        return Err(Error::invalid(path.display(), "every array is zero"));
    }
    for variable in kept {
        let near = |folder: &str| {
            let inside =
                folder.is_empty() || variable.folder == folder || variable.folder.starts_with(&format!("{folder}/"));
            inside.then_some(folder.len())
        };
        // What is nearest in the tree counts.
        let rate =
            rates.iter().filter_map(|said| Some((near(&said.folder)?, said.rate_hz))).max_by_key(|found| found.0);
        let unit = units.iter().filter_map(|(folder, unit)| Some((near(folder)?, unit))).max_by_key(|found| found.0);
        let rate_hz = variable.rate_hz.or(rate.map(|found| found.1));
        let unit = variable.unit.clone().or(unit.map(|found| found.1.clone()));
        for (c, (suffix, values)) in columns(variable.rows, variable.columns, variable.values).into_iter().enumerate() {
            let signal = Signal {
                own: Some(variable.name.clone()),
                folder: variable.folder.clone(),
                unit: unit.clone(),
                rate_hz: if values.len() > 1 { rate_hz } else { None },
                start_s: variable.start_s,
                ..Signal::unnamed(format!("{stem} {}{suffix}", variable.shown), values)
            };
            // Columns of one array are told by their numbers.
            let own = if suffix.is_empty() { variable.name.clone() } else { format!("{} {c}", variable.name) };
            found.signals.push(Signal { own: Some(own), ..signal });
        }
    }
    Ok(found)
}

/// Time runs along the longer side; arrays are stored column by column.
fn columns(rows: usize, columns: usize, values: Vec<f64>) -> Vec<(String, Vec<f64>)> {
    match rows.min(columns) {
        0 | 1 => vec![(String::new(), values)],
        count if rows >= columns => {
            (0..count).map(|c| (format!(" {c}"), values[c * rows..(c + 1) * rows].to_vec())).collect()
        }
        count => {
            let column = |c: usize| values.iter().skip(c).step_by(rows).copied().collect();
            (0..count).map(|c| (format!(" {c}"), column(c))).collect()
        }
    }
}

fn last_of_each(variables: Vec<Variable>, remarks: &mut Vec<String>) -> Vec<Variable> {
    let mut kept: Vec<Variable> = Vec::new();
    for variable in variables {
        let zero = variable.values.iter().all(|&x| x == 0.0);
        match kept.iter_mut().find(|other| other.name == variable.name && other.folder == variable.folder) {
            Some(other) => {
                remarks.push(format!(
                    "variable {} is stored more than once; the last that is not zero is used",
                    other.shown
                ));
                if !zero {
                    *other = variable;
                }
            }
            None => kept.push(variable),
        }
    }
    kept
}

/// Takes the numbers that are sampling rates out of the variables.
fn take_rates(path: &Path, kept: &mut Vec<Variable>, remarks: &mut Vec<String>) -> Result<Vec<Said>> {
    let mut said: Vec<Said> = Vec::new();
    let mut refused = None;
    kept.retain(|variable| {
        let [value] = variable.values[..] else { return true };
        let Some(rate_hz) = rate_of(&variable.name, value) else { return true };
        if !(rate_hz.is_finite() && rate_hz >= 1.0) {
            let name = text::quoted(&variable.shown);
            refused.get_or_insert(format!("variable {name} is {value}, no sampling rate in Hz"));
        }
        if let Some(other) =
            said.iter().find(|other| other.folder == variable.folder && (other.rate_hz / rate_hz - 1.0).abs() > 1e-6)
        {
            refused.get_or_insert(format!(
                "states two sampling rates, {} of {} and {} of {}; keep the right one in the file",
                text::number(other.rate_hz),
                text::quoted(&other.name),
                text::number(rate_hz),
                text::quoted(&variable.shown)
            ));
        }
        remarks.push(format!("variable {} is the sampling rate, {rate_hz} Hz", variable.shown));
        said.push(Said { folder: variable.folder.clone(), name: variable.shown.clone(), rate_hz });
        false
    });
    match refused {
        Some(what) => Err(Error::invalid(path.display(), what)),
        None => Ok(said),
    }
}
