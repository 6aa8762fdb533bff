//! The board's time base: a free-running 32-bit counter at the timers' clock.

use super::registers::{Device, DualTimerBlock, dual_timer};
use meshband::replay::START_TICK;

const RUN: u32 = 1 << 7;
const WIDE_COUNTER: u32 = 1 << 1;

/// Ticks since the record's start.
#[derive(Clone, Copy)]
pub struct TimeBase {
    counter: Device<DualTimerBlock>,
    start: u32,
}

impl TimeBase {
    /// Starts the counter; the record starts now.
    pub fn start() -> Self {
        let counter = dual_timer();
        counter.load.write(u32::MAX);
        counter.control.write(RUN | WIDE_COUNTER);
        let mut base = Self { counter, start: 0 };
        base.start = base.now();
        base
    }

    /// Ticks since the record's start.
    pub fn now(&self) -> u32 {
        // It counts down.
        (!self.counter.value.read()).wrapping_sub(self.start)
    }

    /// The node's time stamp of an instant of the record.
    pub fn stamp(record_tick: u32) -> u32 {
        START_TICK.wrapping_add(record_tick)
    }
}
