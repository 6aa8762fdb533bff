//! WAV files: RIFF, RIFX (big-endian), RF64 and Wave64-less long files; integers of 8 to 64 bits, floats of 32 and 64.
//!
//! Source: Microsoft "Multimedia Data Standards", EBU Tech 3306 (RF64). Integers are scaled to +-1, so the unit of
//! the numbers is the recorder's full scale; no WAV file states one. A data size of nothing or of all bits is that of
//! a recorder that wrote to a pipe: the data reach to the end. Chunks behind the data that such a file may have are
//! not told apart from samples. Samples are decoded as they are read: a part of a file of any size costs no more than
//! the part.

use super::signals::{Signal, Signals};
use crate::budget::{self, VALUES};
use crate::part::Part;
use crate::{Error, Result};
use std::io::{BufReader, Cursor, Read, Seek, SeekFrom};
use std::path::Path;

/// Bytes before the first chunk.
const HEAD: usize = 12;
/// Bytes of a format chunk that say anything.
const LONGEST_FORMAT: usize = 64;
/// Chunks that are looked at before the data.
const MOST_CHUNKS: usize = 10_000;
/// Samples of all channels that are read at once.
const ROWS: usize = 1 << 14;

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

/// The signals of a WAV file, read from the disk as they are decoded; `None` where the file is none.
pub(super) fn of_file(path: &Path, stem: &str, part: Option<Part>) -> Result<Option<Signals>> {
    let (file, length) = budget::open_any(path)?;
    let mut source = Source { path, reader: BufReader::new(file), length };
    let head = source.bytes(0, HEAD)?;
    if looks_like(&head) { read(source, &head, stem, part).map(Some) } else { Ok(None) }
}

/// The signals of a WAV file in memory.
pub(super) fn of_bytes(path: &Path, bytes: &[u8], stem: &str, part: Option<Part>) -> Result<Signals> {
    let source = Source { path, reader: Cursor::new(bytes), length: bytes.len() as u64 };
    read(source, &bytes[..bytes.len().min(HEAD)], stem, part)
}

/// A file or bytes at hand.
struct Source<'a, R> {
    path: &'a Path,
    reader: R,
    length: u64,
}

impl<R: Read + Seek> Source<'_, R> {
    /// Up to `count` bytes from `at` on, fewer at the end.
    fn bytes(&mut self, at: u64, count: usize) -> Result<Vec<u8>> {
        let mut bytes = Vec::new();
        self.reader.seek(SeekFrom::Start(at)).map_err(Error::file(self.path))?;
        self.reader.by_ref().take(count as u64).read_to_end(&mut bytes).map_err(Error::file(self.path))?;
        Ok(bytes)
    }

    fn refuse(&self, what: impl std::fmt::Display) -> Error {
        Error::invalid(self.path.display(), format!("WAV data is broken ({what})"))
    }
}

fn read<R: Read + Seek>(mut source: Source<R>, head: &[u8], stem: &str, part: Option<Part>) -> Result<Signals> {
    let big = head.starts_with(b"RIFX");
    if head.get(8..12) != Some(b"WAVE") {
        return Err(source.refuse("no WAVE form"));
    }
    let word = |bytes: &[u8]| -> Option<u32> {
        let word: [u8; 4] = bytes.get(4..8)?.try_into().ok()?;
        Some(if big { u32::from_be_bytes(word) } else { u32::from_le_bytes(word) })
    };
    let (mut at, mut long, mut format) = (HEAD as u64, None, None);
    for _ in 0..MOST_CHUNKS {
        let chunk = source.bytes(at, 8)?;
        let Some(size) = word(&chunk) else { return Err(source.refuse("no data")) };
        let body = at + 8;
        match &chunk[..4] {
            b"ds64" => {
                let sizes = source.bytes(body, 16)?;
                long = sizes.get(8..16).and_then(|size| size.try_into().ok()).map(u64::from_le_bytes);
            }
            b"fmt " => {
                let head = source.bytes(body, LONGEST_FORMAT.min(size as usize))?;
                if source.length.saturating_sub(body) < u64::from(size) {
                    return Err(source.refuse("a truncated format"));
                }
                format = Some(Format::of(&head, big).map_err(|what| source.refuse(what))?);
            }
            b"data" => {
                let format = format.ok_or_else(|| source.refuse("no format before the data"))?;
                let data = Data::of(&source, &format, body, size, long)?;
                return samples(&mut source, &data, &format, big, stem, part);
            }
            _ => {}
        }
        // Chunks begin at even bytes.
        at = body + u64::from(size) + u64::from(size & 1);
    }
    Err(source.refuse("no data"))
}

/// Where the samples lie.
struct Data {
    begin: u64,
    rows: usize,
    streamed: bool,
}

impl Data {
    fn of<R: Read + Seek>(
        source: &Source<R>,
        format: &Format,
        begin: u64,
        size: u32,
        long: Option<u64>,
    ) -> Result<Self> {
        let block = (format.channels * format.size) as u64;
        let left = source.length.saturating_sub(begin);
        let of_long = long.filter(|_| size == u32::MAX);
        let streamed = of_long.is_none() && (size == u32::MAX || size == 0);
        let announced = match of_long {
            Some(long) => long,
            None if streamed => left / block * block,
            None => u64::from(size),
        };
        if announced > left {
            return Err(source.refuse(format!("{announced} bytes announced, {left} follow")));
        }
        if !announced.is_multiple_of(block) {
            return Err(source.refuse(format!("{announced} bytes are no whole number of samples")));
        }
        Ok(Self { begin, rows: (announced / block) as usize, streamed })
    }
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

fn samples<R: Read + Seek>(
    source: &mut Source<R>,
    data: &Data,
    format: &Format,
    big: bool,
    stem: &str,
    part: Option<Part>,
) -> Result<Signals> {
    let mut found = Signals { rate_hz: Some(format.rate_hz), ..Signals::default() };
    if data.streamed {
        found.remarks.push("states no size, as a stream does; read to its end".to_owned());
    }
    let integers = format.kind == PCM;
    if integers {
        found.remarks.push("integer WAV samples are scaled to +-1 of full scale (or to --source-full-scale)".into());
    }
    let mut rows = 0..data.rows;
    if let Some(part) = part {
        let (range, cut) = part.of(source.path.display(), data.rows, format.rate_hz)?;
        (rows, found.cut) = (range, Some(cut));
    }
    let values = rows.len() as f64 * format.channels as f64;
    VALUES.check(source.path.display(), values, "take a part with --from and --to")?;
    let mut channels = vec![Vec::with_capacity(rows.len()); format.channels];
    let block = format.channels * format.size;
    for first in rows.clone().step_by(ROWS) {
        let count = ROWS.min(rows.end - first);
        let bytes = source.bytes(data.begin + (first * block) as u64, count * block)?;
        if bytes.len() != count * block {
            return Err(source.refuse("it became shorter while it was read"));
        }
        for (c, channel) in channels.iter_mut().enumerate() {
            let cells = bytes.chunks_exact(block).map(|row| &row[c * format.size..(c + 1) * format.size]);
            channel.extend(cells.map(|cell| format.number(cell, big)));
        }
    }
    for (c, values) in channels.into_iter().enumerate() {
        let name = if format.channels == 1 { stem.to_owned() } else { format!("{stem} {c}") };
        let signal = Signal::unnamed(name, values);
        found.signals.push(Signal { largest: integers.then_some(1.0), ..signal });
    }
    Ok(found)
}
