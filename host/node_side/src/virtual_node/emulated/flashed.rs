//! What `cargo xtask flash` writes to a board: the loader, and an image behind its header, confirmed.

use crate::{Error, Result};
use meshband::update::header::{HEADER_BYTES, IMAGE_OFFSET, LENGTH_STEP, seal};
use meshband::update::slots::first_marks;
use meshband_emulator::elf::{Image, Segment};
use std::path::Path;

/// First address of the lower slot, and its bytes (`memory.x`).
const SLOT: (u32, u32) = (0x0802_0000, 0x4_0000);

/// Reads an image that is linked for the lower slot, and the loader that was built beside it.
///
/// # Errors
/// [`Error::Tool`] naming the file that is absent or none of ours.
pub fn read(firmware: &Path) -> Result<Image> {
    let refuse = |what: &str| Error::tool("firmware", format!("{}: {what}", firmware.display()));
    let mut image = Image::read(firmware).map_err(|e| Error::tool("firmware", e))?;
    let loader = Image::read(&firmware.with_file_name("loader")).map_err(|e| Error::tool("firmware", e))?;
    let bytes = flat(&image).ok_or_else(|| refuse("is not linked for the lower slot"))?;
    let place = image.symbols.get("IMAGE_DESCRIPTION").and_then(|at| at.checked_sub(SLOT.0 + IMAGE_OFFSET));
    let description = place.and_then(|at| bytes.get(at as usize..)?.first_chunk::<HEADER_BYTES>());
    let description = description.ok_or_else(|| refuse("does not say what it is"))?;
    let mut head = seal(description, SLOT.0, &bytes).to_vec();
    head.extend(first_marks());
    image.segments = loader.segments;
    image.segments.push(Segment { address: SLOT.0, bytes: head });
    image.segments.push(Segment { address: SLOT.0 + IMAGE_OFFSET, bytes });
    Ok(image)
}

/// The bytes behind the header; what lies between segments is blank.
fn flat(image: &Image) -> Option<Vec<u8>> {
    let mut bytes = Vec::new();
    for segment in &image.segments {
        let at = segment.address.checked_sub(SLOT.0 + IMAGE_OFFSET).filter(|at| *at < SLOT.1)? as usize;
        bytes.resize(bytes.len().max(at + segment.bytes.len()), 0xff);
        bytes[at..at + segment.bytes.len()].copy_from_slice(&segment.bytes);
    }
    bytes.resize(bytes.len().next_multiple_of(LENGTH_STEP as usize), 0xff);
    Some(bytes)
}
