//! The released image with its loader, as a board comes out of `cargo xtask flash`; where it and Unicorn are there.
#![allow(dead_code, reason = "every test program uses some of it")]

use meshband::update::header::{HEADER_BYTES, IMAGE_OFFSET, LENGTH_STEP, seal};
use meshband::update::slots::first_marks;
use meshband_emulator::elf::{Image, Segment};
use meshband_emulator::error::{Error, Result};
use meshband_emulator::unicorn;
use std::path::{Path, PathBuf};

/// First addresses of the slots.
pub const SLOTS: [u32; 2] = [0x0802_0000, 0x0806_0000];
/// Bytes of a slot.
pub const SLOT_BYTES: u32 = 0x4_0000;

/// Path of a built image.
fn built(name: &str) -> PathBuf {
    let workspace = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let target =
        std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| workspace.join("target"), |folder| workspace.join(folder));
    target.join("thumbv7em-none-eabihf/firmware").join(name)
}

/// Path of the released image for the lower slot.
pub fn path() -> PathBuf {
    built("stm32f405")
}

/// The image, or `None` after saying why the test is skipped.
pub fn image(test: &str) -> Option<Image> {
    if !unicorn::is_installed() || !path().is_file() {
        println!("skipped {test}: Unicorn or the firmware image is absent (cargo xtask setup, cargo xtask node-build)");
        return None;
    }
    Some(with_loader(&path()).expect("an image and its loader"))
}

/// What `cargo xtask flash` writes, from the first address of flash on.
pub fn flashed() -> Vec<u8> {
    std::fs::read(path().with_extension("flash")).expect("made by `cargo xtask node-build`")
}

/// What is built for the lower slot (0) or the upper one: header and bytes, as an update has them.
pub fn for_slot(slot: usize) -> ([u8; HEADER_BYTES], Vec<u8>) {
    let image = Image::read(&built(["stm32f405", "stm32f405_b"][slot])).expect("an image");
    let bytes = flat(&image, SLOTS[slot]).expect("of this slot");
    (sealed(&image, SLOTS[slot], &bytes).expect("describes itself"), bytes)
}

/// An image of the lower slot behind its header, confirmed, with the loader that was built beside it.
///
/// # Errors
/// [`Error::Image`] for a file that is none of ours.
pub fn with_loader(path: &Path) -> Result<Image> {
    let mut image = Image::read(path)?;
    let bytes = flat(&image, SLOTS[0])?;
    let mut head = sealed(&image, SLOTS[0], &bytes)?.to_vec();
    head.extend(first_marks());
    image.segments = Image::read(&path.with_file_name("loader"))?.segments;
    image.segments.push(Segment { address: SLOTS[0], bytes: head });
    image.segments.push(Segment { address: SLOTS[0] + IMAGE_OFFSET, bytes });
    Ok(image)
}

/// The bytes of an image behind its header; what lies between segments is blank.
fn flat(image: &Image, base: u32) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    for segment in &image.segments {
        let place = segment.address.checked_sub(base + IMAGE_OFFSET).filter(|at| *at < SLOT_BYTES);
        let at = place.ok_or_else(|| Error::Image(format!("a segment at {:#010x}", segment.address)))? as usize;
        bytes.resize(bytes.len().max(at + segment.bytes.len()), 0xff);
        bytes[at..at + segment.bytes.len()].copy_from_slice(&segment.bytes);
    }
    bytes.resize(bytes.len().next_multiple_of(LENGTH_STEP as usize), 0xff);
    Ok(bytes)
}

fn sealed(image: &Image, base: u32, bytes: &[u8]) -> Result<[u8; HEADER_BYTES]> {
    let at = image.symbols.get("IMAGE_DESCRIPTION").and_then(|at| at.checked_sub(base + IMAGE_OFFSET));
    let description = at.and_then(|at| bytes.get(at as usize..)?.first_chunk());
    description.map(|description| seal(description, base, bytes)).ok_or_else(|| Error::Image("no description".into()))
}
