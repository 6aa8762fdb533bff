//! Tachometer tracker in the revolution domain: from pulse instants to speed, angle, and how far to trust them.
//!
//! Every pulse belongs to an integer *position* on the wheel. An [`AngleFilter`] predicts when positions pass, with
//! speed, acceleration and the size of its own errors; each pulse is given the nearest position and corrects it.
//! Gains count pulses, not seconds, and one setting serves 1000:1 in speed.
//!
//! A pulse at no position is rejected (spurious); a skipped position is counted (missed). Either only *lowers the
//! validity*; the tracker is re-opened by evidence, never by time alone: four pulses whose three gaps agree with one
//! constant acceleration start a new track, whatever was tracked before. Two of them at a fraction of the tracked
//! period may be noise, so while they fit both hypotheses, the speed is flagged instead of changed.
//!
//! An edge close behind a pulse is a bounce, a scratch or the second flank of a keyway: when the next pulse shows that
//! it lay in the first [`BOUNCE`] of the interval it is counted and nothing else; further behind it may be a pulse of a
//! faster shaft, which is doubt.
//!
//! Uneven pitches are learned and taken off the instants before anything else sees them
//! ([`wheel_pitch`](super::wheel_pitch)).
//!
//! A wheel with adjacent missing teeth has the same equidistant positions; its gap is learned from pulses that follow
//! one wheel-gap and confirmed by the next pulse. Direction is not observable from one track.
//!
//! What a wheel cannot see: speed that wanders faster than a third of the pulse rate looks like jitter. The speed is
//! then the mean, and its uncertainty that of the mean.
//!
//! Cost (Cortex-M4F in QEMU): 660 instructions per pulse.
//! Prior art: engine decoders (relative gap rejection, re-opening, tooth angle error), RPLL of idsp (test harness).

use super::wheel_pitch::WheelPitch;
use crate::angle_filter::{AngleFilter, Motion, Pulse, WIDEST_GATE};
use crate::config::TachWheel;
use crate::units::{Hertz, TicksPerSecond, TurnFraction};
use serde::{Deserialize, Serialize};

/// Turns a steady speed is averaged over, at most, and pulses of a coarse wheel.
const LONGEST_TURNS: f32 = 8.0;
const LONGEST_PULSES: f32 = 32.0;
/// Positions that may pass without a pulse before tracking starts anew.
const REOPEN_AFTER: u64 = 8;
/// Agreement of four pulses with one constant acceleration that starts a new track, positions.
const AGREEMENT: f32 = 0.03;
/// The same against a track whose pulses still come.
const RIVAL_AGREEMENT: f32 = 0.003;

/// Share of the interval between two pulses in which an edge is no pulse of a faster shaft.
const BOUNCE: u64 = 3;
/// Intervals in a row with an edge that may be a faster shaft's pulse, after which it is said.
const MAX_SPLIT_INTERVALS: u8 = 8;

/// How far a speed can be trusted. Only `Locked` is a measurement.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Validity {
    /// No speed: too few pulses, or none for too long.
    #[default]
    None,
    /// Pulses contradict the tracked speed, or the next one is overdue.
    Doubtful,
    /// Tracked, and the latest pulses agree.
    Locked,
}

/// Counters since start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TachCounters {
    /// Pulses accepted.
    pub accepted: u32,
    /// Positions without a pulse, apart from the wheel's own gap.
    pub missed: u32,
    /// Pulses rejected.
    pub spurious: u32,
    /// Fits started anew.
    pub relocks: u32,
}

/// Speed of the pinion at an instant.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Speed {
    /// Pinion rate.
    pub pinion: Hertz,
    /// Relative standard uncertainty.
    pub uncertainty: f32,
    /// Pinion acceleration, Hz/s.
    pub acceleration_hz_per_s: f32,
    /// Time since the latest accepted pulse, s; of a node since its start where none came.
    pub age_s: f32,
    /// Trust.
    pub validity: Validity,
    /// Latest prediction error, positions: the quality of wheel and pick-up.
    pub pulse_error: f32,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Lock {
    Acquiring,
    Locked,
    /// Contradicted; this many pulses in a row must agree before the speed counts again.
    Doubtful {
        needed: u8,
    },
}

/// The tracker.
#[derive(Clone, Debug)]
pub struct TachTracker {
    wheel: TachWheel,
    clock: TicksPerSecond,
    pitch: WheelPitch,
    /// Newest edge as it came, before any correction, and the latest one too close behind it.
    edge: u64,
    split: Option<u64>,
    /// Intervals in a row that were split as by a faster shaft.
    splits: u8,
    shortest_gap: u64,
    longest_gap: u64,
    lock: Lock,
    /// Newest raw pulses, newest last.
    raw: [u64; 5],
    raw_count: usize,
    /// How many of the newest raw pulses were accepted, as bits.
    raw_accepted: u8,
    filter: AngleFilter,
    /// Position of a pulse that was rejected just outside the gate.
    near_miss: Option<u64>,
    /// Position (modulo the wheel) of the first tooth after the gap, once confirmed.
    index: Option<u64>,
    index_candidate: Option<u64>,
    counters: TachCounters,
}

impl TachTracker {
    /// A tracker for a validated wheel.
    pub fn new(wheel: TachWheel, clock: TicksPerSecond) -> Self {
        let positions = u64::from(wheel.pulses_per_turn.max(1));
        let ticks = |hz: f32| (clock.0 as f32 / (hz * positions as f32)) as u64;
        Self {
            wheel,
            clock,
            pitch: WheelPitch::new(wheel.pulses_per_turn, wheel.missing),
            edge: 0,
            split: None,
            splits: 0,
            shortest_gap: ticks(wheel.highest.0).max(2) * 9 / 10,
            longest_gap: ticks(wheel.lowest.0) * (1 + u64::from(wheel.missing)) * 3 / 2,
            lock: Lock::Acquiring,
            raw: [0; 5],
            raw_count: 0,
            raw_accepted: 0,
            filter: AngleFilter::new((LONGEST_TURNS * positions as f32).max(LONGEST_PULSES)),
            near_miss: None,
            index: None,
            index_candidate: None,
            counters: TachCounters::default(),
        }
    }

    /// Begins anew with another wheel; the counters go on.
    pub fn for_wheel(&self, wheel: TachWheel) -> Self {
        Self { counters: self.counters, ..Self::new(wheel, self.clock) }
    }

    /// Takes a pulse at a 64-bit instant. Pulses that go back in time or come faster than the shaft can are rejected.
    pub fn on_pulse(&mut self, instant: u64) {
        if self.raw_count > 0 {
            if instant < self.edge.saturating_add(self.shortest_gap) {
                self.counters.spurious = self.counters.spurious.saturating_add(1);
                self.split = Some(instant.max(self.edge));
                return;
            }
            self.judge_split(instant);
            if instant - self.edge > self.longest_gap {
                self.start_acquiring();
                self.pitch.forget();
            }
        }
        self.edge = instant;
        let instant = self.pitch.correct(instant);
        if self.raw_count > 0 && instant <= self.raw[4] {
            // A table that puts pulses in another order is of another wheel.
            self.counters.spurious = self.counters.spurious.saturating_add(1);
            self.pitch.forget();
            self.start_acquiring();
            return;
        }
        self.raw.rotate_left(1);
        self.raw[4] = instant;
        self.raw_count = (self.raw_count + 1).min(5);
        self.raw_accepted <<= 1;
        if self.lock != Lock::Acquiring {
            self.track(instant);
        }
        if self.lock != Lock::Locked {
            self.try_acquire();
        }
    }

    /// An interval has ended that an edge had split: by a bounce, or by a pulse of a faster shaft.
    fn judge_split(&mut self, instant: u64) {
        let bounce = |split: u64| (split - self.edge).saturating_mul(BOUNCE) < instant - self.edge;
        if self.split.take().is_some_and(|split| !bounce(split)) {
            self.splits = self.splits.saturating_add(1);
            self.doubt();
        } else {
            self.splits = 0;
        }
    }

    /// Whether edges come as of a shaft that is faster than the wheel's highest rate.
    pub fn is_too_fast(&self) -> bool {
        self.splits >= MAX_SPLIT_INTERVALS
    }

    fn track(&mut self, instant: u64) {
        let (steps, error) = self.filter.steps(instant);
        if steps > REOPEN_AFTER + u64::from(self.wheel.missing) {
            self.start_acquiring();
            self.raw[4] = instant;
            self.raw_count = 1;
            return;
        }
        let position = self.filter.last().position + steps;
        if self.near_miss.is_some_and(|missed| position > missed) {
            // Nothing better came for that position: it was its pulse.
            self.near_miss = None;
            self.filter.widen();
        }
        if steps == 0 || error.abs() > self.filter.gate() {
            if steps > 0 && error.abs() < WIDEST_GATE {
                self.near_miss = Some(position);
            }
            self.counters.spurious = self.counters.spurious.saturating_add(1);
            self.doubt();
            return;
        }
        let skipped = steps - 1 - self.wheel_gap(steps).min(steps - 1);
        // Pulses with two or more lost in between are no evidence for the tracked speed.
        self.raw_accepted |= u8::from(skipped < 2);
        self.counters.missed = self.counters.missed.saturating_add(skipped as u32);
        self.counters.accepted = self.counters.accepted.saturating_add(1);
        self.learn_index(steps);
        self.near_miss = None;
        let motion = self.filter.take(instant, steps, error);
        self.lock = match self.lock {
            Lock::Locked | Lock::Doubtful { needed: 1 } if motion == Motion::Changed => Lock::Doubtful { needed: 2 },
            // The next pulse tells.
            Lock::Locked if motion == Motion::Unusual && skipped == 0 => Lock::Doubtful { needed: 1 },
            // Two positions lost in a row are more likely another speed.
            Lock::Doubtful { needed } if skipped > 0 => Lock::Doubtful { needed: needed.max(skipped.min(2) as u8) },
            _ if skipped > 0 => Lock::Doubtful { needed: skipped.min(2) as u8 },
            Lock::Doubtful { needed } if needed > 1 || self.rival().is_some() => {
                Lock::Doubtful { needed: needed.saturating_sub(1).max(1) }
            }
            _ => Lock::Locked,
        };
    }

    /// Positions of the wheel's own gap among the steps since the last pulse.
    fn wheel_gap(&self, steps: u64) -> u64 {
        let missing = u64::from(self.wheel.missing);
        if missing == 0 || steps <= missing {
            return 0;
        }
        let positions = u64::from(self.wheel.pulses_per_turn.max(1));
        match self.index {
            Some(index) => {
                let to_index = (index + positions - self.filter.last().position % positions) % positions;
                if to_index > 0 && to_index <= steps { missing } else { 0 }
            }
            None => missing,
        }
    }

    /// A gap of exactly the missing teeth, followed by a single step, marks the first tooth; seen twice at the same
    /// place it is believed.
    fn learn_index(&mut self, steps: u64) {
        let missing = u64::from(self.wheel.missing);
        if missing == 0 {
            return;
        }
        let positions = u64::from(self.wheel.pulses_per_turn.max(1));
        if steps == missing + 1 {
            let place = (self.filter.last().position + steps) % positions;
            if self.index_candidate == Some(place) {
                self.index = Some(place);
            }
            self.index_candidate = Some(place);
        }
    }

    fn doubt(&mut self) {
        match &mut self.lock {
            Lock::Acquiring => {}
            Lock::Doubtful { needed } => *needed = (*needed).max(2),
            Lock::Locked => self.lock = Lock::Doubtful { needed: 2 },
        }
    }

    fn start_acquiring(&mut self) {
        self.lock = Lock::Acquiring;
        self.raw_count = 0;
        self.raw_accepted = 0;
        self.index = None;
        self.index_candidate = None;
    }

    /// Gap of the newest pulses if three gaps agree with one constant acceleration and not with the tracked speed.
    fn rival(&self) -> Option<u64> {
        if self.raw_count < 4 {
            return None;
        }
        let [_, a, b, c, d] = self.raw;
        let gaps = [(b - a) as f32, (c - b) as f32, (d - c) as f32];
        let widest = if self.lock == Lock::Acquiring { 1.3 } else { 2.5 };
        let ratio = |x: f32, y: f32| x < widest * y && y < widest * x;
        if !(ratio(gaps[0], gaps[1]) && ratio(gaps[1], gaps[2])) {
            return None;
        }
        // Speeds at the middles of the gaps lie on a line.
        let rates = [1.0 / gaps[0], 1.0 / gaps[1]];
        let acceleration = (rates[1] - rates[0]) / (0.5 * (gaps[0] + gaps[1]));
        let predicted = rates[1] + acceleration * 0.5 * (gaps[1] + gaps[2]);
        // While the tracked positions are still met, chance alone must not unseat them.
        let met = self.lock != Lock::Acquiring && self.filter.place(d.saturating_sub(self.filter.last().instant)) < 1.3;
        let agrees = (predicted * gaps[2] - 1.0).abs() < if met { RIVAL_AGREEMENT } else { AGREEMENT };
        let gap = d - c;
        let tracked = self.tracked_period();
        // A speed near the tracked one is no rival unless its pulses all come at the wrong angle: one noise pulse
        // beside its true one would bend it.
        let near = gap.abs_diff(tracked) as f32 <= WIDEST_GATE * tracked as f32;
        let same = near && self.raw_accepted & 0b111 != 0;
        (agrees && !same).then_some(gap)
    }

    fn try_acquire(&mut self) {
        let Some(gap) = self.rival() else { return };
        let accepted = if self.lock == Lock::Acquiring { 0 } else { (self.raw_accepted & 0b1111).count_ones() };
        if accepted > 1 {
            // The tracked speed explains some of these pulses as well: wait for a fourth equal gap.
            let near = |x: u64, y: u64| x.abs_diff(y) as f32 <= AGREEMENT * gap as f32;
            let gaps = [1, 2, 3, 4].map(|n| self.raw[n] - self.raw[n - 1]);
            if self.raw_count < 5 || !gaps.iter().all(|&other| near(other, gap)) {
                return;
            }
        }
        // Two noise pulses can imitate a slightly different speed, hardly one beyond a factor of 1.5: confirm the
        // former.
        let tracked = self.tracked_period();
        let similar = gap < tracked + tracked / 2 && tracked < gap + gap / 2;
        self.counters.relocks = self.counters.relocks.saturating_add(1);
        self.counters.accepted = self.counters.accepted.saturating_add(4);
        self.index = None;
        self.index_candidate = None;
        let [_, a, b, c, d] = self.raw;
        self.near_miss = None;
        // Nearly the same speed again: it is less steady than was believed. Another one tells nothing about steadiness.
        if similar {
            self.filter.widen()
        } else {
            self.filter.reset_gate()
        }
        self.filter.start([a, b, c, d], self.filter.last().position + 4);
        self.lock = match (accepted > 1, similar) {
            (true, _) => Lock::Doubtful { needed: 6 },
            (false, true) => Lock::Doubtful { needed: 2 },
            // Every other pulse of a shaft beyond the wheel's highest rate agrees with half of its speed.
            _ if self.splits > 0 => Lock::Doubtful { needed: 2 },
            (false, false) => Lock::Locked,
        };
        self.raw_accepted = 0b1111;
    }

    /// Ticks per position of the tracked speed; 0 without one.
    fn tracked_period(&self) -> u64 {
        if self.lock == Lock::Acquiring { 0 } else { self.filter.present_period() as u64 }
    }

    /// Speed at an instant; a pulse that is overdue then lowers the validity.
    pub fn speed(&self, now: u64) -> Speed {
        let age = now.saturating_sub(self.filter.last().instant);
        if self.lock == Lock::Acquiring {
            return Speed { age_s: self.clock.seconds(age), ..Speed::default() };
        }
        let ticks_per_second = self.clock.0 as f32;
        let pinion_per_position = self.wheel.pinion_per_tach / f32::from(self.wheel.pulses_per_turn);
        let due = 1.0 + f32::from(self.wheel.missing) + self.filter.gate() + self.pitch.late();
        let validity = match self.lock {
            _ if age > self.longest_gap => Validity::None,
            Lock::Locked if self.filter.place(age) <= due => Validity::Locked,
            _ => Validity::Doubtful,
        };
        Speed {
            pinion: Hertz(self.filter.rate(age) * ticks_per_second * pinion_per_position),
            uncertainty: self.filter.uncertainty(),
            acceleration_hz_per_s: self.filter.acceleration()
                * ticks_per_second
                * ticks_per_second
                * pinion_per_position,
            age_s: self.clock.seconds(age),
            validity,
            pulse_error: self.filter.error(),
        }
    }

    /// Angle of the tach shaft at an instant, from the first tooth after the gap or from an arbitrary pulse.
    pub fn tach_angle(&self, instant: u64) -> TurnFraction {
        let positions = u64::from(self.wheel.pulses_per_turn.max(1));
        let index = self.index.unwrap_or(0);
        let Pulse { instant: last, position } = self.filter.last();
        let whole = (position + positions - index) % positions;
        let place =
            if instant >= last { self.filter.place(instant - last) } else { self.filter.place_before(last - instant) };
        let part = TurnFraction::from_turns(place / positions as f32);
        TurnFraction((((whole << 32) / positions) as u32).wrapping_add(part.0))
    }

    /// Position (modulo the wheel) of the first tooth behind the gap; `None` until it is found, and for wheels without
    /// one.
    pub fn index(&self) -> Option<u64> {
        self.index
    }

    /// Whether the wheel's gap has been found (always for wheels without one).
    pub fn is_indexed(&self) -> bool {
        self.wheel.missing == 0 || self.index.is_some()
    }

    /// Latest accepted pulse: instant and position count.
    pub fn latest_pulse(&self) -> (u64, u64) {
        let Pulse { instant, position } = self.filter.last();
        (instant, position)
    }

    /// Counters since start.
    pub fn counters(&self) -> TachCounters {
        self.counters
    }
}
