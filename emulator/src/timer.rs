//! TIM2 to TIM5: up-counters with preloaded reload, update events, master and slave triggers, captures behind a digital
//! filter. RM0090 section 18.
//!
//! Counts are not stepped: a counter knows since when it has counted, and when it will overflow.

use crate::error::{Access, Refusal, within};
use crate::time::{NO_INSTANT, Time};

const CEN: u32 = 1 << 0;
const UDIS: u32 = 1 << 1;
const URS: u32 = 1 << 2;
const ARPE: u32 = 1 << 7;
const UIF: u32 = 1 << 0;
/// DMA request on update, in `DIER`.
const UDE: u32 = 1 << 8;
/// Master mode "update" in `CR2`.
const MASTER_UPDATE: u32 = 0b010 << 4;
/// Slave mode "external clock 1" in `SMCR`.
const EXTERNAL_CLOCK: u32 = 0b111;

/// Samples in a row and divider of the filter's clock, for each `ICxF` (RM0090, `TIMx_CCMR1`); zero samples: no filter.
const FILTERS: [(u32, bool, u64); 16] = [
    (0, false, 1),
    (2, false, 1),
    (4, false, 1),
    (8, false, 1),
    (6, true, 2),
    (8, true, 2),
    (6, true, 4),
    (8, true, 4),
    (6, true, 8),
    (8, true, 8),
    (5, true, 16),
    (6, true, 16),
    (8, true, 16),
    (5, true, 32),
    (6, true, 32),
    (8, true, 32),
];

/// What an update event sets off.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Update {
    /// A pulse on the trigger output.
    pub trigger: bool,
}

/// A timer.
#[derive(Clone, Debug)]
pub struct Timer {
    /// Largest count.
    widest: u32,
    /// Units of one clock.
    clock: Time,
    cr1: u32,
    cr2: u32,
    smcr: u32,
    dier: u32,
    sr: u32,
    ccmr1: u32,
    ccmr2: u32,
    ccer: u32,
    psc: u32,
    arr: u32,
    psc_loaded: u32,
    arr_loaded: u32,
    ccr: [u32; 4],
    /// Count at `since`, or now where the counter does not run by itself.
    count: u32,
    since: Option<Time>,
    /// Clocks from the master that the prescaler has swallowed.
    swallowed: u32,
    /// An update asks the DMA.
    pub request: bool,
}

impl Timer {
    /// A timer of 16 or 32 bits after reset.
    pub fn new(bits: u32, clock: Time) -> Self {
        let widest = u32::MAX >> (32 - bits);
        Self {
            widest,
            clock,
            cr1: 0,
            cr2: 0,
            smcr: 0,
            dier: 0,
            sr: 0,
            ccmr1: 0,
            ccmr2: 0,
            ccer: 0,
            psc: 0,
            arr: widest,
            psc_loaded: 0,
            arr_loaded: widest,
            ccr: [0; 4],
            count: 0,
            since: None,
            swallowed: 0,
            request: false,
        }
    }

    fn step(&self) -> Time {
        self.clock * (Time::from(self.psc_loaded) + 1)
    }

    fn is_slave(&self) -> bool {
        self.smcr & 7 == EXTERNAL_CLOCK
    }

    /// Count at an instant not behind the next overflow.
    pub fn count(&self, now: Time) -> u32 {
        match self.since {
            Some(since) => self.count.wrapping_add((now.saturating_sub(since) / self.step()) as u32) & self.widest,
            None => self.count,
        }
    }

    /// When the counter overflows by itself.
    pub fn due(&self) -> Time {
        let Some(since) = self.since else { return NO_INSTANT };
        let left = if self.count <= self.arr_loaded {
            Time::from(self.arr_loaded - self.count) + 1
        } else {
            Time::from(self.widest - self.count) + 1 + Time::from(self.arr_loaded) + 1
        };
        since.saturating_add(left * self.step())
    }

    /// The clock of the bus has changed.
    pub fn set_clock(&mut self, clock: Time, now: Time) {
        self.settle(now);
        self.clock = clock;
        self.since = None;
        self.resume(now);
    }

    /// Brings the count up to date; a running counter keeps its beat.
    fn settle(&mut self, now: Time) {
        if let Some(since) = self.since {
            let step = self.step();
            self.count = self.count(now);
            self.since = Some(since + now.saturating_sub(since) / step * step);
        }
    }

    /// Runs or not, as the registers say; a counter that starts takes its first step at the second clock.
    fn resume(&mut self, now: Time) {
        let runs = self.cr1 & CEN != 0 && !self.is_slave();
        if !runs {
            self.since = None;
        } else if self.since.is_none() {
            self.since = Some((now / self.clock + 1) * self.clock);
        }
    }

    /// The overflow that [`Timer::due`] told.
    pub fn overflow(&mut self, at: Time) -> Update {
        if self.since.is_some() {
            self.since = Some(at);
        }
        self.count = 0;
        self.update(true)
    }

    /// A clock from the master; `Some` where the counter overflows.
    pub fn step_by_master(&mut self) -> Option<Update> {
        if self.cr1 & CEN == 0 || !self.is_slave() {
            return None;
        }
        if self.swallowed < self.psc_loaded {
            self.swallowed += 1;
            return None;
        }
        self.swallowed = 0;
        if self.count == self.arr_loaded {
            self.count = 0;
            return Some(self.update(true));
        }
        self.count = self.count.wrapping_add(1) & self.widest;
        None
    }

    fn update(&mut self, counted: bool) -> Update {
        if self.cr1 & UDIS != 0 {
            return Update::default();
        }
        self.psc_loaded = self.psc;
        self.arr_loaded = self.arr;
        self.swallowed = 0;
        if counted || self.cr1 & URS == 0 {
            self.sr |= UIF;
            self.request |= self.dier & UDE != 0;
        }
        Update { trigger: self.cr2 & 0x70 == MASTER_UPDATE }
    }

    /// Internal trigger that is selected: `ITR0` to `ITR3`, where the counter or a capture listens to it.
    pub fn trigger_input(&self) -> Option<u32> {
        let captures = self.ccmr1 & 3 == 3 || self.ccmr1 >> 8 & 3 == 3;
        (self.is_slave() || captures).then_some(self.smcr >> 4 & 7)
    }

    /// The selected trigger has come; gives the count that channel 2 captures, if it does.
    pub fn capture_trigger(&mut self, now: Time) -> Option<u32> {
        for channel in [0, 1] {
            if self.ccmr1 >> (8 * channel) & 3 == 3 {
                self.capture(channel, now);
            }
        }
        let captures = self.ccmr1 >> 8 & 3 == 3 && self.ccer & 1 << 4 != 0;
        captures.then_some(self.ccr[1])
    }

    /// The filter of channel 1's pin has accepted a level; true where it is captured.
    pub fn capture_pin(&mut self, level: bool, now: Time) -> bool {
        let wanted = match (self.ccer >> 1 & 1, self.ccer >> 3 & 1) {
            (0, 0) => level,
            (1, 0) => !level,
            _ => true,
        };
        let captured = wanted && self.ccmr1 & 3 == 1 && self.ccer & 1 != 0;
        if captured {
            self.capture(0, now);
        }
        captured
    }

    /// The filter of channel 4's pin has accepted a rising edge.
    pub fn capture_fourth(&mut self, now: Time) {
        let rising = self.ccer >> 12 & 0b1010 == 0;
        if rising && self.ccmr2 >> 8 & 3 == 1 {
            self.capture(3, now);
        }
    }

    fn capture(&mut self, channel: usize, now: Time) {
        if self.ccer & 1 << (4 * channel) == 0 {
            return;
        }
        self.ccr[channel] = self.count(now);
        let flag = 2 << channel;
        if self.sr & flag != 0 {
            self.sr |= flag << 8;
        }
        self.sr |= flag;
    }

    /// The count captured last in channel 1.
    pub fn captured(&self) -> u32 {
        self.ccr[0]
    }

    /// Samples in a row that make a level at channel 1's pin, and the units between them.
    pub fn filter(&self) -> (u32, Time) {
        self.filter_of(self.ccmr1 >> 4 & 0xf)
    }

    /// The same of channel 4.
    pub fn fourth_filter(&self) -> (u32, Time) {
        self.filter_of(self.ccmr2 >> 12 & 0xf)
    }

    fn filter_of(&self, code: u32) -> (u32, Time) {
        let (samples, divided, by) = FILTERS[code as usize];
        let base = if divided { self.clock << (self.cr1 >> 8 & 3) } else { self.clock };
        (samples, base * by)
    }

    /// Whether the interrupt is asked for.
    pub fn interrupt(&self) -> bool {
        self.sr & self.dier & 0x5f != 0
    }

    /// Reads a register.
    ///
    /// # Errors
    /// [`Refusal::Register`].
    pub fn read(&mut self, offset: u32, now: Time) -> Access<u32> {
        Ok(match offset {
            0x00 => self.cr1,
            0x04 => self.cr2,
            0x08 => self.smcr,
            0x0c => self.dier,
            0x10 => self.sr,
            0x18 => self.ccmr1,
            0x1c => self.ccmr2,
            0x20 => self.ccer,
            0x24 => self.count(now),
            0x28 => self.psc,
            0x2c => self.arr,
            0x34 | 0x38 => {
                let channel = (offset - 0x34) as usize / 4;
                // Reading a captured count clears its flag.
                if self.ccmr1 >> (8 * channel) & 3 != 0 {
                    self.sr &= !(2 << channel);
                }
                self.ccr[channel]
            }
            0x40 => {
                if self.ccmr2 >> 8 & 3 != 0 {
                    self.sr &= !(2 << 3);
                }
                self.ccr[3]
            }
            _ => return Err(Refusal::Register),
        })
    }

    /// Writes a register.
    ///
    /// # Errors
    /// A register or bit that is not modelled.
    pub fn write(&mut self, offset: u32, value: u32, now: Time) -> Access<Update> {
        let mut update = Update::default();
        match offset {
            0x00 => {
                self.settle(now);
                self.cr1 = within(value, CEN | UDIS | URS | ARPE | 0x300)?;
                self.resume(now);
            }
            0x04 => self.cr2 = self.master_mode(value)?,
            0x08 => {
                self.settle(now);
                self.smcr = slave_mode(value)?;
                self.resume(now);
            }
            0x0c => self.dier = within(value, UIF | 0x06 | UDE)?,
            // Zeros clear, ones leave.
            0x10 => self.sr &= value,
            0x14 => {
                within(value, 1)?;
                if value & 1 != 0 {
                    (self.count, self.since) = (0, None);
                    update = self.update(false);
                    self.resume(now);
                }
            }
            0x18 => self.ccmr1 = input_modes(value)?,
            0x1c => self.ccmr2 = fourth_mode(value)?,
            0x20 => self.ccer = within(value, 0xb0bb)?,
            0x24 => {
                self.settle(now);
                self.count = value & self.widest;
                self.resume(now);
            }
            0x28 => self.psc = within(value, 0xffff)?,
            0x2c => {
                self.settle(now);
                self.arr = within(value, self.widest)?;
                if self.cr1 & ARPE == 0 {
                    self.arr_loaded = self.arr;
                }
            }
            _ => return Err(Refusal::Register),
        }
        Ok(update)
    }

    fn master_mode(&self, value: u32) -> Access<u32> {
        match value {
            0 | MASTER_UPDATE => Ok(value),
            other => Err(Refusal::Bits(other)),
        }
    }
}

/// Slave modes off and external clock 1, from one of the internal triggers.
fn slave_mode(value: u32) -> Access<u32> {
    within(value, 0x37)?;
    match value & 7 {
        0 | EXTERNAL_CLOCK => Ok(value),
        other => Err(Refusal::Bits(other)),
    }
}

/// Capture of the own pin at channel 4, without a prescaler; nothing at channel 3.
fn fourth_mode(value: u32) -> Access<u32> {
    within(value, 0xf300)?;
    if value >> 8 & 3 > 1 { Err(Refusal::Bits(value)) } else { Ok(value) }
}

/// Captures of the own pin (channel 1) and of the trigger, without a prescaler.
fn input_modes(value: u32) -> Access<u32> {
    within(value, 0xf3f3)?;
    if value >> 8 & 3 == 1 || value >> 8 & 3 == 2 || value & 3 == 2 { Err(Refusal::Bits(value)) } else { Ok(value) }
}
