//! Files as runs: which channels belong together, and the sampling rate that all of them must share.

use super::signals::Signal;
use super::units::Quantity;
use super::{Columns, ImportOptions};
use crate::part::Cut;
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
    /// Where the channels lie in their recording, where they are a part of it.
    pub cut: Option<Cut>,
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

    /// Length of the whole recording, s, of which the channels may be a part.
    pub fn whole_s(&self, rate_hz: f64) -> f64 {
        self.cut.map_or(self.channels[0].len() as f64 / rate_hz, |cut| cut.whole_s)
    }

    /// Edges from the recording's first sample as edges from the channels' first.
    pub fn moved(&self, edges_s: Vec<f64>) -> Vec<f64> {
        match &self.cut {
            Some(cut) => cut.moved(edges_s),
            None => edges_s,
        }
    }

    /// Takes the signal that `source` names out of those that stand apart.
    pub fn take_apart(&mut self, source: &str) -> Option<Signal> {
        let at = self.apart.iter().position(|signal| signal.is_called(source))?;
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
                together(group, files, file, &source)?;
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
                let source = match groups.first() {
                    Some(first) => in_order(first, files, file, source)?,
                    None => source,
                };
                groups.push(Group {
                    label: short(file),
                    names: source.names,
                    channels: source.channels,
                    units: source.units,
                    quantities: source.quantities,
                    start_s: source.start_s,
                    apart: source.apart,
                    cut: source.cut,
                });
            }
        }
    }
    Ok(groups)
}

/// Share of a sample by which the starts of channels of one run may differ.
const SAME_START: f64 = 0.5;

/// Refuses a file whose first sample is not that of the channels it would stand beside.
fn together(group: &Group, files: &[PathBuf], file: &Path, source: &Columns) -> Result<()> {
    let (Some(own), Some(first), Some(rate)) = (source.start_s, group.start_s, source.rate_hz) else { return Ok(()) };
    if (own - first).abs() * rate <= SAME_START {
        return Ok(());
    }
    let what = format!(
        "begins at {own} s, {} at {first} s, {:.1} samples apart; cut both to the same start, or import them as runs \
         of their own (--runs)",
        short(&files[0]),
        (own - first).abs() * rate
    );
    Err(Error::invalid(file.display(), what))
}

/// Channels of a further run in the order of the first one's, where names say it.
fn in_order(first: &Group, files: &[PathBuf], file: &Path, source: Columns) -> Result<Columns> {
    if source.names == first.names {
        return Ok(source);
    }
    let order: Vec<Option<usize>> =
        first.names.iter().map(|name| source.names.iter().position(|own| own == name)).collect();
    if order.iter().all(Option::is_none) {
        return Ok(source);
    }
    let Some(order) = order.into_iter().collect::<Option<Vec<usize>>>() else {
        let what = format!(
            "names its channels {}, {} {}: runs need the same ones; choose them with --columns",
            source.names.join(", "),
            short(&files[0]),
            first.names.join(", ")
        );
        return Err(Error::invalid(file.display(), what));
    };
    Ok(Columns {
        names: first.names.clone(),
        channels: order.iter().map(|&c| source.channels[c].clone()).collect(),
        units: order.iter().map(|&c| source.units[c].clone()).collect(),
        quantities: order.iter().map(|&c| source.quantities[c]).collect(),
        ..source
    })
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
