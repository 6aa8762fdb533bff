//! One light, one code: so many short flashes, then a pause.

use crate::switch::{Polarity, Switch};
use embedded_hal::digital::OutputPin;

/// Tenths of a second from one flash to the next; it is lit in the first of them.
const FLASH_TENTHS: u32 = 3;
/// Tenths of a second of a whole cycle, flashes and pause.
const CYCLE_TENTHS: u32 = 24;
/// Most flashes that leave a pause.
pub const MOST_FLASHES: u8 = 7;

/// Timing of the codes: flashes of 0.1 s every 0.3 s in a cycle of 2.4 s.
///
/// A cycle is followed from poll to poll, not read off the tick: the counter wraps somewhere within a cycle, which
/// would show a wrong code. A new code waits for the cycle's end for the same reason.
#[derive(Clone, Debug)]
pub struct FlashCode {
    ticks_per_tenth: u32,
    /// Flashes of the running cycle.
    flashes: u8,
    /// Ticks since the cycle began.
    position: u32,
    polled: Option<u32>,
}

impl FlashCode {
    /// Codes on a time base of so many ticks per second.
    pub fn new(ticks_per_second: u32) -> Self {
        let ticks_per_tenth = (ticks_per_second / 10).clamp(1, u32::MAX / CYCLE_TENTHS);
        Self { ticks_per_tenth, flashes: 0, position: 0, polled: None }
    }

    /// Whether the light is lit at a tick while it shows a code of so many flashes, at most [`MOST_FLASHES`].
    pub fn is_lit(&mut self, flashes: u8, now: u32) -> bool {
        let cycle = self.ticks_per_tenth * CYCLE_TENTHS;
        let left = cycle - self.position;
        // The first poll begins a cycle.
        let passed = self.polled.map_or(left, |polled| now.wrapping_sub(polled));
        self.polled = Some(now);
        if passed < left {
            self.position += passed;
        } else {
            self.position = (passed - left).checked_rem(cycle).unwrap_or(0);
            self.flashes = flashes.min(MOST_FLASHES);
        }
        let tenths = self.position.checked_div(self.ticks_per_tenth).unwrap_or(0);
        tenths.is_multiple_of(FLASH_TENTHS) && tenths / FLASH_TENTHS < u32::from(self.flashes)
    }
}

/// The light.
#[derive(Clone, Debug)]
pub struct StatusLight<P>(Switch<P>);

impl<P: OutputPin> StatusLight<P> {
    /// Takes over a pin, which keeps its level until the first [`Self::set`].
    pub const fn new(pin: P, polarity: Polarity) -> Self {
        Self(Switch::new(pin, polarity))
    }

    /// Lights it or puts it out; writes to the pin only when that changes.
    ///
    /// # Errors
    /// The pin's own; the next call writes again.
    pub fn set(&mut self, lit: bool) -> Result<(), P::Error> {
        self.0.set(lit)
    }
}
