//! Received bytes: a circle of memory that DMA fills for ever, read behind its position. No interrupt per byte.
//!
//! Here is where to read next; the memory itself, which changes behind the compiler's back, is the board's.

/// Reader's place in a circle of `N` bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ReceiveCircle<const N: usize> {
    read: usize,
}

impl<const N: usize> ReceiveCircle<N> {
    /// A circle whose first byte DMA will write next.
    pub const fn new() -> Self {
        Self { read: 0 }
    }

    /// Place of the next byte to read, where DMA will write at `write` next; `None` when all were read. A host that
    /// outruns the main loop by a whole circle garbles what it sent; its frames' checksums show that.
    pub fn next(&mut self, write: usize) -> Option<usize> {
        // A controller that has just wrapped may still show the end.
        if self.read == write % N {
            return None;
        }
        let place = self.read;
        self.read = (place + 1) % N;
        Some(place)
    }
}
