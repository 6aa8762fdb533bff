//! What a board must provide: a few small traits at block level. A port implements these and touches nothing else.
//!
//! Board code moves data between these and [`crate::node::Node`]; it holds no signal logic. One time base serves sample
//! timer and tach capture, so that every block's first sample has a tick. The configuration's place is any
//! `embedded_storage::nor_flash::NorFlash` of two sectors.

use crate::config::LineFormat;
use crate::node::Block;
use crate::node::health::BoardHealth;
use crate::units::{Hertz, TicksPerSecond};

/// What a board's sample timer and converter can do: figures of the design that plan and configuration need, on the
/// board and on a host that computes the same.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Timing {
    /// Time base of sample periods and tach edges.
    pub clock: TicksPerSecond,
    /// Sample periods are multiples of this many ticks. A converter on a slower clock than the timer's takes a
    /// trigger at the next edge of its own: any other period makes its instants wander by up to that clock's period.
    pub period_step: u32,
    /// Highest ADC rate that a configuration may ask for: converter and processor keep up with margin.
    pub highest_adc: Hertz,
    /// The same with a second sensor, each converter; `None` where there is one converter.
    pub highest_of_two: Option<Hertz>,
    /// Most tach pulses per second: between two looks at the queue of edges the main loop's longest turn passes.
    pub highest_pulses: Hertz,
}

impl Timing {
    /// QEMU's `mps2-an386`: no converter that could be too slow, and no second one.
    pub const AN386: Self = Self {
        clock: TicksPerSecond(25_000_000),
        period_step: 1,
        highest_adc: Hertz(1.0e7),
        highest_of_two: None,
        highest_pulses: Hertz(1.0e6),
    };
    /// STM32F405: the converter runs on a quarter of the timer's clock and could follow 750 kHz; the highest rate is
    /// what the main loop keeps up with at two cycles per instruction, with margin (`cargo xtask pace`).
    pub const STM32F405: Self = Self {
        clock: TicksPerSecond(84_000_000),
        period_step: 4,
        highest_adc: Hertz(420_000.0),
        highest_of_two: Some(Hertz(210_000.0)),
        // 256 edges wait at most, the longest turn of the main loop is 16 ms.
        highest_pulses: Hertz(15_000.0),
    };

    /// Of a node that says which board it is and what its clock is; a board not known here is bound by its clock alone.
    pub fn of(board: &str, clock: TicksPerSecond) -> Self {
        let known = match board {
            "an386" => Self::AN386,
            "stm32f405" => Self::STM32F405,
            _ => clock.into(),
        };
        Self { clock, ..known }
    }
}

/// A timer without a converter behind it that limits anything: tests and hosts that know no more of a node than its
/// clock.
impl From<TicksPerSecond> for Timing {
    fn from(clock: TicksPerSecond) -> Self {
        Self {
            clock,
            period_step: 1,
            highest_adc: Hertz(1.0e7),
            highest_of_two: Some(Hertz(1.0e7)),
            highest_pulses: Hertz(1.0e7),
        }
    }
}

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
    /// Tick up to which nothing can still come: every block that ends at or before it is complete, and of every such
    /// block all edges that belong before its end have been captured, however long a filter held them back. To be
    /// read before
    /// [`Self::pending_end`].
    fn horizon(&self) -> u32;
    /// Gives up all waiting blocks after one was lost because none was taken for too long; the node sees one gap.
    fn catch_up(&mut self);
    /// Most complete blocks that ever waited for the main loop.
    fn most_waiting(&self) -> u32;
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
    /// Sets rate and character of the line; where there is no wire to set, nothing.
    fn set_format(&mut self, format: LineFormat) {
        let _ = format;
    }
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

/// What a board knows of itself as a device; a board without such means leaves it as it is.
pub trait Housekeeping {
    /// Newest measurement; called once a second.
    fn health(&mut self) -> BoardHealth {
        BoardHealth::default()
    }
    /// Moves a measurement under way on, and gives the tick of a pulse per second not yet taken; called once per turn
    /// of the main loop.
    fn next_second_pulse(&mut self) -> Option<u32> {
        None
    }
}

/// A whole board.
pub trait Board: SampleClock + BlockSource + TachCapture + Link + Supervision + Housekeeping {}

impl<T: SampleClock + BlockSource + TachCapture + Link + Supervision + Housekeeping> Board for T {}

/// What one turn of the main loop may hand to the node, so that edges and blocks come in the order of time.
///
/// An edge is known later than it happened: the input's filter waits until the level has lasted, while a block is
/// complete one conversion after its last sample. So a complete block stays where it is until the horizon has passed
/// its end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Due {
    /// Edges before this tick.
    pub edges_before: u32,
    /// Then the oldest complete block.
    pub block: bool,
}

impl Due {
    /// From a horizon and the end of the oldest complete block, read in this order; ticks in wrapping order.
    pub fn of(horizon: u32, pending_end: Option<u32>) -> Self {
        match pending_end {
            Some(end) if horizon.wrapping_sub(end) as i32 >= 0 => Self { edges_before: end, block: true },
            _ => Self { edges_before: horizon, block: false },
        }
    }
}
