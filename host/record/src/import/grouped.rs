//! Files as runs: which channels belong together, and the sampling rate that all of them must share.

use super::selection::is_called;
use super::signals::Signal;
use super::units::Quantity;
use super::{Columns, ImportOptions};
use crate::{Error, Result, text};
use std::path::{Path, PathBuf};

/// Channels that become one run.
#[derive(Clone)]
pub(super) struct Group {
    /// The files, for messages.
    pub label: String,
    /// Names of the channels.
    pub names: Vec<String>,
    /// Equally long channels.
    pub channels: Vec<Vec<f64>>,
    /// Unit of every channel as the files write it.
    pub units: Vec<Option<String>>,
    /// What units and names say of every channel.
    pub quantities: Vec<Option<Quantity>>,
    /// First sample after the files' own zero, s.
    pub start_s: Option<f64>,
    /// Signals of another length, rate or start.
    pub apart: Vec<Signal>,
}

impl Group {
    /// Drops what is known of channels that were taken out since they were called `before`.
    pub fn follow(&mut self, before: &[String]) {
        let mut left = self.names.iter().peekable();
        let kept: Vec<bool> = before.iter().map(|name| left.next_if(|own| *own == name).is_some()).collect();
        let mut keep = kept.iter();
        self.units.retain(|_| *keep.next().unwrap_or(&true));
        let mut keep = kept.iter();
        self.quantities.retain(|_| *keep.next().unwrap_or(&true));
    }

    /// Takes the signal that `source` names out of those that stand apart.
    pub fn take_apart(&mut self, source: &str) -> Option<Signal> {
        let at = self.apart.iter().position(|signal| is_called(signal, source))?;
        Some(self.apart.remove(at))
    }
}

/// Puts the channels of the files together as one run, or each file's as a run of its own.
///
/// # Errors
/// Channels of one run that are not equally long, runs that have not equally many.
pub(super) fn grouped(files: &[PathBuf], sources: Vec<Columns>, files_are_runs: bool) -> Result<Vec<Group>> {
    let mut groups: Vec<Group> = Vec::new();
    for (file, source) in files.iter().zip(sources) {
        let samples = source.channels[0].len();
        match groups.first_mut() {
            Some(group) if !files_are_runs => {
                let expected = group.channels[0].len();
                if samples != expected {
                    let what = format!(
                        "has {samples} samples, {} has {expected}; --runs makes each file a run",
                        short(&files[0])
                    );
                    return Err(Error::invalid(file.display(), what));
                }
                group.label.push_str(&format!(", {}", short(file)));
                group.names.extend(source.names);
                group.channels.extend(source.channels);
                group.units.extend(source.units);
                group.quantities.extend(source.quantities);
                group.apart.extend(source.apart);
            }
            first => {
                if let Some(group) = first
                    && group.channels.len() != source.channels.len()
                {
                    let what = format!(
                        "has {} channels, {} has {}",
                        source.channels.len(),
                        short(&files[0]),
                        group.channels.len()
                    );
                    return Err(Error::invalid(file.display(), what));
                }
                groups.push(Group {
                    label: short(file),
                    names: source.names,
                    channels: source.channels,
                    units: source.units,
                    quantities: source.quantities,
                    start_s: source.start_s,
                    apart: source.apart,
                });
            }
        }
    }
    Ok(groups)
}

/// Rates that agree to this share are the same.
const SAME_RATE: f64 = 1e-4;

/// The sampling rate, from the user or the files, which must not contradict each other.
///
/// # Errors
/// No rate, no positive one, or two that differ.
pub(super) fn rate(
    files: &[PathBuf],
    sources: &[Columns],
    options: &ImportOptions,
    remarks: &mut Vec<String>,
) -> Result<f64> {
    let stated = || files.iter().zip(sources).filter_map(|(file, source)| Some((file, source.rate_hz?)));
    let (file, first) = files.iter().zip(sources).next().ok_or_else(|| Error::invalid("import", "no file given"))?;
    let rate = match options.rate_hz {
        Some(rate) if !(rate.is_finite() && rate > 0.0) => {
            return Err(Error::invalid("--rate", format!("{rate} is not a positive rate in Hz")));
        }
        Some(rate) => rate,
        None => {
            first.rate_hz.ok_or_else(|| Error::invalid(file.display(), "states no sampling rate; give --rate HZ"))?
        }
    };
    if options.rate_hz.is_none()
        && let Some((file, _)) = files.iter().zip(sources).find(|(_, source)| source.rate_hz.is_none())
    {
        let what = format!("does not state the first file's rate of {rate} Hz; give --rate HZ");
        return Err(Error::invalid(file.display(), what));
    }
    if let Some((file, other)) = stated().find(|(_, other)| (other / rate - 1.0).abs() > SAME_RATE) {
        let given = if options.rate_hz.is_some() { "--rate" } else { "the first file" };
        if !options.override_rate {
            let rate = text::number(rate);
            let what = format!("states {other} Hz, {given} {rate} Hz; --override-rate if the file is wrong");
            return Err(Error::invalid(file.display(), what));
        }
        remarks.push(format!("{}: states {other} Hz, {rate} Hz are taken instead", short(file)));
    }
    Ok(rate)
}

/// A file's name without its folder.
pub(super) fn short(path: &Path) -> String {
    path.file_name().map_or_else(|| path.display().to_string(), |name| name.to_string_lossy().into_owned())
}
