//! A record of a simulated machine: signals, codes and tach edges, from a seed.

use super::crossings::crossings;
use super::energy::Report;
use super::excitation::{Effect, Sampled};
use super::kinematics::Motion;
use super::rig::Rig;
use super::taylor::Statistics;
use super::work::{check_edges, check_samples};
use crate::{Error, Result};
use rand_chacha::ChaCha12Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, Normal};

/// Most pulses per turn that a record may declare.
const MOST_PULSES: u32 = 10_000;
/// Edges are written with nanoseconds: closer ones would not ascend.
const LEAST_INTERVAL_S: f64 = 2e-9;

/// What a run is sampled with.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Acquisition {
    /// Sampling rate, Hz.
    pub rate_hz: f64,
    /// Length, s.
    pub duration_s: f64,
    /// Tach pulses per turn of the pinion.
    pub pulses_per_turn: u32,
    /// Standard deviation of the tach edges, s.
    pub jitter_s: f64,
    /// Standard deviation of white noise, m/s2.
    pub noise_m_s2: f64,
    /// Seed of all random streams.
    pub seed: u64,
}

/// A simulated run.
#[derive(Debug, Clone)]
pub struct Simulated {
    /// Acceleration of both channels, m/s2.
    pub channels: [Vec<f64>; 2],
    /// Tach edges, s.
    pub edges_s: Vec<f64>,
    /// Pulses from angle 0 to the first edge, modulo pulses per turn.
    pub first_pulse_index: u32,
    /// Cost.
    pub statistics: Statistics,
    /// Energy balance of the first mesh periods and least mesh force.
    pub energy: Report,
}

/// Simulates one run.
///
/// # Errors
/// Impossible rates, lengths and deviations, and everything that stops the solver.
pub fn simulate(
    rig: &Rig,
    motion: &Motion,
    input_torque_n_m: f64,
    effects: &[Box<dyn Effect>],
    acquisition: &Acquisition,
) -> Result<Simulated> {
    let a = acquisition;
    if !(10e3..=100e6).contains(&a.rate_hz) {
        return Err(Error::invalid("--rate", format!("{} Hz is not within 10 kHz to 100 MHz", a.rate_hz)));
    }
    if !(a.duration_s.is_finite() && a.duration_s > 0.0) {
        return Err(Error::invalid("--duration", format!("{} s is not a positive time", a.duration_s)));
    }
    if a.pulses_per_turn == 0 {
        return Err(Error::invalid("--pulses", "at least one pulse per turn is needed"));
    }
    if a.pulses_per_turn > MOST_PULSES {
        return Err(Error::invalid("--pulses", format!("{} is not within 1 to {MOST_PULSES}", a.pulses_per_turn)));
    }
    let deviation = |option: &str, value: f64| {
        Normal::new(0.0, value)
            .ok()
            .filter(|_| value >= 0.0 && value.is_finite())
            .ok_or_else(|| Error::invalid(option, format!("{value} is not a standard deviation")))
    };
    let (jitter, noise) = (deviation("--jitter", a.jitter_s)?, deviation("--noise", a.noise_m_s2)?);
    check_samples(a.rate_hz, a.duration_s, 1)?;
    let count = (a.duration_s * a.rate_hz).round().max(1.0) as usize;
    check_edges(rig.work(motion, a.duration_s).shaft_hz, a.pulses_per_turn, a.duration_s)?;
    let sampled = rig.sampled(motion, input_torque_n_m, effects, a.rate_hz, count)?;
    let mut channels = sampled.channels;
    let facts = rig.facts(input_torque_n_m);
    let angle = |t: f64| angle_turns(motion, effects, t);
    let turns: Vec<f64> = (0..count).map(|i| angle(i as f64 / a.rate_hz)).collect();
    for effect in effects {
        let (rate_hz, seed) = (a.rate_hz, a.seed);
        effect.measure(&mut Sampled { channels: &mut channels, rate_hz, seed, turns: &turns, facts: &facts });
    }
    // One stream per purpose: a change of the noise leaves the tach as it was.
    let mut random = ChaCha12Rng::seed_from_u64(a.seed);
    random.set_stream(1);
    channels.iter_mut().flatten().for_each(|x| *x += noise.sample(&mut random));
    random.set_stream(2);
    let (first_pulse, edges_s) = edges(&turns, a, &angle);
    let edges_s: Vec<f64> = edges_s.into_iter().map(|t| t + jitter.sample(&mut random)).collect();
    if let Some(i) = edges_s.windows(2).position(|w| w[1] - w[0] < LEAST_INTERVAL_S) {
        let what = format!(
            "{} s makes edges {i} and {} of the tach change places; it must be far below their distance",
            a.jitter_s,
            i + 1
        );
        return Err(Error::invalid("--jitter", what));
    }
    let first_pulse_index = first_pulse.rem_euclid(i64::from(a.pulses_per_turn)) as u32;
    let (statistics, energy) = (sampled.statistics, sampled.energy);
    Ok(Simulated { channels, edges_s, first_pulse_index, statistics, energy })
}

/// Seed of run `index` of a record: well apart for neighbouring seeds and runs (SplitMix64).
pub fn run_seed(seed: u64, index: usize) -> u64 {
    if index == 0 {
        return seed;
    }
    let mut x = seed.wrapping_add((index as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15));
    x = (x ^ (x >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    x ^ (x >> 31)
}

/// Random angle, turns, at which a run of this seed starts.
pub fn start_turns(seed: u64) -> f64 {
    let mut random = ChaCha12Rng::seed_from_u64(seed);
    random.set_stream(3);
    rand::RngExt::random(&mut random)
}

/// Random whole turn of the pinion, below `hunting`, at which a run of this seed starts.
pub fn start_turn(seed: u64, hunting: u32) -> u32 {
    let mut random = ChaCha12Rng::seed_from_u64(seed);
    random.set_stream(4);
    rand::RngExt::random_range(&mut random, 0..hunting.max(1))
}

/// Angle of the pinion at `t`, turns, with what effects add to it.
pub fn angle_turns(motion: &Motion, effects: &[Box<dyn Effect>], t: f64) -> f64 {
    let mut turns = motion.turns(t, 1e-6);
    effects.iter().for_each(|e| e.turns(t, 1e-6, &mut turns));
    turns.coefficient(0)
}

/// Edge times within the run, and the first pulse's number.
fn edges(turns: &[f64], a: &Acquisition, angle: &impl Fn(f64) -> f64) -> (i64, Vec<f64>) {
    let pulses = f64::from(a.pulses_per_turn);
    let first = (turns[0] * pulses).ceil() as i64;
    (first, crossings(turns, a.rate_hz, angle, (first..).map(|pulse| pulse as f64 / pulses)))
}
