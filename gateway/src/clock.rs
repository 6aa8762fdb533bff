//! The two clocks: the wall's, which people set, and the steady one, which shows that they did.

use std::time::{Duration, Instant, SystemTime};

/// Difference between the two clocks' advances that counts as a jump, microseconds.
pub const JUMP_US: i64 = 2_000_000;

/// Wall clock, microseconds since 1970.
pub fn wall_us() -> i64 {
    let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or(Duration::ZERO);
    since.as_micros() as i64
}

/// Steady clock, microseconds since `start`.
pub fn steady_us(start: Instant) -> i64 {
    start.elapsed().as_micros() as i64
}

/// Compares the clocks.
#[derive(Clone, Copy, Debug, Default)]
pub struct JumpWatch {
    offset_us: Option<i64>,
}

impl JumpWatch {
    /// Both clocks at one instant; gives by how much the wall clock jumped since the last look, microseconds.
    pub fn look(&mut self, wall_us: i64, steady_us: i64) -> Option<i64> {
        let offset = wall_us - steady_us;
        let jump = offset - self.offset_us.unwrap_or(offset);
        // Small steps of a disciplined clock are followed, so that they do not add up to a jump.
        self.offset_us = Some(offset);
        (jump.abs() > JUMP_US).then_some(jump)
    }
}
