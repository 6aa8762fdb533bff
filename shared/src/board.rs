//! What a board must provide: five small traits at block level. A port implements these and touches nothing else.
//!
//! Board code moves data between these and [`crate::node::Node`]; it holds no signal logic. One time base serves sample
//! timer and tach capture, so that every block's first sample has a tick.

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
    /// Hands the next complete block to `consume`; false if there is none. The block is only valid inside the call.
    fn with_block(&mut self, consume: &mut dyn FnMut(Block<'_>)) -> bool;
}

/// Capture of tach edges.
pub trait TachCapture {
    /// Next captured edge, oldest first.
    fn next_edge(&mut self) -> Option<u32>;
    /// Edges lost to over-capture since start.
    fn lost_edges(&self) -> u32;
}

/// Byte link to the host.
pub trait Link {
    /// Queues a whole frame or nothing; false if there is no room.
    fn send(&mut self, frame: &[u8]) -> bool;
    /// Next received byte.
    fn receive(&mut self) -> Option<u8>;
}

/// Place that keeps one configuration through power cuts.
pub trait Storage {
    /// What went wrong.
    type Error;
    /// Reads the newest intact record into `buffer`; `None` if there is none.
    fn load<'a>(&mut self, buffer: &'a mut [u8]) -> Result<Option<&'a [u8]>, Self::Error>;
    /// Writes a record; the former one stays valid until the new one is complete.
    fn store(&mut self, record: &[u8]) -> Result<(), Self::Error>;
}
