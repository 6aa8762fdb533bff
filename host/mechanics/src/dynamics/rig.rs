//! A machine made ready to run: model, stiffness curve and effects, with the number of coordinates hidden.

use super::assembly::Coordinate;
use super::assembly::{Damping, Model, Options as AssemblyOptions, System};
use super::decimate::{Decimator, OVERSAMPLING, Stream};
use super::energy::{Report, Watch};
use super::excitation::{Effect, Facts};
use super::kinematics::Motion;
use super::mesh::{Mesh, MeshDamping};
use super::quantity::Quantity;
use super::sample::Sampler;
use super::steady::{Balance, steady_state};
use super::taylor::{Options, Solver, State, Statistics, Step};
use crate::machine::{EngagementKind, Geometry, Load, MOST_TORQUE_N_M, Machine, Motor};
use crate::piecewise::PiecewisePolynomial;
use crate::stiffness::{CrackedPair, Table};
use crate::terminal::Progress;
use crate::{Error, Result};
use std::f64::consts::TAU;
use std::sync::Arc;

/// Time that a transient is given to decay before the first sample, s.
pub const RUN_IN_S: f64 = 0.4;

/// Parts of a run that progress is told in.
pub const PARTS: u64 = 200;

/// A machine ready to run.
#[derive(Debug, Clone)]
pub struct Rig {
    /// The assembled model.
    pub system: System,
    /// Stiffness of one pair over base pitches.
    pub stiffness: PiecewisePolynomial,
    /// The pair of the cracked tooth, where the machine declares one.
    pub cracked: Option<CrackedPair>,
    /// Damping of the contact.
    pub damping: MeshDamping,
    /// Accuracy.
    pub options: Options,
    /// Time before the first sample, s, in which the transient decays.
    pub run_in_s: f64,
    /// Told of every part of a run that is done, [`PARTS`] parts per run.
    pub progress: Option<Arc<Progress>>,
    facts: Facts,
    motor: Option<Motor>,
    load: Option<Load>,
}

/// Signals of a run with its cost and energy.
#[derive(Debug, Clone)]
pub struct Sampled {
    /// Acceleration of both channels, m/s2.
    pub channels: [Vec<f64>; 2],
    /// Cost.
    pub statistics: Statistics,
    /// Energy balance of the first mesh periods and least mesh force.
    pub energy: Report,
}

/// Any quantities of a run with its cost and energy.
#[derive(Debug, Clone)]
pub struct Recorded {
    /// One signal per quantity, in its unit.
    pub signals: Vec<Vec<f64>>,
    /// Cost.
    pub statistics: Statistics,
    /// Energy balance of the first mesh periods and least mesh force.
    pub energy: Report,
}

impl Rig {
    /// Prepares a machine with the given model and damping; `y` lies along the line of action.
    ///
    /// # Errors
    /// Anything in the declaration that makes no sense.
    pub fn new(machine: &Machine, model: Model, damping: Damping) -> Result<Self> {
        let hard = machine.engagement.is_none_or(|e| e.kind == EngagementKind::None);
        let stiffness = match &machine.pair.pair_stiffness {
            // A declared table means straight lines between its rows; fitted curves differ by up to 0.3 %.
            Some(table) if hard => Table::read(&machine.folder.join(table))?.linear(),
            _ => machine.pair_stiffness()?,
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
        let own = Self::assembled(system, stiffness, machine.pair.mesh_damping_s, facts);
        Ok(Self { cracked: machine.cracked_pair()?, motor: machine.motor, load: machine.load, ..own })
    }

    /// A system that is assembled already, with a mesh damping that is this time, s, times the stiffness.
    pub fn assembled(system: System, stiffness: PiecewisePolynomial, damping_time_s: f64, facts: Facts) -> Self {
        Self {
            system,
            stiffness,
            cracked: None,
            damping: MeshDamping::Time(damping_time_s),
            options: Options { tolerance: 1e-9, ..Options::default() },
            run_in_s: RUN_IN_S,
            progress: None,
            facts,
            motor: None,
            load: None,
        }
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
    /// A speed that is not positive, a torque that does not load the drive flanks although contact is taken as
    /// permanent, and everything that stops the solver.
    pub fn run(
        &self,
        motion: &Motion,
        input_torque_n_m: f64,
        effects: &[Box<dyn Effect>],
        duration_s: f64,
        sink: impl FnMut(&Step),
    ) -> Result<Statistics> {
        self.check(motion, input_torque_n_m, effects, duration_s)?;
        match self.system.len() {
            2 => self.run_n::<2>(motion, input_torque_n_m, effects, duration_s, sink),
            6 => self.run_n::<6>(motion, input_torque_n_m, effects, duration_s, sink),
            8 => self.run_n::<8>(motion, input_torque_n_m, effects, duration_s, sink),
            10 => self.run_n::<10>(motion, input_torque_n_m, effects, duration_s, sink),
            n => Err(unknown_model(n)),
        }
    }

    /// Whether a run makes sense.
    fn check(
        &self,
        motion: &Motion,
        input_torque_n_m: f64,
        effects: &[Box<dyn Effect>],
        duration_s: f64,
    ) -> Result<()> {
        if !input_torque_n_m.is_finite() {
            return Err(Error::invalid("torque", format!("{input_torque_n_m} N m is not a finite number")));
        }
        if input_torque_n_m.abs() > MOST_TORQUE_N_M {
            let what = format!("{input_torque_n_m:e} N m is more than the {MOST_TORQUE_N_M:e} N m of any machine");
            return Err(Error::invalid("torque", what));
        }
        if input_torque_n_m <= 0.0 && effects.iter().all(|e| e.backlash().is_none()) {
            return Err(Error::impossible(
                "torque",
                format!(
                    "{input_torque_n_m} N m does not load the drive flanks; contact loss needs the effect `backlash`"
                ),
            ));
        }
        let speed = motion.speed_hz(0.0);
        if !(speed.is_finite() && speed > 0.0) {
            return Err(Error::invalid("speed", format!("{speed} Hz is not a positive speed")));
        }
        self.work(motion, duration_s).check()?;
        let facts = self.facts(input_torque_n_m);
        effects.iter().try_for_each(|effect| effect.check(&facts))
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
        let system = self.with_characteristics(motion.speed_hz(0.0), torque);
        let solver = Solver::<N>::new(&system, &force);
        let mut mesh = Mesh::new(&system, &self.stiffness, self.damping, motion, effects, self.facts(torque))
            .with_crack(self.cracked.as_ref());
        solver.integrate(&mut mesh, &mut state, (-self.run_in_s, duration_s), &self.options, sink)
    }

    /// The system with the slopes of motor and load characteristic about the operating point as damping.
    fn with_characteristics(&self, speed_hz: f64, torque: f64) -> System {
        let mut system = self.system.clone();
        let mut damp = |coordinates: [Coordinate; 2], slope: f64| {
            if let Some(i) = coordinates.into_iter().find_map(|c| self.system.index(c)) {
                system.damping[(i, i)] += slope;
            }
        };
        if let Some(motor) = self.motor {
            // Below breakdown the torque is nearly proportional to slip: T = 2 Tb s / sb (Kloss).
            let synchronous = TAU * motor.line_frequency_hz / f64::from(motor.pole_pairs);
            let slope = 2.0 * motor.breakdown_torque_n_m / (motor.breakdown_slip * synchronous);
            damp([Coordinate::Motor, Coordinate::Rotation(0)], slope);
        }
        if let Some(load) = self.load {
            let ratio = f64::from(self.facts.teeth[1]) / f64::from(self.facts.teeth[0]);
            let slope = load.speed_exponent * torque * ratio / (TAU * speed_hz / ratio);
            damp([Coordinate::Load, Coordinate::Rotation(1)], slope);
        }
        system
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
        let sampled = self.sampled(motion, input_torque_n_m, effects, rate_hz, count)?;
        Ok((sampled.channels, sampled.statistics))
    }

    /// [`Rig::accelerations`] with the energy balance. An effect may let a share past the filter
    /// ([`Effect::unfiltered`]).
    ///
    /// # Errors
    /// As [`Rig::run`] and [`Rig::sensors`].
    pub fn sampled(
        &self,
        motion: &Motion,
        input_torque_n_m: f64,
        effects: &[Box<dyn Effect>],
        rate_hz: f64,
        count: usize,
    ) -> Result<Sampled> {
        let quantities = self.sensors()?.map(Quantity::Acceleration);
        let Recorded { signals, statistics, energy } =
            self.recorded(motion, input_torque_n_m, effects, (rate_hz, count), &quantities)?;
        let channels = signals.try_into().map_err(|_| Error::impossible("simulation", "gives no two channels"))?;
        Ok(Sampled { channels, statistics, energy })
    }

    /// Acceleration of both bearing channels, m/s2, at `count` points of one period of the periodic motion, as they are
    /// and free of any transient: effects and mesh must repeat after `period_s`.
    ///
    /// # Errors
    /// As [`Rig::run`], [`Rig::sensors`] and [`steady_state`].
    pub fn period(
        &self,
        motion: &Motion,
        input_torque_n_m: f64,
        effects: &[Box<dyn Effect>],
        (period_s, count): (f64, usize),
    ) -> Result<[Vec<f64>; 2]> {
        let sensors = self.sensors()?;
        self.check(motion, input_torque_n_m, effects, period_s)?;
        let mut sampler = Sampler::new(count as f64 / period_s, count);
        let mut channels = [0, 1].map(|_| Vec::with_capacity(count));
        let sink = |step: &Step| {
            sampler.take(step, &sensors, |channel, _, values| channels[channel].extend_from_slice(values));
        };
        match self.system.len() {
            6 => self.period_n::<6>(motion, input_torque_n_m, effects, period_s, sink),
            8 => self.period_n::<8>(motion, input_torque_n_m, effects, period_s, sink),
            10 => self.period_n::<10>(motion, input_torque_n_m, effects, period_s, sink),
            n => Err(unknown_model(n)),
        }?;
        match channels.iter().any(|c| c.len() != count || c.iter().any(|x| !x.is_finite())) {
            true => Err(Error::impossible("simulation", "gives values beyond the range of numbers")),
            false => Ok(channels),
        }
    }

    fn period_n<const N: usize>(
        &self,
        motion: &Motion,
        torque: f64,
        effects: &[Box<dyn Effect>],
        period_s: f64,
        sink: impl FnMut(&Step),
    ) -> Result<Statistics> {
        let force = &self.system.torque * torque;
        let system = self.with_characteristics(motion.speed_hz(0.0), torque);
        let mesh = || {
            Mesh::new(&system, &self.stiffness, self.damping, motion, effects, self.facts(torque))
                .with_crack(self.cracked.as_ref())
        };
        let span = (0.0, period_s);
        let steady = steady_state::<N>(&system, &mut mesh(), &force, span, Balance::Inertia, &self.options)?;
        let solver = Solver::<N>::new(&system, &(force + &steady.correction));
        let mut state = steady.state;
        solver.integrate(&mut mesh(), &mut state, span, &self.options, sink)
    }

    /// Any quantities of a run at `index / rate_hz` for `count` samples, through the anti-alias filter as
    /// [`Rig::sampled`].
    ///
    /// # Errors
    /// As [`Rig::run`].
    pub fn recorded(
        &self,
        motion: &Motion,
        input_torque_n_m: f64,
        effects: &[Box<dyn Effect>],
        (rate_hz, count): (f64, usize),
        quantities: &[Quantity],
    ) -> Result<Recorded> {
        if !(rate_hz.is_finite() && rate_hz > 0.0 && count > 0) {
            return Err(Error::invalid("sample rate", format!("{count} samples at {rate_hz} Hz is no record")));
        }
        self.work(motion, count as f64 / rate_hz).check_against(rate_hz)?;
        let filter = Decimator::new();
        let folded: f64 = effects.iter().map(|e| e.unfiltered()).sum();
        let (first, end) = filter.span(count);
        let fine_hz = rate_hz * OVERSAMPLING as f64;
        let mut sampler = Sampler::spanning(fine_hz, first, end);
        let mut streams: Vec<Stream> = quantities.iter().map(|_| Stream::new(&filter, count)).collect();
        let mut points = vec![Vec::new(); quantities.len()];
        let force = &self.system.torque * input_torque_n_m;
        let mut watch = Watch::new(&self.system, &force);
        // The last sample must lie inside a step.
        let duration_s = (end as f64 + 0.5) / fine_hz;
        let mut told = 0;
        let statistics = self.run(motion, input_torque_n_m, effects, duration_s, |step| {
            watch.add(step);
            if let Some(progress) = &self.progress {
                let share = (step.end_s() + self.run_in_s) / (duration_s + self.run_in_s);
                let parts = ((PARTS as f64 * share) as u64).min(PARTS);
                if parts > told {
                    progress.advance(parts - told);
                    told = parts;
                }
            }
            sampler.take_of(
                step,
                quantities.len(),
                |i| quantities[i].series(step),
                |channel, index, values| {
                    streams[channel].push(values);
                    if folded != 0.0 {
                        let on_grid =
                            (index..).zip(values).filter(|(i, _)| i.rem_euclid(OVERSAMPLING as i64) == 0 && *i >= 0);
                        points[channel].extend(on_grid.map(|(_, x)| *x));
                    }
                },
            );
        })?;
        let mut channels: Vec<Vec<f64>> = streams.into_iter().map(Stream::finish).collect();
        for (channel, points) in channels.iter_mut().zip(&points) {
            channel.iter_mut().zip(points).for_each(|(x, point)| *x += folded * (point - *x));
        }
        if let Some(short) = channels.iter().find(|c| c.len() != count) {
            let what = format!("{} of {count} samples lie within the run", short.len());
            return Err(Error::impossible("sample rate", what));
        }
        if channels.iter().flatten().any(|x| !x.is_finite()) {
            return Err(Error::impossible("simulation", "gives values beyond the range of numbers"));
        }
        Ok(Recorded { signals: channels, statistics, energy: watch.report() })
    }
}

fn unknown_model(coordinates: usize) -> Error {
    Error::invalid("model", format!("{coordinates} coordinates are not a known model"))
}
