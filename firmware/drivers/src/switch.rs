//! A load behind a pin: on or off, whichever level that takes.

use embedded_hal::digital::{OutputPin, PinState};

/// Level of the pin that switches the load on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Polarity {
    /// High is on.
    ActiveHigh,
    /// Low is on.
    ActiveLow,
}

impl Polarity {
    /// The level for on or off.
    pub const fn level(self, on: bool) -> PinState {
        match (self, on) {
            (Polarity::ActiveHigh, true) | (Polarity::ActiveLow, false) => PinState::High,
            (Polarity::ActiveHigh, false) | (Polarity::ActiveLow, true) => PinState::Low,
        }
    }
}

/// A pin with its polarity. Writes when something changes, and again after a write that failed.
#[derive(Clone, Debug)]
pub struct Switch<P> {
    pin: P,
    polarity: Polarity,
    /// What the pin was last told; `None` before the first write and after a failed one.
    written: Option<bool>,
}

impl<P: OutputPin> Switch<P> {
    /// Takes over a pin, which keeps its level until the first [`Self::set`].
    pub const fn new(pin: P, polarity: Polarity) -> Self {
        Self { pin, polarity, written: None }
    }

    /// Switches the load.
    ///
    /// # Errors
    /// The pin's own; the load may then be in either state, and the next call writes whatever it is asked for.
    pub fn set(&mut self, on: bool) -> Result<(), P::Error> {
        if self.written == Some(on) {
            return Ok(());
        }
        self.written = None;
        self.pin.set_state(self.polarity.level(on))?;
        self.written = Some(on);
        Ok(())
    }

    /// What the load was last told; `None` before the first write and after a failed one.
    pub const fn is_on(&self) -> Option<bool> {
        self.written
    }
}
