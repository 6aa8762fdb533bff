//! How deep the stack has ever been: start-up paints it, the paint that is left tells.

use core::ptr;

/// What cortex-m-rt's `paint-stack` writes.
const PAINT: u32 = 0xcccc_cccc;

unsafe extern "C" {
    static _stack_start: u32;
    static _stack_end: u32;
}

/// Deepest use and size of the stack since start-up, bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StackUse {
    /// Deepest use: an upper bound of what was needed, as a frame may leave paint inside.
    pub used: u32,
    /// Size of the region.
    pub size: u32,
}

/// Measures by looking for the first word without paint, from the end that is used last. Takes a few cycles per word
/// never used.
pub fn high_water() -> StackUse {
    let (end, start) = (&raw const _stack_end, &raw const _stack_start);
    let size = (start as u32).saturating_sub(end as u32);
    let mut word = end;
    // SAFETY: the linker's symbols bound the stack's region, which is readable and aligned; volatile, because the
    // program itself never writes there by these addresses.
    while word < start && unsafe { ptr::read_volatile(word) } == PAINT {
        word = word.wrapping_add(1);
    }
    StackUse { used: (start as u32).saturating_sub(word as u32), size }
}

/// Bytes below the stack pointer that [`repaint`] leaves alone.
const SPARED_BYTES: u32 = 256;

/// Paints anew what is free now, so that [`high_water`] shows the deepest use from here on.
#[inline(never)]
pub fn repaint() {
    let mut word = (&raw const _stack_end).cast_mut();
    // The compiler may push registers after the pointer was read: those few words are left alone.
    let here = cortex_m::register::msp::read().saturating_sub(SPARED_BYTES) as *mut u32;
    while word < here {
        // SAFETY: between the stack's end and this function's frame lies memory that nobody uses; an interrupt's frame
        // there has served by the time this goes on.
        unsafe { ptr::write_volatile(word, PAINT) };
        word = word.wrapping_add(1);
    }
}
