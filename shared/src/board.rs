//! What a board must provide: a few small traits at block level. A port implements these and touches nothing else.
//!
//! Board code moves data between these and [`crate::node::Node`]; it holds no signal logic. One time base serves sample
//! timer and tach capture, so that every block's first sample has a tick. The configuration's place is any
//! `embedded_storage::nor_flash::NorFlash` of two sectors.

use crate::node::Block;
use crate::units::TicksPerSecond;

/// Timer that triggers the ADC.
pub trait SampleClock {
    /// Rate of the time base that periods and ticks count in.
    fn time_base(&self) -> TicksPerSecond;
    /// Present tick.
    fn now(&self) -> u32;
    /// Sample period for the next block; takes effect at a block border, without a glitch.
    fn set_period_ticks(&mut self, period: u32);
}

/// Source of sample blocks.
pub trait BlockSource {
    /// Tick up to which edges may be handed over while no block is complete; to be read before [`Self::pending_end`].
    fn horizon(&self) -> u32;
    /// First tick behind the oldest complete block; `None` if there is no complete block.
    fn pending_end(&self) -> Option<u32>;
    /// Hands the oldest complete block to `consume`; false if there is none. The block is only valid inside the call.
    fn with_block(&mut self, consume: &mut dyn FnMut(Block<'_>)) -> bool;
}

/// Capture of tach edges.
pub trait TachCapture {
    /// Next captured edge before a tick, oldest first.
    fn next_edge_before(&mut self, tick: u32) -> Option<u32>;
    /// Edges lost to over-capture since start.
    fn lost_edges(&self) -> u32;
}

/// Byte link to the host.
pub trait Link {
    /// Queues a whole frame or nothing; false if there is no room.
    fn send(&mut self, frame: &[u8]) -> bool;
    /// Next received byte.
    fn receive(&mut self) -> Option<u8>;
    /// Moves queued bytes on; called once per turn of the main loop.
    fn pump(&mut self);
    /// Frames refused and not yet reported, once there is room again.
    fn take_dropped(&mut self) -> Option<u32>;
}

/// Life of the main loop.
pub trait Supervision {
    /// Tells the watchdog that the main loop lives.
    fn feed_watchdog(&mut self);
    /// Switches the light.
    fn set_light(&mut self, lit: bool);
    /// Sleeps until something may have happened; at most some milliseconds while bytes wait or a light blinks.
    fn wait(&mut self);
}

/// A whole board.
pub trait Board: SampleClock + BlockSource + TachCapture + Link + Supervision {}

impl<T: SampleClock + BlockSource + TachCapture + Link + Supervision> Board for T {}
