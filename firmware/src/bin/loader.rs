//! The loader of an STM32F405: looks at the two slots of images, chooses, and jumps.
//!
//! It runs on the internal oscillator as a reset leaves it, uses no peripheral but the watchdog and the flash
//! controller, and knows no line: an image that arrives is the running node's business ([`meshband::update`]). What
//! it decides is one function that tests know ([`slots::choose`]); here are the reads, one word that it may write,
//! and the jump. The watchdog runs from here on, so that an image that hangs before its own start of it comes back
//! here as well.
#![no_std]
#![no_main]

use cortex_m_rt::entry;
use embedded_storage::nor_flash::NorFlash;
use meshband::update::checksum;
use meshband::update::header::{Header, IMAGE_OFFSET};
use meshband::update::receiver::Place;
use meshband::update::slots::{self, Choice, Standing, YES_WORD};
use meshband_node::crash::{self, Cause};
use meshband_node::stm32f405::sector_flash::{Parts, SectorFlash};
use meshband_node::stm32f405::start_watchdog;
use meshband_stm32::flash::Sectors;

meshband_node::restart_on_failure!();

#[entry]
fn main() -> ! {
    start_watchdog();
    let Some(Parts { slots, .. }) = Parts::take() else { crash::on_cause(Cause::Start) };
    let mut slots = slots.map(|flash| Place { base: flash.start(), flash });
    let mut standings = slots.each_mut().map(Place::standing);
    while let Some(Choice { slot, mark_at }) = slots::choose(&standings, |_, header| is_whole(header)) {
        let Some(place) = slots.get_mut(slot) else { break };
        if mark_at.is_none_or(|at| is_marked(place, at)) {
            let vectors = (place.base + IMAGE_OFFSET) as *const u32;
            // SAFETY: a whole image lies there, its vector table first; no interrupt is unmasked and nothing of the
            // loader is used again.
            unsafe { cortex_m::asm::bootload(vectors) }
        }
        // A start that cannot be counted could be repeated for ever.
        if let Some(standing) = standings.get_mut(slot) {
            *standing = standing.filter(|standing| standing.confirmed);
        }
    }
    // No image: wait for a probe; the watchdog looks again every few seconds.
    loop {
        cortex_m::asm::wfi();
    }
}

/// Whether the image is what its header says.
fn is_whole(header: &Header) -> bool {
    let start = (header.base + IMAGE_OFFSET) as *const u8;
    if header.length > Sectors::SLOT_A.bytes() - IMAGE_OFFSET {
        return false;
    }
    // SAFETY: a header is only taken of a slot that it is for, and both slots have this size; nothing writes there
    // meanwhile.
    let image = unsafe { core::slice::from_raw_parts(start, header.length as usize) };
    checksum::of_image(image) == header.checksum
}

/// Counts a start: programs the word and looks whether it is no longer blank.
fn is_marked(place: &mut Place<SectorFlash>, at: u32) -> bool {
    let before = place.standing().map(|Standing { trials, .. }| trials);
    let written = place.flash.write(at, &YES_WORD.to_le_bytes()).is_ok();
    written && place.standing().map(|Standing { trials, .. }| trials) > before
}
