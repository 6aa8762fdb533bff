//! The record: the bench without its effect, what the effect changes at a strength in multiples of the record's
//! floor, noise, files, import.
//!
//! Two simulations without noise, with the effect and without it; the difference is added in proportion (near the
//! floor effects are linear in their strength). *Floor*: the strength at which the strongest line of the difference,
//! over orders (of a tone: over frequency), reaches `6 sqrt(S / T)` in the noise of its channel, as in the campaign
//! of model-based inference. Mesh harmonics do not count: what an effect changes in them the unknown path takes in, and
//! an effect may change them most. The tachometer's voltage is written beside the channels and read by `import`.

use super::bench::Bench;
use super::hidden::{Draw, Hidden, Source};
use crate::dynamics::Effect;
use crate::dynamics::assembly::{Damping, Model};
use crate::dynamics::rig::Rig;
use crate::field::{FieldRun, Format, Site, WheelShaft, add_noise, content};
use crate::import::tach::{Shaft, TachOptions};
use crate::import::{ImportOptions, TachChoice, import};
use crate::record::Record;
use crate::spectral::{AngleMap, Window, amplitude_spectrum, resample_by_angle};
use crate::{Error, Result, effects};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::ChaCha12Rng;
use rand_chacha::rand_core::SeedableRng;
use std::f64::consts::TAU;

/// Lines are looked at from this frequency, Hz, up to this share of the rate.
const LOWEST_HZ: f64 = 5.0;
const PASS_SHARE: f64 = 0.4;
/// Bins over which the noise is averaged, on each side.
const NOISE_BINS: usize = 40;
/// Bins about a mesh harmonic that are its own.
const MESH_BINS: f64 = 8.0;
/// Amplitude of a Hann line at `6 sqrt(S / T)` over the root mean square of the noise's: `6 / sqrt(2 x 1.5)`.
const FLOOR_OVER_NOISE: f64 = 3.464;
/// Tolerance of the simulation: six digits beneath the signal are far below any noise here.
const TOLERANCE: f64 = 1e-6;

/// A record and what is in it.
pub struct Made {
    /// As imported.
    pub record: Record,
    /// Noise alone, channel by channel.
    pub noise: Vec<Vec<f64>>,
    /// The effect in numbers.
    pub truth: String,
}

/// Signals of a bench without noise.
struct Clean {
    run: FieldRun,
    angle: AngleMap,
}

/// Makes the record of a bench with an effect at `level` times its floor; `seed` draws what the bench leaves open.
///
/// # Errors
/// What stops the simulation or refuses the import.
pub fn record(bench: &Bench, hidden: Option<(&Hidden, f64)>, seed: u64) -> Result<Made> {
    let mut rig = Rig::new(&bench.machine, Model::default(), Damping::Declared)?;
    rig.options.tolerance = TOLERANCE;
    let site = Site::new(&bench.field, &bench.machine, &rig, (bench.rate_hz, bench.duration_s), seed);
    let motion = site.motion(&bench.motion, seed);
    let simulated = |texts: &[String]| -> Result<FieldRun> {
        let mut all: Vec<Box<dyn Effect>> = texts.iter().map(|text| effects::parse(text)).collect::<Result<_>>()?;
        all.extend(site.effects());
        site.run(&motion, bench.torque_n_m, &all, seed)
    };
    let mut random = ChaCha8Rng::seed_from_u64(seed ^ 0x5eed);
    let run = simulated(&[])?;
    let angle = AngleMap::new(&run.turn_times_s, 1, run.first_turn as f64)
        .ok_or_else(|| Error::invalid("bench", "has fewer than two turns"))?;
    let mut clean = Clean { run, angle };
    let noise = noise(bench, &clean.run, seed);
    let mut draw = Draw { teeth: bench.machine.pair.teeth, random: &mut random };
    let mut truth = String::new();
    match hidden.map(|(h, level)| (h, level, h.source)) {
        None | Some((_, _, Source::Clipping)) => {}
        Some((h, _, Source::Unseen(strength))) => {
            truth = h.effect(strength, &mut draw);
            clean.run.channels = simulated(&[truth.clone()])?.channels;
        }
        Some((h, level, source)) => {
            let (difference, reference, words) = match source {
                Source::Simulated(reference) => {
                    let mut draws = draw.random.clone();
                    let text = h.effect(reference, &mut draw);
                    let with = simulated(&[text])?.channels;
                    let difference = with.iter().zip(&clean.run.channels).map(|(b, a)| minus(b, a)).collect();
                    let again = move |strength: f64| {
                        h.effect(strength, &mut Draw { teeth: bench.machine.pair.teeth, random: &mut draws })
                    };
                    (difference, reference, Words::Effect(Box::new(again)))
                }
                Source::Impacts(inner) => {
                    let (signal, words) = impacts(&site, &clean, inner, &mut draw);
                    (signal, 1.0, Words::Plain(words))
                }
                _ => {
                    let (signal, words) = tone(bench, matches!(source, Source::Tone(true)), &mut draw);
                    (signal, 1.0, Words::Plain(words))
                }
            };
            let is_tone = matches!(source, Source::Tone(_));
            let Strongest { over_noise, place, channel } = strongest(bench, &clean, &difference, &noise, is_tone);
            let factor = level / over_noise;
            for (channel, change) in clean.run.channels.iter_mut().zip(&difference) {
                channel.iter_mut().zip(change).for_each(|(x, d)| *x += factor * d);
            }
            truth = match words {
                Words::Effect(mut again) => again(reference * factor),
                Words::Plain(words) => format!("{words}, strength {factor:.3e}"),
            };
            let per = if is_tone { "second" } else { "turn of the pinion" };
            truth += &format!("; strongest line at {place:.3} per {per}, channel {channel}");
        }
    }
    for (channel, noise) in clean.run.channels.iter_mut().zip(&noise) {
        channel.iter_mut().zip(noise).for_each(|(x, n)| *x += n);
    }
    if let Some((Hidden { source: Source::Clipping, .. }, level)) = hidden {
        truth = clip(&mut clean.run.channels, level, &mut random);
    }
    let record = imported(bench, &site, &clean.run, seed)?;
    Ok(Made { record, noise, truth })
}

enum Words<'a> {
    Effect(Box<dyn FnMut(f64) -> String + 'a>),
    Plain(String),
}

fn minus(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a - b).collect()
}

fn rms(signal: &[f64]) -> f64 {
    (signal.iter().map(|x| x * x).sum::<f64>() / signal.len().max(1) as f64).sqrt()
}

fn noise(bench: &Bench, run: &FieldRun, seed: u64) -> Vec<Vec<f64>> {
    let of_channel = |(i, (signal, [share, slope])): (usize, (&Vec<f64>, &[f64; 2]))| {
        let mut noise = vec![0.0; signal.len()];
        let mut random = ChaCha12Rng::seed_from_u64(seed);
        random.set_stream(900 + i as u64);
        add_noise(&mut noise, bench.rate_hz, share * rms(signal), *slope, &mut random);
        noise
    };
    run.channels.iter().zip(&bench.noise).enumerate().map(of_channel).collect()
}

/// The strongest line of a difference.
struct Strongest {
    /// Amplitude over that of a line at the floor.
    over_noise: f64,
    /// Order, or Hz.
    place: f64,
    /// Channel.
    channel: usize,
}

/// Which line of `difference` stands highest over its floor.
fn strongest(bench: &Bench, clean: &Clean, difference: &[Vec<f64>], noise: &[Vec<f64>], is_tone: bool) -> Strongest {
    let (first, last) = clean.angle.range();
    let (from, turns) = (first.ceil() + 1.0, (last - first) as usize - 3);
    let per_turn = (1.1 * bench.rate_hz / bench.speeds_hz[0]).ceil() as usize;
    let spectrum = |signal: &[f64]| {
        if is_tone {
            return amplitude_spectrum(signal, bench.rate_hz, Window::Hann);
        }
        let samples = resample_by_angle(signal, bench.rate_hz, &clean.angle, from, turns, per_turn);
        amplitude_spectrum(&samples, per_turn as f64, Window::Hann)
    };
    let [slowest, fastest] = bench.speeds_hz;
    let top = PASS_SHARE * bench.rate_hz;
    let (low, high) = if is_tone { (LOWEST_HZ, top) } else { (LOWEST_HZ / slowest, top / fastest) };
    let mesh = f64::from(bench.machine.pair.teeth[0]);
    let on_mesh = |order: f64| {
        let k = (order / mesh).round();
        !is_tone && k >= 1.0 && (order - k * mesh).abs() * (turns as f64) < MESH_BINS
    };
    let mut strongest = Strongest { over_noise: 1e-30, place: 0.0, channel: 0 };
    for (channel, (signal, noise)) in difference.iter().zip(noise).enumerate() {
        let (line, noise) = (spectrum(signal), spectrum(noise));
        let mean = smoothed(&noise.values);
        for (i, (value, mean)) in line.values.iter().zip(&mean).enumerate().skip(1) {
            let (place, over_noise) = (line.frequency(i), value / (FLOOR_OVER_NOISE * mean));
            if (low..high).contains(&place) && !on_mesh(place) && over_noise > strongest.over_noise {
                strongest = Strongest { over_noise, place, channel };
            }
        }
    }
    strongest
}

/// Root of the mean square over neighbouring bins.
fn smoothed(values: &[f64]) -> Vec<f64> {
    let mut sums = vec![0.0];
    for x in values {
        sums.push(sums[sums.len() - 1] + x * x);
    }
    let mean = |i: usize| {
        let (a, b) = (i.saturating_sub(NOISE_BINS), (i + NOISE_BINS + 1).min(values.len()));
        ((sums[b] - sums[a]) / (b - a) as f64).sqrt().max(1e-300)
    };
    (0..values.len()).map(mean).collect()
}

/// Rolling elements strike the housing through either bearing: an impulse of force each, on every channel through its
/// path.
fn impacts(site: &Site, clean: &Clean, inner: bool, draw: &mut Draw) -> (Vec<Vec<f64>>, String) {
    let body = draw.random.random_range(0..2_usize);
    let [z1, z2] = draw.teeth.map(f64::from);
    let own = [1.0, z1 / z2][body];
    let (outer, slip) = (draw.passage(), draw.random.random_range(0.002..0.012));
    let elements = (2.0 * outer / 0.75).round();
    let order = own * if inner { elements - outer } else { outer };
    let samples = clean.run.channels[0].len();
    let mut force = vec![0.0; samples];
    let (mut at, last) = clean.angle.range();
    at += draw.random.random::<f64>() / order;
    while at < last {
        let swell = if inner { 0.5 + 0.5 * (TAU * own * at).cos() } else { 1.0 };
        let place = clean.angle.time_at(at) * site.rate_hz;
        let (i, u) = (place.max(0.0) as usize, place.fract());
        if i + 1 < samples {
            force[i] += swell * (1.0 - u);
            force[i + 1] += swell * u;
        }
        let jitter: f64 = (0..12).map(|_| draw.random.random::<f64>()).sum::<f64>() - 6.0;
        at += (1.0 + slip * jitter).max(0.2) / order;
    }
    let mut forces = vec![vec![0.0; samples]; 4];
    forces[body] = force;
    let ring = if inner { "inner" } else { "outer" };
    (site.paths.accelerations(forces, site.rate_hz), format!("{ring} ring, order {order:.4}, slip {slip:.4}"))
}

/// A tone with two harmonics, in every channel with a share of its own.
fn tone(bench: &Bench, supply: bool, draw: &mut Draw) -> (Vec<Vec<f64>>, String) {
    let hz: f64 = if supply {
        [50.0, 60.0][draw.random.random_range(0..2)] * draw.random.random_range(0.999..1.001)
    } else {
        draw.random.random_range(120.0..0.3 * bench.rate_hz)
    };
    let samples = (bench.rate_hz * bench.duration_s) as usize;
    let channel = |random: &mut ChaCha8Rng| {
        let parts: Vec<[f64; 2]> = [1.0, if supply { 0.4 } else { 0.0 }]
            .iter()
            .map(|a| [a * random.random_range(0.2..1.0), TAU * random.random::<f64>()])
            .collect();
        let value = |i: usize| -> f64 {
            let turns = hz * i as f64 / bench.rate_hz;
            parts.iter().enumerate().map(|(n, [a, phase])| a * (TAU * (n + 1) as f64 * turns + phase).cos()).sum()
        };
        (0..samples).map(value).collect()
    };
    ((0..bench.noise.len()).map(|_| channel(draw.random)).collect(), format!("tone at {hz:.3} Hz"))
}

/// Limits one channel at a share of its peak that falls with the level.
fn clip(channels: &mut [Vec<f64>], level: f64, random: &mut ChaCha8Rng) -> String {
    let index = random.random_range(0..channels.len());
    let channel = &mut channels[index];
    let top = (1.0 - 0.05 * level.min(10.0)) * channel.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    channel.iter_mut().for_each(|x| *x = x.clamp(-top, top));
    format!("channel {index} limited at {top:.4}")
}

/// Through a file of an acquisition system and `import`.
fn imported(bench: &Bench, site: &Site, run: &FieldRun, seed: u64) -> Result<Record> {
    let folder = std::env::temp_dir().join(format!("meshband-field-{}-{seed:016x}", std::process::id()));
    std::fs::create_dir_all(&folder).map_err(Error::file(&folder))?;
    let file = folder.join("run00.wav");
    let bytes = content(Format::Wav, run, &site.field.channel, bench.rate_hz)?;
    let written = std::fs::write(&file, bytes).map_err(Error::file(&file));
    let made = written.and_then(|()| import(std::slice::from_ref(&file), &options(bench, run)));
    std::fs::remove_dir_all(&folder).map_err(Error::file(&folder))?;
    Ok(made?.0)
}

fn options(bench: &Bench, run: &FieldRun) -> ImportOptions {
    let teeth = bench.machine.pair.teeth;
    let z = f64::from(teeth[0]);
    let tach = bench.field.tach.as_ref().map(|wheel| TachOptions {
        sources: vec![(run.channels.len() + 1).to_string()],
        pulses: wheel.pulses,
        shaft: if wheel.shaft == WheelShaft::Gear { Shaft::Gear } else { Shaft::Pinion },
        falling: None,
        threshold: None,
    });
    let [from, to] = bench.speeds_hz;
    ImportOptions {
        title: "field".into(),
        teeth: Some(teeth),
        // What an owner knows who reads the speed from a display.
        mesh_guess_hz: (!bench.runs_up()).then_some(1.004 * z * from),
        mesh_range_hz: bench.runs_up().then_some([0.93 * z * from, 1.07 * z * to]),
        float: bench.float,
        tach: tach.map_or(TachChoice::Virtual, TachChoice::Measured),
        remove_mean: true,
        ..ImportOptions::default()
    }
}
