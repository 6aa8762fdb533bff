//! From captured borders to stamped blocks: no register, only the order of things.
//!
//! A period word in memory reaches the timer by DMA at a border and governs the block behind it. Which word that is,
//! the one published last or the one before, depends on when the DMA read it: in direct mode it reads one word ahead
//! (RM0090 section 10.3.13). So nothing is concluded from what was published: after each border the timer's register
//! says which period the block has that has just begun.

use crate::period::{reload_of, served};

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

/// What the time base says of borders when a block is complete.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Captured {
    /// Instant of the newest block's last sample; `None` if it was taken before.
    pub last_tick: Option<u32>,
    /// A border before it went unnoticed.
    pub missed: bool,
}

/// Book of periods and sequence.
#[derive(Clone, Copy, Debug)]
pub struct Borders {
    /// Samples of a block.
    samples: u16,
    /// Of the block that runs; `None` where it could not be read in time.
    running: Option<u32>,
    published: u32,
    sequence: u32,
    overrun: bool,
    /// Last sample's instant and period of the block that ended before.
    before: Option<(u32, u32)>,
}

impl Borders {
    /// The first block has this period, or the shortest one served; every block has so many samples.
    pub const fn starting(period_ticks: u32, samples: u16) -> Self {
        let period = served(period_ticks);
        Self { samples, running: Some(period), published: period, sequence: 0, overrun: false, before: None }
    }

    /// A block is complete. Where other borders passed unnoticed before the one captured, the time since the last one
    /// noticed tells how many (a flash erasure takes seconds), exactly where the rate was steady. `next` is the
    /// period of the block that has begun, as the timer's register says, or `None` if yet another border may have
    /// changed it.
    ///
    /// An interrupt so late that it falls between the next block's last trigger and the end of that conversion finds
    /// that block's border captured, and is followed by another interrupt for it: no border is captured then, and the
    /// block is already counted.
    ///
    /// Gives the block's stamp; `None` for a block whose own period nobody read, which must be given up.
    pub fn on_border(&mut self, captured: Captured, next: Option<u32>) -> Option<Stamp> {
        let Some(last_tick) = captured.last_tick else {
            // The register was read at the border itself, perhaps before DMA had written it.
            self.running = next;
            return None;
        };
        let ended = self.running.filter(|_| !captured.missed);
        if captured.missed {
            self.sequence = self.sequence.wrapping_add(self.unnoticed(last_tick));
        }
        let sequence = self.sequence;
        self.sequence = sequence.wrapping_add(1);
        self.running = next;
        self.before = Some((last_tick, ended.unwrap_or(self.published)));
        let overrun = core::mem::replace(&mut self.overrun, ended.is_none());
        let period_ticks = ended?;
        let first_tick = last_tick.wrapping_sub(period_ticks.wrapping_mul(u32::from(self.samples) - 1));
        Some(Stamp { first_tick, period_ticks, sequence, overrun })
    }

    /// Takes the wanted period, as far as the converter can follow; gives the word for the DMA.
    pub fn publish(&mut self, wanted: u32) -> u32 {
        self.published = served(wanted);
        reload_of(self.published)
    }

    /// Blocks between the one that ended before and the one that ends now.
    fn unnoticed(&self, last_tick: u32) -> u32 {
        let Some((before, period)) = self.before else { return 1 };
        let samples = u32::from(self.samples);
        // A block's first sample follows its predecessor's last at the predecessor's period.
        let with_one = period + self.running.unwrap_or(self.published) * samples + self.published * (samples - 1);
        let more = last_tick.wrapping_sub(before).saturating_sub(with_one);
        1 + more.checked_div(self.published * samples).unwrap_or(0)
    }

    /// The next block is known to lack samples, or the one just stamped could not be handed over.
    pub fn mark_loss(&mut self) {
        self.overrun = true;
    }

    /// Sampling was stopped and starts anew with the published period, in blocks of so many samples: the running
    /// block is lost.
    pub fn restart(&mut self, samples: u16) {
        self.samples = samples;
        self.running = Some(self.published);
        self.sequence = self.sequence.wrapping_add(1);
        self.overrun = true;
        self.before = None;
    }

    /// The period published last.
    pub const fn published(&self) -> u32 {
        self.published
    }
}

/// Whether a converter's transfers keep step with the triggers: TIM3's count against the stream's remaining
/// transfers of a block of `samples`, read one after the other. A conversion takes less than two sample periods, so
/// more than two triggers without a transfer mean that a sample was lost and every later one of the block is one
/// place early.
pub const fn is_aligned(counted: u16, remaining: u16, samples: u16) -> bool {
    let transferred = samples.wrapping_sub(remaining) % samples;
    counted.wrapping_sub(transferred) % samples <= 2
}
