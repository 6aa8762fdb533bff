//! The configuration's flash, imitated at the end of the PSRAM.
//!
//! AN386 has no flash the processor can write. This memory obeys the rules of one: bits only fall until the sector is
//! erased, addresses and lengths are aligned. It survives a reset, and QEMU can keep it in a file beyond its own end.

use core::ptr;
use embedded_storage::nor_flash::{
    ErrorType, NorFlash, NorFlashErrorKind, ReadNorFlash, check_erase, check_read, check_write,
};
use meshband::replay::{FLASH_ADDRESS, FLASH_CAPACITY};

/// Bytes of a sector.
pub const SECTOR: usize = FLASH_CAPACITY / 2;

/// The flash; there is one.
pub struct Flash(());

impl Flash {
    /// Takes the flash into use. Memory that never held anything reads as zeros and is erased first, as a new chip is.
    ///
    /// # Panics
    /// When called twice.
    pub fn take() -> Self {
        cortex_m::singleton!(: () = ()).expect("the flash is taken once");
        let mut flash = Self(());
        if (0..FLASH_CAPACITY).all(|at| flash.get(at) == 0) {
            (0..FLASH_CAPACITY).for_each(|at| flash.set(at, 0xff));
        }
        flash
    }

    fn get(&self, at: usize) -> u8 {
        // SAFETY: callers stay below FLASH_CAPACITY; this memory belongs to this value alone, and nothing else maps it.
        unsafe { ptr::read_volatile((FLASH_ADDRESS as *const u8).add(at)) }
    }

    fn set(&mut self, at: usize, byte: u8) {
        // SAFETY: as for `get`.
        unsafe { ptr::write_volatile((FLASH_ADDRESS as *mut u8).add(at), byte) }
    }
}

impl ErrorType for Flash {
    type Error = NorFlashErrorKind;
}

impl ReadNorFlash for Flash {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Self::Error> {
        check_read(self, offset, bytes.len())?;
        for (n, byte) in bytes.iter_mut().enumerate() {
            *byte = self.get(offset as usize + n);
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        FLASH_CAPACITY
    }
}

impl NorFlash for Flash {
    const WRITE_SIZE: usize = 4;
    const ERASE_SIZE: usize = SECTOR;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), Self::Error> {
        check_erase(self, from, to)?;
        (from as usize..to as usize).for_each(|at| self.set(at, 0xff));
        Ok(())
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Self::Error> {
        check_write(self, offset, bytes.len())?;
        for (n, &byte) in bytes.iter().enumerate() {
            let at = offset as usize + n;
            self.set(at, self.get(at) & byte);
        }
        Ok(())
    }
}
