//! What the light says, as numbers of flashes; `book/src/reference/node.md` lists them. Their timing is the driver's
//! ([`meshband_drivers::status_light`]).

use meshband::node::State;

/// What the light says; the most serious condition wins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Code {
    /// One flash: measuring.
    Measuring,
    /// Two: no usable speed, sampling at the safe rate.
    NoTach,
    /// Three: stopped by request.
    Stopped,
    /// Four: measuring on the internal oscillator, frequencies within 1 %.
    NoCrystal,
    /// Five: the self-test found something.
    SelfTestFailed,
    /// Six: an alarm stands.
    Alarm,
}

impl Code {
    /// The code for a node's condition.
    pub fn of(state: State, crystal: bool, self_test_failed: bool, alarm: bool) -> Code {
        match state {
            _ if alarm => Code::Alarm,
            _ if self_test_failed => Code::SelfTestFailed,
            State::Stopped => Code::Stopped,
            State::WaitingForTach => Code::NoTach,
            State::Settling | State::Measuring if crystal => Code::Measuring,
            State::Settling | State::Measuring => Code::NoCrystal,
        }
    }

    /// Flashes in each cycle.
    pub fn flashes(self) -> u8 {
        self as u8 + 1
    }
}
