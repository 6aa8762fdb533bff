//! Frames on their way out through DMA: a ring that takes whole frames and lends contiguous runs.
//!
//! A link that is slower than the node must not stop the measurement: a frame without room is dropped and counted.

/// Ring over memory of fixed size.
pub struct SendRing {
    bytes: &'static mut [u8],
    /// Position of the first byte not yet sent.
    tail: usize,
    /// Bytes waiting, those in flight included.
    waiting: usize,
    /// Bytes of the run that is being sent.
    in_flight: usize,
    dropped: u32,
}

impl SendRing {
    /// An empty ring.
    pub const fn new(bytes: &'static mut [u8]) -> Self {
        Self { bytes, tail: 0, waiting: 0, in_flight: 0, dropped: 0 }
    }

    /// Queues a whole frame; false, and nothing queued, if there is no room.
    pub fn push(&mut self, frame: &[u8]) -> bool {
        let size = self.bytes.len();
        if frame.len() > size - self.waiting.min(size) {
            self.dropped = self.dropped.saturating_add(1);
            return false;
        }
        let mut at = self.tail + self.waiting;
        for &byte in frame {
            at = if at >= size { at - size } else { at };
            if let Some(place) = self.bytes.get_mut(at) {
                *place = byte;
            }
            at += 1;
        }
        self.waiting += frame.len();
        true
    }

    /// The run lent before has been sent; lends the next one, if any.
    pub fn next_run(&mut self) -> Option<&[u8]> {
        let size = self.bytes.len();
        self.waiting -= self.in_flight.min(self.waiting);
        self.tail += self.in_flight;
        if self.tail >= size {
            self.tail -= size;
        }
        self.in_flight = self.waiting.min(size - self.tail.min(size)).min(usize::from(u16::MAX));
        self.bytes.get(self.tail..self.tail + self.in_flight).filter(|run| !run.is_empty())
    }

    /// Whether nothing waits.
    pub const fn is_empty(&self) -> bool {
        self.waiting == 0
    }

    /// Frames dropped and not yet reported, once half the room is free again: the detail of an event.
    pub fn take_dropped(&mut self) -> Option<u32> {
        let due = self.dropped != 0 && self.waiting <= self.bytes.len() / 2;
        due.then(|| core::mem::take(&mut self.dropped))
    }
}
