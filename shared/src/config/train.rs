//! Further gears of a train: what a node follows beside its pinion.
//!
//! The order domain follows one gear at a time and goes round: the pinion ([`super::GearPair`]), then each of these. A
//! gear is known by its teeth, its mate's teeth and its turns per turn of the pinion, as whole numbers. Of a planetary
//! set the turns count against the carrier, with which sun, planet and ring pass as many teeth as each other; the ring
//! is then followed once per turn of the carrier. Names of shafts and stages are the host's business.

use super::TachWheel;
use crate::alarm::AlarmBand;
use crate::law::RISE_TIME_CONSTANT;
use crate::math;
use crate::tach::turn_marks::Ratio;
use crate::units::Hertz;
use serde::{Deserialize, Serialize};

/// Most gears of a train beside the pinion.
pub const MAX_TRAIN_GEARS: usize = 5;
/// Most stages beside the pinion's.
pub const MAX_FURTHER_STAGES: usize = 3;
/// Teeth of a gear that is followed: with fewer the bands of neighbouring mesh harmonics would overlap, with more none
/// has samples enough.
pub const TEETH: core::ops::RangeInclusive<u16> = 12..=800;
/// Teeth of its mate.
pub const MATE_TEETH: core::ops::RangeInclusive<u16> = 4..=1000;
/// Most turns of a gear from one tach pulse to the next: its turns must still be held when the mark comes.
const MAX_TURNS_PER_PULSE: f32 = 1.0;
/// Turns of a gear per turn of the pinion, either way.
const TURNS: core::ops::RangeInclusive<f32> = 0.001..=1000.0;
/// Ramp angles of an engagement edge, turns of the gear.
const RAMP_TURNS: core::ops::Range<f32> = 0.0..1.0;
/// Rise times of a mode, s.
const MODE_RISE_S: core::ops::Range<f32> = 0.0..1.0;

/// A gear beside the pinion.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct TrainGear {
    /// Its stage, from 1: gears of one stage share their mesh.
    pub stage: u8,
    /// Its teeth, 12 to 800.
    pub teeth: u16,
    /// Teeth of its mate, 4 to 1000.
    pub mate_teeth: u16,
    /// So many turns of it, against the carrier in a planetary set...
    pub turns: u32,
    /// ...in so many turns of the pinion.
    pub pinion_turns: u32,
}

/// Law of a further stage, in the physical form; zeros stand for none, and the stage then asks for its mesh harmonics.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StageLaw {
    /// Ramp angle of the engagement edge, turns of the stage's first gear in the list.
    pub ramp_turns: f32,
    /// Rise time of the dominant mode, s.
    pub mode_rise_s: f32,
}

impl TrainGear {
    /// Its turns per turn of the pinion.
    pub fn per_pinion_turn(&self) -> f32 {
        // In double precision: both numbers may have more digits than a single holds.
        (f64::from(self.turns) / f64::from(self.pinion_turns)) as f32
    }

    /// Its rate at a rate of the pinion.
    pub fn rate(&self, pinion: Hertz) -> Hertz {
        Hertz(self.per_pinion_turn() * pinion.0)
    }

    fn is_sane(&self, tach: &TachWheel) -> bool {
        let pinion_per_tach = tach.pinion_per_tach;
        let per_pulse = self.per_pinion_turn() * pinion_per_tach / f32::from(tach.pulses_per_turn.max(1));
        let turns = self.turns > 0 && self.pinion_turns > 0 && TURNS.contains(&self.per_pinion_turn());
        let teeth = TEETH.contains(&self.teeth) && MATE_TEETH.contains(&self.mate_teeth);
        // The marks count turns of the gear in 32 bits.
        let marks = || Ratio::of(pinion_per_tach).times(self.turns, self.pinion_turns).is_some();
        let stage = (1..=1 + MAX_FURTHER_STAGES as u8).contains(&self.stage);
        stage && teeth && turns && per_pulse <= MAX_TURNS_PER_PULSE && marks()
    }
}

impl StageLaw {
    /// Bandwidth at a rate of the stage's gear, Hz; `None` where there is no law.
    fn bandwidth_hz(&self, rate: Hertz) -> Option<f32> {
        let ramp_s = self.ramp_turns / rate.0.max(f32::MIN_POSITIVE);
        let rise_s = math::hypot(ramp_s, self.mode_rise_s);
        (self.ramp_turns > 0.0 || self.mode_rise_s > 0.0).then(|| RISE_TIME_CONSTANT / rise_s)
    }
}

/// What one of a train's further stages asks for at a rate of the pinion, Hz: its law's bandwidth or `harmonics` of its
/// mesh; the highest of all, 0 without any.
pub fn bandwidth_hz(gears: &[TrainGear], laws: &[StageLaw], harmonics: f32, pinion: Hertz) -> f32 {
    let of = |gear: &TrainGear| {
        let rate = gear.rate(pinion);
        let law = usize::from(gear.stage).checked_sub(2).and_then(|place| laws.get(place));
        let of_law = law.and_then(|law| law.bandwidth_hz(rate));
        of_law.unwrap_or(harmonics * f32::from(gear.teeth) * rate.0)
    };
    let first_of_stage =
        |n: usize, gear: &TrainGear| gear.stage > 1 && gears.iter().take(n).all(|before| before.stage != gear.stage);
    let firsts = gears.iter().enumerate().filter(|(n, gear)| first_of_stage(*n, gear));
    firsts.map(|(_, gear)| of(gear)).fold(0.0, f32::max)
}

/// Whether gears, laws and the gears of alarms can be used: stages do not descend, and alarms watch gears there are,
/// by quantities that gears have.
pub(super) fn are_sane(
    gears: &[TrainGear],
    laws: &[StageLaw],
    (alarms, alarm_gears): (&[AlarmBand], &[u8]),
    tach: &TachWheel,
) -> bool {
    let ascending = gears.windows(2).all(|pair| pair[0].stage <= pair[1].stage);
    let laws = laws.iter().all(|law| RAMP_TURNS.contains(&law.ramp_turns) && MODE_RISE_S.contains(&law.mode_rise_s));
    let is_of_gear = |(band, gear): (&AlarmBand, &u8)| *gear == 0 || band.watched.is_of_gear();
    let alarms = alarm_gears.len() <= alarms.len()
        && alarm_gears.iter().all(|gear| usize::from(*gear) <= gears.len())
        && alarms.iter().zip(alarm_gears).all(is_of_gear);
    ascending && laws && alarms && gears.iter().all(|gear| gear.is_sane(tach))
}
