//! A run of a train as a record has it: sampled acceleration and tach edges.
//!
//! The train starts with the deflection of its mean load and is given the time in which every mode's transient falls to
//! 1e-4. Signals are taken at 16 times the rate and pass the acquisition's anti-alias filter. Each purpose has its own
//! random stream, so noise changes no tach edge. Cost: `cargo run --release -p meshband-train-dynamics --example cost`.

use crate::assembly::System;
use crate::effects::Effect;
use crate::integrate::{Course, Statistics, Step, options};
use crate::machine::{TORQUES_N_M, TrainMachine, within};
use crate::modes::settling_s;
use crate::sensor::{Pickup, Sensor};
use crate::{Error, Result};
use meshband_mechanics::dynamics::Motion;
use meshband_mechanics::dynamics::crossings::crossings;
use meshband_mechanics::dynamics::decimate::{Decimator, OVERSAMPLING, Stream};
use meshband_mechanics::dynamics::work::{check_edges, check_samples};
use rand_chacha::ChaCha12Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, Normal};
use std::ops::RangeInclusive;

/// Share to which a transient falls before the first sample.
const TRANSIENT_SHARE: f64 = 1e-4;
/// Longest time that it is given, s.
const MAX_SETTLING_S: f64 = 5.0;
/// Sampling rates, Hz.
const RATES_HZ: RangeInclusive<f64> = 1e3..=1e6;
/// Lengths, s.
const DURATIONS_S: RangeInclusive<f64> = 1e-3..=1e4;
/// Pulses per turn.
const PULSES: RangeInclusive<f64> = 1.0..=10_000.0;
/// Standard deviations of tach edges, s.
const JITTERS_S: RangeInclusive<f64> = 0.0..=1e-3;
/// Standard deviations of noise, m/s2.
const NOISES_M_S2: RangeInclusive<f64> = 0.0..=1e6;
/// Speeds, Hz.
const SPEEDS_HZ: RangeInclusive<f64> = crate::machine::SPEEDS_HZ;

/// How a train runs and how it is measured.
#[derive(Debug, Clone, PartialEq)]
pub struct Run {
    /// Motion of shaft 0, forward.
    pub motion: Motion,
    /// Torque of the load, N m.
    pub load_torque_n_m: f64,
    /// Effects.
    pub effects: Vec<Effect>,
    /// Sensors, one channel each.
    pub sensors: Vec<Sensor>,
    /// Sampling rate, Hz.
    pub rate_hz: f64,
    /// Length, s.
    pub duration_s: f64,
    /// Shaft of the tachometer.
    pub tach_shaft: usize,
    /// Its pulses per turn.
    pub pulses_per_turn: u32,
    /// Standard deviation of its edges, s.
    pub jitter_s: f64,
    /// Standard deviation of white noise, m/s2.
    pub noise_m_s2: f64,
    /// Seed of all random streams.
    pub seed: u64,
}

/// A simulated run.
#[derive(Debug, Clone)]
pub struct Simulated {
    /// Acceleration of each sensor, m/s2.
    pub channels: Vec<Vec<f64>>,
    /// Tach edges, s.
    pub edges_s: Vec<f64>,
    /// Pulses from the tach shaft's angle 0 to the first edge, modulo pulses per turn.
    pub first_pulse_index: u32,
    /// Cost with the transient's, and the least mesh force without it.
    pub statistics: Statistics,
    /// Time given to the transient, s.
    pub settling_s: f64,
}

impl Run {
    /// A run at constant speed without effects, noise and jitter, one pulse per turn of shaft 0.
    pub fn steady(speed_hz: f64, load_torque_n_m: f64, sensors: Vec<Sensor>, rate_hz: f64, duration_s: f64) -> Self {
        Self {
            motion: Motion::Constant { speed_hz, turns_at_zero: 0.0 },
            load_torque_n_m,
            effects: Vec::new(),
            sensors,
            rate_hz,
            duration_s,
            tach_shaft: 0,
            pulses_per_turn: 1,
            jitter_s: 0.0,
            noise_m_s2: 0.0,
            seed: 1,
        }
    }

    fn check(&self, machine: &TrainMachine, system: &System) -> Result<()> {
        within("run", "rate", [self.rate_hz], &RATES_HZ)?;
        within("run", "duration", [self.duration_s], &DURATIONS_S)?;
        within("run", "load torque", [self.load_torque_n_m], &TORQUES_N_M)?;
        within("run", "speed", [0.0, self.duration_s].map(|t| self.motion.speed_hz(t)), &SPEEDS_HZ)?;
        within("run", "pulses", [f64::from(self.pulses_per_turn)], &PULSES)?;
        within("run", "jitter", [self.jitter_s], &JITTERS_S)?;
        within("run", "noise", [self.noise_m_s2], &NOISES_M_S2)?;
        if self.tach_shaft >= machine.train.shafts.len() {
            return Err(Error::invalid("run tach shaft", format!("{} is no shaft of the train", self.tach_shaft)));
        }
        check_samples(self.rate_hz, self.duration_s, 1)?;
        let fastest = self.motion.fastest_hz((0.0, self.duration_s));
        check_edges(fastest * self.tach_ratio(machine), self.pulses_per_turn, self.duration_s)?;
        self.effects.iter().try_for_each(|effect| effect.check(system))
    }

    /// Turns of the tach's shaft per turn of shaft 0.
    fn tach_ratio(&self, machine: &TrainMachine) -> f64 {
        machine.train.shaft_order(self.tach_shaft).value()
    }
}

/// Simulates one run.
///
/// # Errors
/// Values out of range, sensors and effects that the train has no place for, and everything that stops the solver.
pub fn simulate(machine: &TrainMachine, run: &Run) -> Result<Simulated> {
    let system = System::assemble(machine)?;
    run.check(machine, &system)?;
    let pickups: Vec<Pickup> =
        run.sensors.iter().map(|sensor| Pickup::new(&system, machine, sensor)).collect::<Result<_>>()?;
    let count = (run.duration_s * run.rate_hz).round().max(1.0) as usize;
    let settling_s = settling_s(&system, TRANSIENT_SHARE).min(MAX_SETTLING_S);
    let (mut channels, statistics) = sampled(&system, run, &pickups, count, settling_s)?;
    let normal = |deviation: f64| Normal::new(0.0, deviation).map_err(|e| Error::invalid("run noise", e));
    let (noise, jitter) = (normal(run.noise_m_s2)?, normal(run.jitter_s)?);
    let mut random = ChaCha12Rng::seed_from_u64(run.seed);
    random.set_stream(1);
    channels.iter_mut().flatten().for_each(|x| *x += noise.sample(&mut random));
    random.set_stream(2);
    let (first, mut edges_s) = edges(machine, run, count);
    edges_s.iter_mut().for_each(|edge| *edge += jitter.sample(&mut random));
    if edges_s.windows(2).any(|w| w[0] >= w[1]) {
        return Err(Error::invalid("run jitter", format!("{} s makes tach edges change places", run.jitter_s)));
    }
    let first_pulse_index = first.rem_euclid(i64::from(run.pulses_per_turn)) as u32;
    Ok(Simulated { channels, edges_s, first_pulse_index, statistics, settling_s })
}

/// Filtered signals of all sensors.
fn sampled(
    system: &System,
    run: &Run,
    pickups: &[Pickup],
    count: usize,
    settling_s: f64,
) -> Result<(Vec<Vec<f64>>, Statistics)> {
    let filter = Decimator::new();
    let (first, end) = filter.span(count);
    let fine_hz = run.rate_hz * OVERSAMPLING as f64;
    let mut streams: Vec<Stream> = pickups.iter().map(|_| Stream::new(&filter, count)).collect();
    let course = Course { system, motion: &run.motion, load_torque_n_m: run.load_torque_n_m, effects: &run.effects };
    let mut next = first;
    let mut values = Vec::new();
    let sink = |step: &Step| {
        let until = (((step.start_s + step.end * step.length_s) * fine_hz).ceil() as i64).min(end);
        if until <= next {
            return;
        }
        let from = (next as f64 / fine_hz - step.start_s) / step.length_s;
        for (pickup, stream) in pickups.iter().zip(&mut streams) {
            values.clear();
            values.resize((until - next) as usize, 0.0);
            pickup.add(step, &run.motion, [from, 1.0 / (fine_hz * step.length_s)], &mut values);
            stream.push(&values);
        }
        next = until;
    };
    // Whether teeth pull is asked of the record, not of the transient before it.
    let (begin, until) = (first as f64 / fine_hz, (end as f64 + 0.5) / fine_hz);
    let (mut state, options) = (course.start()?, options());
    let before = course.integrate(&mut state, (begin - settling_s, begin), &options, |_| {})?;
    let mut statistics = course.integrate(&mut state, (begin, until), &options, sink)?;
    statistics.steps += before.steps;
    statistics.orders += before.orders;
    let channels: Vec<Vec<f64>> = streams.into_iter().map(Stream::finish).collect();
    if channels.iter().any(|c| c.len() != count || c.iter().any(|x| !x.is_finite())) {
        return Err(Error::impossible("train dynamics", "gives values beyond the range of numbers"));
    }
    Ok((channels, statistics))
}

/// Number of the first pulse and all edges within the run, s.
fn edges(machine: &TrainMachine, run: &Run, count: usize) -> (i64, Vec<f64>) {
    let ratio = run.tach_ratio(machine);
    let pulses = f64::from(run.pulses_per_turn);
    let angle = |t: f64| ratio * run.motion.turns(t, 1e-6).coefficient(0);
    let turns: Vec<f64> = (0..count).map(|i| angle(i as f64 / run.rate_hz)).collect();
    let first = (turns[0] * pulses).ceil() as i64;
    (first, crossings(&turns, run.rate_hz, &angle, (first..).map(|pulse| pulse as f64 / pulses)))
}
