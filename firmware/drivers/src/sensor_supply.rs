//! Supply of the sensor: switched, and followed until its bias has settled.
//!
//! An IEPE sensor needs some seconds after power-up until its bias voltage, and the coupling capacitor behind it, stand
//! still; meanwhile the input lies at a rail or drifts. What is sampled before [`State::On`] says nothing about the
//! machine.

use crate::countdown::Countdown;
use crate::switch::{Polarity, Switch};
use embedded_hal::digital::OutputPin;

/// State of the supply.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum State {
    /// No supply, or a write to the pin that failed. Left by [`SensorSupply::switch_on`].
    Off,
    /// On, bias not yet settled. Left when the settling time is over.
    Settling(Countdown),
    /// On and settled.
    On,
}

/// The switch.
#[derive(Clone, Debug)]
pub struct SensorSupply<P> {
    switch: Switch<P>,
    settling_ticks: u64,
    state: State,
}

impl<P: OutputPin> SensorSupply<P> {
    /// A supply that counts as off. The pin keeps its level until the first call: the board sets it to off.
    pub const fn new(pin: P, polarity: Polarity, settling_ticks: u64) -> Self {
        Self { switch: Switch::new(pin, polarity), settling_ticks, state: State::Off }
    }

    /// Switches the supply on; where it is on already, settling goes on undisturbed.
    ///
    /// # Errors
    /// The pin's own; the state is then `Off`.
    pub fn switch_on(&mut self, now: u32) -> Result<(), P::Error> {
        if self.state == State::Off {
            self.switch.set(true)?;
            self.state = State::Settling(Countdown::start(self.settling_ticks, now));
        }
        Ok(())
    }

    /// Switches the supply off. The state is `Off` whatever the pin answers: a sensor whose supply is in doubt is not
    /// believed.
    ///
    /// # Errors
    /// The pin's own.
    pub fn switch_off(&mut self) -> Result<(), P::Error> {
        self.state = State::Off;
        self.switch.set(false)
    }

    /// The state at a tick; to be called at least once per wrap of the tick counter while the supply settles.
    pub fn poll(&mut self, now: u32) -> State {
        if let State::Settling(countdown) = &mut self.state
            && countdown.poll(now)
        {
            self.state = State::On;
        }
        self.state
    }
}
