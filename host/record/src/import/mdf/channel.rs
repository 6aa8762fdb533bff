//! Channels of a group: where their bits are, what they are called, and their values.

use super::blocks::{Block, Blocks, MAX_GROUP_DEPTH};
use super::conversion::Conversion;
use super::records::Records;
use crate::Result;

/// Flags of a channel: every value is invalid; a bit of the record says whether one is.
const ALL_INVALID_FLAG: u32 = 1;
const INVALID_BIT_FLAG: u32 = 2;

/// Numbers as they are stored.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Stored {
    Unsigned,
    Signed,
    Float,
    /// The record's number, from 0.
    Number,
}

/// A channel of numbers.
#[derive(Debug)]
pub(super) struct Channel {
    pub name: String,
    pub unit: Option<String>,
    /// Whether it is its group's time.
    pub is_time: bool,
    stored: Stored,
    big_endian: bool,
    byte: usize,
    bit: u32,
    bits: u32,
    flags: u32,
    invalid_bit: usize,
    conversion: Conversion,
}

impl Channel {
    /// Channels of a group, and how many are no numbers.
    pub fn all(blocks: &Blocks, group: &Block) -> Result<(Vec<Self>, usize)> {
        let (mut found, mut skipped) = (Vec::new(), 0);
        Self::gather(blocks, group.link(1), &mut found, &mut skipped, 0)?;
        Ok((found, skipped))
    }

    fn gather(blocks: &Blocks, first: u64, found: &mut Vec<Self>, skipped: &mut usize, depth: usize) -> Result<()> {
        if depth > MAX_GROUP_DEPTH {
            return Err(blocks.refuse("structures within structures without end"));
        }
        for block in blocks.chain(first, b"CN")? {
            let inside = block.link(1);
            if inside != 0 && &blocks.any(inside)?.name == b"CN" {
                Self::gather(blocks, inside, found, skipped, depth + 1)?;
                continue;
            }
            match Self::of(blocks, &block)?.filter(|_| inside == 0) {
                Some(channel) => found.push(channel),
                None => *skipped += 1,
            }
        }
        Ok(())
    }

    /// A channel of numbers; `None` for anything else.
    fn of(blocks: &Blocks, block: &Block) -> Result<Option<Self>> {
        let broken = || blocks.refuse("a channel's block is too short");
        let byte = |at: usize| block.u8(at).ok_or_else(broken);
        let word = |at: usize| block.u32(at).ok_or_else(broken);
        let (kind, sync, data) = (byte(0)?, byte(1)?, byte(2)?);
        let stored = match (kind, data) {
            (3 | 6, _) => Stored::Number,
            (0 | 2 | 4, 0 | 1) => Stored::Unsigned,
            (0 | 2 | 4, 2 | 3) => Stored::Signed,
            (0 | 2 | 4, 4 | 5) => Stored::Float,
            _ => return Ok(None),
        };
        let (bit, bits) = (u32::from(byte(3)?), word(8)?);
        let able = match stored {
            Stored::Number => true,
            Stored::Float => bit == 0 && (bits == 32 || bits == 64),
            _ => bits > 0 && bit < 8 && bit + bits <= 64,
        };
        let Some(conversion) = Conversion::of(blocks, block.link(4))?.filter(|_| able) else { return Ok(None) };
        let unit = match blocks.text(block.link(6))? {
            None if block.link(4) != 0 => blocks.text(blocks.at(block.link(4), b"CC")?.link(1))?,
            own => own,
        };
        Ok(Some(Self {
            name: blocks.text(block.link(2))?.unwrap_or_else(|| "unnamed".into()),
            unit,
            is_time: (kind == 2 || kind == 3) && sync == 1,
            stored,
            big_endian: data % 2 == 1,
            byte: word(4)? as usize,
            bit,
            bits,
            flags: word(12)?,
            invalid_bit: word(16)? as usize,
            conversion,
        }))
    }

    /// Its values; NaN where the record says that one is invalid. `None` where it lies outside the records.
    pub fn values(&self, records: &Records) -> Option<Vec<f64>> {
        let bytes = self.byte..self.byte.checked_add((self.bit + self.bits).div_ceil(8) as usize)?;
        if self.stored != Stored::Number && bytes.end > records.bytes {
            return None;
        }
        let value = |(i, record): (usize, &[u8])| {
            if self.is_invalid(record.get(records.bytes..).unwrap_or_default()) {
                return f64::NAN;
            }
            self.conversion.of_raw(match self.stored {
                Stored::Number => i as f64,
                _ => self.raw(&record[bytes.clone()]),
            })
        };
        Some(records.each().enumerate().map(value).collect())
    }

    fn is_invalid(&self, bits: &[u8]) -> bool {
        let said = || bits.get(self.invalid_bit / 8).is_some_and(|byte| byte >> (self.invalid_bit % 8) & 1 == 1);
        self.flags & ALL_INVALID_FLAG != 0 || (self.flags & INVALID_BIT_FLAG != 0 && said())
    }

    /// The number in the bytes of a record.
    fn raw(&self, bytes: &[u8]) -> f64 {
        let add = |number: u64, byte: &u8| number << 8 | u64::from(*byte);
        let whole = if self.big_endian { bytes.iter().fold(0, add) } else { bytes.iter().rev().fold(0, add) };
        let spare = 64 - self.bits;
        let number = whole >> self.bit << spare;
        match self.stored {
            Stored::Float if self.bits == 32 => f64::from(f32::from_bits(whole as u32)),
            Stored::Float => f64::from_bits(whole),
            Stored::Signed => (number as i64 >> spare) as f64,
            _ => (number >> spare) as f64,
        }
    }
}
