//! Foreign measurement files as record folders.
//!
//! Every reader returns [`Columns`]: equally long f64 channels with whatever the file knows about names,
//! rate and unit. Formats are told apart by content first (MATLAB and NumPy magic, RIFF, gzip) and by
//! ending second. What a file does not state (rate, unit, teeth) is the user's to state; nothing is guessed
//! silently.

mod delimited;
mod mat;
mod mesh_line;
mod record;
mod uff58;
pub mod virtual_tach;
mod wav;

pub use record::{ImportOptions, ImportSummary, Unit, import};

use crate::record::npy;
use crate::{Error, Result};
use flate2::read::GzDecoder;
use std::io::Read;
use std::path::Path;

/// Equally long channels of one file.
#[derive(Debug, Clone, PartialEq)]
pub struct Columns {
    /// Channel names as the file gives them.
    pub names: Vec<String>,
    /// One vector per channel.
    pub channels: Vec<Vec<f64>>,
    /// Sampling rate, Hz, where the file states one.
    pub rate_hz: Option<f64>,
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

/// Largest file after decompression that is read, bytes: a compressed file must not exhaust memory.
const SIZE_LIMIT: u64 = 4 << 30;

/// Reads one measurement file: MATLAB v5, csv, csv.gz, wav, npy, or universal file dataset 58.
///
/// # Errors
/// A missing file, an unknown format, or content that is broken; one line with file and place.
pub fn read(path: &Path) -> Result<Columns> {
    let mut bytes = std::fs::read(path).map_err(Error::file(path))?;
    if bytes.starts_with(&[0x1f, 0x8b]) {
        bytes = gunzip(path, &bytes)?;
    }
    let name = path.file_name().map(|n| n.to_string_lossy().to_lowercase()).unwrap_or_default();
    let stem = name.split('.').next().unwrap_or("signal").to_string();
    let ends = |endings: &[&str]| endings.iter().any(|e| name.ends_with(e) || name.ends_with(&format!("{e}.gz")));
    let columns = if bytes.starts_with(b"MATLAB 5.0") {
        mat::read(path, &bytes, &stem)?
    } else if bytes.starts_with(b"\x93NUMPY") {
        let (values, columns) = npy::read_f64(path)?;
        let channels: Vec<Vec<f64>> =
            (0..columns).map(|c| values.iter().skip(c).step_by(columns).copied().collect()).collect();
        let names = (0..columns).map(|c| format!("{stem}-{c}")).collect();
        Columns { names, channels, rate_hz: None, remarks: Vec::new() }
    } else if bytes.starts_with(b"RIFF") {
        wav::read(path, &bytes, &stem)?
    } else if bytes.get(124..128) == Some(b"\0\x02IM") || bytes.starts_with(b"\x89HDF") {
        return Err(Error::invalid(path.display(), "is a MATLAB 7.3 (HDF5) file; save it with -v6 or -v7"));
    } else if ends(&[".uff", ".unv", ".uf", ".58"]) || uff58::looks_like(&bytes) {
        uff58::read(path, &text(path, bytes)?)?
    } else if ends(&[".csv", ".txt", ".tsv", ".dat"]) {
        delimited::read(path, &text(path, bytes)?, &stem)?
    } else {
        return Err(Error::invalid(path.display(), "is not mat (v5), csv, csv.gz, wav, npy or uff58"));
    };
    columns.checked(path)
}

fn gunzip(path: &Path, bytes: &[u8]) -> Result<Vec<u8>> {
    let mut out = Vec::new();
    GzDecoder::new(bytes)
        .take(SIZE_LIMIT)
        .read_to_end(&mut out)
        .map_err(|error| Error::invalid(path.display(), format!("gzip data is broken or truncated ({error})")))?;
    Ok(out)
}

fn text(path: &Path, bytes: Vec<u8>) -> Result<String> {
    String::from_utf8(bytes).map_err(|_| Error::invalid(path.display(), "is not text"))
}
