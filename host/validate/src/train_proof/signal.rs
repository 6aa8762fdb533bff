//! Signals of a train: mesh forces over time, a fault in them, the way to the sensors, noise, tachometer.
//!
//! A mesh force is a sum of harmonics whose strength the load share, a runout and a bad tooth change; of a planetary
//! set there is one force per planet, phased by its place and heard as it passes the sensor, with load shares that
//! differ by a few per cent (a sound set's do). Forces of every stage grow with its torque and pass the modes of a
//! housing. The fault is the difference of two signals; its *floor* is the strength at which its strongest line that
//! no sound train has, over orders, reaches `6 sqrt(S / T)` in the noise of its channel. Limit: nothing acts back on
//! the train.

use super::bench::{Bench, Fault, Hidden, RATE_HZ, SECONDS};
use crate::field::{Field, Paths};
use crate::record::{Acquisition, Declaration, Record, Run, RunDeclaration, Tach};
use crate::spectral::{AngleMap, Window, amplitude_spectrum, resample_by_angle};
use crate::train::{Mesh, Role, lines};
use crate::{Error, Result};
use rand::RngExt;
use rand_chacha::rand_core::SeedableRng;
use rand_chacha::{ChaCha8Rng, ChaCha12Rng};
use rand_distr::{Distribution, StandardNormal};
use std::f64::consts::{PI, TAU};
use std::path::PathBuf;
use toml::Table;

/// Harmonics of a mesh force.
const HARMONICS: usize = 8;
/// Strength at which a fault is put in before it is scaled.
const REFERENCE: f64 = 0.05;
/// Standard deviation of the planets' load shares.
const LOAD_SHARE_DEVIATION: f64 = 0.03;
/// Part of a planet's force that a sensor hears wherever it is.
const CONSTANT_FORCE_SHARE: f64 = 0.15;
/// Standard deviation of an edge of the tachometer, s.
const JITTER_S: f64 = 2e-6;
/// Bins over which noise is averaged on each side, and bins about a sound line that are its own.
const NOISE_BINS: usize = 40;
const OWN_BINS: f64 = 6.0;
/// Amplitude of a Hann line at `6 sqrt(S / T)` over the root mean square of the noise's: `6 / sqrt(2 x 1.5)`.
const FLOOR_OVER_NOISE: f64 = 3.464;
/// Time that is made and thrown away before the record, s.
const LEAD_S: f64 = 1.0;

/// The housing: a few modes that reach down to slow meshes.
const HOUSING: &str = "[housing]\nmodes = 10\nband_hz = [120, 4000]\ndamping = [0.02, 0.06]\nmass_kg = \
    20\n[[channel]]\nname = \"a\"\n[[channel]]\nname = \"b\"\n";

/// What of a mesh is drawn once for a record.
struct Voice {
    amplitudes: Vec<f64>,
    phases: Vec<f64>,
    shares: Vec<f64>,
    torque: f64,
}

struct Drawn {
    voices: Vec<Voice>,
    /// Where the fault is on its gear, turns; how much of a runout is of phase; shape of a bad tooth in pitches.
    place: f64,
    of_phase: f64,
    width: f64,
    paths: Paths,
}

impl Drawn {
    fn of(bench: &Bench, seed: u64) -> Result<Self> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let voice = |mesh: &Mesh, random: &mut ChaCha8Rng| {
            let steep = if mesh.helix_angle_deg > 0.0 { 1.0 } else { 0.5 };
            let amplitude =
                |k: usize, random: &mut ChaCha8Rng| (0.3 + random.random::<f64>()) * (-steep * k as f64).exp();
            let count = mesh.carrier.as_ref().map_or(1, |carrier| carrier.planets as usize);
            let share = |random: &mut ChaCha8Rng| {
                let normal: f64 = StandardNormal.sample(random);
                1.0 + if count > 1 { LOAD_SHARE_DEVIATION * normal } else { 0.0 }
            };
            Voice {
                amplitudes: (0..HARMONICS).map(|k| amplitude(k, random)).collect(),
                phases: (0..HARMONICS).map(|_| TAU * random.random::<f64>()).collect(),
                shares: (0..count).map(|_| share(random)).collect(),
                torque: 1.0 / bench.train.shaft_order(mesh.stage).value(),
            }
        };
        let voices = bench.train.meshes.iter().map(|mesh| voice(mesh, &mut random)).collect();
        let field = Field::parse(HOUSING, "housing")?;
        Ok(Self {
            voices,
            place: random.random::<f64>(),
            of_phase: random.random::<f64>(),
            width: 0.8 + 0.8 * random.random::<f64>(),
            paths: Paths::drawn(&field, &mut ChaCha12Rng::seed_from_u64(seed ^ 0x9a7)),
        })
    }
}

/// Forces of all stages at the samples, with a fault at a strength.
fn forces(bench: &Bench, drawn: &Drawn, fault: Option<(Hidden, f64)>, turns: &[f64]) -> Vec<Vec<f64>> {
    let mut all = vec![vec![0.0; turns.len()]; 4];
    for (m, mesh) in bench.train.meshes.iter().enumerate() {
        let voice = &drawn.voices[m];
        let own = fault.filter(|(hidden, _)| mesh.gears.contains(&hidden.gear));
        for (x, turn) in all[m.min(3)].iter_mut().zip(turns) {
            *x += voice.torque * of_mesh(bench, drawn, voice, mesh, own, *turn);
        }
    }
    all
}

fn of_mesh(bench: &Bench, drawn: &Drawn, voice: &Voice, mesh: &Mesh, fault: Option<(Hidden, f64)>, turn: f64) -> f64 {
    let order = mesh.order.value();
    let mut sum = 0.0;
    for (i, share) in voice.shares.iter().enumerate() {
        let (place, teeth, heard) = match &mesh.carrier {
            None => (0.0, 0.0, 1.0),
            Some(carrier) => {
                let place = i as f64 / f64::from(carrier.planets);
                let at = (carrier.speed.magnitude().value() * turn + place).rem_euclid(1.0) - 0.5;
                (
                    place,
                    f64::from(carrier.ring),
                    CONSTANT_FORCE_SHARE + (1.0 - CONSTANT_FORCE_SHARE) * (PI * at).cos().powi(4),
                )
            }
        };
        let (gain, lead) =
            fault.map_or((1.0, 0.0), |(hidden, strength)| change(bench, drawn, hidden, strength, i, place, turn));
        let phase = TAU * ((order * turn).fract() + (teeth * place).fract()) + lead;
        let harmonics = voice.amplitudes.iter().zip(&voice.phases).enumerate();
        let force: f64 = harmonics.map(|(k, (a, p))| a * ((k + 1) as f64 * phase + p).cos()).sum();
        // A bad tooth also leaves part of the load for its neighbours: a push that is no multiple of the mesh.
        sum += heard * share * (gain * force + (gain - 1.0));
    }
    sum
}

/// What a fault does to the force of planet `i` (or of a pair): a factor, and a lead of the mesh's phase, rad.
fn change(
    bench: &Bench,
    drawn: &Drawn,
    Hidden { gear, fault }: Hidden,
    strength: f64,
    i: usize,
    place: f64,
    turn: f64,
) -> (f64, f64) {
    let own = &bench.train.gears[gear];
    let turned = own.rate.magnitude().value() * turn + drawn.place;
    // A tooth of a standing ring is met where it stands, planet after planet as the carrier turns.
    let place = if own.role == Role::Ring { -place } else { place };
    // Which contacts of the gear are this force's: a planet's are its own, sun and ring meet every planet where it is.
    let contacts: &[f64] = match own.role {
        Role::Planet if i > 0 => return (1.0, 0.0),
        Role::Planet => &[0.0, 0.5],
        _ => &[0.0],
    };
    match fault {
        Fault::Runout => {
            let at = TAU * (turned - place);
            (1.0 + strength * at.cos(), strength * drawn.of_phase * (at + 1.0).cos())
        }
        Fault::Tooth => {
            let pitch = 1.0 / f64::from(own.teeth);
            let loss = |contact: &f64| {
                let away = (turned - place - contact + 0.5).rem_euclid(1.0) - 0.5;
                let over = away / (drawn.width * pitch);
                if over.abs() < 1.0 { 0.5 + 0.5 * (PI * over).cos() } else { 0.0 }
            };
            (1.0 - strength * contacts.iter().map(loss).sum::<f64>(), 0.0)
        }
    }
}

/// A record with a fault at `level` times its floor, and the fault in words.
///
/// # Errors
/// Signals that a record refuses.
pub fn record(bench: &Bench, hidden: Option<(Hidden, f64)>, seed: u64) -> Result<(Record, String)> {
    let drawn = Drawn::of(bench, seed)?;
    let count = (SECONDS * RATE_HZ) as usize;
    let lead = (LEAD_S * RATE_HZ) as usize;
    let time = |i: usize| (i as f64 - lead as f64) / RATE_HZ;
    let turns: Vec<f64> = (0..lead + count + lead).map(|i| bench.turns(time(i))).collect();
    let heard = |fault: Option<(Hidden, f64)>| -> Vec<Vec<f64>> {
        let mut channels = drawn.paths.accelerations(forces(bench, &drawn, fault, &turns), RATE_HZ);
        channels.iter_mut().for_each(|channel| {
            channel.drain(..lead);
            channel.truncate(count);
        });
        channels
    };
    let mut channels = heard(None);
    let mut random = ChaCha8Rng::seed_from_u64(seed ^ 0x0015e);
    let noise: Vec<Vec<f64>> = channels
        .iter()
        .map(|channel| {
            let rms = (channel.iter().map(|x| x * x).sum::<f64>() / count as f64).sqrt();
            (0..count).map(|_| bench.noise * rms * Distribution::<f64>::sample(&StandardNormal, &mut random)).collect()
        })
        .collect();
    let mut truth = String::new();
    if let Some((hidden, level)) = hidden {
        let with = heard(Some((hidden, REFERENCE)));
        let change: Vec<Vec<f64>> =
            with.iter().zip(&channels).map(|(a, b)| a.iter().zip(b).map(|(a, b)| a - b).collect()).collect();
        let (over, order) = strongest(bench, &change, &noise)?;
        let factor = level / over;
        for (channel, change) in channels.iter_mut().zip(&change) {
            channel.iter_mut().zip(change).for_each(|(x, d)| *x += factor * d);
        }
        let words = bench.train.gears[hidden.gear].words();
        truth =
            format!("{words}, {:?}, strength {:.3e}; strongest line at {order:.4}", hidden.fault, REFERENCE * factor);
    }
    for (channel, noise) in channels.iter_mut().zip(&noise) {
        channel.iter_mut().zip(noise).for_each(|(x, n)| *x += n);
    }
    Ok((made(bench, channels, &mut random)?, truth))
}

/// The record's tables and run.
fn made(bench: &Bench, channels: Vec<Vec<f64>>, random: &mut ChaCha8Rng) -> Result<Record> {
    let (shaft, pulses) = bench.tach;
    let order = bench.train.shaft_order(shaft).value();
    let largest = channels.iter().flatten().fold(0.0, |a: f64, x| a.max(x.abs()));
    let acquisition = Acquisition {
        sample_rate_hz: RATE_HZ,
        channels: (0..channels.len()).map(|c| format!("channel {c}")).collect(),
        full_scale_m_s2: 1.1 * largest,
        code_bits: crate::record::FLOAT_BITS,
        unit: None,
        other: Table::new(),
    };
    let tach = Tach {
        shaft: "pinion".into(),
        turns_per_pinion_turn: None,
        pulses_per_rev: pulses,
        jitter_s: None,
        source: Some("measured".into()),
        other: Table::new(),
    };
    let tach = tach.on_train_shaft(shaft, order);
    let mut declaration = Declaration::of_import("drawn train", None, acquisition.clone(), Some(tach));
    declaration.rest.extend(bench.train.declaration.tables()?);
    let run = RunDeclaration::numbered(0, true, None);
    let edges = edges(bench, order * f64::from(pulses), random);
    let run = Run::from_signals(run, &acquisition, &channels, edges)?;
    declaration.runs = vec![run.declaration.clone()];
    Ok(Record { folder: PathBuf::from("."), declaration, runs: vec![run] })
}

/// Edge times of a tachometer of so many pulses per turn of the input.
fn edges(bench: &Bench, per_turn: f64, random: &mut ChaCha8Rng) -> Vec<f64> {
    let last = (bench.turns(SECONDS) * per_turn) as usize;
    let mut t = 0.0;
    let mut all = Vec::with_capacity(last);
    for pulse in 1..last {
        let wanted = pulse as f64 / per_turn;
        for _ in 0..6 {
            let speed = (bench.turns(t + 1e-4) - bench.turns(t - 1e-4)) / 2e-4;
            t += (wanted - bench.turns(t)) / speed;
        }
        let jitter: f64 = StandardNormal.sample(random);
        all.push(t + JITTER_S * jitter);
    }
    all
}

/// How far the strongest line that no sound train has stands over the floor, and its order.
fn strongest(bench: &Bench, change: &[Vec<f64>], noise: &[Vec<f64>]) -> Result<(f64, f64)> {
    let turns = bench.turns(SECONDS).floor() as usize - 2;
    let per_turn = (1.3 * RATE_HZ / bench.speed_hz[0]).ceil() as usize;
    let edge = |turn: usize| {
        let mut t = turn as f64 / bench.speed_hz[1];
        for _ in 0..20 {
            let speed = (bench.turns(t + 1e-4) - bench.turns(t - 1e-4)) / 2e-4;
            t += (turn as f64 - bench.turns(t)) / speed;
        }
        t
    };
    let times: Vec<f64> = (0..turns + 2).map(edge).collect();
    let map = AngleMap::new(&times, 1, 0.0).ok_or_else(|| Error::invalid("drawn train", "has no turns"))?;
    let highest = 0.4 * RATE_HZ / bench.speed_hz[1];
    let sound = lines::of_sound_meshes(&bench.train, highest);
    let mut best = (0.0, 0.0);
    for (change, noise) in change.iter().zip(noise) {
        let spectrum = |signal: &[f64]| {
            let samples = resample_by_angle(signal, RATE_HZ, &map, 1.0, turns, per_turn);
            amplitude_spectrum(&samples, per_turn as f64, Window::Hann)
        };
        let (own, floor) = (spectrum(change), spectrum(noise));
        let powers: Vec<f64> = floor.values.iter().map(|x| x * x).collect();
        let mean = |i: usize| {
            let part = &powers[i.saturating_sub(NOISE_BINS)..(i + NOISE_BINS + 1).min(powers.len())];
            (part.iter().sum::<f64>() / part.len() as f64).sqrt()
        };
        let last = ((highest / own.bin) as usize).min(own.values.len().saturating_sub(1));
        for i in 8..last {
            let order = i as f64 * own.bin;
            let after = sound.partition_point(|line| *line < order - OWN_BINS * own.bin);
            if sound.get(after).is_some_and(|line| *line <= order + OWN_BINS * own.bin) {
                continue;
            }
            let over = own.values[i] / (FLOOR_OVER_NOISE * mean(i)).max(f64::MIN_POSITIVE);
            if over > best.0 {
                best = (over, order);
            }
        }
    }
    if best.0 > 0.0 { Ok(best) } else { Err(Error::invalid("drawn train", "the fault has no line of its own")) }
}
