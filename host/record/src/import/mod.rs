//! Foreign measurement files as record folders.
//!
//! Every reader returns [`Columns`]: equally long f64 channels with whatever the file knows about names,
//! rate and unit. Formats are told apart by content first (MATLAB and NumPy magic, RIFF, gzip) and by
//! ending second. What a file does not state (rate, unit, teeth) is the user's to state; nothing is guessed
//! silently.

mod declared;
mod delimited;
mod flac;
mod follow;
mod grouped;
mod hdf5;
mod lines;
mod mat;
mod mesh_line;
mod quality;
mod quantisation;
mod record;
pub mod tach;
mod tdms;
mod time_axis;
mod uff58;
mod variables;
pub mod virtual_tach;
mod wav;

pub use declared::{read_full_scales, teeth};
pub use record::{ImportOptions, ImportSummary, TachChoice, Unit, import};

use crate::record::npy;
use crate::{Error, Result, budget, text};
use flate2::read::MultiGzDecoder;
use std::path::Path;

/// What the user says about a file's content where the file leaves it open.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Reading {
    /// Text: commas in numbers are decimal (`true`) or separate columns (`false`); told by the content where absent.
    pub decimal_comma: Option<bool>,
    /// No column is time, however evenly it ascends.
    pub no_time: bool,
}

/// Equally long channels of one file.
#[derive(Debug, Clone, PartialEq)]
pub struct Columns {
    /// Channel names as the file gives them.
    pub names: Vec<String>,
    /// One vector per channel.
    pub channels: Vec<Vec<f64>>,
    /// Sampling rate, Hz, where the file states one.
    pub rate_hz: Option<f64>,
    /// The largest number that a source of integers can hold, in the channels' numbers; `None` for values.
    pub largest: Option<f64>,
    /// What the reader did that the user should know (skipped variables, dropped columns).
    pub remarks: Vec<String>,
}

impl Columns {
    /// Refuses empty, ragged or non-finite data; makes the names fit for tables.
    fn checked(mut self, path: &Path) -> Result<Self> {
        let samples = self.channels.first().map_or(0, Vec::len);
        if samples < 2 {
            return Err(Error::invalid(path.display(), "holds no signal"));
        }
        self.names.iter_mut().for_each(|name| *name = text::name(name));
        for (name, channel) in self.names.iter().zip(&self.channels) {
            if channel.len() != samples {
                let what = format!("channel {name} has {} samples, the first has {samples}", channel.len());
                return Err(Error::invalid(path.display(), what));
            }
            if let Some(i) = channel.iter().position(|x| !x.is_finite()) {
                return Err(Error::invalid(path.display(), format!("channel {name}, sample {i} is {}", channel[i])));
            }
        }
        Ok(self)
    }
}

/// Reads one measurement file: MATLAB v5 or v7.3, HDF5, TDMS, csv, csv.gz, wav, FLAC, npy, or universal file dataset
/// 58.
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
    let mut bytes = budget::read(path)?;
    if bytes.starts_with(&[0x1f, 0x8b]) {
        // A gzip file may have several members, as parallel compressors and `cat` make them.
        bytes = budget::expand(path, "gzip data", MultiGzDecoder::new(&bytes[..]), 0)?;
    }
    let name = path.file_name().map(|n| n.to_string_lossy().to_lowercase()).unwrap_or_default();
    let stem = name.split('.').next().unwrap_or("signal").to_string();
    let ends = |endings: &[&str]| endings.iter().any(|e| name.ends_with(e) || name.ends_with(&format!("{e}.gz")));
    let columns = if hdf5::looks_like(&bytes) {
        hdf5::read(path, bytes, &stem, reading)?
    } else if bytes.starts_with(b"MATLAB 5.0") {
        mat::read(path, &bytes, &stem, reading)?
    } else if bytes.starts_with(b"\x93NUMPY") {
        numpy(path, &bytes, &stem, reading)?
    } else if bytes.starts_with(b"RIFF") {
        wav::read(path, &bytes, &stem)?
    } else if bytes.starts_with(b"TDSm") {
        tdms::read(path, &bytes)?
    } else if bytes.starts_with(b"fLaC") {
        flac::read(path, &bytes, &stem)?
    } else if bytes.get(124..128) == Some(b"\0\x02IM") {
        return Err(Error::invalid(path.display(), "is a MATLAB 7.3 (HDF5) file that has lost its HDF5 part"));
    } else if ends(&[".uff", ".unv", ".uf", ".58"]) || uff58::looks_like(&bytes) {
        uff58::read(path, &bytes)?
    } else if ends(&[".csv", ".txt", ".tsv", ".dat"]) {
        delimited::read(path, &utf8(path, bytes)?, &stem, reading)?
    } else {
        return Err(Error::invalid(path.display(), "is not mat, HDF5, TDMS, csv, csv.gz, wav, FLAC, npy or uff58"));
    };
    columns.checked(path)
}

/// Channels of a NumPy array, samples x channels; an array with more columns than rows is channels x samples.
fn numpy(path: &Path, bytes: &[u8], stem: &str, reading: &Reading) -> Result<Columns> {
    let (values, columns) = npy::parse_f64(path, bytes)?;
    let rows = values.len() / columns;
    let mut remarks = Vec::new();
    let channels: Vec<Vec<f64>> = if columns > rows && rows > 1 {
        remarks.push(format!("shape {rows} x {columns} is taken for channels x samples"));
        values.chunks(columns).map(<[f64]>::to_vec).collect()
    } else {
        (0..columns).map(|c| values.iter().skip(c).step_by(columns).copied().collect()).collect()
    };
    let names = (0..channels.len()).map(|c| format!("{stem}-{c}")).collect();
    let columns = Columns { names, channels, rate_hz: None, remarks, largest: npy::largest(bytes) };
    if reading.no_time { Ok(columns) } else { time_axis::take(path, columns, &[0]) }
}

fn utf8(path: &Path, bytes: Vec<u8>) -> Result<String> {
    String::from_utf8(bytes).map_err(|_| Error::invalid(path.display(), "is not text"))
}
