//! One light, one code: so many short flashes, then a pause. `docs/node.md` lists the codes.

use meshband::node::State;
use meshband::units::TicksPerSecond;

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
}

impl Code {
    /// The code for a node's condition.
    pub fn of(state: State, crystal: bool, self_test_failed: bool) -> Code {
        match state {
            _ if self_test_failed => Code::SelfTestFailed,
            State::Stopped => Code::Stopped,
            State::WaitingForTach => Code::NoTach,
            State::Settling | State::Measuring if crystal => Code::Measuring,
            State::Settling | State::Measuring => Code::NoCrystal,
        }
    }

    fn flashes(self) -> u32 {
        self as u32 + 1
    }

    /// Whether the light is lit at a tick: flashes of 0.1 s every 0.3 s, a cycle of 2.4 s.
    pub fn is_lit(self, now: u32, clock: TicksPerSecond) -> bool {
        let tenths = now / (clock.0 / 10).max(1) % 24;
        tenths.is_multiple_of(3) && tenths / 3 < self.flashes()
    }
}
