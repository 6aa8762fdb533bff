//! Which blocks the node really got, for a replay on the host.
//!
//! A processor that is late takes up a wish for another rate one block later, or loses a block. What the node then says
//! depends on that, and on nothing else that the record does not hold: with this log the host computes the same bytes.

use heapless::Vec;
use meshband::pipeline::{BLOCK_SAMPLES, Filled};
use meshband::replay::START_TICK;
use semihosting::eprintln;

/// Runs kept: rate changes and losses of any sane record.
const RUNS: usize = 512;

/// Blocks that follow each other without gap or change.
#[derive(Clone, Copy, Debug)]
struct Run {
    sequence: u32,
    first_tick: u32,
    period: u32,
    overrun: bool,
    count: u32,
}

/// The log.
pub struct BlockLog {
    runs: Vec<Run, RUNS>,
    /// Runs that found no room: the log is then of no use.
    left_out: u32,
}

impl BlockLog {
    /// Of nothing yet.
    pub const fn new() -> Self {
        Self { runs: Vec::new(), left_out: 0 }
    }

    /// Appends a block.
    pub fn append(&mut self, block: &Filled) {
        if let Some(run) = self.runs.last_mut().filter(|_| self.left_out == 0)
            && run.continues(block)
        {
            run.count += 1;
            return;
        }
        let run = Run {
            sequence: block.sequence,
            first_tick: block.first_tick,
            period: block.period_ticks,
            overrun: block.overrun,
            count: 1,
        };
        if self.runs.push(run).is_err() {
            self.left_out += 1;
        }
    }

    /// Prints it: first sequence number, first sample's tick of the record, period, overrun flag of the first block,
    /// blocks.
    pub fn print(&self) {
        for run in &self.runs {
            let tick = run.first_tick.wrapping_sub(START_TICK);
            eprintln!("block: {} {tick} {} {} {}", run.sequence, run.period, u8::from(run.overrun), run.count);
        }
        eprintln!("node: runs_left_out={}", self.left_out);
    }
}

impl Run {
    /// Whether a block goes on where this run ends.
    fn continues(&self, block: &Filled) -> bool {
        let length = self.count.wrapping_mul(self.period).wrapping_mul(BLOCK_SAMPLES as u32);
        block.sequence == self.sequence.wrapping_add(self.count)
            && block.first_tick == self.first_tick.wrapping_add(length)
            && block.period_ticks == self.period
            && !block.overrun
    }
}

impl Default for BlockLog {
    fn default() -> Self {
        Self::new()
    }
}
