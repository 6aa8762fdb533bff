//! Signatures of the effects: where each appears in the spectrum, and where not.

use meshband_host::dynamics::assembly::{Damping, Model};
use meshband_host::dynamics::{Coordinate, Motion, Rig};
use meshband_host::effects;
use meshband_host::machine::Machine;

const RATE_HZ: f64 = 10_240.0;

fn rig() -> Rig {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("vectors/check-19-48");
    let machine = Machine::read(&folder).expect("a machine");
    let mut rig = Rig::new(&machine, Model::BendingTorsional, Damping::Declared).expect("sound");
    rig.stiffness = machine.pair_stiffness().expect("a curve");
    rig
}

/// Amplitude of the pinion's acceleration along the line of action at `hz`, over one second at 10 turns/s times `speed`.
fn amplitude(rig: &Rig, effect: Option<&str>, speed_hz: f64, hz: f64) -> f64 {
    let effects: Vec<_> = effect.iter().map(|text| effects::parse(text).expect("known")).collect();
    let motion = Motion::Constant { speed_hz, turns_at_zero: 0.0 };
    let count = RATE_HZ as usize;
    let (channels, _) = rig.accelerations(&motion, 15.0, &effects, RATE_HZ, count).expect("runs");
    let (mut re, mut im) = (0.0, 0.0);
    for (i, x) in channels[0].iter().enumerate() {
        let angle = std::f64::consts::TAU * hz * i as f64 / RATE_HZ;
        re += x * angle.cos();
        im -= x * angle.sin();
    }
    2.0 * f64::hypot(re, im) / count as f64
}

fn appears(effect: &str, lines_hz: &[f64]) {
    let rig = rig();
    for &hz in lines_hz {
        let (with, without) = (amplitude(&rig, Some(effect), 10.0, hz), amplitude(&rig, None, 10.0, hz));
        println!("{effect} at {hz} Hz: {with:.3e} against {without:.3e} m/s2");
        assert!(with > 10.0 * without && with > 1e-7, "{effect} at {hz} Hz: {with:.3e} against {without:.3e}");
    }
}

#[test]
fn theory_eccentricity_puts_shaft_sidebands_beside_the_mesh() {
    appears("eccentricity:amplitude=20e-6", &[180.0, 200.0, 370.0, 390.0]);
}

#[test]
fn theory_single_pitch_error_fills_the_shaft_harmonics() {
    appears("pitch-error:single=5e-6,tooth=3", &[70.0, 130.0, 180.0, 200.0, 250.0]);
}

#[test]
fn theory_torque_ripple_appears_at_its_order_or_frequency() {
    appears("torque-ripple:depth=0.1,order=3", &[30.0]);
    appears("torque-ripple:depth=0.1,frequency=47", &[47.0]);
}

#[test]
fn theory_ghost_appears_at_its_order() {
    appears("ghost:amplitude=1e-6,order=31", &[310.0]);
}

#[test]
fn theory_imbalance_acceleration_grows_with_the_fourth_power_of_speed() {
    let rig = rig();
    let slow = amplitude(&rig, Some("imbalance:moment=1e-3"), 10.0, 10.0);
    let fast = amplitude(&rig, Some("imbalance:moment=1e-3"), 20.0, 20.0);
    assert!((fast / slow / 16.0 - 1.0).abs() < 0.02, "{slow:.3e} became {fast:.3e}");
}

#[test]
fn theory_friction_shakes_across_the_line_of_action_and_scales_with_torque() {
    let rig = rig();
    let across = rig.system.index(Coordinate::Across(0)).expect("x1");
    let motion = Motion::Constant { speed_hz: 10.0, turns_at_zero: 0.0 };
    let peak = |torque: f64, list: &[&str]| {
        let effects: Vec<_> = list.iter().map(|text| effects::parse(text).expect("known")).collect();
        let mut peak = 0.0_f64;
        rig.run(&motion, torque, &effects, 0.1, |step| {
            if step.start_s > 0.0 {
                peak = peak.max(step.acceleration(across).value(0.5 * step.end).abs());
            }
        })
        .expect("runs");
        peak
    };
    assert_eq!(peak(15.0, &[]), 0.0);
    let (one, two) = (peak(15.0, &["friction"]), peak(30.0, &["friction"]));
    assert!(one > 0.01 && (two / one - 2.0).abs() < 0.02, "{one} and {two} m/s2");
}

#[test]
fn fault_senseless_effects_are_refused_with_the_reason() {
    for (text, expected) in [
        ("nothing", "is not one of"),
        ("ghost:order=x", "key=number"),
        ("ghost:order=NaN", "not within"),
        ("ghost:size=1", "is not one of"),
    ] {
        let error = effects::parse(text).err().expect("refused").to_string();
        assert!(error.contains(expected), "{text}: {error}");
    }
}
