//! The configuration in the flash of an emulated board, as the node itself would have stored it.

use crate::{Error, Result};
use embedded_storage::nor_flash::{ErrorType, NorFlash, NorFlashErrorKind, ReadNorFlash};
use meshband::config::Configuration;
use meshband::store::Store;

/// Bytes of a sector.
const SECTOR: usize = 128 * 1024;
/// Both sectors.
pub const BYTES: usize = 2 * SECTOR;

struct Sectors<'a>(&'a mut [u8]);

impl ErrorType for Sectors<'_> {
    type Error = NorFlashErrorKind;
}

impl ReadNorFlash for Sectors<'_> {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> std::result::Result<(), NorFlashErrorKind> {
        let at = offset as usize;
        bytes.copy_from_slice(self.0.get(at..at + bytes.len()).ok_or(NorFlashErrorKind::OutOfBounds)?);
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.0.len()
    }
}

impl NorFlash for Sectors<'_> {
    const WRITE_SIZE: usize = 4;
    const ERASE_SIZE: usize = SECTOR;

    fn erase(&mut self, from: u32, to: u32) -> std::result::Result<(), NorFlashErrorKind> {
        self.0.get_mut(from as usize..to as usize).ok_or(NorFlashErrorKind::OutOfBounds)?.fill(0xff);
        Ok(())
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> std::result::Result<(), NorFlashErrorKind> {
        let at = offset as usize;
        let cells = self.0.get_mut(at..at + bytes.len()).ok_or(NorFlashErrorKind::OutOfBounds)?;
        cells.iter_mut().zip(bytes).for_each(|(cell, byte)| *cell &= byte);
        Ok(())
    }
}

/// Stores a configuration in `sectors`, [`BYTES`] of them.
///
/// # Errors
/// [`Error::Invalid`] where it does not fit.
pub fn save(sectors: &mut [u8], config: &Configuration) -> Result<()> {
    let refuse = |e| Error::invalid("the board's stored configuration", format!("{e:?}"));
    Store::new(Sectors(sectors), 0).save(config).map_err(refuse)
}
