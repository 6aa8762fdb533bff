//! One field-like run: motion, forces of the bearings, housing, measuring chain, tachometer.

use super::declaration::{Field, Wheel};
use super::housing::Paths;
use super::wander::Course;
use super::{noise, wheel};
use crate::budget::{EDGES, SAMPLES};
use crate::dynamics::excitation::{Effect, Sampled};
use crate::dynamics::inertia::InertiaTorque;
use crate::dynamics::quantity::{Bearing, Quantity};
use crate::dynamics::rig::{Recorded, Rig};
use crate::dynamics::simulate::{angle_turns, start_turn, start_turns};
use crate::dynamics::{Motion, Statistics, crossings::crossings};
use crate::machine::{Hunting, Machine};
use crate::{Error, Result};
use rand_chacha::ChaCha12Rng;
use rand_chacha::rand_core::SeedableRng;

/// Random streams of a run and of a machine, far from those of effects and of plain simulation.
const COURSE: u64 = 301;
const START: u64 = 302;
const HOUSING: u64 = 303;
const MARKS: u64 = 304;
const VOLTAGE: u64 = 305;
const NOISE: u64 = 320;
/// Simulated behind the last sample, s, so that the wrap-around of the housing's filter has no share in it.
const TAIL_S: f64 = 0.02;
/// Arrays of a run's length that are in memory while it is made: forces, their spectra, angles.
const WORKING_ARRAYS: f64 = 14.0;

/// What all runs of a record share.
pub struct Site<'a> {
    /// What is asked for.
    pub field: &'a Field,
    /// The declared machine.
    pub machine: &'a Machine,
    /// The machine made ready.
    pub rig: &'a Rig,
    /// The housing.
    pub paths: Paths,
    /// Places of the wheel's marks, shares of the pitch.
    pub places: Vec<f64>,
    /// Sampling rate, Hz.
    pub rate_hz: f64,
    /// Length of every run, s.
    pub duration_s: f64,
}

/// One run as it was and as it was measured.
#[derive(Debug, Clone)]
pub struct FieldRun {
    /// Acceleration of every channel as its sensor shows it, m/s2.
    pub channels: Vec<Vec<f64>>,
    /// Voltage of the tachometer, V; empty without one.
    pub tach_v: Vec<f64>,
    /// Rising edges of the wheel, s.
    pub edges_s: Vec<f64>,
    /// Mark of the first edge.
    pub first_mark: usize,
    /// Pinion angle at the first sample, turns.
    pub first_turns: f64,
    /// Times, s, at which the pinion passes its angle 0, from the first time on.
    pub turn_times_s: Vec<f64>,
    /// Number of the first of these turns.
    pub first_turn: i64,
    /// Cost.
    pub statistics: Statistics,
    /// Least mesh force, N, and when, s.
    pub least_mesh_force: [f64; 2],
}

/// A random stream of a seed.
fn stream(seed: u64, number: u64) -> ChaCha12Rng {
    let mut random = ChaCha12Rng::seed_from_u64(seed);
    random.set_stream(number);
    random
}

impl<'a> Site<'a> {
    /// Draws the housing and the wheel from `seed`.
    pub fn new(
        field: &'a Field,
        machine: &'a Machine,
        rig: &'a Rig,
        (rate_hz, duration_s): (f64, f64),
        seed: u64,
    ) -> Self {
        let paths = Paths::drawn(field, &mut stream(seed, HOUSING));
        let places = field.tach.as_ref().map_or_else(Vec::new, |w| wheel::drawn_places(w, &mut stream(seed, MARKS)));
        Self { field, machine, rig, paths, places, rate_hz, duration_s }
    }

    /// Refuses what would take more memory than a simulation may.
    ///
    /// # Errors
    /// One line with the figure and the limit.
    pub fn check(&self, runs: usize) -> Result<()> {
        let kept = (self.field.channel.len() + usize::from(self.field.tach.is_some())) as f64;
        let at_once = (runs as f64).min(rayon::current_num_threads() as f64);
        let samples = self.rate_hz * self.duration_s * (kept * runs as f64 + WORKING_ARRAYS * at_once);
        SAMPLES.check("--duration and --rate", samples, "shorten the runs, lower the rate, or make fewer runs")
    }

    /// Effects of the field: what the change of speed takes.
    pub fn effects(&self) -> Vec<Box<dyn Effect>> {
        let inertia = InertiaTorque::of(self.machine);
        if self.field.wander.inertia { vec![Box::new(inertia)] } else { Vec::new() }
    }

    /// Motion of one run with its lead-in.
    pub fn motion(&self, base: &Motion, seed: u64) -> Motion {
        let course = Course::drawn(base.clone(), &self.field.wander, &mut stream(seed, COURSE));
        let hunting = Hunting::of(self.machine.pair.teeth).turns;
        let turns = f64::from(start_turn(seed, hunting)) + start_turns(seed);
        course.motion(self.paths.lead_s(), self.duration_s + TAIL_S, turns)
    }

    /// Makes one run; `effects` hold [`Site::effects`].
    ///
    /// # Errors
    /// As [`Rig::run`]; more tach edges than a run may have; a run without a whole turn.
    pub fn run(&self, motion: &Motion, torque_n_m: f64, effects: &[Box<dyn Effect>], seed: u64) -> Result<FieldRun> {
        let rate_hz = self.rate_hz;
        let count = (self.duration_s * rate_hz).round() as usize;
        let lead = (self.paths.lead_s() * rate_hz).round() as usize;
        let total = transform_length(lead + count + (TAIL_S * rate_hz).ceil() as usize);
        let bearings = Bearing::all(&self.rig.system)?.map(Quantity::BearingForce);
        let Recorded { signals, statistics, energy } =
            self.rig.recorded(motion, torque_n_m, effects, (rate_hz, total), &bearings)?;
        let mut channels = self.paths.accelerations(signals, rate_hz);
        for channel in &mut channels {
            channel.drain(..lead);
            channel.truncate(count);
        }
        let lead_s = lead as f64 / rate_hz;
        let angle = |t: f64| angle_turns(motion, effects, t + lead_s);
        let turns: Vec<f64> = (0..count).map(|i| angle(i as f64 / rate_hz)).collect();
        self.measure(&mut channels, &turns, torque_n_m, effects, seed);
        let first_turn = turns[0].ceil() as i64;
        let turn_times_s = crossings(&turns, rate_hz, &angle, (first_turn..).map(|turn| turn as f64));
        let mut run = FieldRun {
            channels,
            tach_v: Vec::new(),
            edges_s: Vec::new(),
            first_mark: 0,
            first_turns: turns[0],
            turn_times_s,
            first_turn,
            statistics,
            least_mesh_force: [energy.least_mesh_force_n, energy.least_at_s - lead_s],
        };
        if let Some(tach) = &self.field.tach {
            self.tachometer(tach, &turns, &angle, seed, &mut run)?;
        }
        Ok(run)
    }

    /// Noise, effects of the measuring chain, gain of every channel.
    fn measure(
        &self,
        channels: &mut Vec<Vec<f64>>,
        turns: &[f64],
        torque_n_m: f64,
        effects: &[Box<dyn Effect>],
        seed: u64,
    ) {
        let (rate_hz, facts) = (self.rate_hz, self.rig.facts(torque_n_m));
        // Effects know two channels.
        let kept = channels.len();
        channels.resize(kept.max(2), vec![0.0; if kept < 2 { turns.len() } else { 0 }]);
        for effect in effects {
            effect.measure(&mut Sampled { channels, rate_hz, seed, turns, facts: &facts });
        }
        channels.truncate(kept);
        for (i, (channel, declared)) in channels.iter_mut().zip(&self.field.channel).enumerate() {
            let (rms, slope) = (declared.noise_rms_m_s2, declared.noise_slope);
            noise::add(channel, rate_hz, rms, slope, &mut stream(seed, NOISE + i as u64));
            channel.iter_mut().for_each(|x| *x *= declared.gain);
        }
    }

    fn tachometer(
        &self,
        tach: &Wheel,
        turns: &[f64],
        angle: &impl Fn(f64) -> f64,
        seed: u64,
        run: &mut FieldRun,
    ) -> Result<()> {
        let ratio = tach.ratio(self.machine.pair.teeth);
        // Where the marks stand against the teeth is any place, the same in all runs only by chance.
        let start = rand::RngExt::random::<f64>(&mut stream(seed, START));
        let of_shaft: Vec<f64> = turns.iter().map(|turn| start + ratio * turn).collect();
        let edges_expected = (of_shaft[of_shaft.len() - 1] - of_shaft[0]) * f64::from(tach.pulses);
        EDGES.check("[tach] pulses", edges_expected, "fewer pulses per turn or a shorter run")?;
        let shaft = |t: f64| start + ratio * angle(t);
        let edges = wheel::edges(tach, &self.places, &of_shaft, self.rate_hz, &shaft);
        if edges.rising_s.len() < 2 {
            let what = format!("{} edges of the tachometer: a speed needs two, lengthen the run", edges.rising_s.len());
            return Err(Error::invalid("--duration", what));
        }
        let mut random = stream(seed, VOLTAGE);
        run.tach_v = wheel::voltage(tach, &edges, turns.len(), self.rate_hz, &mut random);
        run.edges_s = edges.rising_s;
        run.first_mark = edges.first;
        Ok(())
    }
}

/// An even length not below `samples` whose transform is fast: at most five binary digits before the zeros.
fn transform_length(samples: usize) -> usize {
    let unit = (samples.next_power_of_two() / 64).max(2);
    samples.div_ceil(unit) * unit
}
