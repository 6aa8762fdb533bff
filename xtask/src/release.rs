//! What is made of the linked images: the update file, and what `cargo xtask flash` writes to a new board.
//!
//! An image becomes whole by its header (`shared/src/update/header.rs`): what it says of itself (symbol
//! `IMAGE_DESCRIPTION`), with place, length and checksums filled in here. An update file is both slots' images behind
//! one another, each behind its header: the host sends the one that fits the slot that is free.
//! `emulator/tests/flashed/update.rs` holds the file against the node's own reading of it.

use crate::elf::{self, Image};
use crate::node_build::{RELEASE_BOARD, image};
use crate::shell::Outcome;
use std::path::Path;

/// First address of flash.
const FLASH: u32 = 0x0800_0000;
/// Slots: image and first address (`memory.x`).
const SLOTS: [(&str, u32); 2] = [(RELEASE_BOARD, 0x0802_0000), ("stm32f405_b", 0x0806_0000)];
/// From a slot's first address to its image.
const IMAGE_OFFSET: u32 = 512;
const HEADER_BYTES: usize = 64;
/// Images are whole numbers of this many bytes.
const LENGTH_STEP: usize = 8;
/// Behind the header: the first sequence with its complement, three starts not used, confirmed.
const FIRST_MARKS: [u32; 6] = [1, !1, u32::MAX, u32::MAX, u32::MAX, 0];

/// Writes the update file, `stm32f405.update`, and what a new board's flash holds, `stm32f405.flash`.
pub fn write() -> Outcome {
    write_beside("flash", &first_flash()?)?;
    let mut file = Vec::new();
    for (name, base) in SLOTS {
        let (header, bytes) = whole(&image(name), base)?;
        file.extend(header);
        file.extend(bytes);
    }
    write_beside("update", &file)
}

fn write_beside(ending: &str, bytes: &[u8]) -> Outcome {
    let path = image(RELEASE_BOARD).with_extension(ending);
    std::fs::write(&path, bytes).map_err(|e| format!("{}: {e}", path.display()))
}

/// The flash of a new board from its first address on: loader, the image of the lower slot, confirmed, and no header
/// in the upper slot.
pub fn first_flash() -> Outcome<Vec<u8>> {
    let loader = flat(&read(&image("loader"))?, FLASH)?;
    let (_, base) = SLOTS[0];
    let (header, bytes) = whole(&image(RELEASE_BOARD), base)?;
    let mut flash = vec![0xff; (base - FLASH + IMAGE_OFFSET) as usize];
    flash[..loader.len()].copy_from_slice(&loader);
    let marks = FIRST_MARKS.iter().flat_map(|word| word.to_le_bytes());
    let head: Vec<u8> = header.into_iter().chain(marks).collect();
    let at = (base - FLASH) as usize;
    flash[at..at + head.len()].copy_from_slice(&head);
    flash.extend(bytes);
    let (_, upper) = SLOTS[1];
    flash.resize((upper - FLASH) as usize, 0xff);
    flash.extend([0; 16]);
    Ok(flash)
}

/// As Intel HEX, blank lines of 16 bytes left out: a probe then leaves alone what lies there.
pub fn intel_hex(flash: &[u8]) -> String {
    let mut text = String::new();
    let mut record = |kind: u8, address: u16, data: &[u8]| {
        let [high, low] = address.to_be_bytes();
        let bytes: Vec<u8> = [&[data.len() as u8, high, low, kind][..], data].concat();
        let sum = bytes.iter().fold(0u8, |sum, byte| sum.wrapping_add(*byte)).wrapping_neg();
        text.push(':');
        bytes.iter().chain([&sum]).for_each(|byte| text.push_str(&format!("{byte:02X}")));
        text.push('\n');
    };
    for (n, part) in flash.chunks(0x1_0000).enumerate() {
        let upper = (FLASH >> 16) as u16 + n as u16;
        record(4, 0, &upper.to_be_bytes());
        for (line, data) in part.chunks(16).enumerate().filter(|(_, data)| data.iter().any(|byte| *byte != 0xff)) {
            record(0, (16 * line) as u16, data);
        }
    }
    record(1, 0, &[]);
    text
}

fn read(path: &Path) -> Outcome<Vec<u8>> {
    std::fs::read(path).map_err(|e| format!("{}: {e}", path.display()))
}

/// Header and bytes of a linked image.
fn whole(path: &Path, base: u32) -> Outcome<([u8; HEADER_BYTES], Vec<u8>)> {
    let refuse = || format!("{}: no image for the slot at {base:#010x}", path.display());
    let file = read(path)?;
    let mut bytes = flat(&file, base + IMAGE_OFFSET).map_err(|why| format!("{}: {why}", path.display()))?;
    bytes.resize(bytes.len().next_multiple_of(LENGTH_STEP), 0xff);
    let place =
        Image::parse(&file).and_then(|image| image.symbol("IMAGE_DESCRIPTION")?.checked_sub(base + IMAGE_OFFSET));
    let description =
        place.and_then(|at| bytes.get(at as usize..)?.first_chunk::<HEADER_BYTES>()).ok_or_else(refuse)?;
    let mut header = *description;
    header[8..12].copy_from_slice(&base.to_le_bytes());
    header[12..16].copy_from_slice(&(bytes.len() as u32).to_le_bytes());
    header[16..20].copy_from_slice(&checksum(&bytes).to_le_bytes());
    let own = checksum(&header[..60]);
    header[60..].copy_from_slice(&own.to_le_bytes());
    Ok((header, bytes))
}

/// What is programmed from `start` on, the gaps blank.
fn flat(file: &[u8], start: u32) -> Outcome<Vec<u8>> {
    let mut bytes = Vec::new();
    for (address, data) in elf::segments(file).ok_or("no ELF32 image")? {
        let at = address.checked_sub(start).ok_or_else(|| format!("a segment at {address:#010x}"))? as usize;
        bytes.resize(bytes.len().max(at + data.len()), 0xff);
        bytes[at..at + data.len()].copy_from_slice(data);
    }
    Ok(bytes)
}

/// CRC-32 (ISO-HDLC), bit by bit.
fn checksum(bytes: &[u8]) -> u32 {
    let step = |sum: u32, _| if sum & 1 != 0 { sum >> 1 ^ 0xedb8_8320 } else { sum >> 1 };
    !bytes.iter().fold(u32::MAX, |sum, &byte| (0..8).fold(sum ^ u32::from(byte), step))
}

#[cfg(test)]
mod tests {
    use super::{checksum, intel_hex};

    #[test]
    fn ref_checksum_of_the_catalogue() {
        // Check value of CRC-32/ISO-HDLC.
        assert_eq!(checksum(b"123456789"), 0xcbf4_3926);
    }

    #[test]
    fn ref_intel_hex_of_two_lines() {
        let mut flash = vec![0xff; 64];
        flash[..4].copy_from_slice(&[0, 1, 2, 3]);
        let lines: Vec<String> = intel_hex(&flash).lines().map(str::to_owned).collect();
        assert_eq!(lines, [":020000040800F2", ":1000000000010203FFFFFFFFFFFFFFFFFFFFFFFFF6", ":00000001FF"]);
    }
}
