//! Puts imported channels into a record: channels or runs, unit, full scale, virtual tach.

use super::virtual_tach::{Options, Quality, virtual_tach};
use super::{Columns, read};
use crate::record::{Acquisition, Declaration, Record, Run, RunDeclaration, Tach, suggested_full_scale};
use crate::{Error, Result};
use serde::Serialize;
use std::path::{Path, PathBuf};
use toml::{Table, Value};

/// Standard acceleration of gravity, m/s2.
const GRAVITY: f64 = 9.80665;

/// Unit of the source.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Unit {
    /// m/s2.
    MetrePerSecondSquared,
    /// Multiples of standard gravity; converted.
    Gravity,
    /// Volts; converted where the sensitivity, V per g, is known, otherwise kept and named in the record.
    Volt(Option<f64>),
    /// Not stated by the source; kept and named in the record.
    Unknown,
}

impl Unit {
    /// Factor to the record's unit and the name of that unit where it is not m/s2.
    fn conversion(self) -> (f64, Option<String>) {
        match self {
            Unit::MetrePerSecondSquared => (1.0, None),
            Unit::Gravity => (GRAVITY, None),
            Unit::Volt(Some(volt_per_g)) => (GRAVITY / volt_per_g, None),
            Unit::Volt(None) => (1.0, Some("V".into())),
            Unit::Unknown => (1.0, Some("unknown".into())),
        }
    }
}

/// How to import.
#[derive(Debug, Clone, PartialEq)]
pub struct ImportOptions {
    /// Title of the record.
    pub title: String,
    /// Sampling rate, Hz; overrides what the files say, required where they say nothing.
    pub rate_hz: Option<f64>,
    /// Tooth counts; required for the virtual tach.
    pub teeth: Option<[u32; 2]>,
    /// Mesh frequency as far as known, Hz.
    pub mesh_guess_hz: Option<f64>,
    /// Unit of the source.
    pub unit: Unit,
    /// Channel names instead of those of the files.
    pub channel_names: Option<Vec<String>>,
    /// Full scale in the record's unit; 10 % over the peak where absent.
    pub full_scale: Option<f64>,
    /// Each file is a run of its own instead of channels of one run.
    pub files_are_runs: bool,
    /// Make no virtual tach.
    pub without_tach: bool,
    /// Remove each channel's mean (volts with an offset would waste codes).
    pub remove_mean: bool,
}

/// What an import did, for printing.
#[derive(Debug, Clone, Serialize)]
pub struct ImportSummary {
    /// Source files.
    pub files: Vec<PathBuf>,
    /// Sampling rate, Hz.
    pub sample_rate_hz: f64,
    /// Samples of each run.
    pub samples: Vec<usize>,
    /// Channel names.
    pub channels: Vec<String>,
    /// Value of code 32767.
    pub full_scale: f64,
    /// Unit of the record.
    pub unit: String,
    /// Signal over quantisation noise per channel of the first run, dB.
    pub quantisation_snr_db: Vec<f64>,
    /// Virtual tach of each run; empty without.
    pub tach: Vec<Quality>,
    /// Remarks of the readers.
    pub remarks: Vec<String>,
}

/// Reads `files` and builds the record in memory.
///
/// # Errors
/// Unreadable files, files that do not fit together, a missing rate, clipping at the chosen full scale, or no
/// trustworthy mesh line where a virtual tach is wanted.
pub fn import(files: &[PathBuf], options: &ImportOptions) -> Result<(Record, ImportSummary)> {
    let sources = files.iter().map(|file| read(file)).collect::<Result<Vec<Columns>>>()?;
    let first = files.first().ok_or_else(|| Error::invalid("import", "no file given"))?;
    let rate_hz = rate(files, &sources, options.rate_hz)?;
    let mut remarks: Vec<String> = Vec::new();
    for (file, source) in files.iter().zip(&sources) {
        remarks.extend(source.remarks.iter().map(|remark| format!("{}: {remark}", short(file))));
    }
    let mut runs = grouped(files, sources, options.files_are_runs)?;
    let names = channel_names(first, &runs[0], options.channel_names.as_deref())?;
    let (factor, unit) = options.unit.conversion();
    if !(factor.is_finite() && factor > 0.0) {
        return Err(Error::invalid("--volt-per-g", "must be a positive number"));
    }
    for channel in runs.iter_mut().flat_map(|run| &mut run.channels) {
        let mean = if options.remove_mean { channel.iter().sum::<f64>() / channel.len() as f64 } else { 0.0 };
        channel.iter_mut().for_each(|x| *x = factor * (*x - mean));
    }
    let full_scale = options
        .full_scale
        .unwrap_or_else(|| runs.iter().map(|run| suggested_full_scale(&run.channels)).fold(0.0, f64::max));
    let acquisition = Acquisition {
        sample_rate_hz: rate_hz,
        channels: names.clone(),
        full_scale_m_s2: full_scale,
        code_bits: 16,
        unit: unit.clone(),
        other: Table::new(),
    };
    let mut made = Vec::new();
    let mut quality = Vec::new();
    for (i, run) in runs.iter().enumerate() {
        let mut declaration = RunDeclaration::numbered(i, !options.without_tach, None);
        declaration.other.insert("source".into(), run.label.clone().into());
        let mut edges = Vec::new();
        if !options.without_tach {
            let tach = run_tach(&run.label, &run.channels, rate_hz, options)?;
            declaration.other.insert("virtual_tach".into(), quality_table(&tach.quality));
            edges = tach.edges_s;
            quality.push(tach.quality);
        }
        made.push(Run::from_signals(declaration, &acquisition, &run.channels, edges)?);
    }
    let tach = quality.iter().map(|q| q.jitter_s).reduce(f64::max).map(|jitter| Tach {
        shaft: "pinion".into(),
        pulses_per_rev: 1,
        jitter_s: Some(jitter),
        source: Some("virtual".into()),
        other: Table::new(),
    });
    let step = full_scale / crate::record::CODE_MAX;
    let summary = ImportSummary {
        files: files.to_vec(),
        sample_rate_hz: rate_hz,
        samples: made.iter().map(Run::samples).collect(),
        channels: names,
        full_scale,
        unit: unit.unwrap_or_else(|| "m/s2".into()),
        quantisation_snr_db: runs[0]
            .channels
            .iter()
            .map(|c| 10.0 * (variance(c) * 12.0 / (step * step)).log10())
            .collect(),
        tach: quality,
        remarks,
    };
    let mut declaration = Declaration::of_import(&options.title, options.teeth, acquisition, tach);
    declaration.runs = made.iter().map(|run| run.declaration.clone()).collect();
    Ok((Record { folder: PathBuf::from("."), declaration, runs: made }, summary))
}

/// Channels that become one run.
struct Group {
    label: String,
    names: Vec<String>,
    channels: Vec<Vec<f64>>,
}

fn grouped(files: &[PathBuf], sources: Vec<Columns>, files_are_runs: bool) -> Result<Vec<Group>> {
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
                groups.push(Group { label: short(file), names: source.names, channels: source.channels });
            }
        }
    }
    Ok(groups)
}

fn rate(files: &[PathBuf], sources: &[Columns], given: Option<f64>) -> Result<f64> {
    if let Some(rate) = given {
        if !(rate.is_finite() && rate > 0.0) {
            return Err(Error::invalid("--rate", format!("{rate} is not a positive rate in Hz")));
        }
        return Ok(rate);
    }
    let mut rates = files.iter().zip(sources);
    let (file, first) = rates.next().ok_or_else(|| Error::invalid("import", "no file given"))?;
    let rate =
        first.rate_hz.ok_or_else(|| Error::invalid(file.display(), "states no sampling rate; give --rate HZ"))?;
    for (file, source) in rates {
        if source.rate_hz.is_none_or(|other| (other / rate - 1.0).abs() > 1e-6) {
            return Err(Error::invalid(
                file.display(),
                format!("does not state the first file's rate of {rate} Hz; give --rate HZ"),
            ));
        }
    }
    Ok(rate)
}

fn channel_names(file: &Path, run: &Group, given: Option<&[String]>) -> Result<Vec<String>> {
    match given {
        Some(names) if names.len() == run.channels.len() => Ok(names.to_vec()),
        Some(names) => {
            let what = format!("names {} channels, {} holds {}", names.len(), short(file), run.channels.len());
            Err(Error::invalid("--channel-names", what))
        }
        None => Ok(run.names.clone()),
    }
}

fn run_tach(
    label: &str,
    channels: &[Vec<f64>],
    rate_hz: f64,
    options: &ImportOptions,
) -> Result<super::virtual_tach::VirtualTach> {
    let teeth = options
        .teeth
        .ok_or_else(|| Error::invalid("--teeth", "the virtual tach needs tooth counts; or give --no-tach"))?;
    if let Some(hz) = options.mesh_guess_hz.filter(|hz| !(hz.is_finite() && *hz > 0.0)) {
        return Err(Error::invalid("--mesh", format!("{hz} is not a positive frequency in Hz")));
    }
    if teeth.iter().any(|z| !(5..=1000).contains(z)) {
        return Err(Error::invalid("--teeth", format!("{},{} are not tooth counts (5 to 1000)", teeth[0], teeth[1])));
    }
    virtual_tach(label, channels, rate_hz, &Options { teeth, mesh_guess_hz: options.mesh_guess_hz })
}

fn quality_table(quality: &Quality) -> Value {
    Value::try_from(quality).unwrap_or_else(|_| Value::Table(Table::new()))
}

fn variance(values: &[f64]) -> f64 {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    values.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / values.len() as f64
}

fn short(path: &Path) -> String {
    path.file_name().map_or_else(|| path.display().to_string(), |name| name.to_string_lossy().into_owned())
}
