//! Named arrays of a file as channels: what MATLAB and HDF5 files have in common.
//!
//! The longest arrays are the channels; a single number called `fs`, `Fs`, `sample_rate` or the like is the sampling
//! rate in Hz. Of a name that is stored more than once the last array that is not all zeros wins.

use super::Columns;
use crate::{Error, Result, text};
use std::path::Path;

/// What a sampling rate is called, letters only.
const RATE_NAMES: [&str; 8] =
    ["fs", "fsamp", "fshz", "samplerate", "samplingrate", "samplefrequency", "samplingfrequency", "sampleratehz"];
/// Variables left out that are named in a remark.
const LISTED: usize = 10;

/// A named array of two dimensions, stored column by column.
pub(super) struct Variable {
    pub name: String,
    pub rows: usize,
    pub columns: usize,
    pub values: Vec<f64>,
}

/// Whether a name is that of a sampling rate; of a path its last part.
pub(super) fn is_rate(name: &str) -> bool {
    let last = name.rsplit('/').next().unwrap_or_default();
    let letters: String = last.chars().filter(|c| c.is_alphanumeric()).flat_map(char::to_lowercase).collect();
    RATE_NAMES.contains(&letters.as_str())
}

/// Keeps the last non-zero variable of each name and takes those of the longest length as channels.
pub(super) fn columns(path: &Path, variables: Vec<Variable>, skipped: usize, stem: &str) -> Result<Columns> {
    let mut remarks = Vec::new();
    let mut kept: Vec<Variable> = Vec::new();
    for variable in variables {
        let zero = variable.values.iter().all(|&x| x == 0.0);
        match kept.iter_mut().find(|other| other.name == variable.name) {
            Some(other) => {
                remarks.push(format!(
                    "variable {} is stored more than once; the last that is not zero is used",
                    other.name
                ));
                if !zero {
                    *other = variable;
                }
            }
            None => kept.push(variable),
        }
    }
    if skipped > 0 {
        remarks.push(format!("{skipped} variables that are no real numeric arrays were skipped"));
    }
    let rate_hz = take_rate(path, &mut kept, &mut remarks)?;
    let longest = kept.iter().map(|v| v.rows.max(v.columns)).max().unwrap_or(0);
    let (mut names, mut channels, mut small) = (Vec::new(), Vec::new(), Vec::new());
    for mut variable in kept {
        let (rows, columns) = (variable.rows, variable.columns);
        if rows.max(columns) != longest || longest < 2 {
            small.push(variable.name);
            continue;
        }
        // Time runs along the longer side; arrays are stored column by column.
        let count = rows.min(columns);
        for c in 0..count {
            names.push(if count == 1 {
                format!("{stem} {}", variable.name)
            } else {
                format!("{stem} {} {c}", variable.name)
            });
            channels.push(if count == 1 {
                std::mem::take(&mut variable.values)
            } else if rows >= columns {
                variable.values[c * rows..(c + 1) * rows].to_vec()
            } else {
                variable.values.iter().skip(c).step_by(rows).copied().collect()
            });
        }
    }
    if channels.is_empty() {
        return Err(Error::invalid(path.display(), "holds no real numeric array"));
    }
    if channels.iter().flatten().all(|&x| x == 0.0) {
        return Err(Error::invalid(path.display(), "every array is zero"));
    }
    if !small.is_empty() {
        let more = if small.len() > LISTED { format!(" and {} more", small.len() - LISTED) } else { String::new() };
        small.truncate(LISTED);
        remarks.push(format!("shorter variables are not channels: {}{more}", small.join(", ")));
    }
    Ok(Columns { names, channels, rate_hz, remarks, largest: None })
}

/// Takes the scalar that is called a sampling rate out of the variables.
fn take_rate(path: &Path, kept: &mut Vec<Variable>, remarks: &mut Vec<String>) -> Result<Option<f64>> {
    let Some(at) = kept.iter().position(|v| v.values.len() == 1 && is_rate(&v.name)) else { return Ok(None) };
    let variable = kept.remove(at);
    let rate_hz = variable.values[0];
    if !(rate_hz.is_finite() && rate_hz >= 1.0) {
        let what = format!("variable {} is {rate_hz}, no sampling rate in Hz", text::quoted(&variable.name));
        return Err(Error::invalid(path.display(), what));
    }
    remarks.push(format!("variable {} is the sampling rate, {rate_hz} Hz", variable.name));
    Ok(Some(rate_hz))
}
