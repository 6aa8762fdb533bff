//! Configurations in the board's flash, written as the node's own store would have left them.
#![allow(dead_code, reason = "every test program uses some of it")]

use meshband::frame::CRC32;
use meshband::store::{HEADER, SLOT};
use meshband_emulator::chip::Chip;
use meshband_emulator::flash::{DATA_START, START};

/// Slots of a sector.
pub const SLOTS: usize = 128 * 1024 / SLOT;
const MARK: u32 = 0x6d62_6366;

/// Offset of a slot in flash; slots count through both sectors.
pub fn place(slot: usize) -> usize {
    (DATA_START - START) as usize + slot * SLOT
}

/// Puts a record into a slot.
pub fn put(chip: &mut Chip, slot: usize, sequence: u32, payload: &[u8]) {
    let mut record: Vec<u8> =
        [MARK, sequence, payload.len() as u32].iter().flat_map(|word| word.to_le_bytes()).collect();
    let mut digest = CRC32.digest();
    digest.update(&record);
    digest.update(payload);
    record.extend(digest.finalize().to_le_bytes());
    record.resize(HEADER, 0xff);
    record.extend(payload);
    chip.cells[place(slot)..place(slot) + record.len()].copy_from_slice(&record);
}
