//! The periodic acceleration of a machine at an operating point, as polynomials.
//!
//! Every study of the law starts here: steady state by the period map (no transient is waited for, none is
//! left), then one more integration whose Taylor polynomials are kept. The period is the mesh period for a
//! healthy pair and one turn of the cracked gear for a cracked one. Being periodic, the result can be sampled
//! at any rate for any time, exactly and without integrating again.
//!
//! Channel: acceleration of the pinion body along the line of action, the paper's choice, m/s2.
//! Cost: about 1 ms (1 Hz) to 0.2 ms (25 Hz) for a healthy operating point of the paper's rig.

use super::crack::{CrackedTooth, OnlyPairs};
use super::edges::{Edge, Polarity, Step, steepest_edge};
use crate::dynamics::assembly::{Damping, Model};
use crate::dynamics::excitation::{Moment, PairOnPath};
use crate::dynamics::steady::{Balance, steady_state};
use crate::dynamics::{Effect, Facts, Mesh, Motion, Rig, Series, Solver, State, Statistics};
use crate::machine::{EngagementKind, Geometry, Machine, Side};
use crate::piecewise::{PiecewisePolynomial, horner};
use crate::stiffness::PAPER_WIDTH_RAD;
use crate::{Error, Result};
use std::f64::consts::TAU;

/// A machine ready for operating points.
pub struct Bench {
    rig: Rig,
    teeth: [u32; 2],
    crack: Option<CrackedTooth>,
    ramps: Ramps,
    /// Makes the effects that act on every pair alike, anew for every operating point.
    effects: Box<dyn Fn() -> Vec<Box<dyn Effect>> + Send + Sync>,
}

/// Which of a pair's two engagement edges.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Event {
    /// The pair takes up load: mesh stiffness rises, the pinion's acceleration falls (a trough).
    Entry,
    /// The pair gives its load off: mesh stiffness falls, the pinion's acceleration rises (a peak).
    Exit,
}

impl Event {
    /// Direction of the edge in the pinion's acceleration at positive torque.
    pub fn polarity(self) -> Polarity {
        match self {
            Event::Entry => Polarity::Falling,
            Event::Exit => Polarity::Rising,
        }
    }
}

/// Where on the path a pair's two ramps lie, base pitches from the theoretical start of contact.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Ramps {
    /// From the first contact to the full share.
    pub entry: [f64; 2],
    /// From the full share to the last contact.
    pub exit: [f64; 2],
}

impl Ramps {
    /// The ramp of an event.
    pub fn of(&self, event: Event) -> [f64; 2] {
        match event {
            Event::Entry => self.entry,
            Event::Exit => self.exit,
        }
    }

    fn new(machine: &Machine, curve: &PiecewisePolynomial) -> Result<Self> {
        let knots = curve.knots();
        let (start, end) = (knots[0], knots[knots.len() - 1]);
        let geometry = Geometry::new(&machine.pair)?;
        let engagement = machine.engagement.filter(|e| e.kind != EngagementKind::None);
        let width = |rad: f64| rad * f64::from(machine.pair.teeth[0]) / TAU;
        let (entry, exit) = match engagement.map(|e| (e.kind, e)) {
            Some((EngagementKind::Loaded, _)) => (0.0, geometry.contact_ratio),
            Some((EngagementKind::TipRelief, e)) => {
                let length = e.relief_length_base_pitches.unwrap_or(0.2);
                (length, geometry.contact_ratio - length)
            }
            Some((_, e)) => {
                let width = width(e.width_rad.unwrap_or(PAPER_WIDTH_RAD));
                (start + width, end - width)
            }
            // A table carries its ramps in its rows: they end where half of the largest stiffness is reached.
            None => {
                let at = |k: i32| start + (end - start) * f64::from(k) / 4096.0;
                let half = 0.5 * (0..4096).map(|k| curve.value(at(k))).fold(0.0, f64::max);
                let first = (0..4096).find(|&k| curve.value(at(k)) > half).unwrap_or(0);
                let last = (0..4096).rfind(|&k| curve.value(at(k)) > half).unwrap_or(4095);
                (at(first), at(last + 1))
            }
        };
        let ramps = Self { entry: [start, entry], exit: [exit, end] };
        if ramps.entry[1] - ramps.entry[0] < 1e-6 || ramps.exit[1] - ramps.exit[0] < 1e-6 {
            return Err(Error::impossible(
                "bandwidth law",
                "the pair switches on at once ([engagement] absent or `none`): the acceleration jumps and its \
                 bandwidth is \
                 infinite; declare an engagement",
            ));
        }
        Ok(ramps)
    }
}

impl Bench {
    /// Prepares a machine; its crack, if declared, is used by [`Bench::cracked`] only.
    ///
    /// # Errors
    /// Anything in the declaration that makes no sense.
    pub fn new(machine: &Machine) -> Result<Self> {
        Self::with_model(machine, Model::BendingTorsional)
    }

    /// The same with another model; it must have bearing motion.
    ///
    /// # Errors
    /// As [`Bench::new`], and for the torsional model.
    pub fn with_model(machine: &Machine, model: Model) -> Result<Self> {
        let mut rig = Rig::new(machine, model, Damping::Declared)?;
        rig.stiffness = machine.pair_stiffness()?;
        rig.sensors()?;
        let crack = machine.cracked_pair()?.map(CrackedTooth::new);
        let ramps = Ramps::new(machine, &rig.stiffness)?;
        Ok(Self { rig, teeth: machine.pair.teeth, crack, ramps, effects: Box::new(Vec::new) })
    }

    /// The same with effects that repeat with every tooth pair (wear, relief, profile), made by `effects`; others
    /// have no place in a mesh period and would spoil the steady state.
    pub fn with_effects(self, effects: impl Fn() -> Vec<Box<dyn Effect>> + Send + Sync + 'static) -> Self {
        Self { effects: Box::new(effects), ..self }
    }

    /// Teeth of pinion and gear.
    pub fn teeth(&self) -> [u32; 2] {
        self.teeth
    }

    /// Where the pair's ramps lie.
    pub fn ramps(&self) -> Ramps {
        self.ramps
    }

    /// Natural frequencies at the mean mesh stiffness, Hz, ascending, without the rigid rotation.
    pub fn natural_frequencies_hz(&self) -> Vec<f64> {
        let all = self.rig.system.natural_frequencies_hz(self.rig.mean_stiffness_n_per_m());
        all.into_iter().skip(1).collect()
    }

    /// Steady acceleration of the healthy pair over one mesh period.
    ///
    /// # Errors
    /// A speed or torque out of range, and everything that stops the solver.
    pub fn healthy(&self, shaft_hz: f64, torque_n_m: f64) -> Result<Periodic> {
        check(shaft_hz, torque_n_m)?;
        self.periodic(shaft_hz, torque_n_m, &(self.effects)(), 1.0 / (shaft_hz * f64::from(self.teeth[0])))
    }

    /// Steady acceleration with the declared crack over one turn of the cracked gear; the cracked pair enters at time
    /// 0.
    ///
    /// # Errors
    /// As [`Bench::healthy`], and where the machine declares no crack.
    pub fn cracked(&self, shaft_hz: f64, torque_n_m: f64) -> Result<Periodic> {
        check(shaft_hz, torque_n_m)?;
        let crack = self.crack.clone().ok_or_else(|| Error::invalid("[crack]", "the machine declares no crack"))?;
        let teeth = match crack.side() {
            Side::Pinion => self.teeth[0],
            Side::Gear => self.teeth[1],
        };
        let period = f64::from(teeth) / (shaft_hz * f64::from(self.teeth[0]));
        self.periodic(shaft_hz, torque_n_m, &[Box::new(crack)], period)
    }

    fn periodic(&self, shaft_hz: f64, torque: f64, effects: &[Box<dyn Effect>], period_s: f64) -> Result<Periodic> {
        match self.rig.system.len() {
            6 => self.periodic_n::<6>(shaft_hz, torque, effects, period_s),
            8 => self.periodic_n::<8>(shaft_hz, torque, effects, period_s),
            10 => self.periodic_n::<10>(shaft_hz, torque, effects, period_s),
            n => Err(Error::invalid("model", format!("{n} coordinates are not a model of the law"))),
        }
    }

    fn periodic_n<const N: usize>(
        &self,
        shaft_hz: f64,
        torque: f64,
        effects: &[Box<dyn Effect>],
        period_s: f64,
    ) -> Result<Periodic> {
        let rig = &self.rig;
        let motion = Motion::Constant { speed_hz: shaft_hz, turns_at_zero: 0.0 };
        let mut force = &rig.system.torque * torque;
        let mesh = || Mesh::new(&rig.system, &rig.stiffness, rig.damping, &motion, effects, rig.facts(torque));
        let steady = steady_state::<N>(&rig.system, &mut mesh(), &force, (0.0, period_s), Balance::Load, &rig.options)?;
        // The steady state's small load correction belongs to the motion.
        force += &steady.correction;
        let sensor = rig.sensors()?[0];
        let solver = Solver::<N>::new(&rig.system, &force);
        let mut state = steady.state;
        let mut steps = Vec::new();
        solver.integrate(&mut mesh(), &mut state, (0.0, period_s), &rig.options, |s| steps.push(kept(s, sensor)))?;
        let mesh_period_s = 1.0 / (shaft_hz * f64::from(self.teeth[0]));
        Ok(Periodic { steps, period_s, mesh_period_s, ramps: self.ramps, statistics: steady.statistics })
    }

    /// One engagement alone, from static balance, without the ring of any other: what the ramp and the modes
    /// make of a single edge. Time 0 is when the ramp begins.
    ///
    /// # Errors
    /// As [`Bench::healthy`].
    pub fn isolated(&self, event: Event, shaft_hz: f64, torque_n_m: f64) -> Result<Option<Edge>> {
        check(shaft_hz, torque_n_m)?;
        match self.rig.system.len() {
            6 => self.isolated_n::<6>(event, shaft_hz, torque_n_m),
            8 => self.isolated_n::<8>(event, shaft_hz, torque_n_m),
            10 => self.isolated_n::<10>(event, shaft_hz, torque_n_m),
            n => Err(Error::invalid("model", format!("{n} coordinates are not a model of the law"))),
        }
    }

    fn isolated_n<const N: usize>(&self, event: Event, shaft_hz: f64, torque: f64) -> Result<Option<Edge>> {
        let rig = &self.rig;
        let Ramps { entry, exit } = self.ramps;
        // Positions of pair 0; pair 1 follows one base pitch behind. Everything else is kept away.
        let (begin, ramp, end) = match event {
            Event::Exit => (entry[1] + 1.0, exit, exit[0] + 1.0),
            Event::Entry => (exit[1] - 1.0, [entry[0] + 1.0, entry[1] + 1.0], exit[0]),
        };
        if begin >= ramp[0] || ramp[1] >= end {
            return Ok(None);
        }
        let rate = shaft_hz * f64::from(self.teeth[0]);
        let motion = Motion::Constant { speed_hz: shaft_hz, turns_at_zero: ramp[0] / f64::from(self.teeth[0]) };
        let time = |position: f64| (position - ramp[0]) / rate;
        let mut effects = (self.effects)();
        effects.push(Box::new(OnlyPairs([0, 1])));
        let force = &rig.system.torque * torque;
        let facts = rig.facts(torque);
        let balance = |position: f64| {
            let (mut total, mut by_errors) = (0.0, 0.0);
            for number in [0, 1] {
                let at = position - number as f64;
                let k = rig.stiffness.value(at);
                total += k;
                by_errors += k * error(&effects, &facts, number, at);
            }
            rig.system.static_deflection(&(&force + &rig.system.mesh * by_errors), total)
        };
        let step = 1e-4 * (ramp[0] - begin);
        let (at, ahead) = (balance(begin)?, balance(begin + step)?);
        let mut state = State::<N> {
            q: std::array::from_fn(|i| at[i]),
            v: std::array::from_fn(|i| (ahead[i] - at[i]) / step * rate),
        };
        let sensor = rig.sensors()?[0];
        let mut mesh = Mesh::new(&rig.system, &rig.stiffness, rig.damping, &motion, &effects, rig.facts(torque));
        let mut steps = Vec::new();
        let solver = Solver::<N>::new(&rig.system, &force);
        solver.integrate(&mut mesh, &mut state, (time(begin), time(end)), &rig.options, |s| {
            steps.push(kept(s, sensor))
        })?;
        Ok(steepest_edge(&steps, [0.0, time(ramp[1])], event.polarity()))
    }
}

/// Error of a pair standing at a position, m.
fn error(effects: &[Box<dyn Effect>], facts: &Facts, number: i64, position: f64) -> f64 {
    let tooth = facts.teeth.map(|z| number.rem_euclid(i64::from(z)) as u32);
    let pair = PairOnPath { number, tooth, position: Series::constant(position) };
    let moment = Moment { facts, start_s: 0.0, length_s: 1.0, angle_rad: [Series::ZERO; 2] };
    let mut error = Series::ZERO;
    effects.iter().for_each(|e| e.pair_error(&moment, &pair, &mut error));
    error.coefficient(0)
}

/// The sensor's acceleration over a solver step, in powers of time.
fn kept(step: &crate::dynamics::Step, sensor: usize) -> Step {
    let mut scale = 1.0;
    let mut coefficients = step.acceleration(sensor).coefficients().to_vec();
    for c in &mut coefficients {
        *c *= scale;
        scale /= step.length_s;
    }
    Step { start_s: step.start_s, length_s: step.end * step.length_s, coefficients }
}

fn check(shaft_hz: f64, torque_n_m: f64) -> Result<()> {
    if !(shaft_hz.is_finite() && shaft_hz > 0.0) {
        return Err(Error::invalid("speed", format!("{shaft_hz} Hz is not a positive speed")));
    }
    if !torque_n_m.is_finite() {
        return Err(Error::invalid("torque", format!("{torque_n_m} N m is not a finite number")));
    }
    Ok(())
}

/// A periodic acceleration from time 0, m/s2.
#[derive(Debug, Clone)]
pub struct Periodic {
    steps: Vec<Step>,
    /// Period, s.
    pub period_s: f64,
    /// Mesh period, s.
    pub mesh_period_s: f64,
    /// Where pairs take up and give off their share.
    pub ramps: Ramps,
    /// What the steady state took.
    pub statistics: Statistics,
}

impl Periodic {
    /// The polynomials over `[from_s, to_s]` and one step more on both sides, in ascending time.
    pub fn steps_over(&self, from_s: f64, to_s: f64) -> Vec<Step> {
        let (first, last) = ((from_s / self.period_s).floor() as i64 - 1, (to_s / self.period_s).floor() as i64 + 1);
        let mut all: Vec<Step> = Vec::new();
        for turn in first..=last {
            let shift = turn as f64 * self.period_s;
            let near = |s: &&Step| s.start_s + shift + s.length_s >= from_s && s.start_s + shift <= to_s;
            all.extend(self.steps.iter().filter(near).map(|s| Step { start_s: s.start_s + shift, ..s.clone() }));
        }
        all
    }

    /// The edge of pair `number`'s event: the steepest of its direction while the ramp lasts.
    ///
    /// Pair `n` enters the path at `n` mesh periods.
    pub fn edge(&self, number: i64, event: Event) -> Option<Edge> {
        let t = self.mesh_period_s;
        let window = self.ramps.of(event).map(|s| (s + number as f64) * t);
        steepest_edge(&self.steps_over(window[0] - 0.5 * t, window[1] + 0.5 * t), window, event.polarity())
    }

    /// Acceleration at any time, m/s2.
    pub fn value(&self, t: f64) -> f64 {
        let t = t.rem_euclid(self.period_s);
        let step = &self.steps[self.steps.partition_point(|s| s.start_s <= t).max(1) - 1];
        horner(&step.coefficients, t - step.start_s)
    }

    /// Samples `0..count` at `offset_s + index / rate_hz`, without any filter.
    pub fn sampled(&self, rate_hz: f64, offset_s: f64, count: usize) -> Vec<f64> {
        (0..count).map(|i| self.value(offset_s + i as f64 / rate_hz)).collect()
    }
}
