//! Raw data of DAQmx, as "log and read" writes them: rows of the converters' buffers, with scalers that say where
//! each channel's bytes lie.
//!
//! Source: National Instruments, "TDMS File Format Internal Structure"; the layout of scalers and of digital lines is
//! that of npTDMS 1.13. Every buffer (one per converter) is interleaved by itself, one behind the other in a chunk.

use super::{Cursor, File, Index, Parsed, broken, number, size};

/// Type of a channel whose numbers only its scales make.
const RAW_DATA: u32 = 0xFFFF_FFFF;
/// Scalers of one channel, and buffers of one segment.
const MAX_ENTRIES: u32 = 4096;

/// Where a channel's numbers are.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Layout {
    scalers: Vec<Scaler>,
    /// Bytes of a row of every buffer.
    widths: Vec<usize>,
}

#[derive(Debug, Clone, PartialEq)]
struct Scaler {
    kind: u32,
    buffer: usize,
    offset: usize,
    id: u32,
    /// The bit of a digital line.
    bit: Option<u32>,
}

/// The index of a channel with raw data of DAQmx.
pub(super) fn index(meta: &mut Cursor, digital: bool) -> Parsed<Index> {
    let (kind, dimension, count, scalers) = (meta.u32()?, meta.u32()?, meta.u64()?, meta.u32()?);
    let count = usize::try_from(count).unwrap_or(usize::MAX);
    if dimension != 1 || scalers > MAX_ENTRIES {
        return broken("is a damaged TDMS file: DAQmx data of more than one dimension or of too many scalers");
    }
    let scalers = (0..scalers).map(|_| scaler(meta, digital)).collect::<Parsed<Vec<_>>>()?;
    let buffers = meta.u32()?;
    if buffers > MAX_ENTRIES {
        return broken("is a damaged TDMS file: too many buffers");
    }
    let widths = (0..buffers).map(|_| Ok(meta.u32()? as usize)).collect::<Parsed<Vec<_>>>()?;
    for scaler in &scalers {
        let end = scaler.offset.checked_add(size(scaler.kind).unwrap_or(0));
        if widths.get(scaler.buffer).is_none_or(|width| end.is_none_or(|end| end > *width)) {
            return broken("is a damaged TDMS file: a scaler lies outside of its buffer");
        }
    }
    Ok(Index { kind, count, bytes: 0, raw: Some(Layout { scalers, widths }) })
}

fn scaler(meta: &mut Cursor, digital: bool) -> Parsed<Scaler> {
    // The types are numbered otherwise than elsewhere in the file.
    const KINDS: [u32; 10] = [5, 1, 6, 2, 7, 3, 8, 4, 9, 10];
    let code = meta.u32()?;
    let Some(&kind) = KINDS.get(code as usize) else {
        return broken(format!("holds DAQmx data of type {code}, which is not read"));
    };
    let (buffer, offset) = (meta.u32()? as usize, meta.u32()? as usize);
    if digital {
        meta.take(1)?;
    } else {
        meta.u32()?;
    }
    let id = meta.u32()?;
    if digital {
        return Ok(Scaler { kind, buffer, offset: offset / 8, id, bit: Some(offset as u32 % 8) });
    }
    Ok(Scaler { kind, buffer, offset, id, bit: None })
}

/// Reads the raw data of a segment.
pub(super) fn read(file: &mut File, raw: &[u8], indices: &[(String, Index)], big_endian: bool) -> Parsed<()> {
    let Some(first) = indices.first().and_then(|(_, index)| index.raw.as_ref()) else {
        return if indices.is_empty() {
            Ok(())
        } else {
            broken("mixes raw data of DAQmx with others in a segment, which is not read")
        };
    };
    let widths = first.widths.clone();
    let mut rows = vec![0_usize; widths.len()];
    for (_, index) in indices {
        let Some(layout) = index.raw.as_ref().filter(|layout| layout.widths == widths) else {
            return broken("mixes raw data of DAQmx with others in a segment, which is not read");
        };
        layout.scalers.iter().for_each(|scaler| rows[scaler.buffer] = rows[scaler.buffer].max(index.count));
    }
    let chunk =
        rows.iter().zip(&widths).try_fold(0_usize, |sum, (rows, width)| sum.checked_add(rows.checked_mul(*width)?));
    let Some(chunk) = chunk.filter(|chunk| *chunk > 0) else { return Ok(()) };
    for part in raw.chunks(chunk) {
        let mut from = 0;
        for (buffer, (rows, width)) in rows.iter().zip(&widths).enumerate() {
            let end = (from + rows * width).min(part.len());
            // The last chunk of a logger that was stopped has fewer rows.
            let own = part.get(from..end).unwrap_or_default();
            file.cut |= end < from + rows * width;
            from = end;
            of_buffer(file, own, buffer, *width, indices, big_endian)?;
        }
    }
    Ok(())
}

fn of_buffer(
    file: &mut File,
    bytes: &[u8],
    buffer: usize,
    width: usize,
    indices: &[(String, Index)],
    big_endian: bool,
) -> Parsed<()> {
    if width == 0 {
        return Ok(());
    }
    for (path, index) in indices {
        let scalers = index.raw.iter().flat_map(|layout| &layout.scalers);
        for scaler in scalers.filter(|scaler| scaler.buffer == buffer) {
            file.count(bytes.len() / width)?;
            let size = size(scaler.kind).unwrap_or(1);
            let cells = bytes.chunks_exact(width).map(|row| &row[scaler.offset..scaler.offset + size]);
            let values = cells.map(|cell| {
                let value = number(scaler.kind, cell, big_endian);
                scaler.bit.map_or(value, |bit| f64::from((value as i64 >> bit & 1) as u8))
            });
            let Some(object) = file.objects.get_mut(path) else { continue };
            if index.kind == RAW_DATA {
                object.scalers.entry(scaler.id).or_default().extend(values);
            } else {
                object.values.extend(values);
            }
        }
    }
    Ok(())
}
