//! A duration that runs down while a wrapping tick counter is polled.

/// Ticks still to pass.
///
/// Durations may exceed the counter's wrap; polls must come at least once per wrap (2^32 ticks), or whole wraps go
/// uncounted and the duration ends later than it should, never earlier.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Countdown {
    left: u64,
    polled: u32,
}

impl Countdown {
    /// Starts at a tick.
    pub const fn start(ticks: u64, now: u32) -> Self {
        Self { left: ticks, polled: now }
    }

    /// Takes off what has passed since the last poll; whether the duration is over.
    pub fn poll(&mut self, now: u32) -> bool {
        let passed = now.wrapping_sub(self.polled);
        self.left = self.left.saturating_sub(passed.into());
        self.polled = now;
        self.left == 0
    }
}

/// Ticks of a duration in milliseconds, rounded up.
pub const fn ticks_of_ms(milliseconds: u32, ticks_per_second: u32) -> u64 {
    (milliseconds as u64 * ticks_per_second as u64).div_ceil(1000)
}
