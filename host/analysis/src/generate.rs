//! Synthetic records with known contents, for training and proof of the loop.
//!
//! The simulator's own effects, given as on the command line, on the machine integrated in time
//! ([`crate::model::integrated`]); nothing of the harmonic balance's solution is shared. Noise first, then what the
//! effects do to the measuring chain, the converter's steps last. Cost: about 0.2 s per run of 2 s. Limits: constant
//! speed, and one pulse per turn.

use crate::dynamics::Effect;
use crate::dynamics::excitation::Sampled;
use crate::dynamics::simulate::{angle_turns, run_seed};
use crate::machine::{Hunting, Pair, Shafts};
use crate::model::harmonic_balance::Machine;
use crate::model::integrated::{self, Integrated, Point};
use crate::model::pieces::exact;
use crate::observation::input::{Record, Run};
use crate::stiffness::pair_curve::PairCurve;
use crate::{Result, effects};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;
use std::f64::consts::TAU;

/// What to generate.
#[derive(Debug, Clone)]
pub struct Scenario {
    /// Machine as it is (may differ from the declaration within tolerance).
    pub actual: Shafts,
    /// Factor on the actual pair stiffness.
    pub stiffness_factor: f64,
    /// Factor on the actual mesh damping.
    pub damping_factor: f64,
    /// Undeclared effects, as on the command line (`name:key=value,...`).
    pub effects: Vec<String>,
    /// RMS of added noise, m/s2; without noise there are no converter's steps either.
    pub noise_rms: f64,
    /// Step of the converter, m/s2; 0: float samples.
    pub step_m_s2: f64,
    /// Jitter of an edge of the tachometer, s.
    pub jitter_s: f64,
    /// First-order low-pass colour of the noise: 0 white, towards 1 redder.
    pub noise_colour: f64,
    /// Seed of phases, noise, jitter.
    pub seed: u64,
    /// Pinion speeds, Hz.
    pub speeds_hz: Vec<f64>,
    /// Input torques, N m.
    pub torques_n_m: Vec<f64>,
    /// Length of a run, s.
    pub duration_s: f64,
    /// Runs start within one turn of the pinion instead of anywhere in the hunting period.
    pub within_one_turn: bool,
}

impl Scenario {
    /// Nothing undeclared: four speeds, two torques, 2 s, 1 % class noise, runs started anywhere in the hunting period.
    pub fn null(shafts: &Shafts, seed: u64) -> Self {
        Self {
            actual: shafts.clone(),
            stiffness_factor: 1.0,
            damping_factor: 1.0,
            effects: Vec::new(),
            noise_rms: 0.3,
            step_m_s2: STEP_M_S2,
            jitter_s: JITTER_S,
            noise_colour: 0.0,
            seed,
            speeds_hz: vec![9.1, 13.3, 18.9, 24.2],
            torques_n_m: vec![8.0, 20.0],
            duration_s: 2.0,
            within_one_turn: false,
        }
    }
}

const RATE_HZ: f64 = 51_200.0;
/// Jitter of an edge, s.
const JITTER_S: f64 = 5e-7;
/// Step of the converter, m/s2.
pub const STEP_M_S2: f64 = 150.0 / 32767.0;

/// Generates the record of a scenario for a declared pair, shafts and pair curve.
///
/// # Errors
/// Effects that the simulator does not know, or that the machine has no place for.
pub fn record(pair: &Pair, shafts: &Shafts, curve: &PairCurve, scenario: &Scenario) -> Result<Record> {
    let points: Vec<(f64, f64)> =
        scenario.speeds_hz.iter().flat_map(|&f| scenario.torques_n_m.iter().map(move |&t| (f, t))).collect();
    let actual_curve = curve.times(|_| scenario.stiffness_factor);
    let mut actual = Machine::new(pair, &scenario.actual, &actual_curve);
    actual.tau_s *= scenario.damping_factor;
    let hidden = scenario.effects.iter().map(|text| effects::parse(text)).collect::<Result<Vec<_>>>()?;
    hidden.iter().try_for_each(|effect| effect.check(&actual.facts(0.0)))?;
    let integrated = Integrated::new(&actual, exact(&actual_curve));
    let runs: Vec<Run> = points
        .par_iter()
        .enumerate()
        .map(|(index, &(speed, torque))| run((&actual, &integrated), scenario, &hidden, index, speed, torque))
        .collect::<Result<_>>()?;
    Ok(Record {
        title: format!("generated-{}", scenario.seed),
        pair: pair.clone(),
        shafts: shafts.clone(),
        curve: curve.clone(),
        sample_rate_hz: RATE_HZ,
        unit: "m/s2".into(),
        top_hz: None,
        pulses_per_rev: 1,
        jitter_s: scenario.jitter_s,
        runs,
    })
}

fn run(
    (machine, integrated): (&Machine, &Integrated),
    scenario: &Scenario,
    hidden: &[Box<dyn Effect>],
    index: usize,
    speed: f64,
    torque: f64,
) -> Result<Run> {
    let mut rng = ChaCha8Rng::seed_from_u64(scenario.seed.wrapping_mul(1009).wrapping_add(index as u64));
    // Any turn of the hunting period, from a stream of its own.
    let mut other = ChaCha8Rng::seed_from_u64(scenario.seed.wrapping_mul(2003).wrapping_add(index as u64));
    let turn = if scenario.within_one_turn { 0 } else { other.random::<u32>() % Hunting::of(machine.teeth).turns };
    let at = Point {
        speed_hz: speed * (1.0 + 0.004 * (rng.random::<f64>() - 0.5)),
        start_rad: TAU * (f64::from(turn) - rng.random::<f64>()),
        torque_n_m: torque,
    };
    let samples = (scenario.duration_s * RATE_HZ) as usize;
    let taken = integrated::Run { effects: hidden, at };
    let mut channels = integrated.accelerations(&taken, samples, RATE_HZ)?;
    let colour = scenario.noise_colour;
    for channel in &mut channels {
        let mut state = 0.0;
        for x in channel.iter_mut() {
            let white: f64 = StandardNormal.sample(&mut rng);
            state = colour * state + (1.0 - colour * colour).sqrt() * white;
            *x += scenario.noise_rms * state;
        }
    }
    let angle = taken.turns(samples, RATE_HZ);
    let (seed, facts) = (run_seed(scenario.seed, index), machine.facts(torque));
    for effect in hidden {
        effect.measure(&mut Sampled { channels: &mut channels, rate_hz: RATE_HZ, seed, turns: &angle, facts: &facts });
    }
    if scenario.noise_rms > 0.0 && scenario.step_m_s2 > 0.0 {
        channels.iter_mut().flatten().for_each(|x| *x = (*x / scenario.step_m_s2).round() * scenario.step_m_s2);
    }
    let name = format!("run{index:02}.npy");
    let edges_s = edges(hidden, at, scenario, &mut rng);
    Ok(Run { name, channels, edges_s, first_pulse_index: 0, input_torque_n_m: torque, clipped_share: 0.0 })
}

/// Times at which the pinion's angle passes whole turns, with jitter.
fn edges(hidden: &[Box<dyn Effect>], at: Point, scenario: &Scenario, rng: &mut ChaCha8Rng) -> Vec<f64> {
    let turns = |t: f64| angle_turns(&at.motion(), hidden, t);
    let first = turns(0.0).ceil();
    (0..)
        .map(|i| {
            let target = first + f64::from(i);
            let begin = (target - at.start_rad / TAU) / at.speed_hz;
            // Fixed point: the departure's rate is a small share of the speed.
            (0..30).fold(begin, |t, _| t - (turns(t) - target) / at.speed_hz)
        })
        .take_while(|t| *t < scenario.duration_s)
        .map(|t| {
            let jitter: f64 = StandardNormal.sample(rng);
            (t + scenario.jitter_s * jitter).max(0.0)
        })
        .collect()
}
