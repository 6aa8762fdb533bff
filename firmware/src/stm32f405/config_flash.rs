//! The configuration's two sectors as `embedded-storage` sees a flash.

use super::flash_control as controller;
use core::ptr;
use embedded_storage::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash, check_erase, check_read, check_write,
};
use meshband_stm32::flash::{self, FlashFault, SECTOR_BYTES, SECTORS, START};

/// The two sectors; there is one set.
pub struct ConfigFlash(());

/// Refusals of the driver or of the controller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Refusal(NorFlashErrorKind);

impl NorFlashError for Refusal {
    fn kind(&self) -> NorFlashErrorKind {
        self.0
    }
}

impl From<NorFlashErrorKind> for Refusal {
    fn from(kind: NorFlashErrorKind) -> Self {
        Self(kind)
    }
}

impl From<FlashFault> for Refusal {
    fn from(_: FlashFault) -> Self {
        Self(NorFlashErrorKind::Other)
    }
}

impl ConfigFlash {
    /// Takes the sectors into use; `None` when called twice.
    pub fn take() -> Option<Self> {
        cortex_m::singleton!(: () = ()).map(|()| Self(()))
    }
}

impl ErrorType for ConfigFlash {
    type Error = Refusal;
}

impl ReadNorFlash for ConfigFlash {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Refusal> {
        check_read(self, offset, bytes.len())?;
        let start = (START + offset) as *const u8;
        for (n, byte) in bytes.iter_mut().enumerate() {
            // SAFETY: checked to lie inside the two sectors; volatile, because the contents change under the compiler.
            *byte = unsafe { ptr::read_volatile(start.add(n)) };
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        (u32::from(SECTORS) * SECTOR_BYTES) as usize
    }
}

impl NorFlash for ConfigFlash {
    const WRITE_SIZE: usize = 4;
    const ERASE_SIZE: usize = SECTOR_BYTES as usize;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), Refusal> {
        check_erase(self, from, to)?;
        for sector in from / SECTOR_BYTES..to / SECTOR_BYTES {
            flash::erase(controller(), sector as u8)?;
        }
        Ok(())
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Refusal> {
        check_write(self, offset, bytes.len())?;
        flash::begin_write(controller())?;
        let (words, _) = bytes.as_chunks::<4>();
        let mut address = (START + offset) as *mut u32;
        let mut outcome = Ok(());
        for word in words {
            // SAFETY: checked to lie inside the two sectors, aligned to words, and the controller expects the write.
            unsafe { ptr::write_volatile(address, u32::from_ne_bytes(*word)) };
            outcome = flash::settle(controller());
            if outcome.is_err() {
                break;
            }
            address = address.wrapping_add(1);
        }
        flash::finish_write(controller())?;
        Ok(outcome?)
    }
}
