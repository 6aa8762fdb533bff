//! Waveforms that were there before the alarm: the latest samples are kept, a trigger lets a quarter more come, then
//! they stand.
//!
//! An alarm judges values of a second and more and waits for its persistence, so most of what it is about lies before
//! it: three quarters of the memory. One waveform is held until a host releases it; a trigger that finds one begun or
//! held is counted and noted. The samples have a filter of their own ([`crate::capture_decimator`]), so a waveform
//! does not depend on what the mesh bands need. Nothing is spliced: a new rate or a lost block begins the memory
//! anew, or ends a waveform whose trigger has been; it then says so. The checksum is computed a part per block,
//! because all of it at once would lose one.
//!
//! RAM: 24 KiB apart from the node's state ([`crate::buffers::Arrays`]), in core-coupled memory on a board. Cost:
//! with capture off none; else see the filter, and 2000 instructions a block.

use crate::capture_decimator::{BATCH, CaptureDecimator};
use crate::frame::CRC32;
use crate::sample_ring::{BLOCK, BLOCK_BYTES, BLOCKS, SampleRing};
use crate::stream::{Filter, OutputClock};
use crate::tach::Validity;
use crate::waveform::{CaptureFacts, CaptureHead, CapturePart, CapturePhase, CaptureReport, PART_BYTES, Trigger};
use core::borrow::BorrowMut;
use heapless::{Deque, Vec};

/// Turns of the pinion marked: 2 s at 61 Hz.
pub const MARKS: usize = 122;
/// Blocks of samples that follow a trigger at least.
const MIN_FOLLOWING_BLOCKS: usize = BLOCKS / 4;
/// Blocks of samples that enter the checksum with each block of codes.
const SEAL_BLOCKS: usize = 16;

/// The memory and what is done with it.
#[derive(Clone, Debug)]
pub struct Capture<R = SampleRing> {
    phase: CapturePhase,
    ring: R,
    decimator: CaptureDecimator,
    clock: OutputClock,
    /// The next block of codes begins the memory anew.
    fresh: bool,
    /// Tick behind the newest sample.
    end_tick: u64,
    /// Low halves of their ticks: no waveform lasts as long as they take to come round.
    marks: Deque<u32, MARKS>,
    /// No mark is missing from this tick on; none before the first mark.
    marks_from: Option<u64>,
    /// Latest block of codes with some at the rails ended here.
    railed: Option<u64>,
    trigger: (Trigger, u64),
    /// Blocks of samples still to come.
    remaining: usize,
    number: u32,
    missed: u32,
    head: CaptureHead,
    /// Blocks of samples in the checksum.
    sealed: usize,
}

/// A block of codes and what has to be known of it.
pub(super) struct Codes<'a> {
    pub(super) codes: &'a [u16],
    /// Whether some are at a rail.
    pub(super) railed: bool,
    /// Tick of the first code.
    pub(super) first: u64,
    /// Ticks from code to code.
    pub(super) period: u32,
    /// ADC rate over the lowest one wanted.
    pub(super) over: f32,
    /// Code of no acceleration.
    pub(super) zero: u16,
}

/// What a trigger did.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Triggered {
    /// Nothing is kept.
    Off,
    /// A waveform was begun.
    Begun,
    /// Another one was begun or is held; so many triggers have been missed.
    Missed(u32),
}

impl<R: BorrowMut<SampleRing>> Capture<R> {
    /// Nothing is kept; the samples will lie in `ring`.
    #[inline(never)]
    pub fn new(ring: R) -> Self {
        Self {
            phase: CapturePhase::Off,
            ring,
            decimator: CaptureDecimator::new(),
            clock: OutputClock::new(0, 1),
            fresh: true,
            end_tick: 0,
            marks: Deque::new(),
            marks_from: None,
            railed: None,
            trigger: (Trigger::Request, 0),
            remaining: 0,
            number: 0,
            missed: 0,
            head: CaptureHead { facts: CaptureFacts::NONE, bytes: 0, checksum: 0 },
            sealed: 0,
        }
    }

    /// What it does.
    pub fn phase(&self) -> CapturePhase {
        self.phase
    }

    /// What a host is told.
    pub fn report(&self) -> CaptureReport {
        CaptureReport { phase: self.phase, missed: self.missed, head: self.held().copied() }
    }

    /// The waveform held.
    pub(super) fn held(&self) -> Option<&CaptureHead> {
        (self.phase == CapturePhase::Held).then_some(&self.head)
    }

    /// Triggers that found another waveform begun or held.
    pub(super) fn missed(&self) -> u32 {
        self.missed
    }

    fn takes_samples(&self) -> bool {
        matches!(self.phase, CapturePhase::Watching | CapturePhase::Collecting)
    }

    /// Keeps samples from now on or does not, once the sample grid has ended; what is to be sealed or held stays, a
    /// trigger that came before there were samples is missed.
    pub(super) fn configure(&mut self, keeps: bool) {
        self.missed = self.missed.saturating_add(u32::from(self.phase == CapturePhase::Collecting));
        if !matches!(self.phase, CapturePhase::Sealing | CapturePhase::Held) {
            self.phase = if keeps { CapturePhase::Watching } else { CapturePhase::Off };
        }
    }

    /// A turn of the pinion began.
    pub(super) fn push_mark(&mut self, instant: u64) {
        if !self.takes_samples() {
            return;
        }
        self.marks_from.get_or_insert(instant);
        if self.marks.is_full() {
            self.marks.pop_front();
            self.marks_from = self.marks.front().map(|&oldest| at_or_before(instant, oldest));
        }
        let _ = self.marks.push_back(instant as u32);
    }

    /// Turns before the next mark may be missing.
    pub(super) fn lose_marks(&mut self) {
        if self.takes_samples() {
            self.marks.clear();
            self.marks_from = None;
        }
    }

    /// Takes a block of codes where samples are wanted; true when a waveform is full and has to be sealed.
    #[inline(never)]
    pub(super) fn take(&mut self, block: &Codes<'_>) -> bool {
        if !self.takes_samples() {
            return false;
        }
        if self.fresh {
            self.fresh = false;
            self.ring.borrow_mut().clear();
            self.decimator.restart(block.over);
            self.clock = OutputClock::new(block.first, block.period);
        }
        if block.railed {
            self.railed = Some(block.first + u64::from(block.period) * block.codes.len() as u64);
        }
        for codes in block.codes.chunks(BATCH) {
            self.push(codes, block.zero);
        }
        self.phase == CapturePhase::Collecting && self.remaining == 0
    }

    fn push(&mut self, codes: &[u16], zero: u16) {
        let filter = Filter {
            ratio: self.decimator.ratio(),
            delay_samples: self.decimator.delay_samples(),
            settling_outputs: self.decimator.settling_outputs(),
        };
        let period = self.period_ticks();
        let collects = self.phase == CapturePhase::Collecting;
        let Self { ring, decimator, clock, end_tick, remaining, .. } = self;
        let ring = ring.borrow_mut();
        decimator.process(codes, zero, |sample| {
            let (settled, tick) = clock.take(core::slice::from_ref(&sample), filter);
            if settled.is_empty() || (collects && *remaining == 0) {
                return;
            }
            *end_tick = tick + period;
            if ring.push(sample) && collects {
                *remaining = remaining.saturating_sub(1);
            }
        });
    }

    /// Ticks from sample to sample.
    fn period_ticks(&self) -> u64 {
        u64::from(self.clock.period_ticks()) * u64::from(self.decimator.ratio())
    }

    /// A cause to keep what is there.
    pub(super) fn trigger(&mut self, trigger: Trigger, tick: u64) -> Triggered {
        match self.phase {
            CapturePhase::Off => Triggered::Off,
            CapturePhase::Watching => {
                self.phase = CapturePhase::Collecting;
                self.trigger = (trigger, tick);
                self.remaining = MIN_FOLLOWING_BLOCKS.max(BLOCKS - self.ring.borrow().held());
                Triggered::Begun
            }
            _ => {
                self.missed = self.missed.saturating_add(1);
                Triggered::Missed(self.missed)
            }
        }
    }

    /// The sample grid ends: the memory begins anew. True where a waveform whose trigger has been ends here and has
    /// to be sealed; one of which there is less than a quarter begins anew with the memory.
    pub(super) fn end_grid(&mut self) -> bool {
        self.fresh = true;
        if self.phase != CapturePhase::Collecting {
            return false;
        }
        if self.ring.borrow().held() >= MIN_FOLLOWING_BLOCKS {
            return true;
        }
        self.remaining = BLOCKS;
        false
    }

    /// Takes the span's facts from what is held, and begins the checksum with the marks; `facts` are those of the node.
    pub(super) fn seal(&mut self, facts: CaptureFacts) {
        let period = self.period_ticks();
        let waiting = self.ring.borrow().waiting() as u64;
        let samples = (self.ring.borrow().held() * BLOCK) as u64;
        let end_tick = self.end_tick.saturating_sub(waiting * period);
        let first_tick = end_tick.saturating_sub(samples * period);
        let last = end_tick.saturating_sub(1);
        let is_outside = |mark: &u32| mark.wrapping_sub(first_tick as u32) > (last - first_tick) as u32;
        while self.marks.front().is_some_and(is_outside) {
            self.marks.pop_front();
        }
        while self.marks.back().is_some_and(is_outside) {
            self.marks.pop_back();
        }
        self.number += 1;
        let facts = CaptureFacts {
            number: self.number,
            trigger: self.trigger.0,
            trigger_tick: self.trigger.1,
            first_tick,
            period_ticks: period as u32,
            samples: samples as u32,
            marks: self.marks.len() as u16,
            marks_whole: facts.validity == Validity::Locked && self.marks_from.is_some_and(|tick| tick <= first_tick),
            overload: self.railed.is_some_and(|tick| tick > first_tick),
            ..facts
        };
        let mut checksum = 0;
        for &mark in &self.marks {
            checksum = continued(checksum, &mark.wrapping_sub(first_tick as u32).to_le_bytes());
        }
        let bytes = 4 * self.marks.len() + BLOCK_BYTES * self.ring.borrow().held();
        self.head = CaptureHead { facts, bytes: bytes as u32, checksum };
        (self.phase, self.sealed) = (CapturePhase::Sealing, 0);
    }

    /// Goes on with the checksum where one is under way; the number of a waveform that is complete with it.
    pub(super) fn go_on_sealing(&mut self) -> Option<u32> {
        if self.phase != CapturePhase::Sealing {
            return None;
        }
        for _ in 0..SEAL_BLOCKS {
            let Some(block) = self.ring.borrow().block(self.sealed) else {
                self.phase = CapturePhase::Held;
                return Some(self.number);
            };
            self.head.checksum = continued(self.head.checksum, block);
            self.sealed += 1;
        }
        None
    }

    /// Forgets the waveform of a number, and where no turn is missing from; false where that is not the one held.
    pub(super) fn release(&mut self, number: u32, marks_from: Option<u64>) -> bool {
        let is_held = self.phase == CapturePhase::Held && self.number == number;
        if is_held {
            (self.phase, self.fresh) = (CapturePhase::Off, true);
            self.marks.clear();
            self.marks_from = marks_from;
        }
        is_held
    }

    /// Part of the bytes held.
    pub(super) fn part(&self, number: u32, offset: u32) -> CapturePart {
        let mut bytes = Vec::new();
        if self.phase == CapturePhase::Held && number == self.head.facts.number {
            let end = self.head.bytes.min(offset.saturating_add(PART_BYTES as u32));
            bytes = (offset..end).filter_map(|place| self.byte(place as usize)).collect();
        }
        CapturePart { number, offset, bytes }
    }

    /// A sample held, m/s^2, by its place from the oldest; not a number where there is none.
    pub(super) fn sample(&self, place: u32) -> f32 {
        let (block, place) = (place as usize / BLOCK, place as usize % BLOCK);
        let ring = self.ring.borrow();
        let coded = ring.block(block).filter(|_| self.phase == CapturePhase::Held);
        coded.map_or(f32::NAN, |coded| crate::sample_ring::decode_one(coded, place) as f32 * self.head.facts.scale)
    }

    fn byte(&self, place: usize) -> Option<u8> {
        let marks = 4 * self.marks.len();
        if place < marks {
            let mark = self.marks.iter().nth(place / 4)?;
            return mark.wrapping_sub(self.head.facts.first_tick as u32).to_le_bytes().get(place % 4).copied();
        }
        let place = place - marks;
        self.ring.borrow().block(place / BLOCK_BYTES)?.get(place % BLOCK_BYTES).copied()
    }
}

/// The instant up to another one that has these low bits.
fn at_or_before(instant: u64, low: u32) -> u64 {
    instant - u64::from((instant as u32).wrapping_sub(low))
}

/// The checksum of what `sum` is the checksum of and of `bytes` behind it.
fn continued(sum: u32, bytes: &[u8]) -> u32 {
    let mut digest = CRC32.digest_with_initial((!sum).reverse_bits());
    digest.update(bytes);
    digest.finalize()
}
