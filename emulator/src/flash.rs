//! Flash: sectors, word programming that only clears bits, erasure, both taking their time; wait states and the data
//! cache that keeps what an erasure has removed. RM0090 section 3.
//!
//! The core stands still while flash is busy, because it fetches from there: the chip lets the time pass. A power cut
//! in that time leaves a torn word or sector.

use crate::error::{Access, Refusal, within};
use crate::time::{NO_INSTANT, Time, UNITS_PER_SECOND};

/// First address.
pub const START: u32 = 0x0800_0000;
/// Size: 1 MiB.
pub const BYTES: u32 = 1 << 20;
/// First address of the part that holds no code: sectors 10 and 11. Its reads go through the data cache; those before
/// it do not.
pub const DATA_START: u32 = 0x080c_0000;

/// A word, data sheet: 16 us typical.
const PROGRAM_TIME: Time = UNITS_PER_SECOND * 16 / 1_000_000;
/// A sector of 128 KiB by words, data sheet: 1 s typical.
const ERASE_TIME: Time = UNITS_PER_SECOND;
const SECTOR_OF_ERASE_TIME: u32 = 0x2_0000;
const ERASED_BYTE: u8 = 0xff;

/// Option bytes as the factory leaves them: no protection, brown-out reset off.
const FACTORY_OPTIONS: u32 = 0x0fff_aaed;

const BSY: u32 = 1 << 16;
const PGSERR: u32 = 1 << 7;
const WRPERR: u32 = 1 << 4;
const ERRORS: u32 = 0xf2;
const EOP: u32 = 1 << 0;
const LOCK: u32 = 1 << 31;
const STRT: u32 = 1 << 16;
const PG: u32 = 1 << 0;
const SER: u32 = 1 << 1;
const EOPIE: u32 = 1 << 24;
const DATA_CACHE: u32 = 1 << 10;
const KEYS: [u32; 2] = [0x4567_0123, 0xcdef_89ab];

/// What flash is busy with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Work {
    Program { offset: u32, value: u32 },
    Erase { sector: u32 },
}

/// A line of the data cache: 128 bits.
#[derive(Clone, Copy, Debug)]
struct Line {
    start: u32,
    bytes: [u8; 16],
}

/// Offset and bytes of a sector.
pub fn sector(number: u32) -> (u32, u32) {
    match number {
        0..=3 => (number * 0x4000, 0x4000),
        4 => (0x1_0000, 0x1_0000),
        _ => ((number - 4) * 0x2_0000, 0x2_0000),
    }
}

/// The sector that an offset lies in.
fn sector_of(offset: u32) -> u32 {
    (0..12).rev().find(|number| sector(*number).0 <= offset).unwrap_or(0)
}

/// Controller and caches; the cells themselves are the caller's.
#[derive(Clone, Debug)]
pub struct Flash {
    acr: u32,
    sr: u32,
    cr: u32,
    keys: usize,
    /// A wrong key locks until reset.
    barred: bool,
    work: Option<(Work, Time, Time)>,
    lines: Vec<Line>,
    /// Where the core fetches from: a program may not erase the sector that it runs in, and of its words only make
    /// some void.
    pub fetching: Option<u32>,
    /// Option bytes, `FLASH_OPTCR`; the lowest level of the brown-out reset is 3 at bits 2 and 3.
    pub options: u32,
    /// Words programmed since power came for the first time.
    pub programmed: u64,
    /// Sectors erased, likewise.
    pub erased: u64,
}

impl Default for Flash {
    fn default() -> Self {
        Self {
            acr: 0,
            sr: 0,
            cr: LOCK,
            keys: 0,
            barred: false,
            work: None,
            lines: Vec::new(),
            fetching: None,
            options: FACTORY_OPTIONS,
            programmed: 0,
            erased: 0,
        }
    }
}

impl Flash {
    /// After a reset.
    pub fn reset(&mut self) {
        let Self { options, programmed, erased, .. } = *self;
        *self = Self { options, programmed, erased, ..Self::default() };
    }

    /// Wait states in force.
    pub fn wait_states(&self) -> u32 {
        self.acr & 7
    }

    /// When it has finished.
    pub fn due(&self) -> Time {
        self.work.map_or(NO_INSTANT, |(_, _, end)| end)
    }

    /// It has finished.
    pub fn finish(&mut self, cells: &mut [u8]) {
        match self.work.take() {
            Some((Work::Program { offset, value }, ..)) => {
                let at = offset as usize;
                for (cell, byte) in cells[at..at + 4].iter_mut().zip(value.to_le_bytes()) {
                    *cell &= byte;
                }
                self.programmed += 1;
            }
            Some((Work::Erase { sector: number }, ..)) => {
                let (offset, bytes) = sector(number);
                cells[offset as usize..(offset + bytes) as usize].fill(ERASED_BYTE);
                self.erased += 1;
            }
            None => {}
        }
        self.sr &= !BSY;
        if self.cr & EOPIE != 0 {
            self.sr |= EOP;
        }
        self.cr &= !STRT;
    }

    /// Power fails while flash is busy: the word or sector is left between what it was and what it was to become.
    /// `noise` gives bits at will.
    pub fn tear(&mut self, now: Time, cells: &mut [u8], mut noise: impl FnMut() -> u32) {
        let Some((work, start, end)) = self.work.take() else { return };
        let share = (now.saturating_sub(start) << 8) / (end - start).max(1);
        // A bit has changed already with the probability of the share of the time.
        let mut changed = || (0..8).fold(0, |bits, bit| bits | u8::from(u64::from(noise() & 0xff) < share) << bit);
        match work {
            Work::Program { offset, value } => {
                let at = offset as usize;
                for (cell, byte) in cells[at..at + 4].iter_mut().zip(value.to_le_bytes()) {
                    *cell &= byte | !changed();
                }
            }
            Work::Erase { sector: number } => {
                let (offset, bytes) = sector(number);
                for cell in &mut cells[offset as usize..(offset + bytes) as usize] {
                    *cell |= changed();
                }
            }
        }
    }

    /// A read of data through the cache.
    pub fn read_data(&mut self, offset: u32, size: u32, cells: &[u8]) -> u32 {
        let start = offset & !15;
        let inside = (offset - start) as usize;
        let read = |bytes: &[u8]| (0..size as usize).fold(0, |word, n| word | u32::from(bytes[inside + n]) << (8 * n));
        if self.acr & DATA_CACHE == 0 {
            return read(&cells[start as usize..start as usize + 16]);
        }
        let line = match self.lines.iter().position(|line| line.start == start) {
            Some(place) => self.lines.remove(place),
            None => {
                self.lines.truncate(7);
                let mut bytes = [0; 16];
                bytes.copy_from_slice(&cells[start as usize..start as usize + 16]);
                Line { start, bytes }
            }
        };
        let value = read(&line.bytes);
        // The line used longest ago goes first.
        self.lines.insert(0, line);
        value
    }

    /// A write into the cells, at an offset from the first address.
    ///
    /// # Errors
    /// What the manual forbids.
    pub fn write_data(&mut self, offset: u32, size: u32, value: u32, now: Time) -> Access<()> {
        if self.work.is_some() {
            return Err(Refusal::Forbidden("flash is busy"));
        }
        if self.cr & PG == 0 {
            self.sr |= PGSERR;
            return Ok(());
        }
        if self.cr >> 8 & 3 != 2 || size != 4 || !offset.is_multiple_of(4) {
            return Err(Refusal::Forbidden("only whole words are programmed"));
        }
        if value != 0 && self.is_fetched_from(sector_of(offset)) {
            self.sr |= WRPERR;
            return Err(Refusal::Forbidden("the program overwrites itself"));
        }
        // A line that holds the word takes it up.
        for line in self.lines.iter_mut().filter(|line| line.start == offset & !15) {
            let at = (offset & 15) as usize;
            for (byte, new) in line.bytes[at..at + 4].iter_mut().zip(value.to_le_bytes()) {
                *byte &= new;
            }
        }
        self.begin(Work::Program { offset, value }, now, PROGRAM_TIME);
        Ok(())
    }

    fn is_fetched_from(&self, number: u32) -> bool {
        self.fetching.is_some_and(|address| sector_of(address.wrapping_sub(START)) == number)
    }

    fn begin(&mut self, work: Work, now: Time, length: Time) {
        self.work = Some((work, now, now + length));
        self.sr |= BSY;
    }

    /// Reads a register.
    ///
    /// # Errors
    /// [`Refusal::Register`].
    pub fn read(&self, offset: u32) -> Access<u32> {
        Ok(match offset {
            0x00 => self.acr,
            0x0c => self.sr,
            0x10 => self.cr,
            0x14 => self.options,
            _ => return Err(Refusal::Register),
        })
    }

    /// Writes a register.
    ///
    /// # Errors
    /// A register or bit that is not modelled, or what the manual forbids.
    pub fn write(&mut self, offset: u32, value: u32, now: Time) -> Access<()> {
        match offset {
            0x00 => self.access_control(within(value, 0x1f07)?)?,
            0x04 => self.unlock(value),
            0x0c => self.sr &= !(value & (ERRORS | EOP)),
            0x10 => self.control(value, now)?,
            _ => return Err(Refusal::Register),
        }
        Ok(())
    }

    fn access_control(&mut self, value: u32) -> Access<()> {
        // The reset bits lie two above the bits that switch the caches on.
        if value >> 2 & (self.acr | value) & 0x600 != 0 {
            return Err(Refusal::Forbidden("a cache is reset while it is on"));
        }
        if value & 1 << 12 != 0 {
            self.lines.clear();
        }
        self.acr = value;
        Ok(())
    }

    fn unlock(&mut self, key: u32) {
        if self.barred || self.keys >= KEYS.len() || key != KEYS[self.keys] {
            self.barred = true;
            return;
        }
        self.keys += 1;
        if self.keys == KEYS.len() {
            self.cr &= !LOCK;
            self.keys = 0;
        }
    }

    fn control(&mut self, value: u32, now: Time) -> Access<()> {
        within(value, PG | SER | 0xf8 | 0x300 | STRT | EOPIE | LOCK)?;
        if self.cr & LOCK != 0 {
            return if value & LOCK != 0 { Ok(()) } else { Err(Refusal::Forbidden("locked")) };
        }
        if self.work.is_some() {
            return Err(Refusal::Forbidden("flash is busy"));
        }
        self.cr = value & !STRT;
        if value & STRT != 0 {
            let number = value >> 3 & 0xf;
            if value & SER == 0 || number > 11 {
                return Err(Refusal::Forbidden("only sectors are erased"));
            }
            if self.is_fetched_from(number) {
                return Err(Refusal::Forbidden("the program erases itself"));
            }
            if sector(number).1 != SECTOR_OF_ERASE_TIME {
                return Err(Refusal::Forbidden("the time to erase a small sector is not modelled"));
            }
            self.cr |= STRT;
            self.begin(Work::Erase { sector: number }, now, ERASE_TIME);
        }
        Ok(())
    }
}
