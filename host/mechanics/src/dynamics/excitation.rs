//! The interface through which an effect enters the model: composable, one object per effect.
//!
//! An effect contributes any of: a change of the pinion's angle, a shift of the contact on its path, an
//! error or a stiffness factor of single tooth pairs, friction of single pairs, external forces, a
//! modulation of bearing stiffness, contact nonlinearity, and stages of the measuring chain. Everything
//! time-varying is handed over as a Taylor [`Series`] over the coming step, built with series
//! arithmetic, so that the solver keeps its full order. Places where a contribution is not smooth are
//! announced as breaks in time or as knots on the path; the solver ends a step there.

use super::series::Series;
use crate::Result;

/// What an effect may ask about the machine and its operating point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Facts {
    /// Teeth of pinion and gear.
    pub teeth: [u32; 2],
    /// Base radii, m.
    pub base_radius_m: [f64; 2],
    /// Base pitch, m.
    pub base_pitch_m: f64,
    /// Pressure angle, rad.
    pub pressure_angle_rad: f64,
    /// Length of the path of contact, base pitches.
    pub path_base_pitches: f64,
    /// Position of the pitch point on the path, base pitches.
    pub pitch_point_base_pitches: f64,
    /// Body masses, kg.
    pub mass_kg: [f64; 2],
    /// Torque at the motor, N m.
    pub input_torque_n_m: f64,
    /// Bearing stiffness, N/m.
    pub bearing_stiffness_n_per_m: [f64; 2],
}

impl Facts {
    /// Distance of the contact from the base tangent point of gear `body` at path position `s`, m.
    pub fn roll_distance_m(&self, body: usize, s: &Series) -> Series {
        let at_pitch = self.base_radius_m[body] * self.pressure_angle_rad.tan();
        let sign = if body == 0 { 1.0 } else { -1.0 };
        let mut distance = s.scaled(sign * self.base_pitch_m);
        distance.add_constant(at_pitch - sign * self.pitch_point_base_pitches * self.base_pitch_m);
        distance
    }
}

/// The coming step as an effect sees it.
#[derive(Debug, Clone, Copy)]
pub struct Moment<'a> {
    /// Machine and operating point.
    pub facts: &'a Facts,
    /// Start of the step, s.
    pub start_s: f64,
    /// Length of the step, s: one unit of the series' time.
    pub length_s: f64,
    /// Angles of pinion and gear, rad, positive in the driven sense.
    pub angle_rad: [Series; 2],
}

impl Moment<'_> {
    /// Time over the step, s.
    pub fn time_s(&self) -> Series {
        Series::linear(self.start_s, self.length_s)
    }

    /// Angular speed of gear `body`, rad/s.
    pub fn speed_rad_s(&self, body: usize) -> Series {
        self.angle_rad[body].derivative().scaled(1.0 / self.length_s)
    }
}

/// One tooth pair on the path during the coming step.
#[derive(Debug, Clone, Copy)]
pub struct PairOnPath {
    /// Number of the pair: 0 entered the path at pinion angle 0.
    pub number: i64,
    /// Tooth of pinion and gear, each counted from its own tooth 0 of pair 0.
    pub tooth: [u32; 2],
    /// Position on the path, base pitches from the start of contact.
    pub position: Series,
}

/// Where an external force acts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// Torque on the motor, N m (on the pinion if the model has no motor).
    Motor,
    /// Torque on the load, N m, positive in the driven sense (on the gear if the model has no load).
    Load,
    /// Force on gear body 0 or 1 across the line of action, N.
    Across(usize),
    /// Force on gear body 0 or 1 along the line of action, N.
    Along(usize),
}

/// External forces of a step.
#[derive(Debug, Default)]
pub struct Forces(pub Vec<(Place, Series)>);

impl Forces {
    /// Adds a force or torque at a place.
    pub fn add(&mut self, place: Place, value: Series) {
        self.0.push((place, value));
    }
}

/// How tooth pairs may lose contact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Backlash {
    /// Clearance along the line of action between drive and coast flank, m.
    pub clearance_m: f64,
}

/// Sampled channels on their way through the measuring chain.
#[derive(Debug)]
pub struct Sampled<'a> {
    /// One vector per channel, m/s2, uniformly sampled from time 0.
    pub channels: &'a mut [Vec<f64>],
    /// Sampling rate, Hz.
    pub rate_hz: f64,
    /// Seed of this run's random streams.
    pub seed: u64,
    /// Pinion angle at each sample, turns.
    pub turns: &'a [f64],
    /// Machine and operating point.
    pub facts: &'a Facts,
}

/// After what the motion of the machine repeats itself, at constant speed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Recurrence {
    /// The mesh period.
    Mesh,
    /// A turn of body 0 or 1.
    Turn(usize),
    /// Nothing shorter than what both bodies' turns share.
    Never,
}

impl Recurrence {
    /// Of a sinusoid at `order` per turn of `body` and a fixed part `frequency_hz` of its rate.
    pub fn of_order(body: usize, order: f64, frequency_hz: f64) -> Self {
        match frequency_hz == 0.0 && order == order.round() {
            true => Self::Turn(body),
            false => Self::Never,
        }
    }

    /// Of two causes together.
    #[must_use]
    pub fn with(self, other: Self) -> Self {
        match (self, other) {
            (Self::Mesh, known) | (known, Self::Mesh) => known,
            (a, b) if a == b => a,
            _ => Self::Never,
        }
    }
}

/// One effect. Every method has a neutral default; an effect overrides what it changes.
pub trait Effect: Send + Sync {
    /// Whether the machine has what the effect sits on.
    ///
    /// # Errors
    /// One line that names effect and key.
    fn check(&self, _facts: &Facts) -> Result<()> {
        Ok(())
    }

    /// After what its part in the motion of the machine repeats itself; the measuring chain has none.
    fn recurrence(&self) -> Recurrence {
        Recurrence::Never
    }

    /// Changes the pinion's angle (turns) over the step: speed fluctuation.
    fn turns(&self, _start_s: f64, _length_s: f64, _turns: &mut Series) {}

    /// Shifts the contact on its path, base pitches.
    fn shift(&self, _moment: &Moment, _position: &mut Series) {}

    /// Adds to the error of one tooth pair, m; positive errors open a gap (`F = k (delta - e)`).
    fn pair_error(&self, _moment: &Moment, _pair: &PairOnPath, _error: &mut Series) {}

    /// Multiplies the stiffness of one tooth pair.
    fn pair_stiffness(&self, _moment: &Moment, _pair: &PairOnPath, _stiffness: &mut Series) {}

    /// Friction coefficient of one pair, positive where the pinion slides ahead of the gear; `None` without friction.
    fn friction(&self, _moment: &Moment, _pair: &PairOnPath) -> Option<Series> {
        None
    }

    /// Adds external forces.
    fn force(&self, _moment: &Moment, _forces: &mut Forces) {}

    /// Change of the bearing stiffness of gear `body` in both directions, N/m.
    fn bearing(&self, _moment: &Moment, _body: usize) -> Option<Series> {
        None
    }

    /// Contact loss and backlash.
    fn backlash(&self) -> Option<Backlash> {
        None
    }

    /// Next time after `t` at which a contribution in time is not smooth.
    fn next_break_s(&self, _t: f64) -> f64 {
        f64::INFINITY
    }

    /// Path positions (base pitches) at which a contribution of a pair is not smooth.
    fn path_knots(&self, _facts: &Facts) -> Vec<f64> {
        Vec::new()
    }

    /// Share of what lies above half the rate that the acquisition's anti-alias filter lets through.
    fn unfiltered(&self) -> f64 {
        0.0
    }

    /// Changes sampled acceleration: sensor, transfer path, noise. Applied in the order of the effects.
    fn measure(&self, _sampled: &mut Sampled) {}
}
