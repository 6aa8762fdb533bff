//! TDMS files of LabVIEW and DAQmx loggers: numeric channels of all segments.
//!
//! Source: National Instruments, "TDMS File Format Internal Structure". Read: both byte orders, contiguous and
//! interleaved raw data, several chunks per segment, objects and indices carried over from earlier segments, the last
//! segment of a file that was not closed, raw data of DAQmx with their scalers. Scales are applied ([`scale`]). Rate
//! (`1 / wf_increment`), start (`wf_start_time` and `wf_start_offset`) and unit (`unit_string`) are the channel's,
//! else the group's, else the file's. Strings, times and truth values are passed over.
//!
//! Every announced size is held against the bytes that follow before anything is made of it.

mod daqmx;
mod scale;

use super::signals::{Signal, Signals};
use super::stamps;
use crate::budget::VALUES;
use crate::{Error, Result, text};
use std::collections::BTreeMap;
use std::path::Path;

const METADATA: u32 = 1 << 1;
const NEW_LIST: u32 = 1 << 2;
const RAW_DATA: u32 = 1 << 3;
const INTERLEAVED_DATA: u32 = 1 << 5;
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
    /// Seconds since 1904 and parts of 2^-64 s.
    Time(i64, u64),
    Other,
}

/// Raw data of one object in one chunk.
#[derive(Debug, Clone, Default, PartialEq)]
struct Index {
    kind: u32,
    count: usize,
    bytes: usize,
    /// Where the numbers are in the buffers of DAQmx.
    raw: Option<daqmx::Layout>,
}

#[derive(Debug, Default)]
struct Object {
    index: Option<Index>,
    properties: BTreeMap<String, Property>,
    values: Vec<f64>,
    /// Raw numbers of DAQmx by their scaler.
    scalers: BTreeMap<u32, Vec<f64>>,
}

/// A broken file: `what` says how.
struct Broken(String);

type Parsed<T> = std::result::Result<T, Broken>;

fn broken<T>(what: impl Into<String>) -> Parsed<T> {
    Err(Broken(what.into()))
}

pub(super) fn read(path: &Path, bytes: &[u8]) -> Result<Signals> {
    let mut file = File { objects: BTreeMap::new(), order: Vec::new(), active: Vec::new(), values: 0, cut: false };
    file.segments(bytes).map_err(|Broken(what)| Error::invalid(path.display(), what))?;
    file.signals(path)
}

/// Everything read so far.
struct File {
    objects: BTreeMap<String, Object>,
    /// Paths in the order of their first appearance.
    order: Vec<String>,
    /// Paths with raw data in the segment at hand, in the order of the data.
    active: Vec<String>,
    values: usize,
    /// Whether the last chunk of a segment was not whole.
    cut: bool,
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
                0x1269 | 0x126A => object.index = Some(daqmx::index(&mut meta, length == 0x126A)?),
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
        let big_endian = flags & BIG_ENDIAN != 0;
        let mut indices = Vec::new();
        for path in &self.active {
            if let Some(index) = self.objects.get(path).and_then(|object| object.index.clone()) {
                indices.push((path.clone(), index));
            }
        }
        if flags & DAQMX != 0 || indices.iter().any(|(_, index)| index.raw.is_some()) {
            return daqmx::read(self, raw, &indices, big_endian);
        }
        let chunk = indices.iter().try_fold(0_usize, |sum, (_, index)| sum.checked_add(index.bytes));
        let Some(chunk) = chunk.filter(|chunk| *chunk > 0) else { return Ok(()) };
        self.cut |= !raw.len().is_multiple_of(chunk);
        self.count(indices.iter().map(|(_, index)| index.count).sum::<usize>().saturating_mul(raw.len() / chunk))?;
        for part in raw.chunks_exact(chunk) {
            if flags & INTERLEAVED_DATA != 0 {
                self.interleaved(part, &indices, big_endian)?;
                continue;
            }
            let mut from = 0;
            for (path, index) in &indices {
                let own = &part[from..from + index.bytes];
                from += index.bytes;
                let (Some(object), Some(size)) = (self.objects.get_mut(path), size(index.kind)) else { continue };
                object.values.extend(own.chunks_exact(size).map(|cell| number(index.kind, cell, big_endian)));
            }
        }
        Ok(())
    }

    /// Counts values before they are made.
    fn count(&mut self, more: usize) -> Parsed<()> {
        self.values = self.values.saturating_add(more);
        if self.values as f64 > VALUES.most {
            return broken(format!("holds more than {:.0} values; cut it into parts", VALUES.most));
        }
        Ok(())
    }

    fn interleaved(&mut self, part: &[u8], indices: &[(String, Index)], big_endian: bool) -> Parsed<()> {
        let sizes: Option<Vec<usize>> = indices.iter().map(|(_, index)| size(index.kind)).collect();
        let Some(sizes) = sizes.filter(|_| indices.windows(2).all(|w| w[0].1.count == w[1].1.count)) else {
            return broken("is a damaged TDMS file: interleaved channels of unequal length");
        };
        for row in part.chunks_exact(sizes.iter().sum::<usize>().max(1)) {
            let mut from = 0;
            for ((path, index), size) in indices.iter().zip(&sizes) {
                let value = number(index.kind, &row[from..from + size], big_endian);
                from += size;
                if let Some(object) = self.objects.get_mut(path) {
                    object.values.push(value);
                }
            }
        }
        Ok(())
    }

    /// Every channel with what it, its group or the file says of it.
    fn signals(mut self, path: &Path) -> Result<Signals> {
        let mut found = Signals::default();
        if self.cut {
            found.remarks.push("the last piece of a segment is not whole and is left out".into());
        }
        let of =
            |objects: &BTreeMap<String, Object>, path: &str| objects.get(path).map(|object| object.properties.clone());
        let file = of(&self.objects, "/");
        let groups: std::collections::BTreeSet<String> = self.order.iter().map(|full| group(full)).collect();
        let mut first_start: Option<(i64, u64)> = None;
        for full in std::mem::take(&mut self.order) {
            let folder = group(&full);
            let group = of(&self.objects, &folder);
            let Some(object) = self.objects.remove(&full) else { continue };
            let has_data = !object.values.is_empty() || object.scalers.values().any(|values| !values.is_empty());
            if !has_data {
                self.objects.insert(full, object);
                continue;
            }
            let name = text::name(&short(&full));
            let property = |key: &str| {
                let sources = [Some(&object.properties), group.as_ref(), file.as_ref()];
                sources.into_iter().flatten().find_map(|properties| properties.get(key)).cloned()
            };
            let number = |key: &str| match property(key) {
                Some(Property::Number(number)) => Some(number),
                _ => None,
            };
            let rate_hz = match number("wf_increment").filter(|increment| *increment != 0.0) {
                None => None,
                Some(increment) if increment.is_finite() && increment > 0.0 => Some(stamps::rate_hz(increment, 1e-7)),
                Some(increment) => {
                    let what = format!("channel {name}: wf_increment {increment} gives no sampling rate");
                    return Err(Error::invalid(path.display(), what));
                }
            };
            let time = match property("wf_start_time") {
                Some(Property::Time(seconds, parts)) => Some((seconds, parts)),
                _ => None,
            };
            let since = time.map(|(seconds, parts)| {
                let (first, first_parts) = *first_start.get_or_insert((seconds, parts));
                seconds.saturating_sub(first) as f64 + (parts as f64 - first_parts as f64) / 2.0_f64.powi(64)
            });
            let offset = number("wf_start_offset");
            let start_s = rate_hz.and(since.or(offset)).map(|_| since.unwrap_or(0.0) + offset.unwrap_or(0.0));
            let unit = match property("unit_string").or_else(|| property("NI_UnitDescription")) {
                Some(Property::Text(unit)) if !unit.is_empty() => Some(unit),
                _ => None,
            };
            let in_frequency = property("wf_xname") == Some(Property::Text("Frequency".into()));
            if in_frequency {
                found.remarks.push(format!("channel {name} is a spectrum and left out"));
                continue;
            }
            match scale::scaled(object, group.as_ref(), file.as_ref()) {
                Ok(values) => {
                    let several = groups.iter().filter(|group| group.len() > 1).count() > 1;
                    let shown = if several { format!("{}/{name}", short(&folder)) } else { name.clone() };
                    let signal = Signal { unit, rate_hz, start_s, folder: short(&folder), ..Signal::new(name, values) };
                    found.signals.push(Signal { name: shown, ..signal });
                }
                Err(what) => found.remarks.push(format!("channel {name} {what}; it is left out")),
            }
        }
        if found.signals.is_empty() && !found.remarks.is_empty() {
            return Err(Error::invalid(
                path.display(),
                format!("holds no signal that is read: {}", found.remarks.join("; ")),
            ));
        }
        Ok(found)
    }
}

/// Path of the group of an object; of a group or the file itself.
fn group(path: &str) -> String {
    match path.rfind("/'") {
        Some(at) if at > 0 => path[..at].to_owned(),
        _ => path.to_owned(),
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
            // Complex numbers, single and double.
            (0x0008_000c, None) => count.checked_mul(8),
            (0x0010_000d, None) => count.checked_mul(16),
            _ => return broken(format!("holds data of type {kind:#x}, which is not read")),
        };
        match bytes {
            Some(bytes) => Ok(Index { kind, count, bytes, raw: None }),
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
            0x44 if self.big_endian => {
                let seconds = self.u64()?.cast_signed();
                Ok(Property::Time(seconds, self.u64()?))
            }
            0x44 => {
                let parts = self.u64()?;
                Ok(Property::Time(self.u64()?.cast_signed(), parts))
            }
            0 => Ok(Property::Other),
            _ => broken(format!("has a property of type {kind:#x}, which is not read")),
        }
    }
}
