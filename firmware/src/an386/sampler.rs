//! The sample clock and the converter it triggers.
//!
//! Timer 0 *is* the sample clock: its reload is the granted sample period (or that of a whole block), and the
//! codes are those of the replayed signal at the timer's instants. With [`SamplingMode::PerBlock`] the timer
//! interrupts once per block and the buffer is filled then, as DMA would have done meanwhile; with
//! [`SamplingMode::PerSample`] it interrupts for every sample. Both give the same codes.
//!
//! Instants are counted from the periods the timer was given, which is exact. Writing this timer's reload
//! register also restarts its count, so the register is written only when the period changes, and the count
//! is then set right from the free-running time base, which also shows interrupts that came too late.

use super::registers::{Device, TimerBlock};
use super::time::TimeBase;
use heapless::spsc::Producer;
use meshband::pipeline::{BLOCK_SAMPLES, Channels, Codes, EmptyBuffers, Filled, Periods, Request};
use meshband::replay::{LONGEST_PERIOD, Replay, SamplingMode};

const RUN: u32 = 1;
const INTERRUPT: u32 = 1 << 3;

/// What happened, for the closing statistics.
#[derive(Debug, Clone, Copy, Default)]
pub struct Counters {
    /// Blocks handed to the main loop.
    pub blocks: u32,
    /// Blocks lost because no buffer was free, and given up with them.
    pub lost: u32,
    /// Blocks lost because their interrupt came too late to be told from the next.
    pub missed: u32,
}

impl Counters {
    /// With blocks that the main loop gave up although they had been handed to it.
    pub fn with_given_up(self, given_up: u32) -> Self {
        Self { blocks: self.blocks - given_up, lost: self.lost + given_up, ..self }
    }
}

/// State of the sample clock, owned by its interrupt.
pub struct Sampler {
    timer: Device<TimerBlock>,
    time: TimeBase,
    signal: Replay<'static>,
    periods: Periods,
    /// Border before the running block, ticks of the record; its first sample is one period later.
    border: u32,
    sequence: u32,
    overrun: bool,
    filling: Option<&'static mut Codes>,
    /// Samples of the running block already taken (one interrupt per sample only).
    taken: usize,
    blocks: Producer<'static, Filled>,
    free: EmptyBuffers,
    request: &'static Request,
    /// Statistics so far.
    pub counters: Counters,
    finished: bool,
}

impl Sampler {
    /// Prepares the clock; [`Sampler::start`] sets it going.
    pub fn new(
        timer: Device<TimerBlock>,
        time: TimeBase,
        signal: Replay<'static>,
        blocks: Producer<'static, Filled>,
        mut free: EmptyBuffers,
        request: &'static Request,
    ) -> Self {
        let filling = free.take();
        let mut sampler = Self {
            timer,
            time,
            signal,
            periods: Periods::starting(1),
            border: 0,
            sequence: 0,
            overrun: false,
            filling,
            taken: 0,
            blocks,
            free,
            request,
            counters: Counters::default(),
            finished: false,
        };
        sampler.periods = Periods::starting(sampler.wanted());
        sampler
    }

    /// Starts sampling at the record's start, which is now.
    pub fn start(&mut self) {
        self.finished = self.ends_early();
        if !self.finished {
            let first = self.reload(self.periods.running);
            self.timer.reload.write(first);
            self.timer.value.write(first);
            self.timer.control.write(RUN | INTERRUPT);
        }
    }

    /// Present instant, ticks of the record.
    pub fn now(&self) -> u32 {
        self.time.now()
    }

    /// Whether the record has ended.
    pub fn is_finished(&self) -> bool {
        self.finished
    }

    /// The border behind the running block, ticks of the record.
    fn next_border(&self) -> u32 {
        self.border.saturating_add(self.periods.running * BLOCK_SAMPLES as u32)
    }

    /// First instant behind the running block, ticks of the record; once the record has ended, behind the last one.
    /// Every block that ends before is complete, and of the running one edges may be handed over as they come.
    pub fn horizon(&self) -> u32 {
        let border = if self.finished { self.border } else { self.next_border() };
        border.saturating_add(1)
    }

    /// The timer's interrupt.
    pub fn on_interrupt(&mut self) {
        self.timer.interrupt.write(1);
        match self.signal.header().sampling {
            SamplingMode::PerBlock => {
                let first = self.border + self.periods.running;
                if let Some(codes) = &mut self.filling {
                    self.signal.sample(first, self.periods.running, &mut codes[..]);
                }
                self.end_block();
            }
            SamplingMode::PerSample => {
                let instant = self.border + self.periods.running * (self.taken as u32 + 1);
                if let (Some(codes), Some(code)) = (&mut self.filling, self.signal.code_at(instant)) {
                    codes[self.taken] = code;
                }
                self.taken += 1;
                if self.taken == BLOCK_SAMPLES {
                    self.taken = 0;
                    self.end_block();
                }
            }
        }
    }

    /// The running block is complete: hands it over, takes a fresh buffer and the newest request.
    fn end_block(&mut self) {
        let first_tick = TimeBase::stamp(self.border + self.periods.running);
        let next = self.free.take();
        match (self.filling.take(), next) {
            (Some(codes), Some(fresh)) => {
                let (sequence, period_ticks) = (self.sequence, self.periods.running);
                let filled = Filled {
                    codes,
                    channels: Channels::One,
                    first_tick,
                    period_ticks,
                    sequence,
                    overrun: self.overrun,
                };
                self.overrun = false;
                self.filling = Some(fresh);
                self.counters.blocks += 1;
                // There are as many places in the queue as buffers: a block always finds one.
                if self.blocks.enqueue(filled).is_err() {
                    self.lose();
                }
            }
            (kept, next) => {
                // No buffer to go on with: this block is given up and its buffer filled again.
                self.filling = kept.or(next);
                self.lose();
            }
        }
        self.border = self.next_border();
        self.sequence = self.sequence.wrapping_add(1);
        let before = self.periods.running;
        self.periods.advance(self.wanted());
        if self.ends_early() {
            self.timer.control.write(0);
            self.finished = true;
            return;
        }
        self.catch_up();
        if self.periods.running != before {
            let reload = self.reload(self.periods.running);
            self.timer.reload.write(reload);
            let since = self.time.now().saturating_sub(self.border);
            self.timer.value.write(reload.saturating_sub(since).max(1));
        }
    }

    /// Skips borders that passed without an interrupt.
    fn catch_up(&mut self) {
        let late = self.time.now().wrapping_sub(self.border) as i32;
        let block = self.periods.running * BLOCK_SAMPLES as u32;
        if late > 0 && late as u32 >= block {
            let missed = late as u32 / block;
            self.border += missed * block;
            self.sequence = self.sequence.wrapping_add(missed);
            self.overrun = true;
            self.counters.missed += missed;
        }
    }

    fn lose(&mut self) {
        self.overrun = true;
        self.counters.lost += 1;
    }

    fn ends_early(&self) -> bool {
        self.next_border() >= self.signal.end_tick()
    }

    /// The period for the block after the next.
    fn wanted(&self) -> u32 {
        self.signal.header().forced_period_ticks.unwrap_or_else(|| self.request.latest()).clamp(1, LONGEST_PERIOD)
    }

    /// Reload value that makes the timer interrupt as the mode says.
    fn reload(&self, period: u32) -> u32 {
        match self.signal.header().sampling {
            SamplingMode::PerBlock => period * BLOCK_SAMPLES as u32 - 1,
            SamplingMode::PerSample => period - 1,
        }
    }
}
