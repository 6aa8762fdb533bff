//! Boot self-test on the live inputs: does the converter really run at the timer's rate, does it move, is there a tach.
//!
//! Converters that run freely instead of by trigger, or miss triggers, give plausible spectra at wrong frequencies; so
//! the first [`BLOCKS`] blocks are counted against a clock read independently at their arrival. Blocks that a busy processor
//! lost were sampled too; their sequence numbers say how many. The test runs beside the measurement and costs it nothing.

use crate::golden;
use crate::message::SelfTest;
use crate::node::Block;
use crate::units::TicksPerSecond;

/// Sample count against the timer.
pub const SAMPLE_COUNT: u8 = 1 << 0;
/// Codes at the converter's rails.
pub const RAILS: u8 = 1 << 1;
/// Codes that never move.
pub const NOISE: u8 = 1 << 2;
/// No tach edge in the first two seconds: a standing machine or a missing tach.
pub const TACH: u8 = 1 << 3;
/// Results of the signal chain differ from the recorded hashes.
pub const MATHEMATICS: u8 = 1 << 4;

/// Blocks counted.
pub const BLOCKS: u32 = 32;
/// Largest relative difference of the sample count from the timer's; covers the main loop's latency.
const TOLERANCE_PERCENT: u64 = 10;
/// Seconds granted to the first tach edge.
const TACH_PATIENCE_S: u64 = 2;

/// The test while it runs.
#[derive(Clone, Debug)]
pub struct BootTest {
    result: SelfTest,
    patience_ticks: u64,
    blocks: u32,
    /// Ticks that the samples after the first block stand for, and that passed by the clock.
    sampled: u64,
    passed: u64,
    latest: u32,
    sequence: u32,
    codes: u32,
    railed: u32,
    lowest: u16,
    highest: u16,
    edge: bool,
    done: bool,
}

impl BootTest {
    /// Checks the mathematics at once (40 ms at 168 MHz); the rest follows with the blocks.
    pub fn new(clock: TicksPerSecond) -> Self {
        let failed = if golden::self_test().is_ok() { 0 } else { MATHEMATICS };
        Self {
            result: SelfTest { run: MATHEMATICS, failed },
            patience_ticks: u64::from(clock.0) * TACH_PATIENCE_S,
            blocks: 0,
            sampled: 0,
            passed: 0,
            latest: 0,
            sequence: 0,
            codes: 0,
            railed: 0,
            lowest: u16::MAX,
            highest: 0,
            edge: false,
            done: false,
        }
    }

    /// What is known so far.
    pub fn result(&self) -> SelfTest {
        self.result
    }

    /// A tach edge came.
    pub fn on_edge(&mut self) {
        self.edge = true;
    }

    /// A block came at `now_tick`; gives the final result once.
    pub fn on_block(&mut self, block: &Block<'_>, now_tick: u32) -> Option<SelfTest> {
        if self.done {
            return None;
        }
        if self.blocks > 0 {
            let blocks = block.sequence.wrapping_sub(self.sequence);
            self.sampled += u64::from(block.period_ticks) * block.codes.len() as u64 * u64::from(blocks);
            self.passed += u64::from(now_tick.wrapping_sub(self.latest));
        }
        self.latest = now_tick;
        self.sequence = block.sequence;
        self.blocks = self.blocks.saturating_add(1);
        if self.blocks <= BLOCKS {
            for &code in block.codes {
                self.railed += u32::from(code == 0 || code >= 0xfff0);
                self.lowest = self.lowest.min(code);
                self.highest = self.highest.max(code);
            }
            self.codes = self.codes.saturating_add(block.codes.len() as u32);
        }
        if self.blocks < BLOCKS || !(self.edge || self.passed >= self.patience_ticks) {
            return None;
        }
        self.done = true;
        let late = self.sampled.abs_diff(self.passed) * 100 > self.passed * TOLERANCE_PERCENT;
        for (item, failed) in [
            (SAMPLE_COUNT, late),
            (RAILS, self.railed > self.codes / 100),
            (NOISE, self.lowest >= self.highest),
            (TACH, !self.edge),
        ] {
            self.result.run |= item;
            self.result.failed |= if failed { item } else { 0 };
        }
        Some(self.result)
    }
}
