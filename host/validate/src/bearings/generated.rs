//! Generated rigs of one shaft with a bearing: a point process of impacts behind two resonances, shaft lines, a
//! supply, another machine, noise.
//!
//! Drawn at random: bearing (7 to 12 elements, ratio 0.16 to 0.3), speed and its wander, jitter 0.2 to 2 % an impact,
//! slip to 1.5 %, load zone of an inner ring, an outer ring under a load that turns (one in three), amplitude
//! scatter, noise that rises towards low frequencies. The strength is a multiple of the *floor*: the strength at
//! which the first line of the squared envelope, in a band matched to the resonance, reaches 6 times the root of its
//! noise's density over the record's length. Limit: two channels, ten seconds.

use super::{Damage, Labelled};
use crate::import::{self, ImportOptions, TachChoice};
use crate::machine::bearing::{Bearing, BearingOrders};
use crate::record::npy;
use crate::{Error, Result};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use std::f64::consts::TAU;
use std::path::Path;

/// Samples per second, and seconds.
const RATE_HZ: f64 = 16_000.0;
const SECONDS: f64 = 10.0;
/// Height of a line over the noise's amplitude density at the floor.
const FLOOR: f64 = 6.0;

/// What was drawn.
struct Drawn {
    orders: BearingOrders,
    speed_hz: f64,
    wander: f64,
    jitter: f64,
    slip: f64,
    scatter: f64,
    turning: f64,
    ring_hz: [f64; 2],
    damping: f64,
}

/// A record with damage at `level` times its floor, written to and read from `folder`.
///
/// # Errors
/// A folder that cannot be written to.
pub fn record(damage: Damage, level: f64, seed: u64, folder: &Path) -> Result<Labelled> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let drawn = drawn(&mut random);
    let count = (RATE_HZ * SECONDS) as usize;
    let turns = turns(&drawn, count, &mut random);
    let mut channels: Vec<Vec<f64>> = (0..2).map(|_| background(&turns, &mut random)).collect();
    if let Some(order) = damage.order(&drawn.orders) {
        let strength = level * floor(&drawn, order * (1.0 - drawn.slip));
        impacts(&drawn, (damage, order), strength, &turns, &mut channels, &mut random);
    }
    let name = format!("{damage:?}-{seed}");
    let path = folder.join(format!("{name}.npy"));
    let samples: Vec<f64> = (0..count).flat_map(|i| channels.iter().map(move |channel| channel[i])).collect();
    std::fs::write(&path, npy::bytes_f64(&samples, channels.len()))
        .map_err(|error| Error::invalid(path.display(), error))?;
    let options = ImportOptions {
        title: name.clone(),
        rate_hz: Some(RATE_HZ),
        float: true,
        no_gears: true,
        tach: TachChoice::Nominal(drawn.speed_hz),
        ..ImportOptions::default()
    };
    let read = import::import(std::slice::from_ref(&path), &options);
    std::fs::remove_file(&path).map_err(|error| Error::invalid(path.display(), error))?;
    let bearing =
        Bearing { name: "drawn".into(), shaft: "shaft".into(), orders: Some(drawn.orders), ..Bearing::default() };
    Ok(Labelled { name, record: read?.0, bearing, damage })
}

fn drawn(random: &mut ChaCha8Rng) -> Drawn {
    let turning = if random.random_range(0..3) == 0 { random.random_range(0.2..0.7) } else { 0.0 };
    Drawn {
        orders: BearingOrders::of(random.random_range(7..=12), random.random_range(0.16..0.3)),
        speed_hz: random.random_range(12.0..32.0),
        wander: random.random_range(0.0..5e-4),
        jitter: 10.0_f64.powf(random.random_range(-2.7..-1.7)),
        slip: random.random_range(0.0..0.015),
        scatter: random.random_range(0.1..0.4),
        turning,
        ring_hz: [random.random_range(1500.0..4000.0), random.random_range(4000.0..6500.0)],
        damping: random.random_range(0.02..0.06),
    }
}

/// Turns of the shaft at each sample: the speed wanders slowly about the nominal one.
fn turns(drawn: &Drawn, count: usize, random: &mut ChaCha8Rng) -> Vec<f64> {
    let swings: Vec<(f64, f64)> =
        (0..3).map(|_| (random.random_range(0.05..0.5), TAU * random.random::<f64>())).collect();
    let mut turns = random.random::<f64>();
    let step = |i: usize| {
        let swing: f64 = swings.iter().map(|(hz, phase)| (TAU * hz * i as f64 / RATE_HZ + phase).sin()).sum();
        turns += drawn.speed_hz / RATE_HZ * (1.0 + drawn.wander * swing);
        turns
    };
    (0..count).map(step).collect()
}

/// Noise of unit density above its corner, shaft orders, a supply, and a tone of another machine.
fn background(turns: &[f64], random: &mut ChaCha8Rng) -> Vec<f64> {
    let lines: Vec<(f64, f64)> =
        (1..=5).map(|_| (random.random_range(0.2..3.0), TAU * random.random::<f64>())).collect();
    let tones = [50.0, 100.0, random.random_range(200.0..3000.0)].map(|hz: f64| (hz, random.random_range(0.1..1.0)));
    let corner = (-TAU * random.random_range(100.0..600.0) / RATE_HZ).exp();
    let mut low = 0.0;
    let sample = |(i, turn): (usize, &f64)| {
        let white: f64 = StandardNormal.sample(random);
        low = corner * low + white;
        let shaft: f64 = (1..).zip(&lines).map(|(k, (a, phase))| a * (TAU * f64::from(k) * turn + phase).sin()).sum();
        let hum: f64 = tones.iter().map(|(hz, a)| a * (TAU * hz * i as f64 / RATE_HZ).sin()).sum();
        white + 0.3 * low + shaft + hum
    };
    turns.iter().enumerate().map(sample).collect()
}

/// Strength of impacts at the floor: in a band of the resonance's own width `b` the mean of the squared envelope of
/// the noise is `4 b / rate` of its variance, and its density over frequency the square of that over `b`.
fn floor(drawn: &Drawn, order: f64) -> f64 {
    let band_hz = TAU * drawn.damping * drawn.ring_hz[0];
    let noise = 2.0 * 2.0 * band_hz / RATE_HZ;
    let density = noise * noise / band_hz;
    let line = FLOOR * (density / SECONDS).sqrt();
    // A burst of unit strength has the energy 1 / (2 decay) in its squared envelope, `order x speed` of them a
    // second, and twice that in the first line.
    let decay = TAU * drawn.damping * drawn.ring_hz[0];
    (line / (2.0 * order * drawn.speed_hz / (2.0 * decay))).sqrt()
}

fn impacts(
    drawn: &Drawn,
    (damage, order): (Damage, f64),
    strength: f64,
    turns: &[f64],
    channels: &mut [Vec<f64>],
    random: &mut ChaCha8Rng,
) {
    let interval = 1.0 / (order * (1.0 - drawn.slip));
    let mut next = turns[0] + interval * random.random::<f64>();
    let cage = drawn.orders.cage * (1.0 - drawn.slip);
    let mut i = 0;
    while let Some(at) = turns[i..].iter().position(|turn| *turn >= next).map(|offset| i + offset) {
        i = at;
        let zone = |turn: f64| (TAU * turn).cos().max(0.0).powf(1.5);
        let load = match damage {
            Damage::Inner => zone(next),
            Damage::Element => zone(cage * next),
            Damage::Outer | Damage::Sound => 1.0 + drawn.turning * (TAU * next).cos(),
        };
        let scatter: f64 = StandardNormal.sample(random);
        let own = strength * load * (1.0 + drawn.scatter * scatter).max(0.0);
        for (channel, (ring_hz, share)) in channels.iter_mut().zip([(drawn.ring_hz[0], 1.0), (drawn.ring_hz[1], 0.6)]) {
            let decay = TAU * drawn.damping * ring_hz;
            for (n, x) in channel[i..].iter_mut().take((8.0 / decay * RATE_HZ) as usize).enumerate() {
                let t = n as f64 / RATE_HZ;
                *x += share * own * (-decay * t).exp() * (TAU * ring_hz * t).sin();
            }
        }
        let wander: f64 = StandardNormal.sample(random);
        next += interval * (1.0 + drawn.jitter * wander).max(0.1);
    }
}
