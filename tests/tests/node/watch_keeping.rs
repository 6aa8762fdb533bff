//! The node's watch: what a value may do to an alarm, clipping before the rails, a sensor that is cut, speeds outside
//! all classes.

use crate::rig::{M_S2_PER_CODE, Rig, none, slow_converter, steady};
use meshband::alarm::{AlarmBand, Watched};
use meshband::config::Configuration;
use meshband::events::EventKind;
use meshband::units::{Acceleration, Hertz};
use std::f64::consts::TAU;

fn limit(watched: Watched, [from, to]: [f32; 2], raise: f32) -> AlarmBand {
    AlarmBand { watched, from: Hertz(from), to: Hertz(to), raise, clear: 0.8 * raise, persistence: 2 }
}

fn with_limits(limits: &[AlarmBand]) -> Configuration {
    Configuration { alarms: limits.iter().copied().collect(), ..slow_converter() }
}

fn sine(amplitude: f64) -> impl Fn(f64) -> f64 {
    move |t| amplitude * (TAU * 400.0 * t).sin()
}

const ALL_SPEEDS: [f32; 2] = [0.0, 1000.0];

/// Sound for four seconds, then much too strong: what the alarm's limit and the output say.
fn stronger(then: impl Fn(f64) -> f64) -> (Vec<u32>, bool) {
    let mut rig = Rig::new(with_limits(&[limit(Watched::Rms, ALL_SPEEDS, 12.0)]));
    rig.run(4.0, sine(2.0), steady(20.0));
    assert!(!rig.node.alarm_stands());
    rig.run(9.0, then, steady(20.0));
    (rig.said(EventKind::AlarmRaised), rig.node.alarm_stands())
}

#[test]
fn regress_a1_a_clipped_signal_raises_the_limits_that_it_exceeds() {
    assert_eq!(stronger(sine(140.0)), (vec![0], true), "below full scale");
    assert_eq!(stronger(sine(165.0)), (vec![0], true), "2 % above full scale");
    assert_eq!(stronger(sine(480.0)), (vec![0], true));
    let struck = |t: f64| sine(85.0)(t) + if t.fract() < 1.0e-4 { 400.0 } else { 0.0 };
    assert_eq!(stronger(struck), (vec![0], true), "one clipped impulse per second");
}

#[test]
fn regress_a1_a_clipped_signal_clears_nothing() {
    let mut rig = Rig::new(with_limits(&[limit(Watched::Kurtosis, ALL_SPEEDS, 5.0)]));
    let impulses = |t: f64| if (20.0 * t).fract() < 0.01 { 100.0 } else { 0.0 };
    rig.run(6.0, impulses, steady(20.0));
    assert_eq!(rig.said(EventKind::AlarmRaised), [0]);
    // Clipped to a square: kurtosis 1.
    rig.run(12.0, sine(2000.0), steady(20.0));
    assert_eq!(rig.said(EventKind::AlarmCleared), [0u32; 0]);
}

#[test]
fn regress_a3_above_60_5_turns_per_second_the_overall_alarm_works() {
    for speed in [60.4, 60.6, 80.0, 95.0] {
        let mut config = Configuration {
            alarms: [limit(Watched::Rms, ALL_SPEEDS, 12.0), limit(Watched::VelocityRms, ALL_SPEEDS, 0.01)]
                .into_iter()
                .collect(),
            ..Configuration::default()
        };
        config.sensor.acceleration_per_code = Acceleration(M_S2_PER_CODE as f32);
        let mut rig = Rig::new(config);
        rig.run(3.0, sine(2.0), steady(speed));
        rig.forget().run(7.0, sine(85.0), steady(speed));
        let mut raised = rig.said(EventKind::AlarmRaised);
        raised.sort_unstable();
        assert_eq!(raised, [0, 1], "{speed} turns per second");
        assert!(rig.indicators[1..].iter().all(|values| values.quality.is_good()), "{speed} turns per second");
    }
}

#[test]
fn regress_a4_clipping_in_front_of_the_converter_is_seen() {
    let highest = 161.0 - 25.0 * 16.0 * M_S2_PER_CODE;
    let clipped = |t: f64| sine(480.0)(t).clamp(-highest, highest);
    let mut rig = Rig::new(with_limits(&[]));
    rig.run(4.0, sine(2.0), steady(20.0)).run(9.0, clipped, steady(20.0));
    assert!(rig.values().quality.overload, "25 codes before both rails");
    assert!(!rig.said(EventKind::Saturated).is_empty() && rig.said(EventKind::SignalBad) == [1]);
}

#[test]
fn regress_a11_outside_all_classes_the_least_strict_limit_watches() {
    let classes = [limit(Watched::Rms, [5.0, 15.0], 5.0), limit(Watched::Rms, [16.0, 25.0], 10.0)];
    for speed in [15.5, 26.0] {
        let mut rig = Rig::new(with_limits(&classes));
        rig.run(3.0, sine(9.0), steady(speed));
        assert!(!rig.node.alarm_stands(), "6.4 m/s2 is below the least strict");
        rig.run(8.0, sine(60.0), steady(speed));
        assert_eq!(rig.said(EventKind::AlarmRaised), [1], "{speed} Hz");
    }
}

#[test]
fn regress_a12_one_clipped_code_does_not_drop_the_output_and_a_clipped_signal_does() {
    let mut config = with_limits(&[]);
    config.holding.latching = true;
    config.holding.persistence_s = 2.0;
    config.holding.watch_signal = true;
    let mut rig = Rig::new(config);
    let knocked = |t: f64| if (6.0..6.0001).contains(&t) { 400.0 } else { sine(2.0)(t) };
    for until in 4..12 {
        rig.run(f64::from(until), knocked, steady(20.0));
        assert!(!rig.node.alarm_stands(), "at {until} s");
    }
    rig.run(18.0, sine(480.0), steady(20.0));
    assert!(rig.node.alarm_stands());
    rig.run(24.0, sine(2.0), steady(20.0));
    assert!(rig.node.alarm_stands(), "latched");
    rig.node.on_request(meshband::message::Request::AcknowledgeAlarms);
    assert!(!rig.node.alarm_stands());
}

#[test]
fn regress_a2_a_cut_cable_is_not_a_sound_machine() {
    use meshband::levels::{ExpectedLevel, LevelPoint};
    let level = |level_db: f32| ExpectedLevel { level_db, uncertainty_db: 1.5 };
    let point = |speed: f32| LevelPoint { speed: Hertz(speed), rms: level(17.0), ..LevelPoint::default() };
    let config = Configuration {
        levels: [point(5.0), point(25.0)].into_iter().collect(),
        ..with_limits(&[limit(Watched::Rms, ALL_SPEEDS, 12.0)])
    };
    let mesh = |t: f64| 10.0 * (TAU * 380.0 * t).sin();
    let hum = |t: f64| 5.0 * 16.0 * M_S2_PER_CODE * (TAU * 50.0 * t).sin();
    let mut rig = Rig::new(config);
    rig.run(8.0, mesh, steady(20.0));
    assert!(!rig.node.alarm_stands());
    rig.run(16.0, hum, steady(20.0));
    assert!(rig.node.alarm_stands(), "25 dB below what is expected");
    assert!(!rig.said(EventKind::SignalBad).is_empty());
}

#[test]
fn theory_without_pulses_a_quiet_machine_is_a_standing_one() {
    let mut rig = Rig::new(with_limits(&[limit(Watched::Rms, ALL_SPEEDS, 12.0)]));
    rig.run(8.0, |t| 16.0 * M_S2_PER_CODE * (TAU * 50.0 * t).sin(), none);
    assert!(!rig.node.alarm_stands());
}
