//! A train, how it runs and how it is measured, drawn from a seed.

use crate::train::{Declaration, Role, Train};
use crate::{Error, Result};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// Length of a record, s.
pub const SECONDS: f64 = 40.0;
/// Sampling rate of a record, Hz.
pub const RATE_HZ: f64 = 10_240.0;
/// Turns of a gear below which nothing is hidden in it: what signal-based inference does not judge either.
const MIN_GEAR_TURNS: f64 = 30.0;
/// One record in so many runs up.
const RUNS_UP: u64 = 5;
/// Pulses per second that a tachometer gives at least.
const PULSES_HZ: f64 = 8.0;

/// What happens to a gear.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    /// Once per turn, smoothly.
    Runout,
    /// One tooth.
    Tooth,
}

/// A fault at a gear, by index.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Hidden {
    /// Index among the train's gears.
    pub gear: usize,
    /// What.
    pub fault: Fault,
}

/// One record's conditions.
#[derive(Debug, Clone)]
pub struct Bench {
    /// The train.
    pub train: Train,
    /// Kind of the train, for groups: "two pairs", "set of 4 planets".
    pub kind: String,
    /// Speed of the input at the beginning and at the end, Hz.
    pub speed_hz: [f64; 2],
    /// Wander: share of the speed, frequency in Hz, phase in turns.
    pub wander: Vec<[f64; 3]>,
    /// Shaft of the tachometer, pulses per turn.
    pub tach: (usize, u32),
    /// Noise over the signal, root mean squares.
    pub noise: f64,
    /// Channels.
    pub channels: usize,
}

impl Bench {
    /// Draws record `number` of a campaign.
    ///
    /// # Errors
    /// A train that its own declaration refuses.
    pub fn drawn(number: u64, random: &mut ChaCha8Rng) -> Result<Self> {
        let (text, kind) = match number % 5 {
            0 => (pairs(2, random), "two pairs".to_owned()),
            1 => (pairs(3, random), "three pairs".to_owned()),
            2 | 3 => set(random),
            _ => {
                let (text, kind) = set(random);
                (text + &pairs(1, random), format!("{kind} and a pair"))
            }
        };
        let train = Train::of(Declaration::parse(&text, "drawn train")?)?;
        let first = 22.0 + 16.0 * random.random::<f64>();
        let runs_up = (number / 5) % RUNS_UP == RUNS_UP - 1;
        let last = if runs_up { first * (1.3 + 0.5 * random.random::<f64>()) } else { first };
        let wander = (0..3)
            .map(|_| [0.004 * random.random::<f64>(), 0.05 + 0.35 * random.random::<f64>(), random.random::<f64>()])
            .collect();
        let shaft = random.random_range(0..train.shafts.len());
        let least = PULSES_HZ / (first * train.shaft_order(shaft).value());
        let wheels = [1, 2, 8, 60, 120].into_iter().filter(|pulses| f64::from(*pulses) >= least);
        let pulses = wheels.take(2).nth(random.random_range(0..2)).unwrap_or(120);
        Ok(Self {
            train,
            kind,
            speed_hz: [first, last],
            wander,
            tach: (shaft, pulses),
            noise: 0.05 + 0.25 * random.random::<f64>(),
            channels: 2,
        })
    }

    /// Turns of the input at a time, s.
    pub fn turns(&self, t: f64) -> f64 {
        let [first, last] = self.speed_hz;
        let mean = first * t + 0.5 * (last - first) * t * t / SECONDS;
        let swing = |[share, hz, phase]: &[f64; 3]| {
            let cycle = std::f64::consts::TAU;
            share * first / (cycle * hz) * ((cycle * (hz * t + phase)).sin() - (cycle * phase).sin())
        };
        mean + self.wander.iter().map(swing).sum::<f64>()
    }

    /// Whether the speed runs up.
    pub fn runs_up(&self) -> bool {
        self.speed_hz[1] > 1.1 * self.speed_hz[0]
    }

    /// Draws a fault at a gear that turns often enough.
    ///
    /// # Errors
    /// A train none of whose gears does.
    pub fn hidden(&self, random: &mut ChaCha8Rng) -> Result<Hidden> {
        let turns = self.turns(SECONDS);
        let mut all = Vec::new();
        for (gear, own) in self.train.gears.iter().enumerate() {
            if own.rate.magnitude().value() * turns < MIN_GEAR_TURNS {
                continue;
            }
            all.push(Hidden { gear, fault: Fault::Tooth });
            if own.role != Role::Ring {
                all.push(Hidden { gear, fault: Fault::Runout });
            }
        }
        if all.is_empty() {
            return Err(Error::invalid("drawn train", "has no gear that turns often enough"));
        }
        Ok(all[random.random_range(0..all.len())])
    }

    /// In words.
    pub fn words(&self) -> String {
        let teeth: Vec<String> = self.train.gears.iter().map(|gear| gear.teeth.to_string()).collect();
        format!(
            "{}: teeth {}, {:.1} to {:.1} Hz, tach {} per turn of shaft {}, noise {:.2}",
            self.kind,
            teeth.join(" "),
            self.speed_hz[0],
            self.speed_hz[1],
            self.tach.1,
            self.tach.0,
            self.noise
        )
    }
}

fn pairs(count: usize, random: &mut ChaCha8Rng) -> String {
    let one = |random: &mut ChaCha8Rng| {
        let pinion: u32 = random.random_range(17..34);
        let ratio = 1.6 + 1.7 * random.random::<f64>();
        let gear = (f64::from(pinion) * ratio).round() as u32;
        let helix: u32 = if random.random::<bool>() { 0 } else { random.random_range(8..21) };
        format!("[[stage]]\nkind = \"pair\"\nteeth = [{pinion}, {gear}]\nhelix_angle_deg = {helix}\n")
    };
    (0..count).map(|_| one(random)).collect()
}

fn set(random: &mut ChaCha8Rng) -> (String, String) {
    loop {
        let planets: u32 = random.random_range(3..6);
        let (sun, planet): (u32, u32) = (random.random_range(20..37), random.random_range(20..37));
        let ring = sun + 2 * planet;
        let apart = f64::from(sun + planet) * (std::f64::consts::PI / f64::from(planets)).sin();
        if (sun + ring) % planets == 0 && apart > f64::from(planet + 2) {
            let text = format!(
                "[[stage]]\nkind = \"planetary\"\nsun = {sun}\nplanet = {planet}\nring = {ring}\nplanets = \
                 {planets}\nfixed = \"ring\"\ninput = \"sun\"\n"
            );
            return (text, format!("set of {planets} planets"));
        }
    }
}
