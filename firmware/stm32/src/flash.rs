//! Flash: erasure and word writes in sectors of 128 KiB.
//!
//! Two hold the configuration, which needs two to survive a power cut at any instant; two and two hold the images.
//! The core stands still while flash is busy (it fetches from the same bank): 16 us per word, 1 s to 2 s per erasure;
//! blocks are lost meanwhile and counted. RM0090 section 3.6.
//!
//! Words of 32 bits may be programmed from 2.7 V on only. The core runs down to 1.8 V; what guarantees the voltage is
//! the brown-out reset, an option byte that new chips have off ([`BrownOut`]).

use crate::pac::flash;

/// Bytes of one sector.
pub const SECTOR_BYTES: u32 = 128 * 1024;
/// The first of this size, and its address; those before it are smaller.
const FIRST_SECTOR: (u8, u32) = (5, 0x0802_0000);

/// Sectors of 128 KiB in a row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sectors {
    first: u8,
    count: u8,
}

impl Sectors {
    /// The lower slot of images.
    pub const SLOT_A: Self = Self { first: 5, count: 2 };
    /// The upper slot of images.
    pub const SLOT_B: Self = Self { first: 7, count: 2 };
    /// The configuration: the last two.
    pub const CONFIGURATION: Self = Self { first: 10, count: 2 };

    /// First address.
    pub const fn start(self) -> u32 {
        FIRST_SECTOR.1 + (self.first - FIRST_SECTOR.0) as u32 * SECTOR_BYTES
    }

    /// All their bytes.
    pub const fn bytes(self) -> u32 {
        self.count as u32 * SECTOR_BYTES
    }
}

/// Polls of a busy flash; an erasure holds the core for its whole length anyway.
const PATIENCE: u32 = 50_000_000;

/// Error flags and the end-of-operation flag in the status register.
const FLAGS: u32 = 0xf3;

/// What went wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FlashFault {
    /// No such sector, or a word across its border.
    Range,
    /// The controller refused: protection, alignment, or a wrong sequence.
    Refused,
    /// Still busy after all patience.
    Busy,
}

/// Erases one of them, counted from 0.
///
/// # Errors
/// As [`FlashFault`] says; the sector is then undefined.
pub fn erase(flash: &flash::RegisterBlock, sectors: Sectors, number: u8) -> Result<(), FlashFault> {
    select(flash, sectors, number)?;
    flash.cr().modify(|_, w| w.strt().set_bit());
    let outcome = finish(flash);
    flush_caches(flash);
    outcome
}

/// Empties both caches: an erasure leaves what they hold of the sector as it was (RM0090 section 3.5.2). They must be
/// off for that.
fn flush_caches(flash: &flash::RegisterBlock) {
    flash.acr().modify(|_, w| w.icen().disabled().dcen().disabled());
    flash.acr().modify(|_, w| w.icrst().set_bit().dcrst().set_bit());
    flash.acr().modify(|_, w| w.icrst().clear_bit().dcrst().clear_bit());
    flash.acr().modify(|_, w| w.icen().enabled().dcen().enabled());
}

/// Voltage below which the chip holds itself in reset: option byte BOR_LEV, thresholds of DS8626.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum BrownOut {
    /// 2.75 V or more: words can always be programmed.
    Level3 = 0,
    /// From 2.44 V on.
    Level2 = 1,
    /// From 2.13 V on.
    Level1 = 2,
    /// From 1.8 V on, as delivered.
    Off = 3,
}

/// The level in force.
pub fn brown_out(flash: &flash::RegisterBlock) -> BrownOut {
    match flash.optcr().read().bits() >> 2 & 3 {
        0 => BrownOut::Level3,
        1 => BrownOut::Level2,
        2 => BrownOut::Level1,
        _ => BrownOut::Off,
    }
}

/// Unlocks the controller and names the sector to erase.
///
/// # Errors
/// As [`FlashFault`] says.
pub fn select(flash: &flash::RegisterBlock, sectors: Sectors, number: u8) -> Result<(), FlashFault> {
    if number >= sectors.count {
        return Err(FlashFault::Range);
    }
    unlock(flash)?;
    let sector = sectors.first + number;
    // SAFETY: sectors 5 to 11 exist; whoever holds the sectors sees to it that no code runs there (memory.x).
    flash.cr().write(|w| unsafe { w.lock().unlocked().psize().psize32().ser().set_bit().snb().bits(sector) });
    Ok(())
}

/// Prepares the writing of words; [`finish_write`] ends it.
///
/// # Errors
/// [`FlashFault::Busy`].
pub fn begin_write(flash: &flash::RegisterBlock) -> Result<(), FlashFault> {
    unlock(flash)?;
    // The register's reset value locks it: every write but the last says otherwise.
    flash.cr().write(|w| w.lock().unlocked().psize().psize32().pg().set_bit());
    Ok(())
}

/// Waits for the word written last.
///
/// # Errors
/// As [`FlashFault`] says.
pub fn settle(flash: &flash::RegisterBlock) -> Result<(), FlashFault> {
    if !(0..PATIENCE).any(|_| flash.sr().read().bsy().is_not_busy()) {
        return Err(FlashFault::Busy);
    }
    let status = flash.sr().read();
    let flags = status.bits() & FLAGS;
    if flags != 0 {
        // SAFETY: writing ones clears these flags; the rest is read-only.
        flash.sr().write(|w| unsafe { w.bits(flags) });
    }
    let refused = status.wrperr().bit() || status.pgaerr().bit() || status.pgperr().bit() || status.pgserr().bit();
    if refused { Err(FlashFault::Refused) } else { Ok(()) }
}

/// Ends the writing of words and locks.
///
/// # Errors
/// As [`FlashFault`] says.
pub fn finish_write(flash: &flash::RegisterBlock) -> Result<(), FlashFault> {
    finish(flash)
}

fn unlock(flash: &flash::RegisterBlock) -> Result<(), FlashFault> {
    // Refusals of an earlier operation were its own; only a busy flash matters here.
    if settle(flash) == Err(FlashFault::Busy) {
        return Err(FlashFault::Busy);
    }
    if flash.cr().read().lock().is_locked() {
        flash.keyr().write(|w| w.key().set(0x4567_0123));
        flash.keyr().write(|w| w.key().set(0xcdef_89ab));
    }
    Ok(())
}

fn finish(flash: &flash::RegisterBlock) -> Result<(), FlashFault> {
    let outcome = settle(flash);
    flash.cr().write(|w| w.lock().set_bit());
    outcome
}
