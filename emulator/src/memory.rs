//! Memory that the processor's engine works on directly: whole pages at fixed addresses of the host.

use std::alloc::{Layout, alloc_zeroed, dealloc, handle_alloc_error};
use std::ops::{Deref, DerefMut};

/// What the engine maps in units of.
const PAGE: usize = 4096;

/// Bytes whose address never changes.
pub struct Pages {
    bytes: *mut u8,
    layout: Layout,
}

// SAFETY: it owns its bytes as a box does.
unsafe impl Send for Pages {}
// SAFETY: as above.
unsafe impl Sync for Pages {}

impl Pages {
    /// `size` bytes of zero, a multiple of the page.
    pub fn new(size: usize) -> Self {
        let layout =
            Layout::from_size_align(size.next_multiple_of(PAGE), PAGE).expect("a size below the address space");
        // SAFETY: the layout is not empty.
        let bytes = unsafe { alloc_zeroed(layout) };
        if bytes.is_null() {
            handle_alloc_error(layout);
        }
        Self { bytes, layout }
    }

    /// For the engine.
    pub fn address(&mut self) -> *mut u8 {
        self.bytes
    }
}

impl Deref for Pages {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        // SAFETY: allocated and initialised with this size.
        unsafe { std::slice::from_raw_parts(self.bytes, self.layout.size()) }
    }
}

impl DerefMut for Pages {
    fn deref_mut(&mut self) -> &mut [u8] {
        // SAFETY: as above, and this is the only user: the engine runs only while nobody else holds the chip.
        unsafe { std::slice::from_raw_parts_mut(self.bytes, self.layout.size()) }
    }
}

impl Clone for Pages {
    fn clone(&self) -> Self {
        let mut copy = Self::new(self.layout.size());
        copy.copy_from_slice(self);
        copy
    }
}

impl Drop for Pages {
    fn drop(&mut self) {
        // SAFETY: allocated with this layout.
        unsafe { dealloc(self.bytes, self.layout) };
    }
}
