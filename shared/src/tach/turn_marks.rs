//! Instants at which the pinion has made a whole turn, from the tracker's accepted pulses.
//!
//! A mark lies every `pulses per turn / pinion turns per tach turn` positions of the wheel. Where that is a pulse (the
//! wheel sits on the pinion) the mark is the pulse itself, always of the same tooth, so that errors of the wheel's
//! pitch cancel. Elsewhere it is interpolated between pulses by the parabola through the last three: at a relative
//! change of speed r per position the error is 0.2 r^2 positions.
//!
//! The ratio of both shafts is one of whole numbers, the simplest fraction that the configured number can stand for
//! ([`Ratio`]); positions are counted in 2^-32 with the rest of the division carried on, so the marks never drift
//! against the pulses.
//!
//! Where the pinion makes whole turns per turn of a wheel with a gap, or with one pulse, marks lie at the first tooth
//! behind the gap, or at the pulse: their phase is the same after every start ([`TurnMarks::is_absolute`]). Elsewhere
//! the angle of the first mark is arbitrary; a new lock of the tracker starts with another one and is reported as a
//! break, and so is the finding of the gap.

use crate::config::TachWheel;
use crate::tach::TachTracker;

/// More marks than this in one gap between pulses are left out: no wheel that coarse can place them.
const MAX_MARKS_PER_PULSE: u32 = 64;
/// Largest relative difference of a fraction from the configured number: two of its last places.
const FRACTION_TOLERANCE_SHARE: f64 = 2.4e-7;
/// Largest denominator of a fraction: two stages of a hundred teeth and more.
const LARGEST_DENOMINATOR: u64 = 20_000;

/// Most turns of the tach shaft in a ratio: times 1024 positions they fit 64 bits with room to spare.
const LARGEST_TACH_TURNS: u64 = 1 << 52;

/// A ratio of whole numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ratio {
    /// Turns of the pinion.
    pub pinion: u64,
    /// In so many turns of the tach shaft.
    pub tach: u64,
}

impl Ratio {
    /// The simplest fraction that is a number but for its last places, by continued fractions; where there is none, the
    /// number itself in 2^-22.
    pub fn of(number: f32) -> Self {
        let exact = f64::from(number).max(1e-6);
        let (mut before, mut convergent) = ((0u64, 1u64), (1u64, 0u64));
        let mut rest = exact;
        for _ in 0..24 {
            let whole = rest as u64;
            let next = |of: u64, before: u64| whole.saturating_mul(of).saturating_add(before);
            let (p, q) = (next(convergent.0, before.0), next(convergent.1, before.1));
            if q > LARGEST_DENOMINATOR {
                break;
            }
            (before, convergent) = (convergent, (p, q));
            if (p as f64 / q as f64 / exact - 1.0).abs() <= FRACTION_TOLERANCE_SHARE && p > 0 {
                return Self { pinion: p, tach: q };
            }
            let part = rest - whole as f64;
            if part < 1e-12 {
                break;
            }
            rest = 1.0 / part;
        }
        // Up to a thousand turns of the pinion fit 32 bits: see `TurnMarks::new`.
        Self { pinion: ((exact * 4_194_304.0) as u64).clamp(1, u64::from(u32::MAX)), tach: 4_194_304 }
    }

    /// The ratio of a shaft that makes `turns` in `pinion_turns` of the pinion, in lowest terms; `None` where its turns
    /// do not fit 32 bits or the wheel's positions in them do not fit 64.
    pub fn times(self, turns: u32, pinion_turns: u32) -> Option<Self> {
        let numerator = self.pinion.checked_mul(turns.into())?;
        let denominator = self.tach.checked_mul(pinion_turns.into())?;
        let divisor = greatest_common_divisor(numerator, denominator).max(1);
        let (pinion, tach) = (numerator / divisor, denominator / divisor);
        let fits = u32::try_from(pinion).is_ok() && pinion > 0 && tach <= LARGEST_TACH_TURNS;
        fits.then_some(Self { pinion, tach })
    }
}

fn greatest_common_divisor(mut a: u64, mut b: u64) -> u64 {
    while b != 0 {
        (a, b) = (b, a % b);
    }
    a
}

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
    /// Positions per turn of the pinion, 2^-32, and the rest of that division.
    step_q32: u64,
    rest: u64,
    ratio: Ratio,
    /// Rests so far, below the ratio's turns of the pinion.
    carried: u64,
    /// Positions per turn of the wheel.
    positions: u64,
    /// First tooth behind the gap that the marks lie at, once found.
    aligned: Option<u64>,
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
        Self::with_ratio(wheel, Ratio::of(wheel.pinion_per_tach))
    }

    /// For another shaft than the pinion's, by its turns per turn of the tach shaft.
    pub fn with_ratio(wheel: &TachWheel, ratio: Ratio) -> Self {
        let positions = u64::from(wheel.pulses_per_turn.max(1));
        // Whole positions and 2^-32 of one in turn: the pinion's turns fit 32 bits.
        let turns = positions * ratio.tach;
        let (whole, left) = (turns / ratio.pinion.max(1), turns % ratio.pinion.max(1));
        let (part, rest) = ((left << 32) / ratio.pinion.max(1), (left << 32) % ratio.pinion.max(1));
        Self {
            step_q32: ((whole << 32) | part).max(1),
            rest,
            ratio,
            carried: 0,
            positions,
            aligned: None,
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
            (self.aligned, self.carried) = (None, 0);
            self.next_q32 = (position << 32).wrapping_add(self.step_q32);
            self.align(tach.index(), position);
            return Continuity::Broken;
        }
        if self.count == 0 || position == self.pulses[2].position {
            return Continuity::Kept;
        }
        self.take(Pulse { instant, position });
        if self.align(tach.index(), position) {
            return Continuity::Broken;
        }
        for _ in 0..MAX_MARKS_PER_PULSE {
            let beyond = self.next_q32.wrapping_sub(position << 32) as i64;
            if beyond > 0 {
                return Continuity::Kept;
            }
            mark(self.instant_at(beyond));
            self.step();
        }
        self.next_q32 = (position << 32).wrapping_add(self.step_q32);
        Continuity::Kept
    }

    /// Whether marks lie at the same angle of the shaft after every start.
    pub fn is_absolute(&self) -> bool {
        self.ratio.tach == 1 && self.count > 0 && (self.positions == 1 || self.aligned.is_some())
    }

    fn step(&mut self) {
        self.next_q32 = self.next_q32.wrapping_add(self.step_q32);
        self.carried += self.rest;
        if self.carried >= self.ratio.pinion {
            self.carried -= self.ratio.pinion;
            self.next_q32 = self.next_q32.wrapping_add(1);
        }
    }

    /// Lays the marks at the first tooth behind the gap, where the pinion makes whole turns per turn of the wheel; true
    /// where they moved.
    fn align(&mut self, index: Option<u64>, position: u64) -> bool {
        if index.is_none() || index == self.aligned || self.ratio.tach != 1 {
            return false;
        }
        self.aligned = index;
        let place = |at: u64| at.checked_rem(self.positions).unwrap_or(0);
        let to_index = place(index.unwrap_or(0) + self.positions - place(position));
        // The first mark behind the present position: the pinion's turns divide the wheel's.
        let ahead = if to_index == 0 { self.positions } else { to_index } << 32;
        let next = (position << 32).wrapping_add((ahead - 1).checked_rem(self.step_q32).unwrap_or(0) + 1);
        let moved = next != self.next_q32;
        (self.next_q32, self.carried) = (next, 0);
        moved
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
