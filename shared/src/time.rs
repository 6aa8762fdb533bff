//! Wrapping 32-bit timer ticks extended to 64 bits.
//!
//! A 32-bit timer at 84 MHz wraps every 51 s. Each instant is taken as the one nearest to the latest known instant, so
//! events may arrive up to half a wrap early or late, and in any order within that.

/// Extends wrapping ticks; feed it at least once per half wrap (25 s at 84 MHz).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TickExtender {
    latest: u64,
}

impl TickExtender {
    /// An extender whose first instant keeps a margin of one wrap, so that slightly earlier instants stay positive.
    pub const fn new(first_tick: u32) -> Self {
        Self { latest: (1 << 32) + first_tick as u64 }
    }

    /// The 64-bit instant of `tick`; later instants move the reference, earlier ones do not.
    pub fn extend(&mut self, tick: u32) -> u64 {
        let instant = self.peek(tick);
        self.latest = self.latest.max(instant);
        instant
    }

    /// As [`Self::extend`], for the first tick known: the reference becomes its instant, even an earlier one.
    pub fn begin(&mut self, tick: u32) -> u64 {
        self.latest = self.peek(tick);
        self.latest
    }

    /// The 64-bit instant of `tick` without moving the reference.
    pub fn peek(&self, tick: u32) -> u64 {
        let difference = tick.wrapping_sub(self.latest as u32) as i32;
        self.latest.saturating_add_signed(i64::from(difference))
    }

    /// Latest instant seen.
    pub fn latest(&self) -> u64 {
        self.latest
    }
}
