//! MATLAB level 5 MAT-files: numeric arrays, plain or zlib-compressed.
//!
//! Source: MathWorks, "MAT-File Format", level 5. Read: real full arrays of every numeric class, small data
//! elements, both byte orders. Not read: structures, cells, sparse and complex arrays (skipped, with a remark).
//!
//! Some exporters store every variable twice, zeros first and data second (matio 1.5.2 as used by at least
//! one bench system). The *last* variable of a name that is not all zeros therefore wins ([`super::variables`]).

use super::variables::{Variable, columns};
use super::{Columns, Reading, time_axis};
use crate::budget::{self, VALUES};
use crate::{Error, Result, text};
use flate2::read::ZlibDecoder;
use std::path::Path;

const MATRIX: u32 = 14;
const COMPRESSED: u32 = 15;

/// Reads all numeric vectors of the longest length as channels, but a time vector, which gives the rate.
pub(super) fn read(path: &Path, bytes: &[u8], stem: &str, reading: &Reading) -> Result<Columns> {
    let refuse = |what: &str| Error::invalid(path.display(), what);
    let big_endian = match bytes.get(126..128) {
        Some(b"IM") => false,
        Some(b"MI") => true,
        _ => return Err(refuse("has no MAT-file header")),
    };
    let mut variables: Vec<Variable> = Vec::new();
    let (mut skipped, mut expanded, mut values) = (0, 0, 0);
    let mut cursor = Cursor { bytes: &bytes[128..], big_endian };
    let mut take = |element: &Element| -> Result<()> {
        let found = match element.kind {
            MATRIX => matrix(element.data, big_endian).ok_or_else(|| refuse("is truncated inside an array"))?,
            _ => None,
        };
        let Some(stored) = found else {
            skipped += 1;
            return Ok(());
        };
        // Bytes become numbers of eight bytes: counted before they do.
        values += stored.rows * stored.columns;
        VALUES.check(path.display(), values as f64, "save fewer variables or shorter ones")?;
        let broken = || refuse("is truncated inside an array");
        variables.push(stored.variable(big_endian).ok_or_else(broken)?);
        Ok(())
    };
    while !cursor.bytes.is_empty() {
        let element = cursor.element().ok_or_else(|| refuse("is truncated"))?;
        if element.kind != COMPRESSED {
            take(&element)?;
            continue;
        }
        let plain = budget::expand(path, "compressed array", ZlibDecoder::new(element.data), expanded)?;
        expanded += plain.len() as u64;
        let mut inner = Cursor { bytes: &plain, big_endian };
        take(&inner.element().ok_or_else(|| refuse("compressed array is truncated"))?)?;
    }
    let columns = columns(path, variables, skipped, stem)?;
    if reading.no_time {
        return Ok(columns);
    }
    let all: Vec<usize> = (0..columns.channels.len()).collect();
    time_axis::take(path, columns, &all)
}

/// A numeric array as it is stored.
struct Stored<'a> {
    name: String,
    rows: usize,
    columns: usize,
    kind: u32,
    data: &'a [u8],
}

impl Stored<'_> {
    /// Its values as f64; `None` if they are not as many as the dimensions say.
    fn variable(self, big_endian: bool) -> Option<Variable> {
        let values = numbers(self.kind, self.data, big_endian)?;
        let Self { name, rows, columns, .. } = self;
        (rows * columns == values.len()).then_some(Variable { name, rows, columns, values })
    }
}

struct Element<'a> {
    kind: u32,
    data: &'a [u8],
}

struct Cursor<'a> {
    bytes: &'a [u8],
    big_endian: bool,
}

impl<'a> Cursor<'a> {
    fn word(&self, at: usize) -> Option<u32> {
        let word: [u8; 4] = self.bytes.get(at..at + 4)?.try_into().ok()?;
        Some(if self.big_endian { u32::from_be_bytes(word) } else { u32::from_le_bytes(word) })
    }

    /// The next data element; the cursor moves behind its padding.
    fn element(&mut self) -> Option<Element<'a>> {
        let first = self.word(0)?;
        if first >> 16 != 0 {
            // Small element: length in the upper half, data in the second word.
            let length = (first >> 16) as usize;
            let data = self.bytes.get(4..4 + length.min(4))?;
            self.bytes = self.bytes.get(8..)?;
            return Some(Element { kind: first & 0xffff, data });
        }
        let length = self.word(4)? as usize;
        let data = self.bytes.get(8..8_usize.checked_add(length)?)?;
        let padded = if first == COMPRESSED { length } else { length.next_multiple_of(8) };
        self.bytes = &self.bytes[(8 + padded).min(self.bytes.len())..];
        Some(Element { kind: first, data })
    }
}

/// `None` if truncated, `Some(None)` if it is no real full numeric array of two dimensions.
fn matrix(bytes: &[u8], big_endian: bool) -> Option<Option<Stored<'_>>> {
    let mut cursor = Cursor { bytes, big_endian };
    let flags = cursor.element()?;
    let flags = Cursor { bytes: flags.data, big_endian }.word(0)?;
    let (class, complex) = (flags & 0xff, flags & 0x0800 != 0);
    if !(6..=15).contains(&class) || complex {
        return Some(None);
    }
    let dimensions = cursor.element()?;
    let name = cursor.element()?;
    let name = text::name(&String::from_utf8_lossy(name.data));
    let dims = Cursor { bytes: dimensions.data, big_endian };
    if dimensions.data.len() != 8 {
        return Some(None);
    }
    let (rows, columns) = (dims.word(0)? as usize, dims.word(4)? as usize);
    let data = cursor.element()?;
    // No number takes less than a byte: dimensions beyond the data are damage, found before they are multiplied
    // further.
    (rows.checked_mul(columns)? <= data.data.len()).then_some(Some(Stored {
        name,
        rows,
        columns,
        kind: data.kind,
        data: data.data,
    }))
}

fn numbers(kind: u32, data: &[u8], big_endian: bool) -> Option<Vec<f64>> {
    macro_rules! read {
        ($type:ty) => {
            data.chunks_exact(size_of::<$type>())
                .map(|c| {
                    let c = c.try_into().expect("chunks have the size of the type");
                    (if big_endian { <$type>::from_be_bytes(c) } else { <$type>::from_le_bytes(c) }) as f64
                })
                .collect()
        };
    }
    Some(match kind {
        1 => read!(i8),
        2 => read!(u8),
        3 => read!(i16),
        4 => read!(u16),
        5 => read!(i32),
        6 => read!(u32),
        7 => read!(f32),
        9 => read!(f64),
        12 => read!(i64),
        13 => read!(u64),
        _ => return None,
    })
}
