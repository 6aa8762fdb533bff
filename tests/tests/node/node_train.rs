//! A node on a gear train: every gear is followed in turns, its lines, indicators and limits are its own.

use super::node_products::{Heard, config, run, run_with, tone};
use meshband::alarm::{AlarmBand, Watched};
use meshband::config::{Configuration, ConfigurationError, StageLaw, TrainGear};
use meshband::events::EventKind;
use meshband::law::{Law, LawForm};
use meshband::levels::{ExpectedLevel, LevelPoint};
use meshband::message::{GearIndicators, LineOrigin};
use meshband::units::{Hertz, TicksPerSecond};

/// Rate of the pinion, Hz.
const SPEED_HZ: f64 = 25.0;
/// Stages of the box: 21/83 and 19/77.
const SECOND_PINION: f64 = 21.0 / 83.0;
const SECOND_GEAR: f64 = SECOND_PINION * 19.0 / 77.0;

fn gear(stage: u8, [teeth, mate_teeth]: [u16; 2], [turns, pinion_turns]: [u32; 2]) -> TrainGear {
    TrainGear { stage, teeth, mate_teeth, turns, pinion_turns }
}

fn two_stages() -> Configuration {
    let mut config = config(21, 83);
    let gears = [gear(1, [83, 21], [21, 83]), gear(2, [19, 77], [21, 83]), gear(2, [77, 19], [21 * 19, 83 * 77])];
    config.train.extend(gears);
    config
}

/// Both meshes with sidebands of the second stage's shafts; `local` is a pulse at one tooth of the last gear.
fn box_signal(turns: f64, local: f64) -> f64 {
    let (first, second) = (21.0, 19.0 * SECOND_PINION);
    let phase = (turns * SECOND_GEAR).fract();
    let pulse = (-((phase - 0.5) * 77.0).powi(2)).exp() * tone(turns, 4.0 * second);
    let harmonics = (1..=3).map(|h| {
        let h = f64::from(h);
        10.0 / h * tone(turns, h * first)
            + 0.4 * tone(turns, h * first - 1.0)
            + 5.0 / h * tone(turns, h * second)
            + 0.5 * tone(turns, h * second + SECOND_PINION)
            + 0.25 * tone(turns, h * second - SECOND_GEAR)
    });
    harmonics.sum::<f64>() + local * pulse
}

fn heard(config: Configuration, seconds: f64, local: f64) -> Heard {
    run(config, seconds, |t| SPEED_HZ * t, |_, turns| box_signal(turns, local))
}

fn decibels(value: f32, wanted: f64) -> f64 {
    20.0 * (f64::from(value) / wanted).log10()
}

#[test]
fn theory_every_gear_of_two_stages_is_followed_with_its_own_lines() {
    let heard = heard(two_stages(), 60.0, 0.0);
    let of_gear = |gear: u8| heard.spectra_of(gear);
    let rates = [1.0, SECOND_PINION, SECOND_PINION, SECOND_GEAR];
    for (gear, rate) in (0u8..).zip(rates) {
        let spectrum = of_gear(gear).last().unwrap_or_else(|| panic!("no spectrum of gear {gear}"));
        assert!((f64::from(spectrum.tag.speed_hz) / (rate * SPEED_HZ) - 1.0).abs() < 1e-4, "gear {gear}");
        // Of more than 69 teeth fewer harmonics fit.
        assert!(spectrum.bands.len() >= 4, "gear {gear}");
        let mesh = [10.0, 10.0, 5.0, 5.0][usize::from(gear)];
        for band in &spectrum.bands[..3] {
            let level = decibels(band.line.amplitude, mesh / f64::from(band.harmonic));
            assert!(level.abs() < 0.1, "gear {gear}, harmonic {}: {level} dB", band.harmonic);
        }
    }
    // The second pinion's sideband is the mate's from the gear's side, and the other way round.
    let [pinion, wheel] = [2, 3].map(|gear| of_gear(gear).last().expect("a spectrum").bands[0].clone());
    for (line, amplitude) in [
        (pinion.sidebands[3], 0.5),
        (pinion.gear_sidebands[2], 0.25),
        (wheel.sidebands[2], 0.25),
        (wheel.gear_sidebands[3], 0.5),
    ] {
        let level = decibels(line.amplitude, amplitude);
        assert!(level.abs() < 0.2, "{level} dB");
    }
    assert!(!heard.events.contains(&EventKind::NoRecords));
}

#[test]
fn theory_a_bad_tooth_raises_the_indicator_and_the_limit_of_its_own_gear_only() {
    let mut config = two_stages();
    let limit =
        AlarmBand { watched: Watched::Fm4, from: Hertz(1.0), to: Hertz(50.0), raise: 6.0, clear: 5.0, persistence: 1 };
    config.alarms.extend([limit; 4]);
    config.alarm_gears.extend([0, 1, 2, 3]);
    config.validate(TicksPerSecond(25_000_000)).expect("a sound configuration");
    let sound = heard(config.clone(), 60.0, 0.0);
    assert!(!sound.events.contains(&EventKind::AlarmRaised));
    let bad = heard(config, 60.0, 6.0);
    let of_pinion = || bad.indicators.iter().filter_map(|indicators| indicators.gear);
    let of_gear = |gear: u8| bad.conditions.iter().filter(move |of| of.gear == gear).map(|of| of.indicators);
    let largest = |all: &mut dyn Iterator<Item = GearIndicators>| all.map(|of| of.fm4).fold(f32::NAN, f32::max);
    let fm4 = |gear: u8| if gear == 0 { largest(&mut of_pinion()) } else { largest(&mut of_gear(gear)) };
    let values = [0, 1, 2, 3].map(fm4);
    println!("FM4 by gear: {values:?}");
    assert!(values[3] > 6.0 && values[..3].iter().all(|&fm4| fm4 < 6.0), "{values:?}");
    assert_eq!(bad.events.iter().filter(|&&kind| kind == EventKind::AlarmRaised).count(), 1);
    // Departures are learned of the pinion, and NA4 with them.
    assert!(bad.conditions.iter().all(|of| of.indicators.na4.is_nan()));
}

/// A box that steps up: its second mesh lies above the first.
fn fast_second_stage() -> Configuration {
    let mut config = config(83, 21);
    config.tach.pulses_per_turn = 4;
    config.train.push(gear(2, [77, 19], [83, 21])).expect("room");
    config
}

#[test]
fn theory_strong_lines_name_the_stage_whose_mesh_they_are() {
    let second = 77.0 * 83.0 / 21.0;
    let signal = |_: f64, turns: f64| 5.0 * tone(turns, 83.0) + 4.0 * tone(turns, second);
    let heard = run_with(fast_second_stage(), 5.0, 4.0, |t| SPEED_HZ * t, signal);
    let peaks = heard.peaks.last().expect("peaks");
    let origin = |order: f64| {
        let place = peaks.lines.iter().position(|line| (f64::from(line.frequency_hz) / SPEED_HZ - order).abs() < 0.2);
        place.map(|place| (peaks.origins[place], peaks.origin_gears[place]))
    };
    assert_eq!(origin(83.0), Some((LineOrigin::Mesh { harmonic: 1 }, 0)));
    assert_eq!(origin(second), Some((LineOrigin::Mesh { harmonic: 1 }, 1)));
}

#[test]
fn regress_a_gear_that_gives_no_record_is_said_and_left() {
    // A slow rotor: the second stage steps up beyond what one pulse per turn can place.
    let mut config = config(84, 24);
    (config.tach.lowest, config.tach.highest) = (Hertz(0.1), Hertz(5.0));
    config.tach.pulses_per_turn = 40;
    config.law.lowest = Hertz(0.2);
    config.train.push(gear(2, [97, 31], [25, 1])).expect("room");
    config.train.push(gear(3, [12, 30], [1, 900])).expect("room");
    let signal = |t: f64, turns: f64| if t > 100.0 { 40.0 } else { 10.0 } * tone(turns, 84.0);
    let heard = run_with(config, 260.0, 40.0, |t| 0.3 * t, signal);
    assert!(heard.events.contains(&EventKind::NoRecords));
    let last = heard.spectra.last().expect("the pinion again");
    assert!((last.bands[0].line.amplitude / 40.0 - 1.0).abs() < 0.05, "{:?}", last.bands[0].line);
}

#[test]
fn regress_once_per_turn_lines_of_the_pinion_are_told_at_every_speed() {
    for speed_hz in [10.0, 50.0] {
        let signal = |_: f64, turns: f64| 10.0 * tone(turns, 21.0) + 5.0 * tone(turns, 1.0);
        let heard = run(two_stages(), 40.0, |t| speed_hz * t, signal);
        let lines: Vec<f32> = heard.indicators.iter().filter_map(|i| i.pinion).map(|o| o.lines[0].amplitude).collect();
        assert!(!lines.is_empty() && lines.iter().all(|line| (line / 5.0 - 1.0).abs() < 0.02), "{speed_hz}: {lines:?}");
    }
}

#[test]
fn regress_a_departure_of_the_pinions_mesh_is_said_once_per_visit() {
    let mut config = two_stages();
    let expected = |level_db: f32| ExpectedLevel { level_db, uncertainty_db: 0.5 };
    for speed in [1.0, 60.0] {
        let (rms, mesh_amplitude) = (expected(20.0), expected(20.0));
        let point =
            LevelPoint { speed: Hertz(speed), rms, velocity_rms: rms, mesh_amplitude, residual_rms: expected(-40.0) };
        config.levels.push(point).expect("room");
    }
    let heard = heard(config, 60.0, 0.0);
    let with = heard.indicators.iter().filter(|i| i.departures.mesh_amplitude.is_some()).count();
    let visits = heard.spectra.len();
    assert!(with >= 2 && with <= visits, "{with} of {} values, {visits} records of the pinion", heard.indicators.len());
    assert!(heard.indicators.iter().filter(|i| i.departures.rms.is_some()).count() > 40, "the RMS every second");
}

#[test]
fn regress_sidebands_of_one_gear_are_not_told_of_another() {
    let mut config = config(21, 42);
    config.train.push(gear(2, [12, 24], [1, 2])).expect("room");
    // Of the first stage's gear as strong as its mesh, none at the second one.
    let signal = |_: f64, turns: f64| 10.0 * tone(turns, 21.0) + 10.0 * tone(turns, 21.5) + 10.0 * tone(turns, 6.0);
    let heard = run(config, 40.0, |t| SPEED_HZ * t, signal);
    let of_pinion = heard.indicators.iter().filter_map(|i| i.gear).map(|of| of.gear_sideband_energy_ratio);
    let of_second = heard.conditions.iter().map(|of| of.indicators.gear_sideband_energy_ratio);
    assert!(of_pinion.clone().count() > 2 && of_pinion.clone().all(|ratio| (ratio - 1.0).abs() < 0.05));
    assert!(of_second.clone().count() > 2 && of_second.clone().all(|ratio| ratio < 0.05));
}

#[test]
fn regress_the_first_visit_is_to_the_pinion() {
    let mut config = config(21, 83);
    config.train.push(gear(2, [31, 97], [1, 20])).expect("room");
    let heard = run(config, 6.0, |t| SPEED_HZ * t, |_, turns| box_signal(turns, 0.0));
    assert!(!heard.spectra.is_empty() && heard.further.is_empty());
}

#[test]
fn theory_a_planetary_set_is_followed_by_its_carrier() {
    // Sun 24, ring 84: the carrier makes 24/108 turns, and 84 teeth of the ring pass in each.
    let carrier = 24.0 / 108.0;
    let mut config = config(29, 74);
    config.train.push(gear(2, [84, 24], [29 * 24, 74 * 108])).expect("room");
    let base = 29.0 / 74.0 * carrier;
    let signal = |_: f64, turns: f64| {
        8.0 * tone(turns, 29.0) + 3.0 * tone(turns, 84.0 * base) + 0.6 * tone(turns, 84.0 * base - 4.0 * base)
    };
    config.mesh.sidebands = 4;
    let heard = run(config, 40.0, |t| SPEED_HZ * t, signal);
    let spectrum = heard.spectra_of(1).last().expect("the set");
    let band = &spectrum.bands[0];
    assert!(decibels(band.line.amplitude, 3.0).abs() < 0.1);
    let lines = [band.sidebands[0], band.sidebands[7]].map(|line| line.amplitude);
    assert!(decibels(lines[0], 0.6).abs() < 0.2 && lines[1] < 0.01, "{lines:?}: four planets, below the mesh only");
}

#[test]
fn theory_the_rate_carries_the_stage_that_asks_for_most() {
    let rate = |config: Configuration| {
        let form = LawForm::Quadratic { a_per_hz: 0.0, b: 0.0, c_hz: 4_000.0 };
        let config = Configuration { law: Law { form, ..Law::PROVISIONAL }, ..config };
        let pulses = f64::from(config.tach.pulses_per_turn);
        let heard = run_with(config, 4.0, pulses, |t| 10.0 * t, |_, turns| 5.0 * tone(turns, 20.0));
        heard.peaks.last().expect("peaks").tag.rate_hz
    };
    let pair = rate(config(21, 83));
    assert_eq!(rate(two_stages()), pair, "slow stages ask for less than the law does");
    // A second stage that steps up asks for its mesh harmonics, or for what its law says.
    let of_mesh = rate(fast_second_stage());
    let rise_s = 0.35 / (4.0 * pair);
    let law = StageLaw { ramp_turns: 0.0, mode_rise_s: rise_s };
    let mut fast = fast_second_stage();
    fast.stage_laws.push(law).expect("room");
    let of_law = rate(fast);
    println!("{pair} Hz, {of_mesh} Hz by the mesh, {of_law} Hz by the law");
    assert!(of_mesh > 1.5 * pair && of_law > 1.5 * of_mesh);
}

#[test]
fn fault_gears_of_a_train_are_refused_by_name() {
    let refused = |change: fn(&mut Configuration)| {
        let mut config = two_stages();
        change(&mut config);
        config.validate(TicksPerSecond(25_000_000)).expect_err("refused")
    };
    let limit =
        |watched| AlarmBand { watched, from: Hertz(1.0), to: Hertz(50.0), raise: 6.0, clear: 5.0, persistence: 1 };
    for (watched, is_of_gear) in [(Watched::Fm0, true), (Watched::Rms, false), (Watched::OncePerTurn, false)] {
        let mut config = two_stages();
        config.alarms.push(limit(watched)).expect("room");
        config.alarm_gears.push(1).expect("room");
        assert_eq!(config.validate(TicksPerSecond(25_000_000)).is_ok(), is_of_gear, "{watched:?}");
    }
    let changes: [fn(&mut Configuration); 10] = [
        |c| c.train[2].teeth = 801,
        |c| (c.train[1].turns, c.train[1].pinion_turns) = (3, 2),
        |c| c.train[0].stage = 0,
        |c| c.train[0].stage = 3,
        |c| c.train[2].stage = 5,
        |c| c.train[1].teeth = 11,
        |c| c.train[1].turns = 0,
        |c| (c.train[1].turns, c.train[1].pinion_turns) = (u32::MAX, 3),
        |c| c.stage_laws.push(StageLaw { ramp_turns: f32::NAN, mode_rise_s: 0.0 }).expect("room"),
        |c| c.alarm_gears.push(4).expect("room"),
    ];
    for change in changes {
        assert_eq!(refused(change), ConfigurationError::Train);
    }
    assert!(ConfigurationError::Train.to_string().starts_with("train, stage_laws, alarm_gears needs"));
}
