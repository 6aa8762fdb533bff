//! NumPy array files of records and predictions: int16 codes and float32 predictions, samples x channels.
//!
//! The header is parsed and written by `npyz`; the size is checked against the file before anything is allocated, so a
//! header that promises too much is a truncated file and not an allocation. The numbers behind it are taken and put
//! here, all at once: one by one through the library's reader and writer they cost ten times as much.

use crate::budget::{self, VALUES};
use crate::{Error, Result};
use npyz::{Order, WriterBuilder};
use std::path::Path;

/// Reads little-endian int16 codes; returns them interleaved (samples x channels) with the channel count.
///
/// A one-dimensional array is one channel. Fortran order is accepted and transposed.
///
/// # Errors
/// Missing, truncated or oversized file, another dtype, more than two dimensions, no samples or no channels.
pub fn read_i16(path: &Path) -> Result<(Vec<i16>, usize)> {
    let bytes = budget::read(path)?;
    let header = Header::parse(path, &bytes)?;
    if header.dtype != "<i2" {
        let what = format!("dtype is {}, a record needs little-endian int16 '<i2'", header.dtype);
        return Err(Error::invalid(path.display(), what));
    }
    let values = header.values(&bytes, i16::from_le_bytes);
    Ok((values, header.columns))
}

/// Reads little-endian float32 values; returns them interleaved (samples x channels) with the channel count.
///
/// # Errors
/// As [`read_i16`].
pub fn read_f32(path: &Path) -> Result<(Vec<f32>, usize)> {
    let bytes = budget::read(path)?;
    let header = Header::parse(path, &bytes)?;
    if header.dtype != "<f4" {
        let what = format!("dtype is {}, a record of code_bits = 32 needs little-endian float32 '<f4'", header.dtype);
        return Err(Error::invalid(path.display(), what));
    }
    let values = header.values(&bytes, f32::from_le_bytes);
    Ok((values, header.columns))
}

/// Reads float32, float64 or an integer type as f64; returns the values (rows x columns) and the column count.
///
/// # Errors
/// As [`read_i16`], but for the dtype: any of f4, f8, i2, i4, i8, u1, u2, little- or big-endian.
pub fn read_f64(path: &Path) -> Result<(Vec<f64>, usize)> {
    parse_f64(path, &budget::read(path)?)
}

/// The largest number of a file's integer type; `None` for floats, and where the type cannot be told.
pub fn largest(bytes: &[u8]) -> Option<f64> {
    let header = Header::parse(Path::new("npy"), bytes).ok()?;
    match &header.dtype[1..] {
        "i2" => Some(f64::from(i16::MAX)),
        "i4" => Some(f64::from(i32::MAX)),
        _ => None,
    }
}

/// [`read_f64`] of bytes at hand; `path` names them in errors.
///
/// # Errors
/// As [`read_f64`].
pub fn parse_f64(path: &Path, bytes: &[u8]) -> Result<(Vec<f64>, usize)> {
    let header = Header::parse(path, bytes)?;
    VALUES.check(path.display(), header.rows as f64 * header.columns as f64, "cut the file into parts")?;
    let big_endian = header.dtype.starts_with('>');
    macro_rules! read {
        ($type:ty) => {
            header.values(bytes, |number| {
                (if big_endian { <$type>::from_be_bytes(number) } else { <$type>::from_le_bytes(number) }) as f64
            })
        };
    }
    let values: Vec<f64> = match &header.dtype[1..] {
        "f4" => read!(f32),
        "f8" => read!(f64),
        "i2" => read!(i16),
        "i4" => read!(i32),
        "i8" => read!(i64),
        "i1" => read!(i8),
        "u1" => read!(u8),
        "u2" => read!(u16),
        _ => return Err(Error::invalid(path.display(), format!("dtype {} is not supported", header.dtype))),
    };
    Ok((values, header.columns))
}

/// An array file of int16 codes as `<i2`, shape samples x channels.
///
/// # Panics
/// If the codes are not a whole number of samples: a programming error of the caller.
pub fn bytes_i16(codes: &[i16], channels: usize) -> Vec<u8> {
    bytes(codes, channels, "<i2", i16::to_le_bytes)
}

/// An array file of a prediction as `<f4`, shape samples x channels.
///
/// # Panics
/// If the values are not a whole number of samples: a programming error of the caller.
pub fn bytes_f32(values: &[f32], channels: usize) -> Vec<u8> {
    bytes(values, channels, "<f4", f32::to_le_bytes)
}

/// An array file of samples as `<f8`, shape samples x channels.
///
/// # Panics
/// If the values are not a whole number of samples: a programming error of the caller.
pub fn bytes_f64(values: &[f64], channels: usize) -> Vec<u8> {
    bytes(values, channels, "<f8", f64::to_le_bytes)
}

fn bytes<T: npyz::Serialize + Copy, const SIZE: usize>(
    values: &[T],
    channels: usize,
    dtype: &str,
    number: impl Fn(T) -> [u8; SIZE],
) -> Vec<u8> {
    assert!(channels > 0 && values.len().is_multiple_of(channels), "whole samples");
    let shape = [(values.len() / channels) as u64, channels as u64];
    let mut bytes = Vec::with_capacity(size_of_val(values) + 128);
    let dtype = npyz::DType::Plain(dtype.parse().expect("a valid type string"));
    let options = npyz::WriteOptions::<T>::new().dtype(dtype).shape(&shape).writer(&mut bytes);
    // The header is written with the first call; the writer itself would only count the numbers.
    drop(options.begin_nd().expect("memory takes every header"));
    bytes.extend(values.iter().flat_map(|&value| number(value)));
    bytes
}

/// The parts of an npy header that matter here.
struct Header {
    dtype: String,
    rows: usize,
    columns: usize,
    fortran: bool,
    /// Where the numbers begin.
    data: usize,
}

impl Header {
    fn parse(path: &Path, bytes: &[u8]) -> Result<Self> {
        let refuse = |what: String| Error::invalid(path.display(), what);
        // The library multiplies the shape before anyone can look at it.
        if values_announced(bytes).is_none() {
            return Err(refuse("announces more values than a file can hold".into()));
        }
        // It takes twice as long for every level of brackets.
        if depth(header_text(bytes)) > DEEPEST_HEADER {
            return Err(refuse(
                "is not a NumPy array file (its header's brackets are nested deeper than any array's)".into(),
            ));
        }
        let mut rest = bytes;
        let header = npyz::NpyHeader::from_reader(&mut rest)
            .map_err(|error| refuse(format!("is not a NumPy array file ({})", first_line(&error.to_string()))))?;
        let npyz::DType::Plain(plain) = header.dtype() else {
            return Err(refuse("holds records or objects, not numbers".into()));
        };
        let (rows, columns) = match header.shape() {
            [rows] => (*rows, 1),
            [rows, columns] => (*rows, *columns),
            shape => return Err(refuse(format!("shape {shape:?} is not samples x channels"))),
        };
        if rows == 0 || columns == 0 {
            return Err(refuse(format!("shape {rows} x {columns} holds no samples")));
        }
        let dtype = plain.to_string();
        let size: u64 = plain.num_bytes().map_or(0, |n| n as u64);
        let wanted = rows.checked_mul(columns).and_then(|n| n.checked_mul(size));
        if wanted != Some(rest.len() as u64) {
            let verdict = if wanted.is_none_or(|n| n > rest.len() as u64) { "truncated" } else { "too long" };
            let wanted = wanted.map_or("too many".to_string(), |n| n.to_string());
            let what = format!(
                "is {verdict}: shape {rows} x {columns} of {dtype} needs {wanted} bytes, {} follow",
                rest.len()
            );
            return Err(refuse(what));
        }
        let fortran = header.order() == Order::Fortran;
        Ok(Self { dtype, rows: rows as usize, columns: columns as usize, fortran, data: bytes.len() - rest.len() })
    }

    /// Numbers in rows x columns order.
    fn values<T: Copy, const SIZE: usize>(&self, bytes: &[u8], number: impl Fn([u8; SIZE]) -> T) -> Vec<T> {
        let (numbers, _) = bytes[self.data..].as_chunks();
        if !self.fortran || self.columns == 1 {
            return numbers.iter().map(|bytes| number(*bytes)).collect();
        }
        let index = (0..self.rows).flat_map(|row| (0..self.columns).map(move |column| column * self.rows + row));
        index.map(|i| number(numbers[i])).collect()
    }
}

/// Longest header that is looked at, bytes.
const LONGEST_HEADER: usize = 65_536;

/// Most brackets within each other in a header: a dictionary with a list of fields, of lists, of shapes.
const DEEPEST_HEADER: usize = 8;

/// The header's text by the length that the file states: two bytes in version 1, four in later ones.
fn header_text(bytes: &[u8]) -> &[u8] {
    let (length, begin) = match bytes {
        [_, _, _, _, _, _, 1, _, low, high, ..] => (usize::from(u16::from_le_bytes([*low, *high])), 10),
        [_, _, _, _, _, _, _, _, a, b, c, d, ..] => (u32::from_le_bytes([*a, *b, *c, *d]) as usize, 12),
        _ => return &[],
    };
    let rest = &bytes[begin..];
    &rest[..length.min(rest.len())]
}

/// Most brackets within each other.
fn depth(text: &[u8]) -> usize {
    let (mut depth, mut deepest) = (0usize, 0);
    for byte in text {
        match byte {
            b'(' | b'[' | b'{' => depth += 1,
            b')' | b']' | b'}' => depth = depth.saturating_sub(1),
            _ => {}
        }
        deepest = deepest.max(depth);
    }
    deepest
}

/// Product of the numbers behind the header's word `shape`, 1 where there are none to be found; `None` beyond 64 bits.
fn values_announced(bytes: &[u8]) -> Option<u64> {
    let header = String::from_utf8_lossy(&bytes[..bytes.len().min(LONGEST_HEADER)]);
    let behind = header.split_once("shape").map_or("", |parts| parts.1);
    let shape = behind.split([')', ']']).next().unwrap_or_default();
    let numbers = shape.split(|c: char| !c.is_ascii_digit()).filter(|digits| !digits.is_empty());
    numbers.map(|digits| digits.parse::<u64>().ok()).try_fold(1_u64, |product, number| product.checked_mul(number?))
}

fn first_line(text: &str) -> &str {
    text.lines().next().unwrap_or_default()
}
