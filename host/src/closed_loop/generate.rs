//! Synthetic records with known contents, for training and proof of the loop.
//!
//! Time-domain integration (RK4, about 205 kHz) of the declared equations with tooth-by-tooth contact forces, so that nothing
//! of the harmonic balance is shared; effects enter the equations themselves. Decimation by a linear-phase Kaiser filter
//! flat to 15 kHz, delay removed. [`response`] gives the same equations without noise at a given angle, for effects whose
//! response is not proportional to their strength. Cost: about 0.1 s per 2 s run. Limits: linear contact, constant nominal speed.

use crate::machine::Hunting;
use crate::machine::{Pair, Shafts};
use crate::model::harmonic_balance::Machine;
use crate::observation::input::{Record, Run};
use crate::spectral::bessel_i0;
use crate::stiffness::pair_curve::PairCurve;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;
use rustfft::{FftPlanner, num_complex::Complex64 as C};
use std::f64::consts::{PI, TAU};

/// Something in the record that the declaration does not mention. Angles in rad, SI units, `shaft` 0 pinion and 1 gear.
#[derive(Debug, Clone)]
#[allow(missing_docs, reason = "fields are named by quantity and unit")]
pub enum Effect {
    Eccentricity {
        shaft: usize,
        amplitude_m: f64,
        phase_rad: f64,
    },
    PitchError {
        shaft: usize,
        offsets_m: Vec<f64>,
    },
    Imbalance {
        shaft: usize,
        kg_m: f64,
        phase_rad: f64,
    },
    /// Displacement error at an order of the pinion.
    Ghost {
        order: f64,
        amplitude_m: f64,
        phase_rad: f64,
    },
    /// Torque at an order of the pinion, as a share of the mean torque; `at` 0 motor, 3 load.
    TorqueRipple {
        at: usize,
        order: f64,
        share: f64,
        phase_rad: f64,
    },
    /// Torque at a fixed frequency, as a share of the mean torque; `at` 0 motor, 3 load.
    FixedTorque {
        at: usize,
        hz: f64,
        share: f64,
    },
    /// Radial force at twice the shaft rate.
    Misalignment {
        shaft: usize,
        force_n: f64,
        phase_rad: f64,
    },
    BearingModulation {
        shaft: usize,
        order: f64,
        share: f64,
        phase_rad: f64,
    },
    StiffnessModulation {
        order: f64,
        share: f64,
        phase_rad: f64,
    },
    /// One tooth's pair stiffness lowered by a share.
    Crack {
        shaft: usize,
        tooth: usize,
        share: f64,
    },
    /// Parabolic wear depth, zero at mid path and `depth_m` at both ends.
    Wear {
        depth_m: f64,
    },
    /// Additive tone on both channels, amplitudes in m/s2, the same in all runs.
    Tone {
        hz: f64,
        amplitude: [f64; 2],
    },
    /// Parallel structural mode in one channel's path: `y (1 + gain H(f))`.
    PathMode {
        channel: usize,
        hz: f64,
        damping: f64,
        gain: f64,
    },
    /// Linear change of a channel's gain over the run.
    Drift {
        channel: usize,
        share: f64,
    },
    /// Relief of the pair by `amount_m` at both ends of the path, falling to zero over `share` of it.
    TipRelief {
        amount_m: f64,
        share: f64,
    },
    /// `y + a y^2 + b y^3`.
    Nonlinearity {
        channel: usize,
        per_m_s2: f64,
        per_m2_s4: f64,
    },
    /// Channel limited to a share of its largest value in all runs.
    Clipping {
        channel: usize,
        share_of_peak: f64,
    },
    /// Channel later than the other by `seconds`.
    Delay {
        channel: usize,
        seconds: f64,
    },
    /// Share of what lies above half the sampling rate that no filter keeps from folding.
    Folding {
        share: f64,
    },
    /// Contacts carried along their path at an order of the pinion, amplitude in base pitches.
    PositionSwing {
        order: f64,
        base_pitches: f64,
        phase_rad: f64,
    },
    /// Sinusoidal departure of the pinion's angle at a fixed frequency, seen by the tachometer, too.
    SpeedFluctuation {
        hz: f64,
        angle_rad: f64,
    },
    /// Damped bursts at a jittered order of the pinion.
    Impacts {
        channel: usize,
        order: f64,
        jitter: f64,
        hz: f64,
        damping: f64,
        peak: f64,
    },
}

/// What to generate.
#[derive(Debug, Clone)]
pub struct Scenario {
    /// Machine as it is (may differ from the declaration within tolerance).
    pub actual: Shafts,
    /// Factor on the actual pair stiffness.
    pub stiffness_factor: f64,
    /// Factor on the actual mesh damping.
    pub damping_factor: f64,
    /// Undeclared effects.
    pub effects: Vec<Effect>,
    /// RMS of added noise, m/s2.
    pub noise_rms: f64,
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
/// Least rate of the integration, Hz: the stiffest mode lies below a tenth of it.
const LEAST_STEP_RATE_HZ: f64 = 200_000.0;

/// Generates the record of a scenario for a declared pair, shafts and pair curve.
pub fn record(pair: &Pair, shafts: &Shafts, curve: &PairCurve, scenario: &Scenario) -> Record {
    let points: Vec<(f64, f64)> =
        scenario.speeds_hz.iter().flat_map(|&f| scenario.torques_n_m.iter().map(move |&t| (f, t))).collect();
    let actual_curve = curve.times(|_| scenario.stiffness_factor);
    let mut actual = Machine::new(pair, &scenario.actual, &actual_curve);
    actual.tau_s *= scenario.damping_factor;
    let mut runs: Vec<Run> = points
        .par_iter()
        .enumerate()
        .map(|(index, &(speed, torque))| run(&actual, scenario, index, speed, torque))
        .collect();
    for effect in &scenario.effects {
        if let Effect::Clipping { channel, share_of_peak } = *effect {
            let peak = runs.iter().flat_map(|r| &r.channels[channel]).fold(0.0_f64, |m, x| m.max(x.abs()));
            let limit = share_of_peak * peak;
            runs.iter_mut().flat_map(|r| &mut r.channels[channel]).for_each(|x| *x = x.clamp(-limit, limit));
        }
    }
    Record {
        title: format!("generated-{}", scenario.seed),
        pair: pair.clone(),
        shafts: shafts.clone(),
        curve: curve.clone(),
        sample_rate_hz: RATE_HZ,
        unit: "m/s2".into(),
        top_hz: None,
        pulses_per_rev: 1,
        jitter_s: 5e-7,
        runs,
    }
}

struct Plant<'a> {
    actual: &'a Shafts,
    effects: &'a [Effect],
    base_radius: [f64; 2],
    teeth: [f64; 2],
    stiffness: Vec<f64>,
    contact_ratio: f64,
    mean_stiffness: f64,
    tau: f64,
    speed: f64,
    start: f64,
    torque: f64,
    ratio: f64,
    tone_phase: f64,
}

impl Plant<'_> {
    fn pair_stiffness(&self, u: f64) -> f64 {
        let x = u / self.contact_ratio * (self.stiffness.len() - 1) as f64;
        let i = x as usize;
        if u < 0.0 || i + 1 >= self.stiffness.len() {
            return 0.0;
        }
        self.stiffness[i] + (x - i as f64) * (self.stiffness[i + 1] - self.stiffness[i])
    }

    fn angle(&self, t: f64) -> f64 {
        let mut theta = self.start + TAU * self.speed * t;
        for effect in self.effects {
            if let Effect::SpeedFluctuation { hz, angle_rad } = *effect {
                theta += angle_rad * (TAU * hz * t + self.tone_phase).sin();
            }
        }
        theta
    }

    /// Accelerations of the six coordinates.
    fn accelerations(&self, t: f64, q: &[f64; 6], v: &[f64; 6]) -> [f64; 6] {
        let s = self.actual;
        let theta = self.angle(t);
        let omega = TAU * self.speed;
        let [rb1, rb2] = self.base_radius;
        let delta = rb1 * q[1] - rb2 * q[2] + q[4] - q[5];
        let rate = rb1 * v[1] - rb2 * v[2] + v[4] - v[5];
        let (mut error, mut error_rate, mut roll) = (0.0, 0.0, 0.0);
        let mut force = [0.0; 6];
        let mut bearing = s.bearing_stiffness_n_per_m;
        let mut mesh_factor = 1.0;
        for effect in self.effects {
            match *effect {
                Effect::Eccentricity { shaft, amplitude_m, phase_rad } => {
                    let o = if shaft == 0 { 1.0 } else { self.ratio };
                    // The displaced gear carries its contact along the path.
                    roll += amplitude_m * (o * theta + phase_rad).cos() / (TAU * self.base_radius[0] / self.teeth[0]);
                    error += amplitude_m * (o * theta + phase_rad).cos();
                    error_rate -= amplitude_m * o * omega * (o * theta + phase_rad).sin();
                }
                Effect::PositionSwing { order, base_pitches, phase_rad } => {
                    roll += base_pitches * (order * theta + phase_rad).cos();
                }
                Effect::Ghost { order, amplitude_m, phase_rad } => {
                    error += amplitude_m * (order * theta + phase_rad).cos();
                    error_rate -= amplitude_m * order * omega * (order * theta + phase_rad).sin();
                }
                Effect::Imbalance { shaft, kg_m, phase_rad } => {
                    let o = if shaft == 0 { 1.0 } else { self.ratio };
                    force[4 + shaft] += kg_m * (o * omega).powi(2) * (o * theta + phase_rad).cos();
                }
                Effect::Misalignment { shaft, force_n, phase_rad } => {
                    let o = if shaft == 0 { 2.0 } else { 2.0 * self.ratio };
                    force[4 + shaft] += force_n * (o * theta + phase_rad).cos();
                }
                Effect::TorqueRipple { at, order, share, phase_rad } => {
                    let mean = if at == 0 { self.torque } else { self.torque / self.ratio };
                    force[at] += mean * share * (order * theta + phase_rad).cos();
                }
                Effect::FixedTorque { at, hz, share } => {
                    let mean = if at == 0 { self.torque } else { self.torque / self.ratio };
                    force[at] += mean * share * (TAU * hz * t + self.tone_phase).cos();
                }
                Effect::BearingModulation { shaft, order, share, phase_rad } => {
                    bearing[shaft] *= 1.0 + share * (order * theta + phase_rad).cos();
                }
                Effect::StiffnessModulation { order, share, phase_rad } => {
                    mesh_factor += share * (order * theta + phase_rad).cos();
                }
                _ => {}
            }
        }
        let position = theta * self.teeth[0] / TAU + roll;
        let newest = position.floor();
        let mut mesh = 0.0;
        let mut pair = newest;
        while position - pair < self.contact_ratio {
            let u = position - pair;
            let mut k = self.pair_stiffness(u) * mesh_factor;
            let (mut e, mut e_rate) = (error, error_rate);
            for effect in self.effects {
                match effect {
                    Effect::PitchError { shaft, offsets_m } => {
                        e += offsets_m[pair.rem_euclid(self.teeth[*shaft]) as usize];
                    }
                    Effect::Crack { shaft, tooth, share } if pair.rem_euclid(self.teeth[*shaft]) as usize == *tooth => {
                        k *= 1.0 - share;
                    }
                    Effect::TipRelief { amount_m, share } => {
                        let x = u / self.contact_ratio;
                        let depth = |x: f64| ((share - x) / share).max(0.0);
                        e += amount_m * (depth(x) + depth(1.0 - x));
                        let per_s = self.speed * self.teeth[0] / self.contact_ratio / share;
                        e_rate += amount_m * per_s * (f64::from(x > 1.0 - share) - f64::from(x < *share));
                    }
                    Effect::Wear { depth_m } => {
                        let x = 2.0 * u / self.contact_ratio - 1.0;
                        e += depth_m * x * x;
                        e_rate += depth_m * 4.0 * x / self.contact_ratio * self.speed * self.teeth[0];
                    }
                    _ => {}
                }
            }
            mesh += k * (delta - e + self.tau * (rate - e_rate));
            pair -= 1.0;
        }
        let input =
            s.coupling_stiffness_n_m_per_rad[0] * (q[0] - q[1]) + s.coupling_damping_n_m_s_per_rad[0] * (v[0] - v[1]);
        let output =
            s.coupling_stiffness_n_m_per_rad[1] * (q[2] - q[3]) + s.coupling_damping_n_m_s_per_rad[1] * (v[2] - v[3]);
        let c = s.bearing_damping_n_s_per_m;
        [
            (self.torque - input + force[0]) / s.inertia_motor_kg_m2,
            (input - rb1 * mesh) / s.inertia_pinion_kg_m2,
            (rb2 * mesh - output) / s.inertia_gear_kg_m2,
            (output - self.torque / self.ratio + force[3]) / s.inertia_load_kg_m2,
            (force[4] - bearing[0] * q[4] - c[0] * v[4] - mesh) / s.mass_kg[0],
            (force[5] - bearing[1] * q[5] - c[1] * v[5] + mesh) / s.mass_kg[1],
        ]
    }

    /// One step; returns the accelerations at its start.
    fn step(&self, t: f64, h: f64, q: &mut [f64; 6], v: &mut [f64; 6]) -> [f64; 6] {
        let mix = |a: &[f64; 6], b: &[f64; 6], s: f64| std::array::from_fn(|i| a[i] + s * b[i]);
        let a1 = self.accelerations(t, q, v);
        let (q2, v2): ([f64; 6], [f64; 6]) = (mix(q, v, 0.5 * h), mix(v, &a1, 0.5 * h));
        let a2 = self.accelerations(t + 0.5 * h, &q2, &v2);
        let (q3, v3): ([f64; 6], [f64; 6]) = (mix(q, &v2, 0.5 * h), mix(v, &a2, 0.5 * h));
        let a3 = self.accelerations(t + 0.5 * h, &q3, &v3);
        let (q4, v4): ([f64; 6], [f64; 6]) = (mix(q, &v3, h), mix(v, &a3, h));
        let a4 = self.accelerations(t + h, &q4, &v4);
        for i in 0..6 {
            q[i] += h / 6.0 * (v[i] + 2.0 * v2[i] + 2.0 * v3[i] + v4[i]);
            v[i] += h / 6.0 * (a1[i] + 2.0 * a2[i] + 2.0 * a3[i] + a4[i]);
        }
        a1
    }
}

/// Where and how one run is taken.
#[derive(Debug, Clone, Copy)]
pub struct Point {
    /// Angle of the pinion at the first sample, rad.
    pub start_rad: f64,
    /// Pinion speed, Hz.
    pub speed_hz: f64,
    /// Input torque, N m.
    pub torque_n_m: f64,
    /// Phase of everything not locked to the shaft, rad.
    pub free_phase_rad: f64,
}

impl<'a> Plant<'a> {
    /// The machine as it is, not as declared.
    fn new(machine: &'a Machine, effects: &'a [Effect], at: Point) -> Self {
        let curve = &machine.curve;
        let contact_ratio = curve.contact_ratio();
        let fine = 4096;
        Self {
            actual: &machine.shafts,
            effects,
            base_radius: machine.base_radius_m,
            teeth: machine.teeth.map(f64::from),
            stiffness: (0..=fine).map(|i| curve.at(contact_ratio * i as f64 / fine as f64)).collect(),
            contact_ratio,
            tau: machine.tau_s,
            speed: at.speed_hz,
            start: at.start_rad,
            torque: at.torque_n_m,
            ratio: f64::from(machine.teeth[0]) / f64::from(machine.teeth[1]),
            mean_stiffness: curve.transform(0.0).re,
            tone_phase: at.free_phase_rad,
        }
    }

    /// Accelerations of both bodies, settled, through the decimation filter.
    fn settled(&self, samples: usize, rate_hz: f64) -> [Vec<f64>; 2] {
        let over = (LEAST_STEP_RATE_HZ / rate_hz).ceil().max(1.0) as usize;
        let h = 1.0 / (rate_hz * over as f64);
        let taps = kaiser_low_pass(rate_hz, over);
        let half = taps.len() / 2;
        let settle = (0.35 / h) as usize;
        let force = self.torque / self.base_radius[0];
        let s = self.actual;
        let (y1, y2) = (-force / s.bearing_stiffness_n_per_m[0], force / s.bearing_stiffness_n_per_m[1]);
        let twist = (force / self.mean_stiffness - y1 + y2) / self.base_radius[0];
        let mut q = [
            twist + self.torque / s.coupling_stiffness_n_m_per_rad[0],
            twist,
            0.0,
            -self.torque / self.ratio / s.coupling_stiffness_n_m_per_rad[1],
            y1,
            y2,
        ];
        let mut v = [0.0; 6];
        let total = settle + samples * over + half;
        let mut fine_signal = [Vec::with_capacity(total), Vec::with_capacity(total)];
        for n in 0..total {
            let t = (n as f64 - settle as f64) * h;
            let a = self.step(t, h, &mut q, &mut v);
            if n + half >= settle {
                fine_signal[0].push(a[4]);
                fine_signal[1].push(a[5]);
            }
        }
        let folded =
            self.effects.iter().map(|e| if let Effect::Folding { share } = e { *share } else { 0.0 }).sum::<f64>();
        fine_signal.map(|fine| {
            (0..samples)
                .map(|n| {
                    let filtered = taps.iter().zip(&fine[n * over..]).map(|(a, b)| a * b).sum::<f64>();
                    filtered + folded * (fine[n * over + half] - filtered)
                })
                .collect()
        })
    }
}

/// Noise-free accelerations of both bodies with `effects` in the equations (effects of the path are left out).
pub fn response(machine: &Machine, effects: &[Effect], at: Point, samples: usize, rate_hz: f64) -> [Vec<f64>; 2] {
    Plant::new(machine, effects, at).settled(samples, rate_hz)
}

fn run(machine: &Machine, scenario: &Scenario, index: usize, speed: f64, torque: f64) -> Run {
    let mut rng = ChaCha8Rng::seed_from_u64(scenario.seed.wrapping_mul(1009).wrapping_add(index as u64));
    // Any turn of the hunting period, from a stream of its own.
    let mut other = ChaCha8Rng::seed_from_u64(scenario.seed.wrapping_mul(2003).wrapping_add(index as u64));
    let turn = if scenario.within_one_turn { 0 } else { other.random::<u32>() % Hunting::of(machine.teeth).turns };
    let at = Point {
        speed_hz: speed * (1.0 + 0.004 * (rng.random::<f64>() - 0.5)),
        start_rad: TAU * (f64::from(turn) - rng.random::<f64>()),
        torque_n_m: torque,
        free_phase_rad: TAU * rng.random::<f64>(),
    };
    let speed = at.speed_hz;
    let plant = Plant::new(machine, &scenario.effects, at);
    let samples = (scenario.duration_s * RATE_HZ) as usize;
    let mut channels = plant.settled(samples, RATE_HZ);
    for effect in &scenario.effects {
        apply_path(effect, &mut channels, &plant, &mut rng);
    }
    for channel in &mut channels {
        let mut state = 0.0;
        let colour = scenario.noise_colour;
        for x in channel.iter_mut() {
            let white: f64 = StandardNormal.sample(&mut rng);
            state = colour * state + (1.0 - colour * colour).sqrt() * white;
            let lsb = 150.0 / 32767.0;
            *x = ((*x + scenario.noise_rms * state) / lsb).round() * lsb;
        }
    }
    let first = (plant.angle(0.0) / TAU).ceil();
    let edges_s = (0..)
        .map(|i| {
            let target = (first + f64::from(i)) * TAU;
            // Fixed point: the departure's rate is a small share of the speed.
            (0..30).fold((target - plant.start) / (TAU * speed), |t, _| t - (plant.angle(t) - target) / (TAU * speed))
        })
        .take_while(|t| *t < scenario.duration_s)
        .map(|t| {
            let jitter: f64 = StandardNormal.sample(&mut rng);
            (t + 5e-7 * jitter).max(0.0)
        })
        .collect();
    let name = format!("run{index:02}.npy");
    Run { name, channels, edges_s, first_pulse_index: 0, input_torque_n_m: torque, clipped_share: 0.0 }
}

fn apply_path(effect: &Effect, channels: &mut [Vec<f64>; 2], plant: &Plant<'_>, rng: &mut ChaCha8Rng) {
    match *effect {
        Effect::Tone { hz, amplitude } => {
            for (channel, a) in channels.iter_mut().zip(amplitude) {
                for (n, x) in channel.iter_mut().enumerate() {
                    *x += a * (TAU * hz * n as f64 / RATE_HZ + plant.tone_phase).cos();
                }
            }
        }
        Effect::PathMode { channel, hz, damping, gain } => {
            let (w, h) = (TAU * hz, 1.0 / RATE_HZ);
            let wd = w * (1.0 - damping * damping).sqrt();
            // Exact recursion of the mode's impulse response w^2/wd exp(-z w t) sin(wd t).
            let (r, c) = ((-damping * w * h).exp(), (wd * h).cos());
            let scale = w * w / wd * r * (wd * h).sin() * h;
            let (mut y1, mut y2, mut x1) = (0.0, 0.0, 0.0);
            for x in channels[channel].iter_mut() {
                let y = 2.0 * r * c * y1 - r * r * y2 + scale * x1;
                (y2, y1, x1) = (y1, y, *x);
                *x += gain * y;
            }
        }
        Effect::Drift { channel, share } => {
            let n = channels[channel].len() as f64;
            for (i, x) in channels[channel].iter_mut().enumerate() {
                *x *= 1.0 + share * (i as f64 / n - 0.5);
            }
        }
        Effect::Nonlinearity { channel, per_m_s2, per_m2_s4 } => {
            channels[channel].iter_mut().for_each(|x| *x += (per_m_s2 + per_m2_s4 * *x) * *x * *x);
        }
        Effect::Delay { channel, seconds } => {
            let n = channels[channel].len();
            let mut bins: Vec<C> = channels[channel].iter().map(|x| C::new(*x, 0.0)).collect();
            let mut planner = FftPlanner::new();
            planner.plan_fft_forward(n).process(&mut bins);
            for (k, bin) in bins.iter_mut().enumerate() {
                let signed = if 2 * k > n { k as f64 - n as f64 } else { k as f64 };
                *bin *= C::cis(-TAU * signed * RATE_HZ / n as f64 * seconds) / n as f64;
            }
            planner.plan_fft_inverse(n).process(&mut bins);
            channels[channel].iter_mut().zip(&bins).for_each(|(x, bin)| *x = bin.re);
        }
        Effect::Impacts { channel, order, jitter, hz, damping, peak } => {
            let interval = 1.0 / (order * plant.speed);
            let mut t = interval * rng.random::<f64>();
            let length = channels[channel].len();
            while t < length as f64 / RATE_HZ {
                let size: f64 = peak * (1.0 + 0.2 * rng.random::<f64>());
                let from = (t * RATE_HZ).ceil() as usize;
                for n in from..(from + 2000).min(length) {
                    let dt = n as f64 / RATE_HZ - t;
                    channels[channel][n] += size * (-damping * TAU * hz * dt).exp() * (TAU * hz * dt).sin();
                }
                let wander: f64 = StandardNormal.sample(rng);
                t += interval * (1.0 + jitter * wander).max(0.2);
            }
        }
        _ => {}
    }
}

/// Low-pass at `over` times the output rate: flat to 15 kHz, 90 dB down from 36 kHz (at 51.2 kHz); odd length, unit gain.
fn kaiser_low_pass(rate_hz: f64, over: usize) -> Vec<f64> {
    let fine_hz = rate_hz * over as f64;
    let (half, beta) = ((fine_hz * 1.465e-4) as i32, 9.0);
    let cut = (25_000.0_f64).min(0.49 * rate_hz) / fine_hz;
    let mut taps: Vec<f64> = (-half..=half)
        .map(|n| {
            let x = f64::from(n);
            let sinc = if n == 0 { 2.0 * cut } else { (TAU * cut * x).sin() / (PI * x) };
            sinc * bessel_i0(beta * (1.0 - (x / f64::from(half)).powi(2)).max(0.0).sqrt()) / bessel_i0(beta)
        })
        .collect();
    let sum: f64 = taps.iter().sum();
    taps.iter_mut().for_each(|tap| *tap /= sum);
    taps
}
