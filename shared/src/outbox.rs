//! Frames that wait for the link: whole frames or nothing, and a count of those that found no room.
//!
//! A host that does not read must not stop the measurement. The sender keeps counting sequence numbers over dropped
//! frames, so the host sees how many are missing; the node reports them as one event when there is room again.

use heapless::Deque;

/// Queue of `N` bytes between the node and the byte-wise link.
#[derive(Clone, Debug, Default)]
pub struct Outbox<const N: usize> {
    bytes: Deque<u8, N>,
    dropped: u32,
    unreported: u32,
}

impl<const N: usize> Outbox<N> {
    /// An empty queue.
    pub const fn new() -> Self {
        Self { bytes: Deque::new(), dropped: 0, unreported: 0 }
    }

    /// Queues a whole frame; false if it had to be dropped.
    pub fn push(&mut self, frame: &[u8]) -> bool {
        if N - self.bytes.len() < frame.len() {
            self.dropped = self.dropped.saturating_add(1);
            self.unreported = self.unreported.saturating_add(1);
            return false;
        }
        for &byte in frame {
            // There is room, as just checked.
            let _ = self.bytes.push_back(byte);
        }
        true
    }

    /// Hands bytes to `accept` until it refuses one or none are left; gives how many were taken.
    pub fn drain(&mut self, mut accept: impl FnMut(u8) -> bool) -> usize {
        let mut taken = 0;
        while let Some(&byte) = self.bytes.front() {
            if !accept(byte) {
                break;
            }
            self.bytes.pop_front();
            taken += 1;
        }
        taken
    }

    /// Bytes waiting.
    pub fn len(&self) -> usize {
        self.bytes.len()
    }

    /// Whether nothing waits.
    pub fn is_empty(&self) -> bool {
        self.bytes.is_empty()
    }

    /// Frames dropped since start.
    pub fn dropped(&self) -> u32 {
        self.dropped
    }

    /// Frames dropped and not yet reported, once half the room is free again: the detail of an event.
    pub fn take_unreported(&mut self) -> Option<u32> {
        let due = self.unreported != 0 && self.bytes.len() <= N / 2;
        due.then(|| core::mem::take(&mut self.unreported))
    }
}
