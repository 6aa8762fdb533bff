//! From interrupts to the main loop: which buffer, which period, in which order.
//!
//! Converters are triggered by a timer and written to memory by DMA, so while block `j` is handed over,
//! block `j + 1` is already running; its period was decided one border earlier, and the wish taken up now
//! governs block `j + 2`. Rates therefore change at block borders only, on every board after the same rule.
//!
//! A main loop that has fallen behind by all buffers gives up everything that waits, at once ([`Inbox::catch_up`]): a
//! gap restarts the node's records, and records that restart with a full queue behind them end in the next loss, for
//! ever. One long gap leaves all buffers free for what the restart costs.

pub use crate::config::BLOCK_SAMPLES;
use crate::config::Configuration;
use crate::node::Block;
use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use heapless::spsc::{Consumer, Producer, Queue};

/// Most block buffers of a board; each has as many as its memory and its longest main-loop turn ask for.
pub const MOST_BUFFERS: usize = 26;
/// Edges that may wait for the main loop.
pub const EDGE_QUEUE: usize = 256;

/// Codes of one block: of one channel, or one half of each of two.
pub type Codes = [u16; BLOCK_SAMPLES];

/// Channels that share a block.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Channels {
    /// The first alone.
    #[default]
    One,
    /// Both: the first one's samples, then the second one's of the same instants.
    Two,
}

impl Channels {
    /// What a configuration asks for.
    pub fn of(config: &Configuration) -> Self {
        if config.second.is_some() { Self::Two } else { Self::One }
    }

    /// Instants in a block.
    pub const fn instants(self) -> usize {
        match self {
            Self::One => BLOCK_SAMPLES,
            Self::Two => BLOCK_SAMPLES / 2,
        }
    }
}

/// A filled buffer on its way to the main loop; the main loop gives `codes` back through the free queue.
pub struct Filled {
    /// The samples.
    pub codes: &'static mut Codes,
    /// Whose they are.
    pub channels: Channels,
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
        let (codes, second) = self.codes.split_at(self.channels.instants());
        Block {
            codes,
            second,
            first_tick: self.first_tick,
            period_ticks: self.period_ticks,
            sequence: self.sequence,
            overrun: self.overrun,
        }
    }

    /// First instant behind the block's last sample.
    pub fn end_tick(&self) -> u32 {
        self.first_tick
            .wrapping_add(self.period_ticks.wrapping_mul(self.channels.instants() as u32 - 1))
            .wrapping_add(1)
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

/// Queues between interrupts and main loop; one set in a static.
pub struct Queues {
    // One place more than there are buffers: such a queue never fills.
    blocks: Queue<Filled, { MOST_BUFFERS + 1 }>,
    free: Queue<&'static mut Codes, { MOST_BUFFERS + 1 }>,
    edges: Queue<u32, EDGE_QUEUE>,
    starved: AtomicBool,
}

/// Where an interrupt finds its next empty buffer.
pub struct EmptyBuffers {
    queue: Consumer<'static, &'static mut Codes>,
    starved: &'static AtomicBool,
}

impl EmptyBuffers {
    /// The next one. Where there is none, a block will be lost, and the main loop learns of it before it gets there.
    pub fn take(&mut self) -> Option<&'static mut Codes> {
        let buffer = self.queue.dequeue();
        if buffer.is_none() {
            self.starved.store(true, Ordering::Release);
        }
        buffer
    }
}

/// The interrupts' ends of the queues.
pub struct Outlets {
    /// Filled blocks, in order.
    pub blocks: Producer<'static, Filled>,
    /// Empty buffers.
    pub free: EmptyBuffers,
    /// Edge instants, in order.
    pub edges: Producer<'static, u32>,
}

impl Queues {
    /// Empty ones.
    pub const fn new() -> Self {
        Self { blocks: Queue::new(), free: Queue::new(), edges: Queue::new(), starved: AtomicBool::new(false) }
    }

    /// Both ends, with all buffers empty; of more than [`MOST_BUFFERS`] the rest is not used.
    pub fn split(&'static mut self, buffers: &'static mut [Codes]) -> (Outlets, Inbox) {
        let (blocks_in, blocks) = self.blocks.split();
        let (mut free, free_out) = self.free.split();
        let (edges_in, edges) = self.edges.split();
        for buffer in buffers {
            let _ = free.enqueue(buffer);
        }
        let starved = &self.starved;
        let outlets = Outlets { blocks: blocks_in, free: EmptyBuffers { queue: free_out, starved }, edges: edges_in };
        (outlets, Inbox { blocks, free, edges, starved, most_waiting: 0 })
    }
}

impl Default for Queues {
    fn default() -> Self {
        Self::new()
    }
}

/// The main loop's ends of the queues.
pub struct Inbox {
    blocks: Consumer<'static, Filled>,
    free: Producer<'static, &'static mut Codes>,
    edges: Consumer<'static, u32>,
    starved: &'static AtomicBool,
    most_waiting: u32,
}

impl Inbox {
    /// Whether a block waits.
    pub fn has_block(&self) -> bool {
        self.blocks.ready()
    }

    /// Most blocks that ever waited when one was taken.
    pub fn most_waiting(&self) -> u32 {
        self.most_waiting
    }

    /// First instant behind the oldest block.
    pub fn pending_end(&self) -> Option<u32> {
        self.blocks.peek().map(Filled::end_tick)
    }

    /// Lends the oldest block and takes its buffer back as empty; false if there is none.
    pub fn with_block(&mut self, consume: impl FnOnce(&Filled)) -> bool {
        self.most_waiting = self.most_waiting.max(self.blocks.len() as u32);
        let Some(block) = self.blocks.dequeue() else { return false };
        consume(&block);
        // The queue of empty buffers has room for all of them.
        let _ = self.free.enqueue(block.codes);
        true
    }

    /// Gives up all blocks that wait if one was lost for want of an empty buffer; tells how many. The next block's
    /// sequence number shows the gap.
    pub fn catch_up(&mut self) -> u32 {
        if !self.starved.load(Ordering::Acquire) {
            return 0;
        }
        // Before the queue is emptied: a loss meanwhile asks for another round.
        self.starved.store(false, Ordering::Release);
        let mut given_up = 0;
        while self.with_block(|_| given_up += 1) {}
        given_up
    }

    /// The next edge that comes before `instant`.
    pub fn edge_before(&mut self, instant: u32) -> Option<u32> {
        // Wrapping order: differences below half the range.
        let edge = *self.edges.peek()?;
        if (edge.wrapping_sub(instant) as i32) < 0 { self.edges.dequeue() } else { None }
    }
}
