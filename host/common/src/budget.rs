//! What one command may spend, in one place: every limit is stated here and checked before it is spent.
//!
//! A size that a file or an option announces is an estimate to be refused, not an allocation to be tried. Each
//! refusal is one line with the figure, the limit and what to change. Files are opened only where they are files: a
//! pipe or a device has no end that could be known beforehand.

use crate::{Error, Result, text};
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// A limit with its unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limit {
    /// Most that is allowed.
    pub most: f64,
    /// Of what.
    pub unit: &'static str,
}

const MIB: f64 = 1_048_576.0;

/// One input file that is taken whole, and what a compressed one expands to: 20 minutes of four channels as text.
pub const FILE: Limit = Limit { most: 512.0 * MIB, unit: "bytes" };
/// Numbers that are taken of measurement files at once, all channels; 960 MiB in memory: eight minutes of four channels
/// and a tachometer at 51.2 kHz. As float32 they are no more than a [`FILE`].
pub const VALUES: Limit = Limit { most: 120.0 * MIB, unit: "values" };
/// Samples times channels of all runs of one simulation; 512 MiB in memory.
pub const SAMPLES: Limit = Limit { most: 64.0 * MIB, unit: "samples x channels" };
/// Tach edges of one run.
pub const EDGES: Limit = Limit { most: 1e6, unit: "tach edges" };
/// Integration steps of one run; about four minutes on one core.
pub const STEPS: Limit = Limit { most: 2e8, unit: "integration steps" };
/// Integration steps of all runs of one simulation; about twenty minutes on one core.
pub const ALL_STEPS: Limit = Limit { most: 1e9, unit: "integration steps" };
/// Points of one channel at equal angles; about 1 GiB with all that is computed from them.
pub const ANGLES: Limit = Limit { most: 8e6, unit: "points at equal angles" };
/// Points at equal angles of all channels and runs that the kinematic loop takes; about 2 GiB with its copies.
pub const GRID: Limit = Limit { most: 3.2e7, unit: "points at equal angles, all channels" };
/// Rows of a stiffness table.
pub const TABLE_ROWS: Limit = Limit { most: 20_000.0, unit: "rows" };
/// Fastest shaft, turns per second: 60 000 rpm.
pub const SHAFT: Limit = Limit { most: 1000.0, unit: "turns/s" };
/// Highest natural frequency of a declared machine, in multiples of the sampling rate it is computed for.
pub const NATURAL_FREQUENCY: Limit = Limit { most: 20.0, unit: "times the sampling rate" };
impl Limit {
    /// Refuses what needs more than the limit; NaN is more.
    ///
    /// # Errors
    /// [`Error::Invalid`] with the figure, the limit and the remedy.
    pub fn check(&self, place: impl std::fmt::Display, needed: f64, remedy: &str) -> Result<()> {
        if needed <= self.most {
            return Ok(());
        }
        let what = format!("{} {}, the limit is {}; {remedy}", figure(needed), self.unit, figure(self.most));
        Err(Error::invalid(place, what))
    }
}

fn figure(value: f64) -> String {
    if value.abs() < 1e7 { text::number((10.0 * value).round() / 10.0) } else { format!("{value:.3e}") }
}

/// Opens a regular file of any size, for readers that do not take it whole; with its length, bytes.
///
/// # Errors
/// A missing or unreadable file, a folder, a pipe or a device.
pub fn open_any(path: &Path) -> Result<(File, u64)> {
    // Looked at before it is opened: opening a pipe waits for its writer.
    let metadata = std::fs::metadata(path).map_err(Error::file(path))?;
    if metadata.is_dir() {
        return Err(Error::invalid(path.display(), "is a folder, a file is needed"));
    }
    if !metadata.is_file() {
        return Err(Error::invalid(path.display(), "is a pipe or a device, a regular file is needed"));
    }
    Ok((File::open(path).map_err(Error::file(path))?, metadata.len()))
}

/// Opens a regular file no larger than [`FILE`].
///
/// # Errors
/// As [`open_any`], and a file that is too large.
pub fn open(path: &Path) -> Result<File> {
    let (file, length) = open_any(path)?;
    FILE.check(path.display(), length as f64, "cut it into parts")?;
    Ok(file)
}

/// Content of a regular file.
///
/// # Errors
/// As [`open`].
pub fn read(path: &Path) -> Result<Vec<u8>> {
    let file = open(path)?;
    // All at once: a vector that grows is copied as often as its length doubles.
    let announced = file.metadata().map_or(0, |found| found.len().min(FILE.most as u64));
    let mut bytes = Vec::with_capacity(announced as usize + 1);
    file.take(FILE.most as u64).read_to_end(&mut bytes).map_err(Error::file(path))?;
    Ok(bytes)
}

/// Content of a regular text file.
///
/// # Errors
/// As [`open`], and bytes that are no UTF-8.
pub fn read_text(path: &Path) -> Result<String> {
    String::from_utf8(read(path)?).map_err(|_| Error::invalid(path.display(), "is not text (UTF-8)"))
}

/// Everything a decompressing reader gives, as long as it stays within [`FILE`] less what was `spent` before.
///
/// # Errors
/// The reader's own as [`Error::Invalid`] that names `what`; more than the limit.
pub fn expand(path: &Path, what: &str, reader: impl Read, spent: u64) -> Result<Vec<u8>> {
    let left = (FILE.most as u64).saturating_sub(spent);
    let mut out = Vec::new();
    reader
        .take(left + 1)
        .read_to_end(&mut out)
        .map_err(|error| Error::invalid(path.display(), format!("{what} is broken or truncated ({error})")))?;
    if out.len() as u64 > left {
        let what = format!("{what} expands to more than the limit of {:.0} MiB; cut it into parts", FILE.most / MIB);
        return Err(Error::invalid(path.display(), what));
    }
    Ok(out)
}
