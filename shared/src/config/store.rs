//! Configuration in NOR flash: a log of records in two sectors, of which the newest intact one counts.
//!
//! Each sector is divided into slots of [`SLOT`] bytes, one record per slot: header (mark, sequence, length, CRC-32),
//! then the configuration in postcard. A record goes into the next blank slot of the sector in use; when there is
//! none, the other sector is erased and used. The record in force is therefore never in the sector being erased, and
//! a power cut at any byte of a write or an erase leaves the old record or the new one. Every write is read back.
//!
//! Own code, although sequential-storage has a map for this, for three reasons: it judges a sector by its first and
//! last word, so that an erase cut short in the middle (an STM32F405 erases 128 KiB for seconds) passes for a blank
//! sector; it falls back to an older value without a word, where a node must say so; and its futures are dead weight
//! here.
//!
//! Any `embedded_storage::NorFlash` with two equal sectors and a write unit of at most [`HEADER`] bytes will do.
//! Nothing is written twice without an erase. Cost: 2.6 KiB of stack; loading reads every slot's header.

use crate::board::Timing;
use crate::config::Configuration;
use crate::frame::CRC32;
use embedded_storage::nor_flash::{NorFlash, ReadNorFlash};

/// Bytes per slot, a layout constant: it outlives changes of the configuration.
pub const SLOT: usize = 2048;
/// Bytes of a header, padding included: the largest write unit known (STM32H7).
pub const HEADER: usize = 32;

const MARK: u32 = 0x6d62_6366;
const BLANK_BYTE: u8 = 0xff;
const PAYLOAD: usize = SLOT - HEADER;
const _: () = assert!(Configuration::MAX_SERIALISED <= PAYLOAD);

/// Where a loaded configuration came from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Origin {
    /// The newest record; nothing is wrong.
    Stored,
    /// Nothing was ever stored: the default.
    Blank,
    /// A record after this one was cut short or damaged; this is the one before it.
    Former,
    /// Records were there but none is intact: the default.
    Damaged,
    /// The newest record is intact but of a newer schema, or invalid on this board: the default.
    Refused,
    /// The flash cannot be read: the default.
    Unreadable,
}

impl Origin {
    /// Detail of [`crate::events::EventKind::ConfigurationRefused`], or `None` where there is nothing to report.
    pub fn complaint(self) -> Option<u32> {
        match self {
            Origin::Stored | Origin::Blank => None,
            Origin::Former => Some(1),
            Origin::Damaged => Some(2),
            Origin::Refused => Some(3),
            Origin::Unreadable => Some(4),
        }
    }
}

/// Why a configuration was not stored; the former one is still in force then.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum StoreError<E> {
    /// The driver's reason.
    Flash(E),
    /// The configuration is larger than a slot.
    TooLong,
    /// What was written reads back differently, in every slot tried.
    Unwritable,
    /// The flash has less than two sectors at this place, or sectors or write units this layout cannot use.
    Geometry,
}

/// The log in two sectors of a flash.
#[derive(Debug)]
pub struct Store<F> {
    flash: F,
    base: u32,
}

/// Place of the newest intact record.
#[derive(Clone, Copy)]
struct Newest {
    slot: usize,
    sequence: u32,
}

impl<F: NorFlash> Store<F> {
    const SLOTS: usize = F::ERASE_SIZE / SLOT;

    /// A log in the two sectors from offset `base` of the flash on.
    pub const fn new(flash: F, base: u32) -> Self {
        Self { flash, base }
    }

    /// The flash itself.
    pub fn flash_mut(&mut self) -> &mut F {
        &mut self.flash
    }

    /// The newest intact configuration that this board accepts, brought up from an older schema where it has one, or
    /// the default; and which of them it is. Its slot's buffer is on the stack only while it runs.
    #[inline(never)]
    pub fn load(&mut self, board: impl Into<Timing>) -> (Configuration, Origin) {
        let mut payload = [0; PAYLOAD];
        let board = board.into();
        match self.read_newest(&mut payload) {
            Ok((Some(bytes), origin)) => {
                let mut stored = Configuration::from_stored(bytes);
                if let Some(config) = &mut stored {
                    config.lower_to(board);
                }
                match stored {
                    Some(config) if config.validate(board).is_ok() => (config, origin),
                    _ => (Configuration::default(), Origin::Refused),
                }
            }
            Ok((None, origin)) => (Configuration::default(), origin),
            Err(_) => (Configuration::default(), Origin::Unreadable),
        }
    }

    /// Stores a configuration; whatever happens meanwhile, a later load finds this one or the former one.
    ///
    /// # Errors
    /// Any of [`StoreError`].
    pub fn save(&mut self, config: &Configuration) -> Result<(), StoreError<F::Error>> {
        self.check_geometry()?;
        let mut record = [BLANK_BYTE; SLOT];
        let (header, payload) = record.split_at_mut(HEADER);
        let length = config.to_stored(payload).ok_or(StoreError::TooLong)?;
        let newest = self.find_newest().map_err(StoreError::Flash)?;
        let sequence = newest.map_or(0, |newest| newest.sequence.wrapping_add(1));
        write_header(header, sequence, payload.get(..length).unwrap_or_default());
        // Whole write units; the padding stays blank.
        let used = (HEADER + length).next_multiple_of(HEADER).min(SLOT);
        let record = record.get(..used).unwrap_or_default();
        // Nothing intact anywhere: the first sector is as good as the second.
        let (sector, from) = newest.map_or((0, 0), |newest| (newest.slot / Self::SLOTS, newest.slot % Self::SLOTS + 1));
        for slot in from..Self::SLOTS {
            if self.write_slot(sector * Self::SLOTS + slot, record)? {
                return Ok(());
            }
        }
        let other = if newest.is_some() { 1 - sector } else { sector };
        let start = self.address(other * Self::SLOTS);
        self.flash.erase(start, start.saturating_add(F::ERASE_SIZE as u32)).map_err(StoreError::Flash)?;
        for slot in 0..Self::SLOTS {
            if self.write_slot(other * Self::SLOTS + slot, record)? {
                return Ok(());
            }
        }
        Err(StoreError::Unwritable)
    }

    /// Writes a record into a blank slot and reads it back; false if the slot was not blank or did not keep it.
    fn write_slot(&mut self, slot: usize, record: &[u8]) -> Result<bool, StoreError<F::Error>> {
        if !self.is_blank(slot, SLOT).map_err(StoreError::Flash)? {
            return Ok(false);
        }
        let address = self.address(slot);
        self.flash.write(address, record).map_err(StoreError::Flash)?;
        for (n, written) in record.chunks(HEADER).enumerate() {
            let mut kept = [0; HEADER];
            let kept = kept.get_mut(..written.len()).unwrap_or_default();
            let at = address.saturating_add((n * HEADER) as u32);
            self.flash.read(at, kept).map_err(StoreError::Flash)?;
            if kept != written {
                return Ok(false);
            }
        }
        Ok(true)
    }

    fn read_newest<'b>(&mut self, payload: &'b mut [u8; PAYLOAD]) -> Result<(Option<&'b [u8]>, Origin), F::Error> {
        if self.check_geometry().is_err() {
            return Ok((None, Origin::Unreadable));
        }
        let Some(newest) = self.find_newest()? else {
            for slot in 0..2 * Self::SLOTS {
                if !self.is_blank(slot, SLOT)? {
                    return Ok((None, Origin::Damaged));
                }
            }
            return Ok((None, Origin::Blank));
        };
        // The slot written next holds nothing, or a record older than this one; anything else was cut short or damaged.
        let next = (newest.slot + 1) % (2 * Self::SLOTS);
        let sound = self.is_blank(next, SLOT)? || self.read_record(next, payload)?.is_some();
        let origin = if sound { Origin::Stored } else { Origin::Former };
        let length = self.read_record(newest.slot, payload)?.map(|(_, length)| length);
        Ok((length.and_then(|length| payload.get(..length)), origin))
    }

    fn find_newest(&mut self) -> Result<Option<Newest>, F::Error> {
        let mut payload = [0; PAYLOAD];
        let mut newest: Option<Newest> = None;
        for slot in 0..2 * Self::SLOTS {
            if let Some((sequence, _)) = self.read_record(slot, &mut payload)?
                && newest.is_none_or(|known| sequence.wrapping_sub(known.sequence) as i32 > 0)
            {
                newest = Some(Newest { slot, sequence });
            }
        }
        Ok(newest)
    }

    /// Sequence and length of a slot's record if it is intact; its payload is read into the buffer.
    fn read_record(&mut self, slot: usize, payload: &mut [u8; PAYLOAD]) -> Result<Option<(u32, usize)>, F::Error> {
        let mut header = [0; HEADER];
        let address = self.address(slot);
        self.flash.read(address, &mut header)?;
        let length = word(&header, 8) as usize;
        if word(&header, 0) != MARK || length > PAYLOAD {
            return Ok(None);
        }
        // Whole read units.
        let whole = length.next_multiple_of(HEADER).min(PAYLOAD);
        self.flash.read(address.saturating_add(HEADER as u32), payload.get_mut(..whole).unwrap_or_default())?;
        let sequence = word(&header, 4);
        let checksum = checksum(&header, payload.get(..length).unwrap_or_default());
        Ok((checksum == word(&header, 12)).then_some((sequence, length)))
    }

    fn is_blank(&mut self, slot: usize, bytes: usize) -> Result<bool, F::Error> {
        let mut part = [0; 128];
        let address = self.address(slot);
        for offset in (0..bytes).step_by(part.len()) {
            self.flash.read(address.saturating_add(offset as u32), &mut part)?;
            if part.iter().any(|&byte| byte != BLANK_BYTE) {
                return Ok(false);
            }
        }
        Ok(true)
    }

    fn address(&self, slot: usize) -> u32 {
        let sector = slot / Self::SLOTS.max(1);
        let inside = slot % Self::SLOTS.max(1);
        self.base.saturating_add((sector * F::ERASE_SIZE + inside * SLOT) as u32)
    }

    fn check_geometry(&self) -> Result<(), StoreError<F::Error>> {
        let end = self.base as usize + 2 * F::ERASE_SIZE;
        let usable = Self::SLOTS >= 1
            && HEADER.is_multiple_of(F::WRITE_SIZE)
            && HEADER.is_multiple_of(<F as ReadNorFlash>::READ_SIZE)
            && (self.base as usize).is_multiple_of(F::ERASE_SIZE)
            && end <= self.flash.capacity();
        if usable { Ok(()) } else { Err(StoreError::Geometry) }
    }
}

fn write_header(header: &mut [u8], sequence: u32, payload: &[u8]) {
    put(header, 0, MARK);
    put(header, 4, sequence);
    put(header, 8, payload.len() as u32);
    let checksum = checksum(header, payload);
    put(header, 12, checksum);
}

/// Over mark, sequence, length and payload.
fn checksum(header: &[u8], payload: &[u8]) -> u32 {
    let mut digest = CRC32.digest();
    digest.update(header.get(..12).unwrap_or_default());
    digest.update(payload);
    digest.finalize()
}

fn word(bytes: &[u8], at: usize) -> u32 {
    bytes.get(at..).and_then(|rest| rest.first_chunk()).map_or(0, |word| u32::from_le_bytes(*word))
}

fn put(bytes: &mut [u8], at: usize, value: u32) {
    if let Some(place) = bytes.get_mut(at..at + 4) {
        place.copy_from_slice(&value.to_le_bytes());
    }
}
