//! TDMS files of LabVIEW and DAQmx loggers: numeric channels of all segments.
//!
//! Source: National Instruments, "TDMS File Format Internal Structure". Read: both byte orders, contiguous and
//! interleaved raw data, several chunks per segment, objects and indices carried over from earlier segments, the last
//! segment of a file that was not closed. A linear scale (`NI_Scale[0]`) is applied to integers. Not read, and
//! refused: DAQmx raw data and other scales (their numbers would be codes). The rate is `1 / wf_increment`, the unit
//! (`unit_string`) a remark. Strings, times and truth values are passed over.
//!
//! Every announced size is held against the bytes that follow before anything is made of it.

use super::Columns;
use crate::budget::VALUES;
use crate::{Error, Result, text};
use std::collections::BTreeMap;
use std::path::Path;

const METADATA: u32 = 1 << 1;
const NEW_LIST: u32 = 1 << 2;
const RAW_DATA: u32 = 1 << 3;
const INTERLEAVED: u32 = 1 << 5;
const BIG_ENDIAN: u32 = 1 << 6;
const DAQMX: u32 = 1 << 7;
/// Bytes of a segment's lead-in.
const LEAD_IN: usize = 28;
/// Names and texts longer than this are damage.
const LONGEST_TEXT: usize = 1 << 20;

/// What a property says, where it is a number or text.
#[derive(Debug, Clone, PartialEq)]
enum Property {
    Number(f64),
    Text(String),
    Other,
}

/// Raw data of one object in one chunk.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Index {
    kind: u32,
    count: usize,
    bytes: usize,
}

#[derive(Debug, Default)]
struct Object {
    index: Option<Index>,
    properties: BTreeMap<String, Property>,
    values: Vec<f64>,
}

/// A broken file: `what` says how.
struct Broken(String);

type Parsed<T> = std::result::Result<T, Broken>;

fn broken<T>(what: impl Into<String>) -> Parsed<T> {
    Err(Broken(what.into()))
}

pub(super) fn read(path: &Path, bytes: &[u8]) -> Result<Columns> {
    let mut file = File { objects: BTreeMap::new(), order: Vec::new(), active: Vec::new(), values: 0 };
    file.segments(bytes).map_err(|Broken(what)| Error::invalid(path.display(), what))?;
    file.columns(path)
}

/// Everything read so far.
struct File {
    objects: BTreeMap<String, Object>,
    /// Paths in the order of their first appearance.
    order: Vec<String>,
    /// Paths with raw data in the segment at hand, in the order of the data.
    active: Vec<String>,
    values: usize,
}

impl File {
    fn segments(&mut self, mut bytes: &[u8]) -> Parsed<()> {
        while !bytes.is_empty() {
            let (Some(b"TDSm"), Some(lead)) = (bytes.get(..4), bytes.get(..LEAD_IN)) else {
                return broken("is a damaged TDMS file: a segment does not begin where the one before ends");
            };
            let flags = u32::from_le_bytes([lead[4], lead[5], lead[6], lead[7]]);
            let mut cursor = Cursor { bytes: &lead[12..], big_endian: flags & BIG_ENDIAN != 0 };
            let (next, raw) = (cursor.u64()?, cursor.u64()?);
            let body = &bytes[LEAD_IN..];
            // A file that was not closed says so with all bits set: what follows is the last segment.
            let length = if next == u64::MAX { body.len() } else { usize::try_from(next).unwrap_or(usize::MAX) };
            let raw = usize::try_from(raw).unwrap_or(usize::MAX);
            if length > body.len() || raw > length {
                return broken("is a truncated TDMS file: a segment announces more bytes than follow");
            }
            if flags & METADATA != 0 {
                let meta = Cursor { bytes: &body[..raw], big_endian: flags & BIG_ENDIAN != 0 };
                self.metadata(meta, flags)?;
            }
            if flags & RAW_DATA != 0 {
                self.raw(&body[raw..length], flags)?;
            }
            bytes = &body[length..];
        }
        Ok(())
    }

    fn metadata(&mut self, mut meta: Cursor, flags: u32) -> Parsed<()> {
        if flags & NEW_LIST != 0 {
            self.active.clear();
        }
        for _ in 0..meta.u32()? {
            let path = meta.text()?;
            let length = meta.u32()?;
            if !self.objects.contains_key(&path) {
                self.order.push(path.clone());
            }
            let object = self.objects.entry(path.clone()).or_default();
            match length {
                u32::MAX => {}
                0 if object.index.is_some() => {}
                0 => return broken("is a damaged TDMS file: an object repeats an index that it never had"),
                0x1269 | 0x126A => {
                    return broken("holds DAQmx raw data, which is not read: let the logger write scaled values");
                }
                _ => object.index = Some(meta.index()?),
            }
            if length != u32::MAX && !self.active.contains(&path) {
                self.active.push(path.clone());
            }
            if length == u32::MAX {
                self.active.retain(|other| *other != path);
            }
            for _ in 0..meta.u32()? {
                let name = meta.text()?;
                let value = meta.property()?;
                object.properties.insert(name, value);
            }
        }
        Ok(())
    }

    fn raw(&mut self, raw: &[u8], flags: u32) -> Parsed<()> {
        if flags & DAQMX != 0 {
            return broken("holds DAQmx raw data, which is not read: let the logger write scaled values");
        }
        let indices: Vec<Index> = self.active.iter().filter_map(|path| self.objects.get(path)?.index).collect();
        let chunk = indices.iter().try_fold(0_usize, |sum, index| sum.checked_add(index.bytes));
        let Some(chunk) = chunk.filter(|chunk| *chunk > 0) else { return Ok(()) };
        let chunks = raw.len() / chunk;
        self.values += indices.iter().map(|index| index.count).sum::<usize>().saturating_mul(chunks);
        if self.values as f64 > VALUES.most {
            return broken(format!("holds more than {:.0} values; cut it into parts", VALUES.most));
        }
        let big_endian = flags & BIG_ENDIAN != 0;
        for part in raw.chunks_exact(chunk) {
            if flags & INTERLEAVED != 0 {
                self.interleaved(part, &indices, big_endian)?;
                continue;
            }
            let mut from = 0;
            for (path, index) in self.active.iter().zip(&indices) {
                let own = &part[from..from + index.bytes];
                from += index.bytes;
                let (Some(object), Some(size)) = (self.objects.get_mut(path), size(index.kind)) else { continue };
                object.values.extend(own.chunks_exact(size).map(|cell| number(index.kind, cell, big_endian)));
            }
        }
        Ok(())
    }

    fn interleaved(&mut self, part: &[u8], indices: &[Index], big_endian: bool) -> Parsed<()> {
        let sizes: Option<Vec<usize>> = indices.iter().map(|index| size(index.kind)).collect();
        let Some(sizes) = sizes.filter(|_| indices.windows(2).all(|w| w[0].count == w[1].count)) else {
            return broken("is a damaged TDMS file: interleaved channels of unequal length");
        };
        for row in part.chunks_exact(sizes.iter().sum::<usize>().max(1)) {
            let mut from = 0;
            for ((path, index), size) in self.active.iter().zip(indices).zip(&sizes) {
                let value = number(index.kind, &row[from..from + size], big_endian);
                from += size;
                if let Some(object) = self.objects.get_mut(path) {
                    object.values.push(value);
                }
            }
        }
        Ok(())
    }

    /// The longest channels; shorter ones are named in a remark.
    fn columns(mut self, path: &Path) -> Result<Columns> {
        let refuse = |what: String| Error::invalid(path.display(), what);
        let longest = self.objects.values().map(|object| object.values.len()).max().unwrap_or(0);
        let mut columns =
            Columns { names: Vec::new(), channels: Vec::new(), rate_hz: None, remarks: Vec::new(), largest: None };
        for full in &self.order {
            let Some(object) = self.objects.remove(full) else { continue };
            let name = text::name(&short(full));
            if object.values.is_empty() {
                continue;
            }
            if object.values.len() < longest {
                columns.remarks.push(format!("channel {name} is shorter than others and left out"));
                continue;
            }
            if let Some(Property::Number(increment)) = object.properties.get("wf_increment") {
                let rate = 1.0 / increment;
                if !(rate.is_finite() && rate > 0.0) {
                    return Err(refuse(format!("channel {name}: wf_increment {increment} gives no sampling rate")));
                }
                if columns.rate_hz.is_some_and(|other| (other / rate - 1.0).abs() > 1e-6) {
                    return Err(refuse(format!("channel {name} has another sampling rate than those before")));
                }
                columns.rate_hz = Some(rate);
            }
            if let Some(Property::Text(unit)) =
                object.properties.get("unit_string").filter(|u| **u != Property::Text(String::new()))
            {
                columns
                    .remarks
                    .push(format!("channel {name} is in {} by the file; --unit decides", text::quoted(unit)));
            }
            columns.channels.push(object.scaled().map_err(|what| refuse(format!("channel {name}: {what}")))?);
            columns.names.push(name);
        }
        Ok(columns)
    }
}

impl Object {
    /// Values with the linear scale that the file states.
    fn scaled(self) -> std::result::Result<Vec<f64>, String> {
        let property = |name: &str| self.properties.get(name);
        let number = |name: &str| match property(name) {
            Some(Property::Number(value)) => Some(*value),
            _ => None,
        };
        let Some(count) = number("NI_Number_Of_Scales").filter(|count| *count > 0.0) else { return Ok(self.values) };
        let linear = property("NI_Scale[0]_Scale_Type") == Some(&Property::Text("Linear".into()));
        let (slope, shift) = (number("NI_Scale[0]_Linear_Slope"), number("NI_Scale[0]_Linear_Y_Intercept"));
        match (slope, shift) {
            (Some(slope), Some(shift)) if linear && count == 1.0 => {
                Ok(self.values.iter().map(|x| slope * x + shift).collect())
            }
            _ => Err("has a scale other than one linear one, which is not read".into()),
        }
    }
}

/// Last part of an object's path, `/'group'/'channel'`.
fn short(path: &str) -> String {
    let last = path.rsplit("/'").next().unwrap_or(path);
    last.trim_end_matches('\'').replace("''", "'")
}

/// Bytes of a number; `None` for what is no number.
fn size(kind: u32) -> Option<usize> {
    match kind {
        1 | 5 => Some(1),
        2 | 6 => Some(2),
        3 | 7 | 9 | 0x19 => Some(4),
        4 | 8 | 10 | 0x1A => Some(8),
        _ => None,
    }
}

fn number(kind: u32, cell: &[u8], big_endian: bool) -> f64 {
    macro_rules! read {
        ($type:ty) => {{
            let cell = cell.try_into().expect("cells have the size of their type");
            (if big_endian { <$type>::from_be_bytes(cell) } else { <$type>::from_le_bytes(cell) }) as f64
        }};
    }
    match kind {
        1 => read!(i8),
        2 => read!(i16),
        3 => read!(i32),
        4 => read!(i64),
        5 => read!(u8),
        6 => read!(u16),
        7 => read!(u32),
        8 => read!(u64),
        9 | 0x19 => read!(f32),
        _ => read!(f64),
    }
}

struct Cursor<'a> {
    bytes: &'a [u8],
    big_endian: bool,
}

impl<'a> Cursor<'a> {
    fn take(&mut self, count: usize) -> Parsed<&'a [u8]> {
        let Some((taken, rest)) = self.bytes.split_at_checked(count) else {
            return broken("is a truncated TDMS file: its metadata end early");
        };
        self.bytes = rest;
        Ok(taken)
    }

    fn u32(&mut self) -> Parsed<u32> {
        let word = self.take(4)?.try_into().expect("four bytes");
        Ok(if self.big_endian { u32::from_be_bytes(word) } else { u32::from_le_bytes(word) })
    }

    fn u64(&mut self) -> Parsed<u64> {
        let word = self.take(8)?.try_into().expect("eight bytes");
        Ok(if self.big_endian { u64::from_be_bytes(word) } else { u64::from_le_bytes(word) })
    }

    fn text(&mut self) -> Parsed<String> {
        let length = self.u32()? as usize;
        if length > LONGEST_TEXT {
            return broken("is a damaged TDMS file: a name of more than a million bytes");
        }
        Ok(String::from_utf8_lossy(self.take(length)?).into_owned())
    }

    fn index(&mut self) -> Parsed<Index> {
        let (kind, dimension, count) = (self.u32()?, self.u32()?, self.u64()?);
        if dimension != 1 {
            return broken("is a damaged TDMS file: raw data of more than one dimension");
        }
        let count = usize::try_from(count).unwrap_or(usize::MAX);
        // Texts state their bytes; times take sixteen, truth values one.
        let bytes = match (kind, size(kind)) {
            (_, Some(size)) => count.checked_mul(size),
            (0x20, None) => usize::try_from(self.u64()?).ok(),
            (0x21, None) => Some(count),
            (0x44, None) => count.checked_mul(16),
            _ => return broken(format!("holds data of type {kind:#x}, which is not read")),
        };
        match bytes {
            Some(bytes) => Ok(Index { kind, count, bytes }),
            None => broken("is a damaged TDMS file: it announces more values than a file can hold"),
        }
    }

    fn property(&mut self) -> Parsed<Property> {
        let kind = self.u32()?;
        if let Some(size) = size(kind) {
            return Ok(Property::Number(number(kind, self.take(size)?, self.big_endian)));
        }
        match kind {
            0x20 => Ok(Property::Text(self.text()?)),
            0x21 => self.take(1).map(|_| Property::Other),
            0x44 => self.take(16).map(|_| Property::Other),
            0 => Ok(Property::Other),
            _ => broken(format!("has a property of type {kind:#x}, which is not read")),
        }
    }
}
