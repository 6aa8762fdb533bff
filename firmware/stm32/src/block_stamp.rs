//! From captured borders to stamped blocks: no register, only the order of things.
//!
//! The period word that DMA copies at a border governs the block behind that border. So when a block is handed over,
//! its successor is already running with the word last published, and the word published now governs the one after.

use crate::BLOCK_SAMPLES;
use crate::period::served;

/// What a block carries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stamp {
    /// Instant of the first sample.
    pub first_tick: u32,
    /// Sample period, ticks.
    pub period_ticks: u32,
    /// Counts blocks; a lost one leaves a gap.
    pub sequence: u32,
    /// Samples before or in this block were lost.
    pub overrun: bool,
}

/// Book of periods and sequence.
#[derive(Clone, Copy, Debug)]
pub struct Borders {
    running: u32,
    published: u32,
    sequence: u32,
    overrun: bool,
    /// Last sample's instant and period of the block stamped before.
    before: Option<(u32, u32)>,
}

impl Borders {
    /// The first two blocks share a period.
    pub const fn starting(period_ticks: u32) -> Self {
        let period = served(period_ticks);
        Self { running: period, published: period, sequence: 0, overrun: false, before: None }
    }

    /// A block has ended: `last_tick` is its last sample's instant, `missed` tells that other borders passed
    /// unnoticed before it; how many, the time since the last one noticed tells (a flash erasure takes seconds). `wanted` is the period to publish now, as far as the converter can follow: a block is stamped with
    /// the period it has. Gives the block's stamp.
    pub fn on_border(&mut self, last_tick: u32, missed: bool, wanted: u32) -> Stamp {
        if missed {
            // The first unnoticed block ended with the published period taken up; all later ones have it, this one too.
            self.sequence = self.sequence.wrapping_add(self.unnoticed(last_tick));
            self.running = self.published;
            self.overrun = true;
        }
        let period_ticks = self.running;
        let first_tick = last_tick.wrapping_sub(period_ticks.wrapping_mul(u32::from(BLOCK_SAMPLES) - 1));
        let stamp = Stamp { first_tick, period_ticks, sequence: self.sequence, overrun: self.overrun };
        self.before = Some((last_tick, period_ticks));
        self.overrun = false;
        self.running = self.published;
        self.published = served(wanted);
        self.sequence = self.sequence.wrapping_add(1);
        stamp
    }

    /// Blocks between the one stamped before and the one that ends now.
    fn unnoticed(&self, last_tick: u32) -> u32 {
        let Some((before, period)) = self.before else { return 1 };
        let samples = u32::from(BLOCK_SAMPLES);
        // A block's first sample follows its predecessor's last at the predecessor's period.
        let with_one = period + self.running * samples + self.published * (samples - 1);
        let more = last_tick.wrapping_sub(before).saturating_sub(with_one);
        1 + more.checked_div(self.published * samples).unwrap_or(0)
    }

    /// The next block is known to lack samples, or the one just stamped could not be handed over.
    pub fn mark_loss(&mut self) {
        self.overrun = true;
    }

    /// Sampling was stopped and starts anew with the published period: the running block is lost.
    pub fn restart(&mut self) {
        self.running = self.published;
        self.sequence = self.sequence.wrapping_add(1);
        self.overrun = true;
        self.before = None;
    }

    /// The period word that DMA is to copy at the next border.
    pub const fn published(&self) -> u32 {
        self.published
    }
}

/// Whether the converter's transfers keep step with the triggers: TIM3's count against the stream's remaining
/// transfers, read one after the other. A conversion takes less than two sample periods, so more than two triggers
/// without a transfer mean that a sample was lost and every later one of the block is one place early.
pub const fn is_aligned(counted: u16, remaining: u16) -> bool {
    let transferred = BLOCK_SAMPLES.wrapping_sub(remaining) % BLOCK_SAMPLES;
    counted.wrapping_sub(transferred) % BLOCK_SAMPLES <= 2
}
