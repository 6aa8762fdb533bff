//! Records of a data group: its data blocks in one piece, and where the records of each channel group begin.

use super::blocks::{Block, Blocks};
use crate::Result;
use crate::budget;
use flate2::read::ZlibDecoder;
use std::rc::Rc;

/// Flag of a channel group that holds values of no fixed length.
const VARIABLE_LENGTH: u16 = 1;
/// Lists within lists.
const MAX_LIST_DEPTH: usize = 4;

/// Where the records of a channel group are.
#[derive(Debug, Clone)]
pub(super) struct Records {
    data: Rc<Vec<u8>>,
    starts: Starts,
    /// Bytes of channels, without those of invalid bits that follow.
    pub bytes: usize,
    /// Bytes with the invalid bits.
    whole: usize,
}

#[derive(Debug, Clone)]
enum Starts {
    Even { count: usize, stride: usize },
    Listed(Vec<usize>),
}

/// What a channel group says of its records.
struct Layout {
    id: u64,
    count: u64,
    is_variable: bool,
    bytes: usize,
    whole: usize,
}

impl Layout {
    fn of(block: &Block) -> Option<Self> {
        let (bytes, invalid) = (block.u32(24)? as usize, block.u32(28)? as usize);
        let is_variable = block.u16(16)? & VARIABLE_LENGTH != 0;
        Some(Self { id: block.u64(0)?, count: block.u64(8)?, is_variable, bytes, whole: bytes + invalid })
    }
}

impl Records {
    /// Records of every channel group of a data group, in their order.
    pub fn of(blocks: &Blocks, data_group: &Block, groups: &[Block]) -> Result<Vec<Self>> {
        let layouts: Option<Vec<Layout>> = groups.iter().map(Layout::of).collect();
        let (Some(layouts), Some(id_bytes)) = (layouts, data_group.u8(0)) else {
            return Err(blocks.refuse("a group's block is too short"));
        };
        let mut data = Vec::new();
        if data_group.link(2) != 0 {
            gather(blocks, data_group.link(2), &mut data, 0)?;
        }
        let data = Rc::new(data);
        if id_bytes == 0 && layouts.len() > 1 {
            return Err(blocks.refuse("several groups share records without numbers"));
        }
        let starts = match (id_bytes, layouts.as_slice()) {
            (0, [one]) => vec![even(blocks, one, data.len())?],
            (0, _) => Vec::new(),
            _ => listed(blocks, &layouts, &data, usize::from(id_bytes))?.into_iter().map(Starts::Listed).collect(),
        };
        let of = |(layout, starts): (&Layout, Starts)| Self {
            data: Rc::clone(&data),
            starts,
            bytes: layout.bytes,
            whole: layout.whole,
        };
        Ok(layouts.iter().zip(starts).map(of).collect())
    }

    pub fn count(&self) -> usize {
        match &self.starts {
            Starts::Even { count, .. } => *count,
            Starts::Listed(starts) => starts.len(),
        }
    }

    /// The records one by one, each with its invalid bits.
    pub fn each(&self) -> impl Iterator<Item = &[u8]> {
        (0..self.count()).map(|i| {
            let start = match &self.starts {
                Starts::Even { stride, .. } => i * stride,
                Starts::Listed(starts) => starts[i],
            };
            &self.data[start..start + self.whole]
        })
    }
}

/// Records that follow each other.
fn even(blocks: &Blocks, layout: &Layout, bytes: usize) -> Result<Starts> {
    let there = bytes.checked_div(layout.whole).map_or(layout.count, |there| there as u64);
    if layout.count > there {
        return Err(blocks.refuse(format!("{there} of {} records are there", layout.count)));
    }
    // Records of no bytes count for channels that are made from their number.
    budget::VALUES.check(blocks.path.display(), layout.count as f64, "save a shorter part")?;
    Ok(Starts::Even { count: layout.count as usize, stride: layout.whole })
}

/// Records of several groups, each behind its group's number.
fn listed(blocks: &Blocks, layouts: &[Layout], data: &[u8], id_bytes: usize) -> Result<Vec<Vec<usize>>> {
    let mut starts: Vec<Vec<usize>> = vec![Vec::new(); layouts.len()];
    let broken = || blocks.refuse("a record belongs to no group");
    if id_bytes > 8 {
        return Err(broken());
    }
    let number = |part: &[u8]| part.iter().rev().fold(0_u64, |number, byte| number.wrapping_shl(8) | u64::from(*byte));
    let mut at = 0;
    while let Some(id) = data.get(at..at + id_bytes) {
        let id = number(id);
        let group = layouts.iter().position(|layout| layout.id == id).ok_or_else(broken)?;
        at += id_bytes;
        let layout = &layouts[group];
        let length = match layout.is_variable {
            true => data.get(at..at + 4).map(|length| 4 + number(length) as usize).ok_or_else(broken)?,
            false => layout.whole,
        };
        // The last record of a file that was closed in a hurry may be cut.
        if at + length > data.len() {
            break;
        }
        if !layout.is_variable {
            starts[group].push(at);
        }
        at += length;
    }
    Ok(starts)
}

/// Appends the data of a block, of a list of blocks, or of a compressed block.
fn gather(blocks: &Blocks, at: u64, data: &mut Vec<u8>, depth: usize) -> Result<()> {
    let block = blocks.any(at)?;
    match &block.name {
        b"DT" | b"SD" => {
            let needed = data.len() as f64 + block.data.len() as f64;
            budget::FILE.check(blocks.path.display(), needed, "save a shorter part")?;
            data.extend_from_slice(block.data);
        }
        b"DZ" => data.extend(inflated(blocks, &block, data.len() as u64)?),
        b"HL" if depth < MAX_LIST_DEPTH && block.link(0) != 0 => gather(blocks, block.link(0), data, depth + 1)?,
        b"DL" => {
            for list in blocks.chain(at, b"DL")? {
                for link in list.links().iter().skip(1).filter(|link| **link != 0) {
                    // A list holds data, no further lists.
                    let depth = depth.max(MAX_LIST_DEPTH);
                    if &blocks.any(*link)?.name == b"DL" {
                        return Err(blocks.refuse("a list of lists"));
                    }
                    gather(blocks, *link, data, depth)?;
                }
            }
        }
        b"LD" | b"DV" | b"DI" => {
            return Err(blocks.refuse(
                "its records are stored by columns as of MDF 4.2, which is not read; convert it: python -m pip install \
                 asammdf, then MDF(FILE).convert('4.10').save('out.mf4')",
            ));
        }
        other => return Err(blocks.refuse(format!("block {} holds no data", String::from_utf8_lossy(other)))),
    }
    Ok(())
}

/// Data of a compressed block.
fn inflated(blocks: &Blocks, block: &Block, spent: u64) -> Result<Vec<u8>> {
    let broken = || blocks.refuse("a compressed block is too short");
    let (kind, columns) = (block.u8(2).ok_or_else(broken)?, block.u32(4).ok_or_else(broken)? as usize);
    let (whole, packed) = (block.u64(8).ok_or_else(broken)?, block.u64(16).ok_or_else(broken)?);
    let packed = usize::try_from(packed).ok().and_then(|packed| block.data.get(24..)?.get(..packed));
    let out = budget::expand(blocks.path, "MDF data", ZlibDecoder::new(packed.ok_or_else(broken)?), spent)?;
    if out.len() as u64 != whole {
        return Err(blocks.refuse("a compressed block has another length than it says"));
    }
    match kind {
        0 => Ok(out),
        1 if columns > 0 => Ok(turned(&out, columns)),
        _ => Err(blocks.refuse(format!("compression {kind} is not read"))),
    }
}

/// Undoes the transposition by which bytes of one place stand together.
fn turned(data: &[u8], columns: usize) -> Vec<u8> {
    let rows = data.len() / columns;
    let mut out = Vec::with_capacity(data.len());
    for row in 0..rows {
        out.extend((0..columns).map(|column| data[column * rows + row]));
    }
    out.extend_from_slice(&data[rows * columns..]);
    out
}
