//! Sectors of the chip's flash as `embedded-storage` sees one: the configuration's, and those of the two slots of
//! images.

use super::flash_control as controller;
use core::ptr;
use embedded_storage::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash, check_erase, check_read, check_write,
};
use meshband_stm32::flash::{self, FlashFault, SECTOR_BYTES, Sectors};

/// Some sectors in a row.
pub struct SectorFlash(Sectors);

/// All that is written on this board; there is one set.
pub struct Parts {
    /// The configuration.
    pub configuration: SectorFlash,
    /// The slots of images, the lower one first.
    pub slots: [SectorFlash; 2],
}

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

impl Parts {
    /// Takes the sectors into use; `None` when called twice.
    pub fn take() -> Option<Self> {
        let [configuration, lower, upper] = [Sectors::CONFIGURATION, Sectors::SLOT_A, Sectors::SLOT_B].map(SectorFlash);
        cortex_m::singleton!(: () = ()).map(|()| Self { configuration, slots: [lower, upper] })
    }
}

impl SectorFlash {
    /// First address.
    pub fn start(&self) -> u32 {
        self.0.start()
    }
}

impl ErrorType for SectorFlash {
    type Error = Refusal;
}

impl ReadNorFlash for SectorFlash {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Refusal> {
        check_read(self, offset, bytes.len())?;
        let start = (self.start() + offset) as *const u8;
        for (n, byte) in bytes.iter_mut().enumerate() {
            // SAFETY: checked to lie inside the sectors; volatile, because the contents change under the compiler.
            *byte = unsafe { ptr::read_volatile(start.add(n)) };
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.0.bytes() as usize
    }
}

impl NorFlash for SectorFlash {
    const WRITE_SIZE: usize = 4;
    const ERASE_SIZE: usize = SECTOR_BYTES as usize;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), Refusal> {
        check_erase(self, from, to)?;
        for sector in from / SECTOR_BYTES..to / SECTOR_BYTES {
            flash::erase(controller(), self.0, sector as u8)?;
        }
        Ok(())
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Refusal> {
        check_write(self, offset, bytes.len())?;
        flash::begin_write(controller())?;
        let (words, _) = bytes.as_chunks::<4>();
        let mut address = (self.start() + offset) as *mut u32;
        let mut outcome = Ok(());
        for word in words {
            // SAFETY: checked to lie inside the sectors, aligned to words, and the controller expects the write.
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
