//! Foreign measurement files as record folders.
//!
//! Every reader returns its signals: values with the name, unit, rate and start that the file states for each. What a
//! format does not know is not its business: which columns are wanted, which is time, and which signals go together
//! as [`Columns`] is decided once for all formats. Formats are told apart by content first and by ending second. What
//! a file does not state is the user's to state; nothing is guessed silently.

mod cut;
mod declared;
mod delimited;
mod flac;
mod follow;
mod foreign;
mod grouped;
mod hdf5;
mod lines;
mod lvm;
mod mat;
mod mdf;
mod quality;
mod quantisation;
mod quantities;
mod record;
mod selection;
pub mod signals;
mod stamps;
mod table;
pub mod tach;
mod tdms;
mod time_axis;
mod train;
mod uff58;
pub mod units;
mod variables;
pub mod virtual_tach;
mod wav;

pub use declared::{read_full_scales, teeth};
pub use quantities::Unit;
pub use record::{ImportOptions, ImportSummary, TachChoice, import};
pub use signals::Signal;

use crate::part::{Cut, Part};
use crate::record::npy;
use crate::{Error, Result, budget};
use flate2::read::MultiGzDecoder;
use signals::Signals;
use std::path::Path;

/// What the user says about a file's content where the file leaves it open.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Reading {
    /// Text: commas in numbers are decimal (`true`) or separate columns (`false`); told by the content where absent.
    pub decimal_comma: Option<bool>,
    /// No column is time, however evenly it ascends.
    pub no_time: bool,
    /// Seconds per unit of time columns that state none.
    pub time_unit_s: Option<f64>,
    /// Sampling rate that the user states, Hz: what stamps are held against.
    pub rate_hz: Option<f64>,
    /// Columns that are read, by name or number; all where empty.
    pub columns: Vec<String>,
    /// Columns that are not looked at, by name or number.
    pub skip: Vec<String>,
    /// Names or numbers of the tachometer's channels, which are no accelerations.
    pub tach: Vec<String>,
    /// Part of the recording that is taken; all of it where absent.
    pub part: Option<Part>,
}

/// Equally long channels of one file, and what stands apart from them.
#[derive(Debug, Clone, PartialEq)]
pub struct Columns {
    /// Channel names as the file gives them.
    pub names: Vec<String>,
    /// One vector per channel.
    pub channels: Vec<Vec<f64>>,
    /// Unit of every channel as the file writes it.
    pub units: Vec<Option<String>>,
    /// What unit or name say that a channel is.
    pub quantities: Vec<Option<units::Quantity>>,
    /// Sampling rate, Hz, where the file states one.
    pub rate_hz: Option<f64>,
    /// First sample after the file's own zero, s, where the file states it.
    pub start_s: Option<f64>,
    /// The largest number that a source of integers can hold, in the channels' numbers; `None` for values.
    pub largest: Option<f64>,
    /// Signals of another length, rate or start.
    pub apart: Vec<Signal>,
    /// Where the channels lie in their recording, where they are a part of it.
    pub cut: Option<Cut>,
    /// What the reader did that the user should know (skipped variables, dropped columns).
    pub remarks: Vec<String>,
}

impl Columns {
    /// Refuses empty, ragged or non-finite data.
    fn checked(self, path: &Path) -> Result<Self> {
        let samples = self.channels.first().map_or(0, Vec::len);
        if samples < 2 {
            return Err(Error::invalid(path.display(), "holds no signal"));
        }
        if let Some(rate) = self.rate_hz.filter(|rate| !(rate.is_finite() && *rate > 0.0)) {
            return Err(Error::invalid(path.display(), format!("states a sampling rate of {rate} Hz")));
        }
        for (name, channel) in self.names.iter().zip(&self.channels) {
            if channel.len() != samples {
                let what = format!("channel {name} has {} samples, the first has {samples}", channel.len());
                return Err(Error::invalid(path.display(), what));
            }
            if let Some(i) = channel.iter().position(|x| !x.is_finite()) {
                let count = channel.iter().filter(|x| !x.is_finite()).count();
                let what = format!(
                    "channel {name}, sample {i} is {} (one of {count}); fill or cut it in the file, or leave the \
                     channel out with --skip",
                    channel[i]
                );
                return Err(Error::invalid(path.display(), what));
            }
        }
        Ok(self)
    }
}

/// Reads one measurement file: MATLAB (version 4 to 7.3), HDF5, TDMS, MDF 4, Parquet, Feather, LabVIEW text, csv and
/// other text, csv.gz, wav, FLAC, npy, or universal file dataset 58.
///
/// # Errors
/// A missing file, an unknown format, or content that is broken or beyond the [`budget`]; one line with file and place.
pub fn read(path: &Path) -> Result<Columns> {
    read_as(path, &Reading::default())
}

/// [`read`] with what the user says about the content.
///
/// # Errors
/// As [`read`].
pub fn read_as(path: &Path, reading: &Reading) -> Result<Columns> {
    let mut found = signals_of(path, reading)?;
    found.prepare();
    selection::skip(path, &mut found, reading)?;
    if !reading.no_time {
        time_axis::take(path, &mut found, reading)?;
    }
    selection::keep(path, &mut found, reading)?;
    cut::take(path, found.gather(path, reading)?, reading)?.checked(path)
}

/// The signals of a file of any format.
fn signals_of(path: &Path, reading: &Reading) -> Result<Signals> {
    let stem = stem(path);
    if let Some(found) = wav::of_file(path, &stem, reading.part)? {
        return Ok(found);
    }
    let mut bytes = budget::read(path)?;
    if bytes.starts_with(&[0x1f, 0x8b]) {
        // A gzip file may have several members, as parallel compressors and `cat` make them.
        bytes = budget::expand(path, "gzip data", MultiGzDecoder::new(&bytes[..]), 0)?;
    }
    let name = path.file_name().map(|n| n.to_string_lossy().to_lowercase()).unwrap_or_default();
    let ends = |endings: &[&str]| endings.iter().any(|e| name.ends_with(e) || name.ends_with(&format!("{e}.gz")));
    if hdf5::looks_like(&bytes) {
        return hdf5::read(path, bytes, &stem);
    }
    if bytes.starts_with(b"MATLAB 5.0") {
        return mat::read(path, &bytes, &stem);
    }
    if bytes.starts_with(b"\x93NUMPY") {
        return numpy(path, &bytes, &stem);
    }
    if wav::looks_like(&bytes) {
        return wav::of_bytes(path, &bytes, &stem, reading.part);
    }
    if bytes.starts_with(b"TDSm") {
        return tdms::read(path, &bytes);
    }
    if mdf::looks_like(&bytes) {
        return mdf::read(path, &bytes);
    }
    if table::is_parquet(&bytes) {
        return table::parquet(path, bytes);
    }
    if table::is_feather(&bytes) {
        return table::feather(path, bytes);
    }
    if bytes.starts_with(b"fLaC") {
        return flac::read(path, &bytes, &stem);
    }
    if bytes.get(124..128) == Some(b"\0\x02IM") {
        return Err(Error::invalid(path.display(), "is a MATLAB 7.3 (HDF5) file that has lost its HDF5 part"));
    }
    if ends(&[".uff", ".unv", ".uf", ".58"]) || uff58::looks_like(&bytes) {
        return uff58::read(path, &bytes);
    }
    if mat::version4::looks_like(&bytes, ends(&[".mat"])) {
        return mat::version4::read(path, &bytes, &stem);
    }
    if let Some(error) = foreign::known(path, &bytes, &name) {
        return Err(error);
    }
    if ends(&[".csv", ".txt", ".tsv", ".dat", ".asc", ".lvm", ".prn", ".log", ".tab", ".xls"])
        || delimited::looks_like(&bytes)
    {
        let (content, remark) = delimited::decode(path, bytes)?;
        let mut found = if lvm::looks_like(&content) {
            lvm::read(path, &content)?
        } else {
            delimited::read(path, &content, &stem, reading)?
        };
        found.remarks.extend(remark.map(str::to_owned));
        return Ok(found);
    }
    Err(Error::invalid(path.display(), foreign::REFUSAL))
}

/// What its signals are called after.
fn stem(path: &Path) -> String {
    let name = path.file_name().map(|n| n.to_string_lossy().to_lowercase()).unwrap_or_default();
    name.split('.').next().unwrap_or("signal").to_string()
}

/// Channels of a NumPy array, samples x channels; an array with more columns than rows is channels x samples.
fn numpy(path: &Path, bytes: &[u8], stem: &str) -> Result<Signals> {
    let (values, columns) = npy::parse_f64(path, bytes)?;
    let rows = values.len() / columns;
    let mut found = Signals::default();
    let channels: Vec<Vec<f64>> = if columns > rows {
        found.remarks.push(format!("shape {rows} x {columns} is taken for channels x samples"));
        values.chunks(columns).map(<[f64]>::to_vec).collect()
    } else {
        (0..columns).map(|c| values.iter().skip(c).step_by(columns).copied().collect()).collect()
    };
    let largest = npy::largest(bytes);
    let named = channels.into_iter().enumerate().map(|(c, values)| (format!("{stem}-{c}"), values));
    found.signals = named.map(|(name, values)| Signal { largest, ..Signal::unnamed(name, values) }).collect();
    Ok(found)
}
