//! A node's ticks as wall clock.
//!
//! A frame is received after its content happened, never before: the smallest difference of reception and ticks is of
//! the frame that waited least. A crystal that is slow makes all later differences larger, so the smallest one ages:
//! it grows by [`SLOWEST_PPM`] until another frame is below it. A crystal that is fast makes them smaller by itself.

use serde::{Deserialize, Serialize};

/// How slow a node's crystal may be against the wall clock, parts per million: crystals have 20 to 50, and the more
/// is allowed, the more of a frame's delay is taken for it.
const SLOWEST_PPM: i64 = 100;

/// Relation of one node's ticks to the wall clock, since its start.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TimeBase {
    /// Of the frame that waited least: wall clock at tick zero, and reception, microseconds.
    least_us: Option<(i64, i64)>,
    /// Newest content: by ticks, and as wall clock, microseconds.
    newest_us: Option<(i64, i64)>,
}

impl TimeBase {
    /// Wall clock of what happened at `since_us` by the node's ticks, microseconds. Later ticks never have an earlier
    /// time, nor earlier ones a later time, than the newest content had.
    pub fn time(&mut self, since_us: i64, received_us: i64) -> i64 {
        let zero_us = self.zero(received_us - since_us, received_us);
        let time_us = zero_us + since_us;
        match self.newest_us {
            Some((since, newest_us)) if since_us < since => time_us.min(newest_us),
            newest => {
                let time_us = newest.map_or(time_us, |(_, newest_us)| time_us.max(newest_us));
                self.newest_us = Some((since_us, time_us));
                time_us
            }
        }
    }

    /// Wall clock at tick zero: this frame's own, or the aged smallest one.
    fn zero(&mut self, own_us: i64, received_us: i64) -> i64 {
        if let Some((least_us, at_us)) = self.least_us {
            let aged_us = least_us + (received_us - at_us).max(0) * SLOWEST_PPM / 1_000_000;
            if aged_us < own_us {
                return aged_us;
            }
        }
        self.least_us = Some((own_us, received_us));
        own_us
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND_US: i64 = 1_000_000;
    const DAY_S: i64 = 86_400;
    /// Time between frames, s.
    const STEP_S: i64 = 10;
    /// What a time may be off, microseconds.
    const OFF_US: i64 = 100_000;

    /// Xorshift: link delays of up to 80 ms, and of up to 5 s for one frame in twenty; the same on every run.
    struct Link(u64);

    impl Link {
        fn delay_us(&mut self) -> i64 {
            self.0 ^= self.0 << 13;
            self.0 ^= self.0 >> 7;
            self.0 ^= self.0 << 17;
            let spread_us = if self.0.is_multiple_of(20) { 5 * SECOND_US } else { 80_000 };
            ((self.0 >> 16) % spread_us as u64) as i64
        }
    }

    /// Errors of the times of frames, and whether a later tick had an earlier time, over a year with three silent days.
    fn year(ppm: f64) -> (i64, i64, bool) {
        let (mut base, mut link) = (TimeBase::default(), Link(0x9e37_79b9_7f4a_7c15));
        let (mut least, mut most, mut back, mut former) = (0, 0, false, i64::MIN);
        let silent = 200 * DAY_S..203 * DAY_S;
        for second in (0..365 * DAY_S).step_by(STEP_S as usize).filter(|second| !silent.contains(second)) {
            let true_us = second * SECOND_US;
            let ticks_us = (true_us as f64 * (1.0 + ppm * 1e-6)) as i64;
            // A first frame has nothing but itself to go by: its delay is its error.
            let first = [0, silent.end].iter().any(|begin| (*begin..begin + STEP_S).contains(&second));
            let delay_us = if first { 1000 } else { link.delay_us() };
            let time_us = base.time(ticks_us, true_us + delay_us);
            (least, most) = (least.min(time_us - true_us), most.max(time_us - true_us));
            back |= time_us < former;
            former = time_us;
        }
        (least, most, back)
    }

    #[test]
    fn theory_a_slow_or_fast_crystal_is_followed_for_a_year_and_time_never_runs_backwards() {
        for ppm in [-20.0, 0.0, 20.0] {
            let (least, most, back) = year(ppm);
            assert!(-OFF_US < least && most < OFF_US, "{ppm} ppm: {least} to {most} us off");
            assert!(!back, "{ppm} ppm");
        }
    }

    #[test]
    fn fault_a_wall_clock_that_is_put_back_a_little_stops_time_and_does_not_turn_it_back() {
        let mut base = TimeBase::default();
        // By ticks 0 s, 1 s, then a second is taken from the wall clock; older content; and on.
        let times = [(0, 0), (1000, 1000), (1500, 500), (1200, 600), (2500, 1500), (4000, 3000)]
            .map(|(since_ms, received_ms)| base.time(1000 * since_ms, 1000 * received_ms) / 1000);
        assert_eq!(times, [0, 1000, 1000, 200, 1500, 3000]);
    }
}
