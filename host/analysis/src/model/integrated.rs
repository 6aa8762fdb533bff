//! The machine of the inference on the Taylor solver, with the simulator's own effects: what a fit is compared with
//! in the end.
//!
//! The equations are the harmonic balance's (rotations of four bodies, two translations along the line of action);
//! what acts across that line is left out, as nothing of it reaches the channels. The stiffness table is taken as few
//! smooth pieces ([`super::pieces`]): a pair that an effect carries along its path meets a dozen breaks, not one per
//! row. Decimation is the acquisition's ([`crate::dynamics::decimate`]), the measuring chain's effects follow in their
//! order. Where all effects repeat with the mesh or with the turn of one gear, one period of the steady state is
//! integrated and the record read from it (`recurring`). Limits: constant nominal speed, no loss of contact.

use super::harmonic_balance::Machine;
use super::poles::Poles;
use super::recurring;
use crate::Result;
use crate::dynamics::assembly::{Coordinate, System};
use crate::dynamics::excitation::{Effect, Recurrence, Sampled};
use crate::dynamics::kinematics::Motion;
use crate::dynamics::rig::Rig;
use crate::dynamics::simulate::angle_turns;
use crate::piecewise::PiecewisePolynomial;
use nalgebra::{DMatrix, DVector};
use std::f64::consts::TAU;

/// Time before the first sample in time constants of the slowest decay: the transient is 6e-6 of itself then.
const RUN_IN_TIME_CONSTANTS: f64 = 12.0;
/// Bounds of that time, s, before a whole run: a machine with hardly any damping is not waited for.
const RUN_IN_S: [f64; 2] = [0.02, 3.0];

/// Where and how one run is taken.
#[derive(Debug, Clone, Copy)]
pub struct Point {
    /// Angle of the pinion at the first sample, rad.
    pub start_rad: f64,
    /// Pinion speed, Hz.
    pub speed_hz: f64,
    /// Input torque, N m.
    pub torque_n_m: f64,
}

/// What is known of one run: the effects in it and where it is taken.
pub struct Run<'a> {
    /// The simulator's effects.
    pub effects: &'a [Box<dyn Effect>],
    /// Where and how.
    pub at: Point,
}

impl Point {
    /// Angle of the pinion over time, without effects.
    pub fn motion(&self) -> Motion {
        Motion::Constant { speed_hz: self.speed_hz, turns_at_zero: self.start_rad / TAU }
    }
}

impl Run<'_> {
    /// Angle of the pinion at every sample, turns.
    pub fn turns(&self, samples: usize, rate_hz: f64) -> Vec<f64> {
        let motion = self.at.motion();
        (0..samples).map(|i| angle_turns(&motion, self.effects, i as f64 / rate_hz)).collect()
    }
}

/// A machine ready to be integrated at any point.
pub struct Integrated {
    rig: Rig,
}

/// What a run's signals are to be corrected by before its measuring chain, m/s2, by channel; empty for nothing.
pub type Beyond<'a> = &'a [Vec<f64>];

impl Integrated {
    /// Of `machine`; `stiffness`: its pair's, as [`super::pieces::smooth`] gives it.
    pub fn new(machine: &Machine, stiffness: PiecewisePolynomial) -> Self {
        let decayed_s = RUN_IN_TIME_CONSTANTS / Poles::of(machine).slowest_decay_per_s;
        let mut rig = Rig::assembled(system(machine), stiffness, machine.tau_s, machine.facts(0.0));
        rig.run_in_s = decayed_s.clamp(RUN_IN_S[0], RUN_IN_S[1]);
        Self { rig }
    }

    /// Length of what of the motion repeats itself under `run`, s.
    fn period_s(&self, run: &Run<'_>) -> Option<f64> {
        if run.effects.iter().any(|e| e.unfiltered() != 0.0 || e.backlash().is_some()) {
            return None;
        }
        let [z1, z2] = self.rig.facts(0.0).teeth.map(f64::from);
        let turn_s = 1.0 / run.at.speed_hz;
        match run.effects.iter().fold(Recurrence::Mesh, |all, e| all.with(e.recurrence())) {
            Recurrence::Mesh => Some(turn_s / z1),
            Recurrence::Turn(0) => Some(turn_s),
            Recurrence::Turn(_) => Some(turn_s * z2 / z1),
            Recurrence::Never => None,
        }
    }

    /// Accelerations of both bodies, m/s2, with what the effects do to the machine; the measuring chain's part is the
    /// caller's.
    ///
    /// # Errors
    /// An effect beyond the machine, and everything that stops the solver.
    pub fn accelerations(&self, run: &Run<'_>, samples: usize, rate_hz: f64) -> Result<[Vec<f64>; 2]> {
        let (motion, torque) = (run.at.motion(), run.at.torque_n_m);
        let Some(period_s) = self.period_s(run).filter(|s| s * rate_hz < 0.5 * samples as f64) else {
            return self.rig.accelerations(&motion, torque, run.effects, rate_hz, samples).map(|run| run.0);
        };
        let count = recurring::points(period_s, rate_hz);
        let fine = self.rig.period(&motion, torque, run.effects, (period_s, count))?;
        Ok(fine.map(|period| recurring::sampled(period, period_s, rate_hz, samples)))
    }

    /// The same with what the effects do to the measuring chain.
    ///
    /// # Errors
    /// As [`Integrated::accelerations`].
    pub fn run(&self, run: &Run<'_>, beyond: Beyond<'_>, samples: usize, rate_hz: f64) -> Result<[Vec<f64>; 2]> {
        let mut channels = self.accelerations(run, samples, rate_hz)?;
        for (channel, beyond) in channels.iter_mut().zip(beyond) {
            channel.iter_mut().zip(beyond).for_each(|(x, more)| *x += more);
        }
        if run.effects.is_empty() {
            return Ok(channels);
        }
        let facts = self.rig.facts(run.at.torque_n_m);
        let turns = run.turns(samples, rate_hz);
        for effect in run.effects {
            let (seed, turns) = (0, turns.as_slice());
            effect.measure(&mut Sampled { channels: &mut channels, rate_hz, seed, turns, facts: &facts });
        }
        Ok(channels)
    }
}

/// Motor, both gears and load; both translations along the line of action.
fn system(machine: &Machine) -> System {
    use Coordinate::{Along, Load, Motor, Rotation};
    let s = &machine.shafts;
    let [rb1, rb2] = machine.base_radius_m;
    let coordinates = vec![Motor, Rotation(0), Rotation(1), Load, Along(0), Along(1)];
    let inertia = [s.inertia_motor_kg_m2, s.inertia_pinion_kg_m2, s.inertia_gear_kg_m2, s.inertia_load_kg_m2];
    let springs = |coupling: [f64; 2], bearing: [f64; 2]| {
        let mut matrix = DMatrix::zeros(6, 6);
        for side in 0..2 {
            let (i, j) = (2 * side, 2 * side + 1);
            matrix[(i, i)] += coupling[side];
            matrix[(j, j)] += coupling[side];
            matrix[(i, j)] -= coupling[side];
            matrix[(j, i)] -= coupling[side];
            matrix[(4 + side, 4 + side)] += bearing[side];
        }
        matrix
    };
    let ratio = f64::from(machine.teeth[1]) / f64::from(machine.teeth[0]);
    System {
        mass: DVector::from_iterator(6, inertia.into_iter().chain(s.mass_kg)),
        stiffness: springs(s.coupling_stiffness_n_m_per_rad, s.bearing_stiffness_n_per_m),
        damping: springs(s.coupling_damping_n_m_s_per_rad, s.bearing_damping_n_s_per_m),
        mesh: DVector::from_column_slice(&[0.0, rb1, -rb2, 0.0, 1.0, -1.0]),
        cross: DVector::zeros(6),
        torque: DVector::from_column_slice(&[1.0, 0.0, 0.0, -ratio, 0.0, 0.0]),
        coordinates,
        base_radius_m: machine.base_radius_m,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drawn;
    use crate::effects::parse;
    use crate::model::pieces::smooth;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    /// Largest difference over the largest value.
    fn apart(a: &[f64], b: &[f64]) -> f64 {
        let largest = b.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        a.iter().zip(b).fold(0.0_f64, |m, (a, b)| m.max((a - b).abs())) / largest
    }

    #[test]
    fn ref_a_period_is_read_as_the_whole_run_is_integrated() {
        let record = drawn::machine(&mut ChaCha8Rng::seed_from_u64(11)).unwrap();
        let machine = Machine::new(&record.pair, &record.shafts, &record.curve);
        let integrated = Integrated::new(&machine, smooth(&record.curve).0);
        let at = Point { start_rad: 1.3, speed_hz: 21.7, torque_n_m: 12.0 };
        for text in
            ["eccentricity:amplitude=3e-5,gear=1", "tooth-crack:loss=0.2,tooth=3,growth=1.2,bow=0.2", "friction"]
        {
            let effects = vec![parse(text).unwrap()];
            let run = Run { effects: &effects, at };
            let (samples, rate_hz) = (25_600, 51_200.0);
            let read = integrated.accelerations(&run, samples, rate_hz).unwrap();
            assert!(integrated.period_s(&run).is_some(), "{text}");
            let (whole, _) = integrated.rig.accelerations(&at.motion(), 12.0, &effects, rate_hz, samples).unwrap();
            for (read, whole) in read.iter().zip(&whole) {
                let apart = apart(&read[..samples / 2], &whole[..samples / 2]);
                assert!(apart < 5e-5, "{text}: {apart:e}");
            }
        }
    }

    #[test]
    fn ref_a_drift_of_the_stiffness_has_no_period() {
        let effects = [parse("stiffness-drift:rate=0.05").unwrap(), parse("friction").unwrap()];
        let all = effects.iter().fold(Recurrence::Mesh, |all, e| all.with(e.recurrence()));
        assert_eq!(all, Recurrence::Never);
    }
}
