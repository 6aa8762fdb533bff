//! Instants at which the pinion has made a whole turn, from the tracker's accepted pulses.
//!
//! A mark lies every `pulses per turn / pinion turns per tach turn` positions of the wheel. Where that is a pulse (the
//! wheel sits on the pinion) the mark is the pulse itself, always of the same tooth, so that errors of the wheel's
//! pitch cancel. Elsewhere it is interpolated between pulses by the parabola through the last three: at a relative
//! change of speed r per position the error is 0.2 r^2 positions.
//!
//! Positions are counted in 2^-32 and never rounded anew, so the marks do not drift against the pulses. The angle of
//! the first mark is arbitrary; a new lock of the tracker starts with another one and is reported as a break.

use crate::config::TachWheel;
use crate::tach::TachTracker;

/// More marks than this in one gap between pulses are left out: no wheel that coarse can place them.
const MOST_PER_PULSE: u32 = 8;

#[derive(Clone, Copy, Debug, Default)]
struct Pulse {
    instant: u64,
    position: u64,
}

/// What a pulse did.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Continuity {
    /// The marks go on.
    Kept,
    /// The tracker has locked anew: earlier marks are of another angle.
    Broken,
}

/// Generator of turn marks.
#[derive(Clone, Debug)]
pub struct TurnMarks {
    /// Positions per turn of the pinion, 2^-32.
    step_q32: u64,
    /// Position of the next mark, 2^-32, wrapping with 32 bits of whole positions.
    next_q32: u64,
    /// Newest accepted pulses, newest last.
    pulses: [Pulse; 3],
    count: usize,
    relocks: u32,
}

impl TurnMarks {
    /// For a validated wheel.
    pub fn new(wheel: &TachWheel) -> Self {
        let positions = f64::from(wheel.pulses_per_turn) / f64::from(wheel.pinion_per_tach);
        Self {
            step_q32: ((positions * 4_294_967_296.0) as u64).max(1),
            next_q32: 0,
            pulses: [Pulse::default(); 3],
            count: 0,
            relocks: 0,
        }
    }

    /// Looks at the tracker after a pulse; `mark` gets the instant of every turn completed with it.
    pub fn follow(&mut self, tach: &TachTracker, mut mark: impl FnMut(u64)) -> Continuity {
        let (instant, position) = tach.latest_pulse();
        let relocks = tach.counters().relocks;
        if relocks != self.relocks {
            self.relocks = relocks;
            self.count = 0;
            self.take(Pulse { instant, position });
            self.next_q32 = (position << 32).wrapping_add(self.step_q32);
            return Continuity::Broken;
        }
        if self.count == 0 || position == self.pulses[2].position {
            return Continuity::Kept;
        }
        self.take(Pulse { instant, position });
        for _ in 0..MOST_PER_PULSE {
            let beyond = self.next_q32.wrapping_sub(position << 32) as i64;
            if beyond > 0 {
                return Continuity::Kept;
            }
            mark(self.instant_at(beyond));
            self.next_q32 = self.next_q32.wrapping_add(self.step_q32);
        }
        self.next_q32 = (position << 32).wrapping_add(self.step_q32);
        Continuity::Kept
    }

    fn take(&mut self, pulse: Pulse) {
        self.pulses.rotate_left(1);
        self.pulses[2] = pulse;
        self.count = (self.count + 1).min(3);
    }

    /// Instant at a position, 2^-32 and at most zero, relative to the newest pulse.
    fn instant_at(&self, place_q32: i64) -> u64 {
        let [oldest, before, newest] = self.pulses;
        if place_q32 == 0 || self.count < 2 {
            return newest.instant;
        }
        let u = place_q32 as f64 / 4_294_967_296.0;
        let ticks = |pulse: &Pulse| -((newest.instant - pulse.instant) as f64);
        let places = |pulse: &Pulse| -((newest.position - pulse.position) as f64);
        let slope = ticks(&before) / places(&before);
        let bend = if self.count == 3 {
            let earlier = (ticks(&before) - ticks(&oldest)) / (places(&before) - places(&oldest));
            (slope - earlier) / -places(&oldest)
        } else {
            0.0
        };
        let since = u * (slope + (u - places(&before)) * bend);
        // Rounded to the nearest tick; `since` is negative between the pulses.
        newest.instant.saturating_add_signed((since - 0.5) as i64)
    }
}
