//! The node's own code on hours of the machine.
//!
//! The speed stays for 20 s to 120 s and goes to the next one, drawn at equal probability per ratio, by 2 % per
//! second; the load is drawn with it and follows within seconds. The converter is a low one behind a low filter (stop
//! edge `STOP_HZ`, so 25 kHz to 50 kHz), because fifty hours at 400 kHz would take a day of computing; the node's
//! code, its rates' plan included, is the same at every rate. Codes are sampled from the wave at the angle that the
//! tach's edges have, with white noise of [`NOISE_M_S2`] per code.

use super::bench::{Bench, LOADS, PASS_HZ, POINTS};
use crate::{Error, Result};
use meshband::board::Timing;
use meshband::config::{Configuration, GearPair, PassBand, TachWheel};
use meshband::message::{Indicators, Message, Spectrum};
use meshband::node::{Block, Node};
use meshband::tach::Validity;
use meshband::units::{Acceleration, Hertz};
use meshband_host::levels::observe::Observations;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};

/// Stop edge of the analogue filter, Hz.
const STOP_HZ: f32 = 12_500.0;
/// Standard deviation of the noise, m/s2.
pub const NOISE_M_S2: f32 = 0.5;
/// Acceleration per code, m/s2.
const M_S2_PER_CODE: f32 = 0.005;
/// Relative change of the speed per second on the way to another one.
const RAMP: f64 = 0.02;
/// Time constant of the load, s.
const LOAD_S: f64 = 5.0;
/// Samples per block.
const BLOCK: usize = 512;
/// A wave serves this long, s.
const MIX_S: f64 = 0.25;

/// Quantities that absolute alarms watch, as the node names them.
pub const ABSOLUTE_QUANTITIES: [&str; 8] =
    ["Rms", "Peak", "Crest", "Kurtosis", "VelocityRms", "MeshAmplitude", "SidebandEnergyRatio", "Fm4"];

/// What alarms see about once a second.
#[derive(Debug, Clone, Copy)]
pub struct Sample {
    /// Severity of the fault, 0 to 1.
    pub severity: f64,
    /// Pinion rate, Hz.
    pub speed_hz: f64,
    /// In the order of [`ABSOLUTE_QUANTITIES`]; NaN before the first one.
    pub values: [f32; 8],
    /// Largest departure in standard uncertainties.
    pub departure: Option<f32>,
}

/// An hour of the machine.
#[derive(Debug, Clone, Copy)]
pub struct Hour {
    /// Which fault grows from nothing to all of it, evenly; none in a sound machine.
    pub fault: Option<usize>,
    /// Length, s.
    pub seconds: f64,
    /// Seed of speed, load and noise.
    pub seed: u64,
}

/// A node on this machine; `levels` are the configuration's where there are some.
pub fn configuration(bench: &Bench) -> Result<Configuration> {
    let small = |teeth: u32| u16::try_from(teeth).map_err(|_| Error::invalid("[pair] teeth", "beyond a node's range"));
    let defaults = Configuration::default();
    let mut config = Configuration {
        gears: GearPair { pinion_teeth: small(bench.teeth[0])?, gear_teeth: small(bench.teeth[1])? },
        tach: TachWheel { pulses_per_turn: 1, ..defaults.tach },
        pass: PassBand { analogue: Hertz(PASS_HZ as f32), sensor: Hertz(0.0) },
        ..defaults
    };
    config.sensor.acceleration_per_code = Acceleration(M_S2_PER_CODE);
    config.limits.analogue_stop = Hertz(STOP_HZ);
    config.validate(Timing::AN386).map_err(|error| Error::invalid("the node's configuration", error))?;
    Ok(config)
}

/// Speed and load as they wander.
struct Drive {
    speed_hz: f64,
    load: f64,
    target_hz: f64,
    target_load: f64,
    until_s: f64,
}

impl Drive {
    fn advance(&mut self, now_s: f64, step_s: f64, range: (f64, f64), random: &mut ChaCha8Rng) {
        if now_s >= self.until_s {
            self.target_hz = range.0 * (range.1 / range.0).powf(random.random::<f64>());
            self.target_load = LOADS[0] + (LOADS[1] - LOADS[0]) * random.random::<f64>();
            self.until_s = now_s + 20.0 + 100.0 * random.random::<f64>();
        }
        let most = RAMP * step_s;
        self.speed_hz *= (self.target_hz / self.speed_hz).ln().clamp(-most, most).exp();
        self.load += (self.target_load - self.load) * (step_s / LOAD_S).min(1.0);
    }
}

/// Runs a node over an hour.
///
/// # Errors
/// A configuration that the node refuses.
pub fn run(bench: &Bench, config: &Configuration, hour: Hour) -> Result<(Vec<Sample>, Observations)> {
    let refuse = |error| Error::invalid("the node's configuration", error);
    let mut node = Box::new(Node::new(config.clone(), Timing::AN386).map_err(refuse)?);
    let clock_hz = f64::from(Timing::AN386.clock.0);
    let mut random = ChaCha8Rng::seed_from_u64(hour.seed);
    let range = (bench.speeds_hz[0], bench.speeds_hz[bench.speeds_hz.len() - 1]);
    let middle = (range.0 * range.1).sqrt();
    let mut drive = Drive { speed_hz: middle, load: 1.0, target_hz: middle, target_load: 1.0, until_s: 5.0 };
    let (mut tick, mut turns, mut sequence, mut mixed_s) = (0u64, 0.0f64, 0u32, f64::NEG_INFINITY);
    let mut turn = vec![0.0f32; POINTS];
    let mut heard = Heard::default();
    loop {
        let now_s = tick as f64 / clock_hz;
        if now_s >= hour.seconds {
            return Ok((heard.samples, heard.observed));
        }
        let severity = now_s / hour.seconds;
        let period = node.requested_period_ticks();
        let block_s = BLOCK as f64 * f64::from(period) / clock_hz;
        drive.advance(now_s, block_s, range, &mut random);
        if now_s - mixed_s >= MIX_S {
            bench.mix(drive.speed_hz, drive.load, hour.fault.map(|fault| (fault, severity)), &mut turn);
            mixed_s = now_s;
        }
        let per_sample = drive.speed_hz * f64::from(period) / clock_hz;
        let mut codes = [0u16; BLOCK];
        for (n, code) in codes.iter_mut().enumerate() {
            let noise: f32 = StandardNormal.sample(&mut random);
            let value = looked_up(&turn, turns + per_sample * n as f64) + NOISE_M_S2 * noise;
            *code = (value / M_S2_PER_CODE + 32_768.5).clamp(0.0, 65_535.0) as u16;
        }
        let after = turns + per_sample * BLOCK as f64;
        let mut edge = turns.floor() + 1.0;
        while edge <= after {
            let at = tick as f64 + (edge - turns) / drive.speed_hz * clock_hz;
            node.on_tach_edge(at.round() as u64 as u32);
            edge += 1.0;
        }
        let block = Block {
            codes: &codes,
            second: &[],
            first_tick: tick as u32,
            period_ticks: period,
            sequence,
            overrun: false,
        };
        node.on_block(block);
        (tick, turns, sequence) = (tick + BLOCK as u64 * u64::from(period), after, sequence.wrapping_add(1));
        while let Some(message) = node.poll(tick as u32) {
            heard.take(&message, severity);
        }
    }
}

fn looked_up(turn: &[f32], turns: f64) -> f32 {
    let at = (turns - turns.floor()) * POINTS as f64;
    let index = at as usize;
    let (a, b) = (turn[index % POINTS], turn[(index + 1) % POINTS]);
    a + (at - index as f64) as f32 * (b - a)
}

/// What the node said, as alarms see it.
#[derive(Default)]
struct Heard {
    mesh: Option<f32>,
    sideband: Option<f32>,
    fm4: Option<f32>,
    samples: Vec<Sample>,
    observed: Observations,
}

impl Heard {
    fn take(&mut self, message: &Message, severity: f64) {
        self.observed.take(message);
        match message {
            Message::Spectrum(spectrum) => self.mesh = first_harmonic(spectrum),
            Message::Indicators(values) => self.values(values, severity),
            _ => {}
        }
    }

    fn values(&mut self, values: &Indicators, severity: f64) {
        self.sideband = self.mesh.map(|_| values.sideband_energy_ratio);
        self.fm4 = values.gear.map(|gear| gear.fm4).or(self.fm4);
        if values.tag.validity != Validity::Locked || !values.quality.is_good() {
            return;
        }
        let held = |value: Option<f32>| value.unwrap_or(f32::NAN);
        let Indicators { rms, peak, crest, kurtosis, velocity_rms, .. } = *values;
        let of_records = [held(self.mesh), held(self.sideband), held(self.fm4)];
        let [mesh, sideband, fm4] = of_records;
        self.samples.push(Sample {
            severity,
            speed_hz: f64::from(values.tag.speed_hz),
            values: [rms, peak, crest, kurtosis, velocity_rms, mesh, sideband, fm4],
            departure: values.largest_departure(),
        });
    }
}

fn first_harmonic(spectrum: &Spectrum) -> Option<f32> {
    spectrum.bands.first().map(|band| band.line.amplitude)
}
