//! Independent watchdog: its own oscillator, cannot be stopped. RM0090 section 21.

use crate::error::{Access, Refusal, within};
use crate::time::{NO_INSTANT, Time, UNITS_PER_SECOND};

const START: u32 = 0xcccc;
const UNLOCK: u32 = 0x5555;
const FEED: u32 = 0xaaaa;
/// Cycles of its oscillator until a new prescaler or reload is in force.
const UPDATE_CYCLES: Time = 5;

/// The watchdog.
#[derive(Clone, Debug)]
pub struct Watchdog {
    /// Units of a cycle of its oscillator: 32 kHz, 17 to 47 kHz over all chips.
    pub cycle: Time,
    prescaler: u32,
    reload: u32,
    unlocked: bool,
    prescaler_settled: Time,
    reload_settled: Time,
    expires: Time,
}

impl Default for Watchdog {
    fn default() -> Self {
        Self {
            cycle: UNITS_PER_SECOND / 32_000,
            prescaler: 0,
            reload: 0xfff,
            unlocked: false,
            prescaler_settled: 0,
            reload_settled: 0,
            expires: NO_INSTANT,
        }
    }
}

impl Watchdog {
    /// After a reset, with the oscillator as it is.
    pub fn reset(&mut self) {
        *self = Self { cycle: self.cycle, ..Self::default() };
    }

    /// When it resets the chip.
    pub fn due(&self) -> Time {
        self.expires
    }

    fn feed(&mut self, now: Time) {
        let divider: Time = 4 << self.prescaler.min(6);
        self.expires = now + (Time::from(self.reload) + 1) * divider * self.cycle;
    }

    /// Reads a register.
    ///
    /// # Errors
    /// [`Refusal::Register`].
    pub fn read(&self, offset: u32, now: Time) -> Access<u32> {
        Ok(match offset {
            0x00 => 0,
            0x04 => self.prescaler,
            0x08 => self.reload,
            0x0c => u32::from(now < self.prescaler_settled) | u32::from(now < self.reload_settled) << 1,
            _ => return Err(Refusal::Register),
        })
    }

    /// Writes a register.
    ///
    /// # Errors
    /// A register or bit that is not modelled, or what the manual forbids.
    pub fn write(&mut self, offset: u32, value: u32, now: Time) -> Access<()> {
        let runs = self.expires != NO_INSTANT;
        match (offset, value) {
            (0x00, UNLOCK) => self.unlocked = true,
            (0x00, START) => {
                self.unlocked = false;
                self.feed(now);
            }
            (0x00, FEED) => {
                self.unlocked = false;
                if runs {
                    self.feed(now);
                }
            }
            (0x00, _) => self.unlocked = false,
            (0x04 | 0x08, _) if !self.unlocked => return Err(Refusal::Forbidden("locked")),
            (0x04, _) if now < self.prescaler_settled => return Err(Refusal::Forbidden("PVU is set")),
            (0x08, _) if now < self.reload_settled => return Err(Refusal::Forbidden("RVU is set")),
            (0x04, _) => {
                self.prescaler = within(value, 7)?;
                self.prescaler_settled = now + UPDATE_CYCLES * self.cycle;
            }
            (0x08, _) => {
                self.reload = within(value, 0xfff)?;
                self.reload_settled = now + UPDATE_CYCLES * self.cycle;
            }
            _ => return Err(Refusal::Register),
        }
        // A running counter goes on with the new divider.
        if runs && offset != 0x00 {
            self.feed(now);
        }
        Ok(())
    }
}
