//! Pitch errors of the wheel, learned from its pulses: the butt joint of a zebra tape, an eccentric ring, bolts at
//! uneven places.
//!
//! The angle of pulse k of a turn is measured by time: the gap before the pulse in the middle of a turn's window over
//! the time of that turn is its pitch, in mean pitches, exact for a constant acceleration. Means over turns give a
//! table; its sum is the place of each pulse. Once a table is known, and some pulse lies further from its even place
//! than `MIN_ERROR` and than the table's own noise, the tracker gets instants from which the error is taken: an even
//! wheel's. Where all is even within that, instants pass as they are.
//!
//! A turn that differs from the one before by more than `MAX_TURN_JUMP` has lost or added pulses, or the speed jumped:
//! places are then unknown, the table is forgotten and instants pass as they are until it is made anew, which takes
//! `TURNS` turns. The first pulse corrected keeps its instant, so that nothing jumps.
//!
//! Wheels of 2 to [`MAX_PULSES`] pulses without a gap. Cost (Cortex-M4F): about 60 instructions per pulse, 8 more per
//! pulse once a turn. Sources: Resor, Trethewey, Maynard, "Compensation for encoder geometry and shaft speed
//! variation", JSV 286 (2005); zebra tape butt joint correction of order trackers.

use crate::math;

/// Most pulses per turn of a wheel whose pitch is learned; finer ones are encoders.
pub const MAX_PULSES: usize = 64;
/// Unit of the tables, pitches: errors of up to two pitches.
const UNIT: f32 = 1.0 / 16_384.0;
/// Place error that is worth a correction, pitches: below it the tracker's gate holds it.
const MIN_ERROR: f32 = 0.004;
/// Place errors must exceed the table's noise by this factor.
const MIN_NOISE_RATIO: f32 = 5.0;
/// Largest difference of two turns a pulse apart: of a turn, and of a pitch.
const MAX_TURN_JUMP: f32 = 0.02;
const STEADY_PITCHES: f32 = 0.3;
/// Turns of a new table, and the longest memory.
const TURNS: u32 = 2;
const MAX_MEMORY_TURNS: f32 = 16.0;

/// The wheel's pitch table under way.
#[derive(Clone, Debug)]
pub struct WheelPitch {
    pulses: usize,
    /// Instants of the latest turn, in a ring; one more than pulses.
    ring: [u32; MAX_PULSES + 1],
    newest: usize,
    held: usize,
    /// Duration of the turn that ended with the pulse before, ticks.
    turn: f32,
    /// Gap before each pulse in mean pitches, less one; in [`UNIT`]s.
    gaps: [i16; MAX_PULSES],
    /// What all gaps have too much on the average, and the place of the latest pulse less its even one, pitches.
    excess: f32,
    off: f32,
    /// Which pulse of the table came last, and gaps taken.
    place: usize,
    taken: u32,
    /// Mean square by which a gap differs from its mean.
    scatter: f32,
    /// Instants are corrected, by places less this.
    from: Option<f32>,
    /// How much later than an even wheel's a pulse comes at most, pitches.
    late: f32,
}

impl WheelPitch {
    /// For a wheel of so many pulses per turn; with a gap, or too many or few pulses, nothing is learned.
    pub fn new(pulses_per_turn: u16, missing: u16) -> Self {
        let pulses = usize::from(pulses_per_turn);
        let pulses = if missing == 0 && (2..=MAX_PULSES).contains(&pulses) { pulses } else { 0 };
        Self {
            pulses,
            ring: [0; MAX_PULSES + 1],
            newest: 0,
            held: 0,
            turn: 0.0,
            gaps: [0; MAX_PULSES],
            excess: 0.0,
            off: 0.0,
            place: 0,
            taken: 0,
            scatter: 0.0,
            from: None,
            late: 0.0,
        }
    }

    /// Forgets instants and table: pulses have stopped.
    pub fn forget(&mut self) {
        (self.held, self.turn) = (0, 0.0);
        self.forget_table();
    }

    fn forget_table(&mut self) {
        (self.taken, self.place, self.scatter, self.from) = (0, 0, 0.0, None);
        (self.excess, self.off, self.late) = (0.0, 0.0, 0.0);
    }

    /// Takes the instant of a pulse; gives that of an even wheel.
    pub fn correct(&mut self, instant: u64) -> u64 {
        if self.pulses == 0 {
            return instant;
        }
        self.newest = if self.newest == self.pulses { 0 } else { self.newest + 1 };
        if let Some(place) = self.ring.get_mut(self.newest) {
            *place = instant as u32;
        }
        self.held = (self.held + 1).min(self.pulses + 1);
        if self.held <= self.pulses {
            return instant;
        }
        self.follow(instant as u32);
        let Some(from) = self.from else { return instant };
        let ticks = (self.off - from) * self.turn / self.pulses as f32;
        instant.saturating_add_signed(-math::round(ticks) as i64)
    }

    /// A whole turn is held: its duration, and the pitch in its middle.
    fn follow(&mut self, now: u32) {
        let turn = now.wrapping_sub(self.back(self.pulses)) as f32;
        let before = core::mem::replace(&mut self.turn, turn);
        if (turn - before).abs() > MAX_TURN_JUMP.min(STEADY_PITCHES / self.pulses as f32) * turn {
            self.forget_table();
            return;
        }
        self.place = if self.place + 1 >= self.pulses { 0 } else { self.place + 1 };
        let half = self.pulses / 2;
        let gap = self.back(half).wrapping_sub(self.back(half + 1)) as f32;
        // Of an odd number of pulses the middle of the gap is that of the turn; of an even one it is half a pitch off
        // it.
        let error = gap * self.pulses as f32 / turn - 1.0;
        let middle = (self.place + self.pulses - half) % self.pulses;
        let turns = self.taken / self.pulses as u32;
        let share = 1.0 / (turns as f32 + 1.0).min(MAX_MEMORY_TURNS);
        let Some(mean) = self.gaps.get_mut(middle) else { return };
        let off = error - f32::from(*mean) * UNIT;
        *mean = in_units(f32::from(*mean) * UNIT + share * off);
        if turns > 0 {
            self.scatter += (off * off - self.scatter) / (MAX_MEMORY_TURNS * self.pulses as f32).min(self.taken as f32);
        }
        self.taken = self.taken.saturating_add(1);
        if self.place == 0 && turns >= TURNS {
            self.sum_up(turns as f32);
        }
        // The table's sum up to this pulse; a whole turn's is nothing.
        let gap = f32::from(self.gaps.get(self.place).copied().unwrap_or_default()) * UNIT - self.excess;
        self.off = if self.place == 0 { gap } else { self.off + gap };
    }

    /// Places from gaps, once a turn, and whether they are worth a correction.
    fn sum_up(&mut self, turns: f32) {
        let gaps = self.gaps.iter().take(self.pulses).map(|&gap| f32::from(gap) * UNIT);
        self.excess = gaps.clone().sum::<f32>() / self.pulses as f32;
        let (mut place, mut least, mut most) = (0.0f32, 0.0f32, 0.0f32);
        for gap in gaps {
            place += gap - self.excess;
            (least, most) = (least.min(place), most.max(place));
        }
        let noise = math::sqrt(self.scatter / turns.min(MAX_MEMORY_TURNS));
        let worth = most - least > (2.0 * MIN_ERROR).max(MIN_NOISE_RATIO * noise);
        // What was corrected stays so: a correction that comes and goes would be a jitter of its own.
        if worth && self.from.is_none() {
            self.from = self.gaps.first().map(|&gap| f32::from(gap) * UNIT - self.excess);
        }
        self.late = self.from.map_or(0.0, |from| (most - from).max(0.0));
    }

    /// How much later than an even wheel's a pulse comes at most, pitches; 0 where nothing is corrected.
    pub fn late(&self) -> f32 {
        self.late
    }

    fn back(&self, pulses: usize) -> u32 {
        let place = if pulses <= self.newest { self.newest - pulses } else { self.newest + self.pulses + 1 - pulses };
        self.ring.get(place).copied().unwrap_or_default()
    }
}

/// Rounded, and bounded by the integer's range.
fn in_units(pitches: f32) -> i16 {
    math::round(pitches / UNIT) as i16
}
