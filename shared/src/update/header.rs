//! What an image says of itself, in the first bytes of its slot, and what of that is checked before a byte is erased.
//!
//! Bytes, numbers little-endian: 0 mark, 4 layout (16 bits), 6 configuration schema (16 bits), 8 first address of the
//! slot, 12 length, 16 CRC-32 of the image, 20 version (major, minor, patch), 23 link schema, 24 board's name, 40
//! build, both padded with zeros, 52 zeros, 60 CRC-32 of all before. The image itself, its vector table first, lies
//! [`IMAGE_OFFSET`] behind the slot's first address: a vector table of 98 entries must lie on a multiple of 512
//! (PM0214, VTOR).

use crate::config::SCHEMA;
use crate::frame::CRC32;
use crate::identity::{BOARD_LENGTH, BUILD_LENGTH, VERSION};
use crate::message::WIRE_SCHEMA;
use crate::update::vocabulary::UpdateRefused;

/// Bytes of a header.
pub const HEADER_BYTES: usize = 64;
/// From a slot's first address to the image in it.
pub const IMAGE_OFFSET: u32 = 512;
/// Images are whole numbers of this many bytes.
pub const LENGTH_STEP: u32 = 8;

const MARK: u32 = 0x6d62_696d;
const LAYOUT: u16 = 1;
/// Bytes that the checksum is of.
const CHECKSUM_BYTES: usize = 60;
/// Shortest image that could be one: a vector table.
const MIN_IMAGE_BYTES: u32 = 512;
/// Where an STM32F405's stack may begin: core-coupled memory, or the memory beside it.
const STACKS: [(u32, u32); 2] = [(0x1000_0000, 0x1001_0000), (0x2000_0000, 0x2002_0000)];

/// A header that was read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Header {
    /// First address of the slot that the image is linked for.
    pub base: u32,
    /// Bytes of the image.
    pub length: u32,
    /// CRC-32 (ISO-HDLC) of the image.
    pub checksum: u32,
    /// Major, minor, patch.
    pub version: [u8; 3],
    /// [`WIRE_SCHEMA`] that the image speaks.
    pub wire_schema: u8,
    /// [`SCHEMA`] of the configuration that the image stores.
    pub configuration_schema: u16,
    /// Name of the board, padded with zeros.
    pub board: [u8; BOARD_LENGTH],
    /// What the image was built from, padded with zeros.
    pub build: [u8; BUILD_LENGTH],
}

/// What an image knows of itself when it is compiled: its header without place, length and checksums.
pub const fn describe(board: &str, build: &str) -> [u8; HEADER_BYTES] {
    let mut bytes = [0; HEADER_BYTES];
    put(&mut bytes, 0, &MARK.to_le_bytes());
    put(&mut bytes, 4, &LAYOUT.to_le_bytes());
    put(&mut bytes, 6, &SCHEMA.to_le_bytes());
    put(&mut bytes, 20, &VERSION);
    bytes[23] = WIRE_SCHEMA;
    put_text(&mut bytes, 24, board, BOARD_LENGTH);
    put_text(&mut bytes, 40, build, BUILD_LENGTH);
    bytes
}

const fn put(bytes: &mut [u8; HEADER_BYTES], at: usize, value: &[u8]) {
    let mut n = 0;
    while n < value.len() {
        bytes[at + n] = value[n];
        n += 1;
    }
}

const fn put_text(bytes: &mut [u8; HEADER_BYTES], at: usize, text: &str, most: usize) {
    let mut n = 0;
    while n < text.len() && n < most {
        bytes[at + n] = text.as_bytes()[n];
        n += 1;
    }
}

/// The header of an image that describes itself so ([`describe`]), for the slot that begins at `base`.
pub fn seal(description: &[u8; HEADER_BYTES], base: u32, image: &[u8]) -> [u8; HEADER_BYTES] {
    let mut bytes = *description;
    put(&mut bytes, 8, &base.to_le_bytes());
    put(&mut bytes, 12, &(image.len() as u32).to_le_bytes());
    put(&mut bytes, 16, &CRC32.checksum(image).to_le_bytes());
    let sum = CRC32.checksum(bytes.get(..CHECKSUM_BYTES).unwrap_or_default());
    put(&mut bytes, CHECKSUM_BYTES, &sum.to_le_bytes());
    bytes
}

impl Header {
    /// Reads a header; `None` for anything else, or one that is damaged or of another layout.
    pub fn read(bytes: &[u8; HEADER_BYTES]) -> Option<Self> {
        let sum = CRC32.checksum(bytes.get(..CHECKSUM_BYTES)?);
        let ours = word(bytes, 0) == MARK && half(bytes, 4) == LAYOUT && word(bytes, CHECKSUM_BYTES) == sum;
        ours.then(|| Self {
            base: word(bytes, 8),
            length: word(bytes, 12),
            checksum: word(bytes, 16),
            version: taken(bytes, 20),
            wire_schema: bytes[23],
            configuration_schema: half(bytes, 6),
            board: taken(bytes, 24),
            build: taken(bytes, 40),
        })
    }

    /// Whether the image may go into the slot of so many bytes at `base`, in the place of one that describes itself so.
    ///
    /// # Errors
    /// What speaks against it.
    pub fn check(&self, base: u32, slot_bytes: u32, running: &[u8; HEADER_BYTES]) -> Result<(), UpdateRefused> {
        let room = slot_bytes.saturating_sub(IMAGE_OFFSET);
        if self.board != taken(running, 24) {
            return Err(UpdateRefused::Board);
        }
        if self.configuration_schema < half(running, 6) {
            return Err(UpdateRefused::OlderSchema);
        }
        if self.base != base {
            return Err(UpdateRefused::Place);
        }
        if !(MIN_IMAGE_BYTES..=room).contains(&self.length) || !self.length.is_multiple_of(LENGTH_STEP) {
            return Err(UpdateRefused::Length);
        }
        Ok(())
    }

    /// Whether the first two vectors could be those of this image: a stack in memory, an entry inside the image and
    /// Thumb.
    pub fn fits_vectors(&self, stack: u32, entry: u32) -> bool {
        let stack_fits = STACKS.iter().any(|&(from, to)| stack > from && stack <= to) && stack.is_multiple_of(8);
        let first = self.base.saturating_add(IMAGE_OFFSET);
        let inside = (first..first.saturating_add(self.length)).contains(&entry);
        stack_fits && inside && entry & 1 == 1
    }
}

fn taken<const N: usize>(bytes: &[u8; HEADER_BYTES], at: usize) -> [u8; N] {
    bytes.get(at..).and_then(|rest| rest.first_chunk()).copied().unwrap_or([0; N])
}

fn word(bytes: &[u8; HEADER_BYTES], at: usize) -> u32 {
    u32::from_le_bytes(taken(bytes, at))
}

fn half(bytes: &[u8; HEADER_BYTES], at: usize) -> u16 {
    u16::from_le_bytes(taken(bytes, at))
}
