//! The image: what goes into flash, and where its symbols lie.

use crate::error::{Error, Result};
use std::collections::BTreeMap;
use std::path::Path;

/// A segment that is loaded.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Segment {
    /// Where it is stored.
    pub address: u32,
    /// What is stored.
    pub bytes: Vec<u8>,
}

/// An image.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Image {
    /// What is stored.
    pub segments: Vec<Segment>,
    /// Addresses by name.
    pub symbols: BTreeMap<String, u32>,
}

/// Loaded segments in the program header.
const LOAD: u32 = 1;
/// Symbols in the section header.
const SYMBOLS: u32 = 2;

impl Image {
    /// Reads a file.
    ///
    /// # Errors
    /// [`Error::Image`] naming the file.
    pub fn read(path: &Path) -> Result<Self> {
        let refuse = |what: String| Error::Image(format!("{}: {what}", path.display()));
        let bytes = std::fs::read(path).map_err(|e| refuse(e.to_string()))?;
        Self::parse(&bytes).ok_or_else(|| refuse("is no ELF image of a 32-bit Arm".into()))
    }

    /// Takes an ELF file of 32 bits for Arm apart.
    pub fn parse(bytes: &[u8]) -> Option<Self> {
        let file = Bytes(bytes);
        if bytes.get(..6)? != b"\x7fELF\x01\x01" || file.half(18)? != 40 {
            return None;
        }
        let mut image = Self::default();
        let (first, size, count) = (file.word(28)?, file.half(42)?, file.half(44)?);
        for n in 0..u32::from(count) {
            let at = first + n * u32::from(size);
            let (kind, offset, address, length) =
                (file.word(at)?, file.word(at + 4)?, file.word(at + 12)?, file.word(at + 16)?);
            if kind == LOAD && length > 0 {
                let bytes = bytes.get(offset as usize..)?.get(..length as usize)?.to_vec();
                image.segments.push(Segment { address, bytes });
            }
        }
        image.read_symbols(&file)?;
        Some(image)
    }

    fn read_symbols(&mut self, file: &Bytes<'_>) -> Option<()> {
        let (first, size, count) = (file.word(32)?, file.half(46)?, file.half(48)?);
        let section = |n: u32| first + n * u32::from(size);
        for at in (0..count.into()).map(section) {
            if file.word(at + 4)? != SYMBOLS {
                continue;
            }
            let names = file.word(section(file.word(at + 24)?) + 16)?;
            let (from, bytes) = (file.word(at + 16)?, file.word(at + 20)?);
            for symbol in (from..from + bytes).step_by(16) {
                let name = file.0.get((names + file.word(symbol)?) as usize..)?;
                let name = String::from_utf8_lossy(name.split(|byte| *byte == 0).next()?).into_owned();
                self.symbols.insert(name, file.word(symbol + 4)?);
            }
        }
        Some(())
    }
}

struct Bytes<'a>(&'a [u8]);

impl Bytes<'_> {
    fn half(&self, at: u32) -> Option<u16> {
        let bytes = self.0.get(at as usize..)?.get(..2)?;
        Some(u16::from_le_bytes(bytes.try_into().ok()?))
    }

    fn word(&self, at: u32) -> Option<u32> {
        let bytes = self.0.get(at as usize..)?.get(..4)?;
        Some(u32::from_le_bytes(bytes.try_into().ok()?))
    }
}
