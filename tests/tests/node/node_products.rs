//! What the node makes of whole signals: sidebands of both shafts, run-ups, the law's check, and a cracked tooth.

use meshband::alarm::{AlarmBand, Watched};
use meshband::config::Configuration;
use meshband::events::EventKind;
use meshband::law::{Law, LawForm};
use meshband::message::{GearCondition, GearIndicators, GearSpectrum, Indicators, Message, Peaks, Spectrum};
use meshband::node::{Block, Node};
use meshband::units::{Acceleration, Hertz, TicksPerSecond};
use meshband_host::dynamics::assembly::{Damping, Model};
use meshband_host::dynamics::{Motion, Rig};
use meshband_host::machine::{Crack, Machine, Side};
use std::f64::consts::TAU;

const BLOCK: usize = 512;
const CLOCK: f64 = 25.0e6;
const M_S2_PER_CODE: f64 = 0.01;

/// What a node has said.
#[derive(Default)]
pub struct Heard {
    pub spectra: Vec<Spectrum>,
    pub indicators: Vec<Indicators>,
    pub peaks: Vec<Peaks>,
    pub further: Vec<GearSpectrum>,
    pub conditions: Vec<GearCondition>,
    pub events: Vec<EventKind>,
}

impl Heard {
    /// Spectra of a gear of a train: 0 is the pinion.
    pub fn spectra_of(&self, gear: u8) -> impl Iterator<Item = &Spectrum> {
        let pinion = self.spectra.iter().filter(move |_| gear == 0);
        pinion.chain(self.further.iter().filter(move |of| of.gear == gear).map(|of| &of.spectrum))
    }
}

pub fn config(pinion_teeth: u16, gear_teeth: u16) -> Configuration {
    let mut config = Configuration::default();
    (config.gears.pinion_teeth, config.gears.gear_teeth) = (pinion_teeth, gear_teeth);
    config.sensor.acceleration_per_code = Acceleration(M_S2_PER_CODE as f32);
    config
}

/// Feeds a node for `seconds`; `turns(t)` must ascend, `signal(t, turns)` is the acceleration.
pub fn run(
    config: Configuration,
    seconds: f64,
    turns: impl Fn(f64) -> f64,
    signal: impl FnMut(f64, f64) -> f64,
) -> Heard {
    run_with(config, seconds, 1.0, turns, signal)
}

/// [`run`] with so many tach pulses per turn.
pub fn run_with(
    config: Configuration,
    seconds: f64,
    pulses: f64,
    turns: impl Fn(f64) -> f64,
    mut signal: impl FnMut(f64, f64) -> f64,
) -> Heard {
    let mut node = Box::new(Node::new(config, TicksPerSecond(CLOCK as u32)).expect("a sound configuration"));
    let mut heard = Heard::default();
    let (mut first, mut next_turn, mut sequence) = (1_000u64, 0.0, 0);
    let mut period = node.requested_period_ticks();
    let mut codes = [0u16; BLOCK];
    while (first as f64) < seconds * CLOCK {
        for (n, code) in codes.iter_mut().enumerate() {
            let t = (first + n as u64 * u64::from(period)) as f64 / CLOCK;
            *code = ((signal(t, turns(t)) / M_S2_PER_CODE).round() + 32_768.0).clamp(0.0, 65_535.0) as u16;
        }
        let end = first + BLOCK as u64 * u64::from(period);
        while next_turn <= turns(end as f64 / CLOCK) {
            let (mut low, mut high) = (first as f64 / CLOCK - 1.0, end as f64 / CLOCK);
            for _ in 0..50 {
                let middle = 0.5 * (low + high);
                if turns(middle) < next_turn { low = middle } else { high = middle }
            }
            node.on_tach_edge((high * CLOCK).round() as i64 as u32);
            next_turn += 1.0 / pulses;
        }
        let first_tick = first as u32;
        node.on_block(Block { codes: &codes, second: &[], first_tick, period_ticks: period, sequence, overrun: false });
        (sequence, first, period) = (sequence + 1, end, node.requested_period_ticks());
        while let Some(message) = node.poll(end as u32) {
            match message {
                Message::Spectrum(spectrum) => heard.spectra.push(spectrum),
                Message::Indicators(indicators) => heard.indicators.push(indicators),
                Message::GearSpectrum(spectrum) => heard.further.push(spectrum),
                Message::GearCondition(condition) => heard.conditions.push(condition),
                Message::Peaks(peaks) => heard.peaks.push(peaks),
                Message::Event(event) => heard.events.push(event.kind),
                _ => {}
            }
        }
    }
    heard
}

pub fn tone(turns: f64, order: f64) -> f64 {
    (TAU * (order * turns).fract()).sin()
}

/// Harmonics 1..5 of 19 teeth, each with sidebands of both shafts of a 19/48 pair.
fn gear_signal(turns: f64) -> f64 {
    (1..=5)
        .map(|h| {
            let order = f64::from(h) * 19.0;
            let wheel = 19.0 / 48.0;
            10.0 / f64::from(h) * tone(turns, order)
                + tone(turns, order + 1.0)
                + 0.5 * tone(turns, order - 1.0)
                + 0.3 * tone(turns, order + wheel)
        })
        .sum()
}

/// Asserts the lines of [`gear_signal`]: frequency within a tenth of a bin, amplitudes within `decibels`.
fn assert_lines(spectrum: &Spectrum, decibels: f64) {
    assert_eq!(spectrum.bands.len(), 5);
    let speed = f64::from(spectrum.tag.speed_hz);
    let bin = f64::from(spectrum.tag.resolution_hz);
    assert!(bin <= speed / 8.0 * 1.0001, "resolution {bin} Hz at {speed} Hz");
    for band in &spectrum.bands {
        let centre = f64::from(band.harmonic) * 19.0;
        let lines = [
            (band.line, centre, 10.0 / f64::from(band.harmonic)),
            (band.sidebands[3], centre + 1.0, 1.0),
            (band.sidebands[2], centre - 1.0, 0.5),
            (band.gear_sidebands[3], centre + 19.0 / 48.0, 0.3),
        ];
        for (line, order, amplitude) in lines {
            let bins = (f64::from(line.frequency_hz) - order * speed) / bin;
            let level = 20.0 * (f64::from(line.amplitude) / amplitude).log10();
            assert!(bins.abs() < 0.1, "order {order} at {speed} Hz: {bins} bins off");
            assert!(level.abs() < decibels, "order {order} at {speed} Hz: {level} dB");
        }
    }
}

#[test]
fn theory_sidebands_of_both_shafts_are_resolved_from_1_to_25_hz() {
    for (speed, seconds) in [(1.0, 25.0), (5.0, 6.0), (15.0, 3.0), (25.0, 2.0)] {
        let heard = run(config(19, 48), seconds, |t| speed * t, |_, turns| gear_signal(turns));
        let spectrum = heard.spectra.last().unwrap_or_else(|| panic!("no spectrum at {speed} Hz"));
        assert!((f64::from(spectrum.tag.speed_hz) / speed - 1.0).abs() < 1e-4);
        assert_lines(spectrum, 0.1);
    }
}

#[test]
fn theory_a_run_up_of_5_percent_per_second_gives_sharp_lines() {
    let turns = |t: f64| 6.0 * ((0.05 * t).exp_m1() / 0.05);
    let heard = run(config(19, 48), 9.0, turns, |_, turns| gear_signal(turns));
    assert!(!heard.spectra.is_empty());
    for spectrum in &heard.spectra {
        assert!(spectrum.fastest_hz > 1.05 * spectrum.slowest_hz, "the speed does change");
        assert_lines(spectrum, 0.2);
    }
}

#[test]
fn theory_the_law_is_checked_by_rise_times_and_an_event_tells_when_they_part() {
    // Engagement edges of 100 us, 80 us from 10 to 90 %: 4375 Hz.
    let edges = |_: f64, turns: f64| {
        let t = (turns * 20.0).fract() * 5e-3;
        20.0 * if t < 1e-4 { t / 1e-4 } else { (1.0 - (t - 1e-4) / 4.0e-3).max(0.0) }
    };
    let law = |bandwidth: f32| Law {
        form: LawForm::Quadratic { a_per_hz: 0.0, b: 0.0, c_hz: bandwidth },
        relative_uncertainty: 0.05,
        provisional: false,
        ..Law::PROVISIONAL
    };
    let alarm = AlarmBand {
        watched: Watched::BandwidthRatio,
        from: Hertz(1.0),
        to: Hertz(50.0),
        raise: 1.5,
        clear: 1.2,
        persistence: 1,
    };
    for (bandwidth, parts, raised) in [(4_375.0, false, false), (2_200.0, true, true), (9_000.0, true, false)] {
        let mut config = Configuration { law: law(bandwidth), ..config(20, 30) };
        config.alarms.push(alarm).expect("room for one");
        let heard = run(config, 9.0, |t| 10.0 * t, edges);
        let measured: Vec<_> = heard.indicators.iter().filter_map(|i| i.bandwidth).collect();
        assert!(measured.len() >= 3, "{} measurements", measured.len());
        for measured in &measured {
            let error = measured.bandwidth_hz / 4_375.0 - 1.0;
            assert!(error.abs() < 0.03, "law {bandwidth}: {measured:?}");
        }
        assert_eq!(heard.events.contains(&EventKind::BandwidthDeparts), parts, "law {bandwidth}");
        assert_eq!(heard.events.contains(&EventKind::AlarmRaised), raised, "law {bandwidth}");
    }
}

/// One turn of the pinion of the 19/48 machine in steady state, acceleration of the pinion, unit RMS; `crack_m` deep
/// crack.
fn turn_of_the_machine(crack_m: f64, speed: f64) -> Vec<f64> {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/19-48.toml");
    let mut machine = Machine::read(&path).expect("a machine");
    if crack_m > 0.0 {
        machine.crack =
            Some(Crack { side: Side::Pinion, tooth: 3, depth_m: crack_m, angle_deg: 70.0, rule: Default::default() });
    }
    let rig = Rig::new(&machine, Model::BendingTorsional, Damping::Declared).expect("a rig");
    let rate = 1024.0 * speed;
    let motion = Motion::Constant { speed_hz: speed, turns_at_zero: 0.0 };
    let (channels, _) = rig.accelerations(&motion, 11.9, &[], rate, 9 * 1024).expect("runs");
    let turn = channels[0][8 * 1024..].to_vec();
    let rms = (turn.iter().map(|x| x * x).sum::<f64>() / 1024.0).sqrt();
    turn.iter().map(|x| x / rms).collect()
}

/// Load and speed fluctuation about 20 Hz: relative depth and rate of each.
#[derive(Clone, Copy, Default)]
struct Fluctuation {
    load: f64,
    load_hz: f64,
    wander: f64,
    wander_hz: f64,
}

/// Condition indicators of successive averages of the machine with noise and fluctuation, and the FM4 alarms raised.
fn averages_of(turn: &[f64], noise: f64, about: Fluctuation, seed: u64, seconds: f64) -> (Vec<GearIndicators>, usize) {
    let mut state = seed;
    let mut random = move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    let mut config = config(19, 48);
    let watched = Watched::Fm4;
    let alarm = AlarmBand { watched, from: Hertz(1.0), to: Hertz(50.0), raise: 4.5, clear: 4.0, persistence: 1 };
    config.alarms.push(alarm).expect("room for one");
    let omega = TAU * about.wander_hz;
    let swing = if omega > 0.0 { 20.0 * about.wander / omega } else { 0.0 };
    let turns = |t: f64| 20.0 * t + swing * (1.0 - (omega * t).cos());
    let heard = run(config, seconds, turns, |t, turns| {
        let place = turns.rem_euclid(1.0) * 1024.0;
        let (k, u) = (place as usize % 1024, place.fract());
        let value = turn[k] + u * (turn[(k + 1) % 1024] - turn[k]);
        let gaussian = random() + random() + random() + random() - 2.0;
        20.0 * value * (1.0 + about.load * (TAU * about.load_hz * t).sin()) + 20.0 * noise * gaussian * 3f64.sqrt()
    });
    let alarms = heard.events.iter().filter(|&&kind| kind == EventKind::AlarmRaised).count();
    (heard.indicators.iter().filter_map(|i| i.gear).collect(), alarms)
}

fn fm4(averages: &[GearIndicators]) -> Vec<f64> {
    averages.iter().map(|g| f64::from(g.fm4)).collect()
}

type Indicator = fn(&GearIndicators) -> f32;

/// Mean and standard deviation.
fn spread(values: &[f64]) -> (f64, f64) {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    (mean, (values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (values.len() - 1) as f64).sqrt())
}

#[test]
fn fault_a_cracked_tooth_raises_fm4_beyond_healthy_runs() {
    let speed = 20.0;
    let (healthy, cracked) = (turn_of_the_machine(0.0, speed), turn_of_the_machine(1.8e-3, speed));
    let (averages, false_alarms) = averages_of(&healthy, 1.0, Fluctuation::default(), 11, 26.0);
    let (damaged, alarms) = averages_of(&cracked, 1.0, Fluctuation::default(), 12, 10.0);
    let (mean, deviation) = spread(&fm4(&averages));
    let lowest = fm4(&damaged).into_iter().fold(f64::MAX, f64::min);
    println!("healthy FM4 {mean:.3} +- {deviation:.3} over {} averages, cracked {:.3?}", averages.len(), fm4(&damaged));
    println!("alarms at FM4 4.5: healthy {false_alarms}, cracked {alarms}");
    assert!(averages.len() >= 8 && damaged.len() >= 3);
    assert!(lowest > mean + 5.0 * deviation, "cracked {lowest}, healthy {mean} +- {deviation}");
    assert!(alarms > 0 && false_alarms == 0, "the alarm tells them apart");
}

#[test]
fn fault_load_and_speed_fluctuation_raise_no_false_alarms_of_a_healthy_gear() {
    const SECONDS: f64 = 30.0;
    let healthy = turn_of_the_machine(0.0, 20.0);
    let (steady, _) = averages_of(&healthy, 1.0, Fluctuation::default(), 21, SECONDS);
    let cases = [
        ("load +-20 % at 1.3 Hz", Fluctuation { load: 0.2, load_hz: 1.3, ..Default::default() }),
        ("load +-50 % at 0.4 Hz", Fluctuation { load: 0.5, load_hz: 0.4, ..Default::default() }),
        ("speed +-2 % at 0.7 Hz", Fluctuation { wander: 0.02, wander_hz: 0.7, ..Default::default() }),
        ("speed +-5 % at 0.3 Hz", Fluctuation { wander: 0.05, wander_hz: 0.3, ..Default::default() }),
        ("both, 20 % and 2 %", Fluctuation { load: 0.2, load_hz: 1.3, wander: 0.02, wander_hz: 0.7 }),
    ];
    // What stands beyond five standard deviations of steady running would be called a fault.
    let indicators: [(&str, Indicator); 5] =
        [("FM4", |g| g.fm4), ("M6A", |g| g.m6a), ("NA4", |g| g.na4), ("FM0", |g| g.fm0), ("kurtosis", |g| g.kurtosis)];
    let (mut total, mut alarms_raised, mut beyond_fm4) = (0, 0, 0);
    for (seed, (name, about)) in (31..).zip(cases) {
        let (averages, alarms) = averages_of(&healthy, 1.0, about, seed, SECONDS);
        assert!(averages.len() + 2 >= steady.len(), "{name}: {} averages, steady {}", averages.len(), steady.len());
        total += averages.len();
        alarms_raised += alarms;
        print!("{name}: {} averages, {alarms} alarms; beyond five sigma:", averages.len());
        for (indicator, value) in indicators {
            let values = |of: &[GearIndicators]| of.iter().map(|g| f64::from(value(g))).collect::<Vec<f64>>();
            let (mean, deviation) = spread(&values(&steady));
            let beyond = values(&averages).iter().filter(|&&x| x > mean + 5.0 * deviation).count();
            let (now, _) = spread(&values(&averages));
            print!(" {indicator} {beyond} ({mean:.2} to {now:.2})");
            if indicator == "FM4" {
                beyond_fm4 += beyond;
            }
        }
        println!();
    }
    println!("false alarms at FM4 4.5: {alarms_raised} of {total} averages; FM4 beyond five sigma: {beyond_fm4}");
    assert!(alarms_raised == 0 && beyond_fm4 == 0, "{alarms_raised} alarms, {beyond_fm4} beyond five sigma of {total}");
}
