//! From interrupts to the main loop: which buffer, which period, in which order.
//!
//! Converters are triggered by a timer and written to memory by DMA, so while block `j` is handed over,
//! block `j + 1` is already running; its period was decided one border earlier, and the wish taken up now
//! governs block `j + 2`. Rates therefore change at block borders only, on every board after the same rule.

use core::sync::atomic::{AtomicU32, Ordering};
use heapless::spsc::{Consumer, Producer};
use meshband::node::Block;
pub use meshband::replay::BLOCK_SAMPLES;

/// Block buffers: at 400 kHz they hold 20 ms, longer than the longest transform and its search take.
pub const BUFFERS: usize = 16;
/// Edges that may wait for the main loop.
pub const EDGE_QUEUE: usize = 256;

/// Codes of one block.
pub type Codes = [u16; BLOCK_SAMPLES];

/// A filled buffer on its way to the main loop; the main loop gives `codes` back through the free queue.
pub struct Filled {
    /// The samples.
    pub codes: &'static mut Codes,
    /// Instant of the first sample, time base of the tachometer.
    pub first_tick: u32,
    /// Sample period, ticks.
    pub period_ticks: u32,
    /// Counts blocks; a lost block leaves a gap.
    pub sequence: u32,
    /// At least one block before this one was lost.
    pub overrun: bool,
}

impl Filled {
    /// The block as the node takes it.
    pub fn as_block(&self) -> Block<'_> {
        Block {
            codes: &self.codes[..],
            first_tick: self.first_tick,
            period_ticks: self.period_ticks,
            sequence: self.sequence,
            overrun: self.overrun,
        }
    }

    /// First instant behind the block's last sample.
    pub fn end_tick(&self) -> u32 {
        self.first_tick.wrapping_add(self.period_ticks.wrapping_mul(BLOCK_SAMPLES as u32 - 1)).wrapping_add(1)
    }
}

/// The sample periods of the blocks that are running or decided.
#[derive(Debug, Clone, Copy)]
pub struct Periods {
    /// Of the block that runs.
    pub running: u32,
    /// Of the block behind it.
    pub next: u32,
}

impl Periods {
    /// The first two blocks share a period.
    pub fn starting(period: u32) -> Self {
        Self { running: period, next: period }
    }

    /// A block has ended: moves on by one and takes the newest request for the block after the next.
    pub fn advance(&mut self, request: u32) {
        self.running = self.next;
        self.next = request;
    }
}

/// The node's wish, published by the main loop after each block and taken up at the next block border.
pub struct Request(AtomicU32);

impl Request {
    /// Not set yet.
    pub const fn new() -> Self {
        Self(AtomicU32::new(0))
    }

    /// Publishes the wanted sample period, ticks.
    pub fn publish(&self, period_ticks: u32) {
        self.0.store(period_ticks, Ordering::Relaxed);
    }

    /// The newest wish.
    pub fn latest(&self) -> u32 {
        self.0.load(Ordering::Relaxed)
    }
}

impl Default for Request {
    fn default() -> Self {
        Self::new()
    }
}

/// The main loop's ends of the queues.
pub struct Inbox {
    /// Filled blocks, in order.
    pub blocks: Consumer<'static, Filled>,
    /// Emptied buffers.
    pub free: Producer<'static, &'static mut Codes>,
    /// Edge instants, in order.
    pub edges: Consumer<'static, u32>,
}

impl Inbox {
    /// The next edge that comes before `instant`.
    pub fn edge_before(&mut self, instant: u32) -> Option<u32> {
        // Wrapping order: differences below half the range.
        let edge = *self.edges.peek()?;
        if (edge.wrapping_sub(instant) as i32) < 0 { self.edges.dequeue() } else { None }
    }
}
