//! Alarm output: a relay, lamp or controller input that says whether an alarm stands.
//!
//! Relay practice is fail-safe: the coil is energised while all is well, so that a broken wire, a lost supply, a node
//! that resets or hangs (its watchdog lets the pin float, and a resistor pulls it off) all read as an alarm. Where a
//! lamp or a horn is to be driven directly, [`Practice::EnergisedInAlarm`] is the other way round and has none of
//! that.
//!
//! An alarm that is raised stays for a minimum time, so that a slow controller or a person sees it. Latching until
//! someone acknowledges is the controller's matter.

use crate::countdown::Countdown;
use crate::switch::{Polarity, Switch};
use embedded_hal::digital::OutputPin;

/// When the coil carries current.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Practice {
    /// Fail-safe: while healthy.
    EnergisedInHealth,
    /// While an alarm stands.
    EnergisedInAlarm,
}

/// What the output says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum State {
    /// Not energised, whatever the practice: the node has not judged yet. Left at the first update.
    Starting,
    /// No alarm. Left when one is raised.
    Healthy,
    /// An alarm, raised less than the minimum time ago. Left when that time is over.
    Raised(Countdown),
    /// An alarm that stands since the minimum time or longer. Left when it is cleared.
    Standing,
}

/// What an update did.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Transition {
    /// From `Starting` to `Healthy`.
    Started,
    /// To `Raised`.
    Raised,
    /// From `Raised` to `Standing`.
    Stood,
    /// To `Healthy`.
    Cleared,
}

/// The output.
#[derive(Clone, Debug)]
pub struct AlarmOutput<P> {
    switch: Switch<P>,
    practice: Practice,
    minimum_ticks: u64,
    state: State,
}

impl<P: OutputPin> AlarmOutput<P> {
    /// An output that has not been told anything. `polarity`: the level that energises; `minimum_ticks`: how long an
    /// alarm is shown at least. The pin keeps its level until the first update: the board sets it to not energised.
    pub const fn new(pin: P, polarity: Polarity, practice: Practice, minimum_ticks: u64) -> Self {
        Self { switch: Switch::new(pin, polarity), practice, minimum_ticks, state: State::Starting }
    }

    /// Tells the output whether an alarm stands; to be called at least once per wrap of the tick counter. Gives the
    /// transition, if there was one.
    ///
    /// # Errors
    /// The pin's own. The state has moved on as it would have, and the next update writes again.
    pub fn update(&mut self, alarm: bool, now: u32) -> Result<Option<Transition>, P::Error> {
        let transition = self.step(alarm, now);
        let energised = self.is_alarm() == (self.practice == Practice::EnergisedInAlarm);
        self.switch.set(energised)?;
        Ok(transition)
    }

    fn step(&mut self, alarm: bool, now: u32) -> Option<Transition> {
        let (state, transition) = match &mut self.state {
            State::Starting | State::Healthy if alarm => self.raised(now),
            State::Starting => (State::Healthy, Transition::Started),
            State::Raised(minimum) => match (minimum.poll(now), alarm) {
                (false, _) => return None,
                (true, true) => (State::Standing, Transition::Stood),
                (true, false) => (State::Healthy, Transition::Cleared),
            },
            State::Standing if !alarm => (State::Healthy, Transition::Cleared),
            State::Healthy | State::Standing => return None,
        };
        self.state = state;
        Some(transition)
    }

    fn raised(&self, now: u32) -> (State, Transition) {
        (State::Raised(Countdown::start(self.minimum_ticks, now)), Transition::Raised)
    }

    /// What the output says.
    pub const fn state(&self) -> State {
        self.state
    }

    /// Whether the output says that an alarm stands.
    pub const fn is_alarm(&self) -> bool {
        matches!(self.state, State::Raised(_) | State::Standing)
    }
}
