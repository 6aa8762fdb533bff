//! Received bytes: a circle of memory that DMA fills for ever, read behind its position. No interrupt per byte.

use core::ptr;

/// Reader of a circle of `N` bytes.
pub struct ReceiveCircle<const N: usize> {
    bytes: &'static [u8; N],
    read: usize,
}

impl<const N: usize> ReceiveCircle<N> {
    /// A circle whose first byte DMA will write next.
    pub const fn new(bytes: &'static [u8; N]) -> Self {
        Self { bytes, read: 0 }
    }

    /// The next byte, where DMA will write at `write` next. A host that outruns the main loop by a whole circle garbles what
    /// it sent; its frames' checksums show that.
    pub fn next(&mut self, write: usize) -> Option<u8> {
        if self.read == write {
            return None;
        }
        let place = self.bytes.get(self.read)?;
        self.read = (self.read + 1) % N;
        // SAFETY: a valid place; volatile, because DMA writes there behind the compiler's back.
        Some(unsafe { ptr::read_volatile(place) })
    }
}
