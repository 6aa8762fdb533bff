//! A machine made ready to run: model, stiffness curve and effects, with the number of coordinates hidden.

use super::assembly::{Damping, Model, Options as AssemblyOptions, System};
use super::decimate::{Decimator, OVERSAMPLING};
use super::excitation::{Effect, Facts};
use super::kinematics::Motion;
use super::mesh::{Mesh, MeshDamping};
use super::sample::Sampler;
use super::taylor::{Options, Solver, State, Statistics, Step};
use crate::machine::Machine;
use crate::piecewise::PiecewisePolynomial;
use crate::stiffness::{Geometry, Table};
use crate::{Error, Result};

/// Time that a transient is given to decay before the first sample, s.
const RUN_IN_S: f64 = 0.4;

/// A machine ready to run.
#[derive(Debug, Clone)]
pub struct Rig {
    /// The assembled model.
    pub system: System,
    /// Stiffness of one pair over base pitches.
    pub stiffness: PiecewisePolynomial,
    /// Damping of the contact.
    pub damping: MeshDamping,
    /// Accuracy.
    pub options: Options,
    facts: Facts,
}

impl Rig {
    /// Prepares a machine with the given model and damping; `y` lies along the line of action.
    ///
    /// # Errors
    /// Anything in the declaration that makes no sense.
    pub fn new(machine: &Machine, model: Model, damping: Damping) -> Result<Self> {
        let stiffness = match &machine.pair.pair_stiffness {
            // A declared table means straight lines between its rows; fitted curves differ by up to 0.3 %.
            Some(table) => Table::read(&machine.folder.join(table))?.linear(),
            None => machine.pair_stiffness()?,
        };
        let geometry = Geometry::new(&machine.pair)?;
        let knots = stiffness.knots();
        // One pair enters per base pitch, so the mean mesh stiffness is the curve's integral.
        let mean_mesh_stiffness_n_per_m = stiffness.integral();
        let assembly = AssemblyOptions { model, axis_angle_rad: 0.0, damping, mean_mesh_stiffness_n_per_m };
        let system = System::assemble(machine, &assembly)?;
        let facts = Facts {
            teeth: machine.pair.teeth,
            base_radius_m: system.base_radius_m,
            base_pitch_m: geometry.base_pitch_m,
            pressure_angle_rad: geometry.working_pressure_angle,
            path_base_pitches: knots[knots.len() - 1],
            pitch_point_base_pitches: geometry.pitch_point(),
            mass_kg: machine.shafts.mass_kg,
            input_torque_n_m: 0.0,
            bearing_stiffness_n_per_m: machine.shafts.bearing_stiffness_n_per_m,
        };
        if facts.path_base_pitches < 1.0 {
            return Err(Error::invalid("pair", "contact ratio below 1: no pair carries for part of the mesh cycle"));
        }
        let damping = MeshDamping::Time(machine.pair.mesh_damping_s);
        Ok(Self { system, stiffness, damping, options: Options { tolerance: 1e-9, ..Options::default() }, facts })
    }

    /// Machine facts at a torque.
    pub fn facts(&self, input_torque_n_m: f64) -> Facts {
        Facts { input_torque_n_m, ..self.facts }
    }

    /// Mean mesh stiffness, N/m.
    pub fn mean_stiffness_n_per_m(&self) -> f64 {
        self.stiffness.integral()
    }

    /// The coordinates whose acceleration the record's two channels are.
    ///
    /// # Errors
    /// For models without translations.
    pub fn sensors(&self) -> Result<[usize; 2]> {
        match (self.system.sensor(0), self.system.sensor(1)) {
            (Some(a), Some(b)) => Ok([a, b]),
            _ => Err(Error::invalid("model", "has no bearing motion, hence no acceleration channel")),
        }
    }

    /// Runs from before time 0 (the transient decays) to `duration_s`, handing every step to `sink`.
    ///
    /// # Errors
    /// A torque or speed that is not finite, and everything that stops the solver.
    pub fn run(
        &self,
        motion: &Motion,
        input_torque_n_m: f64,
        effects: &[Box<dyn Effect>],
        duration_s: f64,
        sink: impl FnMut(&Step),
    ) -> Result<Statistics> {
        if !input_torque_n_m.is_finite() {
            return Err(Error::invalid("torque", format!("{input_torque_n_m} N m is not a finite number")));
        }
        let speed = motion.speed_hz(0.0);
        if !(speed.is_finite() && speed > 0.0) {
            return Err(Error::invalid("speed", format!("{speed} Hz is not a positive speed")));
        }
        match self.system.len() {
            2 => self.run_n::<2>(motion, input_torque_n_m, effects, duration_s, sink),
            6 => self.run_n::<6>(motion, input_torque_n_m, effects, duration_s, sink),
            8 => self.run_n::<8>(motion, input_torque_n_m, effects, duration_s, sink),
            10 => self.run_n::<10>(motion, input_torque_n_m, effects, duration_s, sink),
            n => Err(Error::invalid("model", format!("{n} coordinates are not a known model"))),
        }
    }

    fn run_n<const N: usize>(
        &self,
        motion: &Motion,
        torque: f64,
        effects: &[Box<dyn Effect>],
        duration_s: f64,
        sink: impl FnMut(&Step),
    ) -> Result<Statistics> {
        let force = &self.system.torque * torque;
        let start = self.system.static_deflection(&force, self.mean_stiffness_n_per_m())?;
        let mut state = State::<N> { q: std::array::from_fn(|i| start[i]), v: [0.0; N] };
        let solver = Solver::<N>::new(&self.system, &force);
        let mut mesh = Mesh::new(&self.system, &self.stiffness, self.damping, motion, effects, self.facts(torque));
        solver.integrate(&mut mesh, &mut state, (-RUN_IN_S, duration_s), &self.options, sink)
    }

    /// Acceleration of both bearing channels, m/s2, at `index / rate_hz` for `count` samples, through the
    /// acquisition's anti-alias filter ([`Decimator`]: flat to 0.4 of the rate, delay removed).
    ///
    /// # Errors
    /// As [`Rig::run`] and [`Rig::sensors`].
    pub fn accelerations(
        &self,
        motion: &Motion,
        input_torque_n_m: f64,
        effects: &[Box<dyn Effect>],
        rate_hz: f64,
        count: usize,
    ) -> Result<([Vec<f64>; 2], Statistics)> {
        if !(rate_hz.is_finite() && rate_hz > 0.0 && count > 0) {
            return Err(Error::invalid("sample rate", format!("{count} samples at {rate_hz} Hz is no record")));
        }
        let sensors = self.sensors()?;
        let filter = Decimator::new();
        let (first, end) = filter.span(count);
        let mut sampler = Sampler::spanning(rate_hz * OVERSAMPLING as f64, first, end);
        let mut fine = [0, 1].map(|_| vec![0.0; (end - first) as usize]);
        let duration_s = end as f64 / (rate_hz * OVERSAMPLING as f64);
        let statistics = self.run(motion, input_torque_n_m, effects, duration_s, |step| {
            sampler.take(step, &sensors, |channel, index, values| {
                let from = (index - first) as usize;
                fine[channel][from..from + values.len()].copy_from_slice(values);
            });
        })?;
        Ok((fine.map(|signal| filter.apply(&signal, count)), statistics))
    }
}
