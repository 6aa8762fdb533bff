//! WAV files: RIFF, RIFX (big-endian), RF64 and Wave64-less long files; integers of 8 to 64 bits, floats of 32 and 64.
//!
//! Source: Microsoft "Multimedia Data Standards", EBU Tech 3306 (RF64). Integers are scaled to +-1, so the unit of
//! the numbers is the recorder's full scale; no WAV file states one. A data size of nothing or of all bits is that of
//! a recorder that wrote to a pipe: the data reach to the end. Chunks behind the data that such a file may have are
//! not told apart from samples.

use super::signals::{Signal, Signals};
use crate::budget::VALUES;
use crate::{Error, Result};
use std::path::Path;

const PCM: u16 = 1;
const FLOAT: u16 = 3;
const EXTENSIBLE: u16 = 0xfffe;

/// Whether the content begins as a WAV file.
pub(super) fn looks_like(bytes: &[u8]) -> bool {
    [b"RIFF", b"RIFX", b"RF64", b"BW64"].iter().any(|magic| bytes.starts_with(*magic))
        && bytes.get(8..12) == Some(b"WAVE")
        || bytes.starts_with(b"RIFF")
}

/// What the format chunk says.
struct Format {
    kind: u16,
    channels: usize,
    rate_hz: f64,
    /// Bytes of one number.
    size: usize,
}

pub(super) fn read(path: &Path, bytes: &[u8], stem: &str) -> Result<Signals> {
    let refuse = |what: String| Error::invalid(path.display(), format!("WAV data is broken ({what})"));
    let big = bytes.starts_with(b"RIFX");
    if bytes.get(8..12) != Some(b"WAVE") {
        return Err(refuse("no WAVE form".into()));
    }
    let word = |at: usize| -> Option<u32> {
        let word: [u8; 4] = bytes.get(at..at + 4)?.try_into().ok()?;
        Some(if big { u32::from_be_bytes(word) } else { u32::from_le_bytes(word) })
    };
    let (mut at, mut long, mut format, mut remarks) = (12, None, None, Vec::new());
    while let (Some(id), Some(size)) = (bytes.get(at..at + 4), word(at + 4)) {
        let body = at + 8;
        match id {
            b"ds64" => {
                let size = bytes.get(body + 8..body + 16).and_then(|size| size.try_into().ok()).map(u64::from_le_bytes);
                long = size.and_then(|size| usize::try_from(size).ok());
            }
            b"fmt " => {
                let head = bytes
                    .get(body..body.saturating_add(size as usize))
                    .ok_or_else(|| refuse("a truncated format".into()))?;
                format = Some(Format::of(head, big).map_err(&refuse)?);
            }
            b"data" => {
                let format = format.ok_or_else(|| refuse("no format before the data".into()))?;
                let left = &bytes[body..];
                let streamed = size == u32::MAX || size == 0;
                let announced = match long {
                    Some(long) if size == u32::MAX => long,
                    _ if streamed => {
                        remarks.push("states no size, as a stream does; read to its end".to_owned());
                        left.len() / (format.channels * format.size) * (format.channels * format.size)
                    }
                    _ => size as usize,
                };
                let data = left
                    .get(..announced)
                    .ok_or_else(|| refuse(format!("{announced} bytes announced, {} follow", left.len())))?;
                return samples(path, data, &format, big, stem, remarks);
            }
            _ => {}
        }
        // Chunks begin at even bytes.
        at = body.saturating_add(size as usize).saturating_add(size as usize & 1);
    }
    Err(refuse("no data".into()))
}

impl Format {
    fn of(head: &[u8], big: bool) -> std::result::Result<Self, String> {
        let half = |at: usize| -> Option<u16> {
            let half: [u8; 2] = head.get(at..at + 2)?.try_into().ok()?;
            Some(if big { u16::from_be_bytes(half) } else { u16::from_le_bytes(half) })
        };
        let short = || "a truncated format".to_owned();
        let (kind, channels) = (half(0).ok_or_else(short)?, half(2).ok_or_else(short)?);
        let rate: [u8; 4] = head.get(4..8).and_then(|rate| rate.try_into().ok()).ok_or_else(short)?;
        let rate = if big { u32::from_be_bytes(rate) } else { u32::from_le_bytes(rate) };
        let (block, bits) = (half(12).ok_or_else(short)?, half(14).ok_or_else(short)?);
        let kind = if kind == EXTENSIBLE { half(24).ok_or_else(short)? } else { kind };
        let name = match kind {
            PCM | FLOAT => "",
            2 | 17 => "ADPCM",
            6 => "A-law",
            7 => "mu-law",
            85 => "MP3",
            _ => "an unknown coding",
        };
        if !name.is_empty() {
            return Err(format!(
                "samples are {name} (coding {kind}); only integers and floats are read: convert it with sox"
            ));
        }
        if channels == 0 || rate == 0 || bits == 0 {
            return Err("no channel, no rate or no bits".into());
        }
        // The container decides: 24 bits may lie in 32, left-justified.
        let size = if usize::from(block) >= usize::from(channels) {
            usize::from(block) / usize::from(channels)
        } else {
            usize::from(bits).div_ceil(8)
        };
        let known = if kind == FLOAT { [4, 8].contains(&size) } else { [1, 2, 3, 4, 8].contains(&size) };
        if !known || size * usize::from(channels) != usize::from(block) || usize::from(bits) > 8 * size {
            return Err(format!("{bits} bits in {size} bytes are no samples"));
        }
        Ok(Self { kind, channels: usize::from(channels), rate_hz: f64::from(rate), size })
    }

    fn number(&self, cell: &[u8], big: bool) -> f64 {
        let mut bytes = [0_u8; 8];
        bytes[..cell.len()].copy_from_slice(cell);
        if big {
            bytes[..cell.len()].reverse();
        }
        match (self.kind, cell.len()) {
            (FLOAT, 4) => f64::from(f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])),
            (FLOAT, _) => f64::from_le_bytes(bytes),
            (_, 1) => (f64::from(bytes[0]) - 128.0) / 128.0,
            (_, 2) => f64::from(i16::from_le_bytes([bytes[0], bytes[1]])) / 32_768.0,
            (_, 3) => f64::from(i32::from_le_bytes([0, bytes[0], bytes[1], bytes[2]])) / 2_147_483_648.0,
            (_, 8) => i64::from_le_bytes(bytes) as f64 / 2.0_f64.powi(63),
            _ => f64::from(i32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])) / 2_147_483_648.0,
        }
    }
}

fn samples(
    path: &Path,
    data: &[u8],
    format: &Format,
    big: bool,
    stem: &str,
    mut remarks: Vec<String>,
) -> Result<Signals> {
    let block = format.channels * format.size;
    VALUES.check(path.display(), (data.len() / format.size) as f64, "cut the file into parts")?;
    if !data.len().is_multiple_of(block) {
        return Err(Error::invalid(
            path.display(),
            format!("WAV data is broken ({} bytes are no whole number of samples)", data.len()),
        ));
    }
    let integers = format.kind == PCM;
    if integers {
        remarks.push("integer WAV samples are scaled to +-1 of full scale".into());
    }
    let mut found = Signals { signals: Vec::new(), rate_hz: Some(format.rate_hz), remarks };
    for c in 0..format.channels {
        let cells = data.chunks_exact(block).map(|row| &row[c * format.size..(c + 1) * format.size]);
        let values = cells.map(|cell| format.number(cell, big)).collect();
        let name = if format.channels == 1 { stem.to_owned() } else { format!("{stem} {c}") };
        let signal = Signal::unnamed(name, values);
        found.signals.push(Signal { largest: integers.then_some(1.0), ..signal });
    }
    Ok(found)
}
