//! Frames on their way out: a ring that takes whole frames and gives them up by runs, for DMA, or byte by byte.
//!
//! A host that does not read must not stop the measurement: a frame without room is dropped and counted. The sender
//! keeps counting sequence numbers over dropped frames, so the host sees how many are missing; the node reports them
//! as one event when there is room again.

/// Ring of `N` bytes. A board empties it in one of the two ways.
#[derive(Clone, Debug)]
pub struct SendRing<const N: usize> {
    bytes: [u8; N],
    /// Position of the first byte not yet sent.
    tail: usize,
    /// Bytes waiting, those in flight included.
    waiting: usize,
    /// Bytes of the run that is being sent.
    in_flight: usize,
    dropped: u32,
    unreported: u32,
}

impl<const N: usize> Default for SendRing<N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const N: usize> SendRing<N> {
    /// An empty ring.
    pub const fn new() -> Self {
        Self { bytes: [0; N], tail: 0, waiting: 0, in_flight: 0, dropped: 0, unreported: 0 }
    }

    /// Queues a whole frame; false, and nothing queued, if there is no room.
    pub fn push(&mut self, frame: &[u8]) -> bool {
        if frame.len() > N - self.waiting.min(N) {
            self.dropped = self.dropped.saturating_add(1);
            self.unreported = self.unreported.saturating_add(1);
            return false;
        }
        let mut at = self.tail + self.waiting;
        for &byte in frame {
            at = if at >= N { at - N } else { at };
            if let Some(place) = self.bytes.get_mut(at) {
                *place = byte;
            }
            at += 1;
        }
        self.waiting += frame.len();
        true
    }

    /// The run lent before has been sent; lends the next one, if any. It stays as it is until this is called again.
    pub fn next_run(&mut self) -> Option<&[u8]> {
        self.release(self.in_flight);
        self.in_flight = self.waiting.min(N - self.tail.min(N)).min(usize::from(u16::MAX));
        self.bytes.get(self.tail..self.tail + self.in_flight).filter(|run| !run.is_empty())
    }

    /// Hands bytes to `accept` until it refuses one or none are left; gives how many were taken.
    pub fn drain(&mut self, mut accept: impl FnMut(u8) -> bool) -> usize {
        let mut taken = 0;
        while let Some(&byte) = self.bytes.get(self.tail).filter(|_| self.waiting > 0) {
            if !accept(byte) {
                break;
            }
            self.release(1);
            taken += 1;
        }
        taken
    }

    fn release(&mut self, sent: usize) {
        self.waiting -= sent.min(self.waiting);
        self.tail += sent;
        if self.tail >= N {
            self.tail -= N;
        }
        // Nothing waits: the next frame need not be cut in two at the end, which on a line with silences would be two
        // frames.
        if self.waiting == 0 {
            self.tail = 0;
        }
    }

    /// Bytes waiting, those in flight included.
    pub const fn len(&self) -> usize {
        self.waiting
    }

    /// Whether nothing waits.
    pub const fn is_empty(&self) -> bool {
        self.waiting == 0
    }

    /// Frames dropped since start.
    pub const fn dropped(&self) -> u32 {
        self.dropped
    }

    /// Frames dropped and not yet reported, once half the room is free again: the detail of an event.
    pub fn take_unreported(&mut self) -> Option<u32> {
        let due = self.unreported != 0 && self.waiting <= N / 2;
        due.then(|| core::mem::take(&mut self.unreported))
    }
}
