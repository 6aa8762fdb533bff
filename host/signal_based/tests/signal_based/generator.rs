//! Records as measured ones are: housing channels behind modal paths, a speed that wanders or runs up, coloured noise.
//!
//! Everything that turns is a list of lines (an order, a frequency, or both) through each channel's path at its
//! momentary frequency; impacts are pulses that ring the path's modes. Nothing here knows the loop. Seeds are fixed.

use meshband_host::record::{Acquisition, Declaration, Record, Run, RunDeclaration, Tach, suggested_full_scale};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rustfft::num_complex::Complex64;
use std::f64::consts::TAU;

/// A line: its phase turns with `order` per pinion turn and with `hz` per second.
#[derive(Debug, Clone, Copy)]
pub struct Line {
    pub order: f64,
    pub hz: f64,
    pub amplitude: f64,
    pub phase: f64,
}

/// Pulses at equal angles that ring the housing.
#[derive(Debug, Clone, Copy)]
pub struct Impacts {
    /// Per turn of the pinion.
    pub order: f64,
    pub amplitude: f64,
    /// Standard deviation of each interval, share of it.
    pub slip: f64,
    /// Order and depth with which they swell and fade.
    pub modulation: Option<(f64, f64)>,
}

/// A machine on its bench.
#[derive(Debug, Clone)]
pub struct Bench {
    pub teeth: [u32; 2],
    pub speed_hz: f64,
    /// Speed at the end over that at the beginning.
    pub run_up: f64,
    /// Share by which the speed wanders.
    pub wander: f64,
    pub seconds: f64,
    pub rate_hz: f64,
    pub channels: usize,
    /// RMS of the noise over that of the mesh.
    pub noise: f64,
    pub seed: u64,
    pub unit: Option<String>,
    /// Declared over true speed.
    pub tach_off: f64,
}

pub const BENCH: Bench = Bench {
    teeth: [23, 61],
    speed_hz: 20.0,
    run_up: 1.0,
    wander: 0.006,
    seconds: 14.0,
    rate_hz: 8192.0,
    channels: 2,
    noise: 0.15,
    seed: 1,
    unit: None,
    tach_off: 1.0,
};

/// One channel's path: modes with random parts.
struct Path(Vec<(f64, f64, f64)>);

impl Path {
    fn new(random: &mut ChaCha8Rng, modes: &[(f64, f64)]) -> Self {
        Self(modes.iter().map(|&(hz, damping)| (hz, damping, random.random_range(-1.0..1.0))).collect())
    }

    fn gain(&self, hz: f64) -> Complex64 {
        let mode = |&(own, damping, part): &(f64, f64, f64)| {
            let r = hz / own;
            part / Complex64::new(1.0 - r * r, 2.0 * damping * r)
        };
        0.3 + self.0.iter().map(mode).sum::<Complex64>()
    }

    fn ring(&self, signal: &mut [f64], at: f64, amplitude: f64, rate_hz: f64) {
        for &(hz, damping, part) in &self.0 {
            let (decay, turn) = (TAU * hz * damping, TAU * hz);
            let first = (at * rate_hz).ceil() as usize;
            let last = first + (6.0 / decay * rate_hz) as usize;
            for i in first..last.min(signal.len()) {
                let t = i as f64 / rate_hz - at;
                signal[i] += amplitude * part * (-decay * t).exp() * (turn * t).sin();
            }
        }
    }
}

impl Bench {
    pub fn gear_order(&self) -> f64 {
        f64::from(self.teeth[0]) / f64::from(self.teeth[1])
    }

    fn speed(&self, t: f64) -> f64 {
        let wander = (TAU * 0.21 * t + self.seed as f64).sin() + 0.6 * (TAU * 0.47 * t + 2.0).sin();
        self.speed_hz * (1.0 + (self.run_up - 1.0) * t / self.seconds) * (1.0 + self.wander * wander)
    }

    /// Turns at every sample.
    fn turns(&self) -> Vec<f64> {
        let count = (self.seconds * self.rate_hz) as usize;
        let mut turns = Vec::with_capacity(count);
        let mut sum = 0.37;
        for i in 0..count {
            turns.push(sum);
            sum += self.speed((i as f64 + 0.5) / self.rate_hz) / self.rate_hz;
        }
        turns
    }

    /// Mesh lines with random amplitudes, 1 for the first on average.
    pub fn mesh(&self) -> Vec<Line> {
        let mut random = ChaCha8Rng::seed_from_u64(1000 + self.seed);
        let z = f64::from(self.teeth[0]);
        let most = (0.35 * self.rate_hz / (z * self.speed_hz * self.run_up.max(1.0))) as usize;
        let line = |k: usize| Line {
            order: k as f64 * z,
            hz: 0.0,
            amplitude: random.random_range(0.4..1.3) / (k as f64).sqrt(),
            phase: random.random_range(0.0..TAU),
        };
        (1..=most.max(1)).map(line).collect()
    }

    /// Sidebands of a shaft about the mesh: share of the mesh line.
    pub fn modulation(&self, own: f64, share: f64, most: usize) -> Vec<Line> {
        let mut random = ChaCha8Rng::seed_from_u64(2000 + self.seed);
        let mut lines = Vec::new();
        for mesh in self.mesh() {
            for n in 1..=most {
                for side in [-1.0, 1.0] {
                    let amplitude = share * mesh.amplitude / n as f64;
                    let phase = random.random_range(0.0..TAU);
                    lines.push(Line { order: mesh.order + side * n as f64 * own, hz: 0.0, amplitude, phase });
                }
            }
        }
        lines
    }

    /// The record with these lines and impacts beside the mesh.
    pub fn record(&self, lines: &[Line], impacts: &[Impacts]) -> Record {
        let turns = self.turns();
        let mut random = ChaCha8Rng::seed_from_u64(self.seed);
        let nyquist = 0.5 * self.rate_hz;
        let modes: Vec<(f64, f64)> = (0..6)
            .map(|i| {
                (
                    nyquist * (0.08 + 0.13 * f64::from(i) + 0.1 * random.random::<f64>()),
                    random.random_range(0.015..0.05),
                )
            })
            .collect();
        let strikes: Vec<(f64, f64)> = impacts.iter().flat_map(|i| self.strikes(i, &turns, &mut random)).collect();
        let all = [self.mesh(), lines.to_vec()].concat();
        let signals: Vec<Vec<f64>> = (0..self.channels)
            .map(|_| {
                let path = Path::new(&mut random, &modes);
                let mut signal = vec![0.0; turns.len()];
                all.iter().for_each(|line| self.add(&mut signal, line, &path, &turns));
                let level = (self.mesh().iter().map(|l| 0.5 * l.amplitude * l.amplitude).sum::<f64>()).sqrt();
                strikes.iter().for_each(|(at, a)| path.ring(&mut signal, *at, *a, self.rate_hz));
                coloured(&mut signal, self.noise * level, &mut random);
                signal
            })
            .collect();
        self.written(signals, &turns)
    }

    fn add(&self, signal: &mut [f64], line: &Line, path: &Path, turns: &[f64]) {
        const STEP: usize = 256;
        let gain = |i: usize| path.gain((line.order * self.speed(i as f64 / self.rate_hz) + line.hz).abs());
        for from in (0..signal.len()).step_by(STEP) {
            let (a, b) = (gain(from), gain(from + STEP));
            for i in from..(from + STEP).min(signal.len()) {
                let u = (i - from) as f64 / STEP as f64;
                let phase = TAU * (line.order * turns[i] + line.hz * i as f64 / self.rate_hz) + line.phase;
                signal[i] += ((a * (1.0 - u) + b * u) * Complex64::from_polar(line.amplitude, phase)).re;
            }
        }
    }

    fn strikes(&self, impacts: &Impacts, turns: &[f64], random: &mut ChaCha8Rng) -> Vec<(f64, f64)> {
        let mut strikes = Vec::new();
        let mut at = turns[0];
        loop {
            let jitter: f64 = StandardNormal.sample(random);
            at += (1.0 + impacts.slip * jitter) / impacts.order;
            let i = turns.partition_point(|turn| *turn < at);
            if i + 1 >= turns.len() {
                return strikes;
            }
            let swell = impacts.modulation.map_or(1.0, |(order, depth)| 1.0 + depth * (TAU * order * at).cos());
            let time = (i as f64 - (turns[i] - at) / (turns[i] - turns[i - 1])) / self.rate_hz;
            strikes.push((time, impacts.amplitude * swell.max(0.0)));
        }
    }

    fn written(&self, signals: Vec<Vec<f64>>, turns: &[f64]) -> Record {
        let edges = (turns[0].ceil() as usize..turns[turns.len() - 1] as usize).map(|turn| {
            let i = turns.partition_point(|t| *t < turn as f64).max(1);
            let share = (turns[i] - turn as f64) / (turns[i] - turns[i - 1]);
            (i as f64 - share) / self.rate_hz / self.tach_off
        });
        let edges: Vec<f64> = edges.collect();
        let acquisition = Acquisition {
            sample_rate_hz: self.rate_hz,
            channels: (0..signals.len()).map(|c| format!("housing {c}")).collect(),
            full_scale_m_s2: suggested_full_scale(&signals),
            code_bits: 16,
            unit: self.unit.clone(),
            other: Default::default(),
        };
        let tach = Tach {
            shaft: "pinion".into(),
            turns_per_pinion_turn: None,
            pulses_per_rev: 1,
            jitter_s: None,
            source: Some("measured".into()),
            other: Default::default(),
        };
        let run = Run::from_signals(RunDeclaration::numbered(0, true, None), &acquisition, &signals, edges)
            .expect("a sound run");
        let mut declared = Declaration::of_import("bench", Some(self.teeth), acquisition, Some(tach));
        declared.runs = vec![run.declaration.clone()];
        Record { folder: "bench".into(), declaration: declared, runs: vec![run] }
    }
}

/// Adds noise that falls with the frequency and has two humps.
fn coloured(signal: &mut [f64], level: f64, random: &mut ChaCha8Rng) {
    let mut low = 0.0;
    let mut humps = [[0.0_f64; 2]; 2];
    let shapes = [(0.97, random.random_range(0.2..1.2)), (0.985, random.random_range(1.2..2.6))];
    for x in signal {
        let white: f64 = StandardNormal.sample(random);
        low = 0.95 * low + 0.3 * white;
        let mut value = 0.6 * white + low;
        for (hump, (radius, angle)) in humps.iter_mut().zip(shapes) {
            let next = 2.0 * radius * f64::cos(angle) * hump[0] - radius * radius * hump[1] + 0.1 * white;
            *hump = [next, hump[0]];
            value += next;
        }
        *x += 0.7 * level * value;
    }
}

impl Bench {
    /// The record with lines added to each channel's own signal, past every path.
    pub fn injected(&self, record: &Record, lines: &[Vec<Line>]) -> Record {
        let turns = self.turns();
        let signals: Vec<Vec<f64>> = lines
            .iter()
            .enumerate()
            .map(|(c, lines)| {
                let mut signal = record.runs[0].signal_m_s2(c);
                for line in lines {
                    let value = |turn: &f64| line.amplitude * (TAU * line.order * turn + line.phase).cos();
                    signal.iter_mut().zip(&turns).for_each(|(x, turn)| *x += value(turn));
                }
                signal
            })
            .collect();
        self.written(signals, &turns)
    }

    /// The record with a part of it, by time, from another.
    pub fn spliced(&self, record: &Record, other: &Record, part: std::ops::Range<f64>) -> Record {
        let signal = |c: usize| {
            let mut signal = record.runs[0].signal_m_s2(c);
            let [from, to] = [part.start, part.end].map(|share| (share * signal.len() as f64) as usize);
            signal[from..to].copy_from_slice(&other.runs[0].signal_m_s2(c)[from..to]);
            signal
        };
        self.written((0..self.channels).map(signal).collect(), &self.turns())
    }

    /// The record with one channel limited at a share of its peak.
    pub fn limited(&self, record: &Record, channel: usize, share: f64) -> Record {
        let mut signals: Vec<Vec<f64>> = (0..self.channels).map(|c| record.runs[0].signal_m_s2(c)).collect();
        let top = share * signals[channel].iter().fold(0.0_f64, |top, x| top.max(x.abs()));
        signals[channel].iter_mut().for_each(|x| *x = x.clamp(-top, top));
        self.written(signals, &self.turns())
    }
}
