//! A bench drawn at random: gear pair, shafts, housing, operation, tachometer, noise.
//!
//! Ranges are those of small industrial gearboxes: 17 to 80 teeth, modules of 1.5 to 4 mm, mesh frequencies of 150 to
//! 800 Hz. Masses and inertias follow from steel discs of the gears' size with a drawn share for shafts; stiffnesses
//! are drawn over half a decade. Cost is bounded by rate times length.

use crate::Result;
use crate::dynamics::Motion;
use crate::field::{Channel, Field, FileUnit, Housing, Wander, Wheel, WheelShaft};
use crate::machine::{Engagement, EngagementKind, Machine, Pair, Shafts};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use std::f64::consts::PI;
use std::path::Path;

/// Teeth of either gear.
const TEETH: (f64, f64) = (17.0, 80.0);
/// Most samples of a channel: what a record costs.
const MOST_SAMPLES: f64 = 200_000.0;
/// Turns of the slower shaft that a record holds at least.
const LEAST_TURNS: f64 = 45.0;

/// Everything about a record but its effect.
#[derive(Debug, Clone)]
pub struct Bench {
    /// The machine.
    pub machine: Machine,
    /// Wander, housing, channels without noise, tachometer.
    pub field: Field,
    /// Speed of the pinion.
    pub motion: Motion,
    /// Speeds of the pinion at start and end, turns per second.
    pub speeds_hz: [f64; 2],
    /// Torque at the pinion, N m.
    pub torque_n_m: f64,
    /// Sampling rate, Hz.
    pub rate_hz: f64,
    /// Length, s.
    pub duration_s: f64,
    /// Noise of every channel over its signal, and the slope of its power.
    pub noise: Vec<[f64; 2]>,
    /// Whether samples are kept as float values.
    pub float: bool,
}

fn between(random: &mut ChaCha8Rng, low: f64, high: f64) -> f64 {
    low + (high - low) * random.random::<f64>()
}

fn evenly(random: &mut ChaCha8Rng, low: f64, high: f64) -> f64 {
    low * (high / low).powf(random.random::<f64>())
}

fn one_of<T: Copy>(random: &mut ChaCha8Rng, all: &[T]) -> T {
    all[random.random_range(0..all.len())]
}

impl Bench {
    /// Draws one.
    ///
    /// # Errors
    /// A machine that makes no sense: not to be expected.
    pub fn drawn(random: &mut ChaCha8Rng) -> Result<Self> {
        let machine = machine(random)?;
        let [z1, z2] = machine.pair.teeth.map(f64::from);
        let mesh_hz = evenly(random, 150.0, 800.0);
        let speed_hz = (mesh_hz / z1).clamp(7.0, 40.0);
        let rate_hz = one_of(random, &[10_000.0, 12_800.0, 12_800.0, 16_384.0, 20_480.0]);
        let longest = (MOST_SAMPLES / rate_hz).min(40.0);
        let shortest = (LEAST_TURNS * (z2 / z1).max(1.0) / speed_hz).max(10.0).min(longest);
        let duration_s = between(random, shortest, longest).floor().max(5.0);
        let run_up = random.random::<f64>() < 0.2;
        let rise = if run_up { between(random, 1.3, 2.5) } else { 1.0 };
        let from_hz = speed_hz / rise.sqrt();
        let to_hz = speed_hz * rise.sqrt();
        let motion = match run_up {
            true => Motion::RunUp { from_hz, to_hz, duration_s: 0.95 * duration_s },
            false => Motion::Constant { speed_hz, turns_at_zero: 0.0 },
        };
        let channels = random.random_range(1..=4);
        let noise = (0..channels).map(|_| [evenly(random, 0.01, 0.4), between(random, 0.0, 1.6)]).collect();
        let torque_n_m = 6e8 * machine.pair.module_m.powi(3) * evenly(random, 0.7, 2.5);
        let float = random.random();
        let field = field(random, channels, (rate_hz, speed_hz));
        Ok(Self { machine, field, motion, speeds_hz: [from_hz, to_hz], torque_n_m, rate_hz, duration_s, noise, float })
    }

    /// Whether the speed rises.
    pub fn runs_up(&self) -> bool {
        self.speeds_hz[1] > self.speeds_hz[0]
    }

    /// For people.
    pub fn words(&self) -> String {
        let [z1, z2] = self.machine.pair.teeth;
        let [from, to] = self.speeds_hz;
        let speed = if self.runs_up() { format!("{from:.1} to {to:.1}") } else { format!("{from:.1}") };
        let tach = match &self.field.tach {
            None => "no tach".to_owned(),
            Some(wheel) => format!("{} pulses on the {}", wheel.pulses, wheel.shaft_name()),
        };
        let wander = 100.0 * self.field.wander.share;
        let noise: Vec<String> = self.noise.iter().map(|n| format!("{:.3}/{:.1}", n[0], n[1])).collect();
        format!(
            "{z1}/{z2}, {speed} turns/s, wander {wander:.2} %, {tach}, {} s at {} Hz, noise {}",
            self.duration_s,
            self.rate_hz,
            noise.join(" ")
        )
    }
}

fn machine(random: &mut ChaCha8Rng) -> Result<Machine> {
    let pinion = evenly(random, TEETH.0, 48.0).round();
    let gear = (pinion * evenly(random, 1.05, 4.2)).round().min(TEETH.1);
    let teeth = [pinion as u32, gear as u32];
    let module_m = evenly(random, 1.5e-3, 4e-3);
    let face_width_m = module_m * between(random, 7.0, 12.0);
    let radius_m = teeth.map(|z| 0.5 * f64::from(z) * module_m);
    let bores = radius_m.map(|r| 0.3 * r);
    let mut pair = Pair::spur(teeth, module_m, face_width_m, bores);
    pair.mesh_damping_ratio = Some(between(random, 0.03, 0.09));
    let mass = radius_m.map(|r| 7850.0 * PI * r * r * face_width_m);
    let inertia = [0, 1].map(|i| 0.5 * mass[i] * radius_m[i] * radius_m[i]);
    let with_shaft = mass.map(|m| 1.3 * m + 0.8 + 1.5 * random.random::<f64>());
    let bearing = with_shaft.map(|_| evenly(random, 5e7, 2.5e8));
    let damping = [0, 1].map(|i| 2.0 * 0.04 * (bearing[i] * with_shaft[i]).sqrt());
    let coupling = evenly(random, 3e3, 3e4);
    let shafts = Shafts {
        inertia_motor_kg_m2: 6.0 * inertia[0] + 2e-3,
        inertia_pinion_kg_m2: 1.2 * inertia[0] + 5e-5,
        inertia_gear_kg_m2: 1.2 * inertia[1] + 1e-4,
        inertia_load_kg_m2: 4.0 * inertia[1] + 4e-3,
        coupling_stiffness_n_m_per_rad: [coupling, 2.0 * coupling],
        coupling_damping_n_m_s_per_rad: [0.5, 1.2],
        mass_kg: with_shaft,
        bearing_stiffness_n_per_m: bearing,
        bearing_damping_n_s_per_m: damping,
    };
    let engagement = Engagement {
        kind: EngagementKind::RaisedCosine,
        width_rad: Some(between(random, 0.6, 1.4) / pinion),
        relief_m: None,
        relief_length_base_pitches: None,
        relief_exponent: None,
        torque_n_m: None,
    };
    let machine = Machine {
        title: "drawn".into(),
        pair,
        shafts,
        engagement: Some(engagement),
        crack: None,
        motor: None,
        load: None,
        casing: None,
        nominal: None,
        folder: Default::default(),
    };
    machine.prepared("drawn machine", Path::new(""))
}

fn field(random: &mut ChaCha8Rng, channels: usize, (rate_hz, speed_hz): (f64, f64)) -> Field {
    let channel = |i: usize| Channel {
        name: format!("housing {}", i + 1),
        unit: FileUnit::Acceleration,
        volt_per_g: 0.1,
        gain: 1.0,
        offset: 0.0,
        noise_rms_m_s2: 0.0,
        noise_slope: 0.0,
        residues_per_kg: None,
    };
    let band_hz = [0.04, between(random, 0.15, 0.6)];
    let wander = Wander { share: evenly(random, 1e-3, 1e-2), band_hz, ..Wander::default() };
    let housing = Housing {
        modes: random.random_range(5..=12),
        band_hz: [250.0, 0.42 * rate_hz],
        damping: [0.01, 0.05],
        mass_kg: 20.0,
    };
    let pulses = one_of(random, &[1, 1, 1, 8, 60]);
    let wheel = Wheel {
        shaft: one_of(random, &[WheelShaft::Pinion, WheelShaft::Pinion, WheelShaft::Gear]),
        pulses,
        irregularity_percent: if pulses > 1 { between(random, 0.05, 0.3) } else { 0.0 },
        duty: between(random, 0.15, 0.4),
        rise_s: (0.02 / f64::from(pulses) / speed_hz).min(1e-4),
        noise_v: 0.01,
        ..Wheel::default()
    };
    let tach = (random.random::<f64>() < 0.75).then_some(wheel);
    Field { wander, housing, mode: Vec::new(), channel: (0..channels).map(channel).collect(), tach }
}
