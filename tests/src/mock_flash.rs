//! NOR flash that fails like flash: bits only go from 1 to 0, a word takes one write between erases, and the power
//! can fail at any byte of any operation.

use embedded_storage::nor_flash::{ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// What an interrupted erase leaves of the bytes it did not finish.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TornErase {
    /// Bytes from the front are erased, the rest is as before.
    FromFront,
    /// Every byte of the sector has some of its bits erased, from both ends inwards most of all: what a flash with a
    /// parallel erase does.
    Everywhere,
}

/// Why an operation failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MockError {
    /// The power failed in the middle.
    PowerCut,
    /// Address or length is not aligned.
    NotAligned,
    /// Outside the flash.
    OutOfBounds,
    /// A word was written twice without an erase.
    WrittenTwice,
}

impl NorFlashError for MockError {
    fn kind(&self) -> NorFlashErrorKind {
        match self {
            MockError::NotAligned => NorFlashErrorKind::NotAligned,
            MockError::OutOfBounds => NorFlashErrorKind::OutOfBounds,
            _ => NorFlashErrorKind::Other,
        }
    }
}

/// Flash with sectors of `SECTOR` and words of `WORD` bytes.
#[derive(Clone, Debug)]
pub struct MockFlash<const SECTOR: usize, const WORD: usize> {
    /// The contents.
    pub bytes: Vec<u8>,
    written: Vec<bool>,
    /// Bytes written or erased until the power fails; `None` never.
    pub bytes_until_shutoff: Option<u64>,
    /// Bytes written or erased so far.
    pub bytes_used: u64,
    /// Model of an interrupted erase.
    pub torn_erase: TornErase,
    /// Draws which bits of an interrupted byte changed.
    pub random: ChaCha8Rng,
}

impl<const SECTOR: usize, const WORD: usize> MockFlash<SECTOR, WORD> {
    /// A blank flash of this many sectors.
    pub fn new(sectors: usize, random: ChaCha8Rng) -> Self {
        Self {
            bytes: vec![0xff; sectors * SECTOR],
            written: vec![false; sectors * SECTOR / WORD],
            bytes_until_shutoff: None,
            bytes_used: 0,
            torn_erase: TornErase::FromFront,
            random,
        }
    }

    /// Whether there is power for one more byte.
    fn spend(&mut self) -> bool {
        self.bytes_used += 1;
        match &mut self.bytes_until_shutoff {
            Some(0) => false,
            Some(rest) => {
                *rest -= 1;
                true
            }
            None => true,
        }
    }

    fn range(&self, from: u32, length: usize, unit: usize) -> Result<std::ops::Range<usize>, MockError> {
        let from = from as usize;
        if !from.is_multiple_of(unit) || !length.is_multiple_of(unit) {
            return Err(MockError::NotAligned);
        }
        if from + length > self.bytes.len() { Err(MockError::OutOfBounds) } else { Ok(from..from + length) }
    }
}

impl<const SECTOR: usize, const WORD: usize> ErrorType for MockFlash<SECTOR, WORD> {
    type Error = MockError;
}

impl<const SECTOR: usize, const WORD: usize> ReadNorFlash for MockFlash<SECTOR, WORD> {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), MockError> {
        let range = self.range(offset, bytes.len(), 1)?;
        bytes.copy_from_slice(&self.bytes[range]);
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.bytes.len()
    }
}

impl<const SECTOR: usize, const WORD: usize> NorFlash for MockFlash<SECTOR, WORD> {
    const WRITE_SIZE: usize = WORD;
    const ERASE_SIZE: usize = SECTOR;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), MockError> {
        let range = self.range(from, (to - from) as usize, SECTOR)?;
        for at in range.clone() {
            if !self.spend() {
                let left = match self.torn_erase {
                    TornErase::FromFront => at..at + 1,
                    TornErase::Everywhere => range.clone(),
                };
                for byte in left {
                    self.bytes[byte] |= self.random.random::<u8>();
                }
                // A word torn by an erase counts as written: it must be erased again before use.
                return Err(MockError::PowerCut);
            }
            if self.torn_erase == TornErase::FromFront {
                self.bytes[at] = 0xff;
                self.written[at / WORD] = false;
            }
        }
        self.bytes[range.clone()].fill(0xff);
        self.written[range.start / WORD..range.end / WORD].fill(false);
        Ok(())
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), MockError> {
        let range = self.range(offset, bytes.len(), WORD)?;
        for (at, &byte) in range.zip(bytes) {
            if at % WORD == 0 && std::mem::replace(&mut self.written[at / WORD], true) {
                return Err(MockError::WrittenTwice);
            }
            if !self.spend() {
                // Some of the bits made it.
                self.bytes[at] &= byte | self.random.random::<u8>();
                return Err(MockError::PowerCut);
            }
            self.bytes[at] &= byte;
        }
        Ok(())
    }
}
