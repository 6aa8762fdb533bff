//! Signatures of the effects: where each appears in the spectrum and where not, its laws of speed and torque.
//!
//! One second at 10 turns/s of the pinion (mesh 190 Hz) or multiples: all orders fall on whole hertz.

use meshband_host::dynamics::assembly::{Damping, Model};
use meshband_host::dynamics::simulate::{Acquisition, Simulated, simulate};
use meshband_host::dynamics::{Coordinate, Motion, Rig};
use meshband_host::effects;
use meshband_host::machine::{Crack, CrackRule, Machine, Side};

const RATE_HZ: f64 = 10_240.0;

fn machine() -> Machine {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/19-48.toml");
    Machine::read(&path).expect("a machine")
}

fn rig_of(machine: &Machine) -> Rig {
    Rig::new(machine, Model::BendingTorsional, Damping::Declared).expect("sound")
}

fn rig() -> Rig {
    rig_of(&machine())
}

fn record(rig: &Rig, list: &[&str], speed_hz: f64, torque: f64, seed: u64) -> Simulated {
    let effects: Vec<_> = list.iter().map(|text| effects::parse(text).expect("known")).collect();
    let motion = Motion::Constant { speed_hz, turns_at_zero: 0.0 };
    let acquisition =
        Acquisition { rate_hz: RATE_HZ, duration_s: 1.0, pulses_per_turn: 1, jitter_s: 0.0, noise_m_s2: 0.0, seed };
    simulate(rig, &motion, torque, &effects, &acquisition).expect("runs")
}

fn signal(rig: &Rig, list: &[&str], speed_hz: f64, torque: f64) -> Vec<f64> {
    let [pinion, _] = record(rig, list, speed_hz, torque, 1).channels;
    pinion
}

/// Complex amplitude at `hz`.
fn line(signal: &[f64], hz: f64) -> rustfft::num_complex::Complex64 {
    let mut sum = rustfft::num_complex::Complex64::new(0.0, 0.0);
    for (i, x) in signal.iter().enumerate() {
        sum += rustfft::num_complex::Complex64::from_polar(*x, -std::f64::consts::TAU * hz * i as f64 / RATE_HZ);
    }
    2.0 * sum / signal.len() as f64
}

fn amplitude(signal: &[f64], hz: f64) -> f64 {
    line(signal, hz).norm()
}

fn rms(x: &[f64]) -> f64 {
    (x.iter().map(|x| x * x).sum::<f64>() / x.len() as f64).sqrt()
}

fn difference(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a - b).collect()
}

/// What an effect adds to the plain machine's signal.
fn added(rig: &Rig, effect: &str, speed_hz: f64, torque: f64) -> Vec<f64> {
    difference(&signal(rig, &[effect], speed_hz, torque), &signal(rig, &[], speed_hz, torque))
}

/// The lines stand out of the plain machine's signal.
fn appears(effect: &str, lines_hz: &[f64]) {
    let rig = rig();
    let (with, without) = (signal(&rig, &[effect], 10.0, 15.0), signal(&rig, &[], 10.0, 15.0));
    for &hz in lines_hz {
        let (with, without) = (amplitude(&with, hz), amplitude(&without, hz));
        println!("{effect} at {hz} Hz: {with:.3e} against {without:.3e} m/s2");
        assert!(with > 10.0 * without && with > 1e-7, "{effect} at {hz} Hz: {with:.3e} against {without:.3e}");
    }
}

/// Everything the effect adds lies on multiples of `spacing_hz`.
fn only_on(effect: &str, spacing_hz: f64) {
    let rig = rig();
    let mut rest = added(&rig, effect, 10.0, 15.0);
    let before = rms(&rest);
    // Averaging over the period keeps exactly the multiples.
    let period = (RATE_HZ / spacing_hz).round() as usize;
    assert!((RATE_HZ / spacing_hz - period as f64).abs() < 1e-9, "whole samples per period");
    let turns = rest.len() / period;
    for i in 0..period {
        let mean = (0..turns).map(|t| rest[i + t * period]).sum::<f64>() / turns as f64;
        (0..turns).for_each(|t| rest[i + t * period] -= mean);
    }
    assert!(before > 1e-6 && rms(&rest) < 1e-4 * before, "{effect}: {:.1e} of {before:.1e}", rms(&rest));
}

#[test]
fn theory_eccentricity_puts_shaft_sidebands_beside_the_mesh() {
    appears("eccentricity:amplitude=20e-6", &[180.0, 200.0, 370.0, 390.0]);
    // The gear turns at 10 * 19 / 48 Hz: not a whole number, so its sidebands are looked for beside the mesh line.
    let rig = rig();
    let added = added(&rig, "gear-eccentricity:amplitude=20e-6", 10.0, 15.0);
    let gear = 190.0 / 48.0;
    assert!(amplitude(&added, 190.0 + gear) > 3.0 * amplitude(&added, 190.0 + 1.5 * gear));
}

#[test]
fn theory_pitch_errors_fill_the_shaft_harmonics_unevenly() {
    appears("pitch-error:single=5e-6,tooth=3", &[70.0, 130.0, 180.0, 200.0, 250.0]);
    appears("pitch-error:random=3e-6", &[70.0, 130.0, 170.0, 180.0, 200.0, 210.0]);
    only_on("pitch-error:random=3e-6", 10.0);
    let rig = rig();
    let added = added(&rig, "pitch-error:random=3e-6", 10.0, 15.0);
    let comb: Vec<f64> = (1..19).map(|n| amplitude(&added, 190.0 + 10.0 * f64::from(n))).collect();
    let (low, high) = comb.iter().fold((f64::MAX, 0.0_f64), |(l, h), &a| (l.min(a), h.max(a)));
    assert!(high > 2.0 * low, "{comb:?}");
}

#[test]
fn theory_a_wobbling_face_puts_sidebands_of_its_shaft_and_its_double_beside_the_mesh() {
    appears("wobble:ratio=0.5", &[180.0, 200.0, 170.0, 210.0]);
    only_on("wobble:ratio=0.5", 10.0);
}

#[test]
fn theory_errors_alike_on_all_teeth_change_mesh_harmonics_only() {
    for effect in ["profile-error:first=1e-6", "tip-relief:amount=5e-6", "tip-relief:amount=5e-6,exponent=2", "wear"] {
        // 190 Hz has no whole number of samples; no line may stand between the mesh harmonics.
        let rig = rig();
        let added = added(&rig, effect, 10.0, 15.0);
        let mesh: f64 = (1..=26).map(|n| amplitude(&added, 190.0 * f64::from(n)).powi(2)).sum();
        let all = 2.0 * rms(&added).powi(2);
        assert!(mesh > 1e-8 && mesh > 0.98 * all, "{effect}: {mesh:.2e} of {all:.2e}");
        for n in 1..=10 {
            let between = amplitude(&added, 190.0 * f64::from(n) + 10.0);
            assert!(between < 1e-3 * mesh.sqrt(), "{effect}: {between:.1e} beside harmonic {n}");
        }
    }
}

#[test]
fn theory_a_profile_error_appears_at_its_own_mesh_order() {
    let rig = rig();
    for (key, order) in [("first", 1.0), ("second", 2.0), ("third", 3.0)] {
        let others = if key == "first" { "" } else { "first=0," };
        let effect = format!("profile-error:{others}{key}=1e-6");
        let added = added(&rig, &effect, 3.0, 15.0);
        let own = amplitude(&added, 57.0 * order);
        // Far below the modes acceleration grows with the square of the order: compare displacements.
        for other in [1.0, 2.0, 3.0, 4.0].into_iter().filter(|o| *o != order) {
            let beside = amplitude(&added, 57.0 * other) / (other * other);
            assert!(own / (order * order) > 1.5 * beside, "{effect}: order {other}");
        }
    }
}

#[test]
fn theory_displacements_do_not_depend_on_torque() {
    let rig = rig();
    for effect in
        ["profile-error", "tip-relief", "wear", "ghost-order", "pitch-error:random=3e-6", "pitch-error:single=5e-6"]
    {
        let (one, two) = (added(&rig, effect, 10.0, 15.0), added(&rig, effect, 10.0, 45.0));
        let change = rms(&difference(&one, &two)) / rms(&one);
        assert!(change < 1e-5, "{effect}: {change:.1e}");
    }
}

#[test]
fn theory_load_effects_grow_with_torque() {
    let rig = rig();
    for effect in [
        "tooth-crack",
        "friction",
        "torque-ripple:depth=0.1,frequency=47",
        "load-fluctuation:depth=0.1,frequency=7",
        "coupling-misalignment:force=0,torque=0.1",
        "bearing-stiffness-modulation:order=3.5",
        "speed-fluctuation:frequency=3",
        "wobble:ratio=0.5",
    ] {
        let (one, two) = (added(&rig, effect, 10.0, 15.0), added(&rig, effect, 10.0, 30.0));
        let doubled: Vec<f64> = one.iter().map(|x| 2.0 * x).collect();
        let change = rms(&difference(&doubled, &two)) / rms(&two);
        assert!(rms(&one) > 1e-7 && change < 1e-4, "{effect}: {change:.1e}");
    }
}

#[test]
fn theory_effects_of_the_measuring_chain_add_the_same_at_every_torque() {
    let rig = rig();
    for effect in ["mains-hum", "fixed-tone", "noise", "bearing-impacts"] {
        let (one, two) = (added(&rig, effect, 10.0, 15.0), added(&rig, effect, 10.0, 30.0));
        let change = rms(&difference(&one, &two)) / rms(&one);
        assert!(rms(&one) > 1e-3 && change < 1e-9, "{effect}: {change:.1e}");
    }
}

#[test]
fn theory_torque_ripple_appears_at_its_order_or_frequency() {
    appears("torque-ripple:depth=0.1,order=3", &[30.0]);
    appears("torque-ripple:depth=0.1,frequency=47", &[47.0, 143.0, 237.0]);
}

#[test]
fn theory_load_fluctuation_modulates_the_mesh_at_its_rate() {
    appears("load-fluctuation:depth=0.3,frequency=7", &[7.0, 183.0, 197.0]);
    let gear_order = 48.0 / 19.0;
    appears(&format!("load-fluctuation:depth=0.3,order={gear_order}"), &[10.0, 180.0, 200.0]);
}

#[test]
fn theory_ghost_appears_at_its_order() {
    appears("ghost-order:amplitude=1e-6,order=31", &[310.0]);
    let rig = rig();
    let added = added(&rig, "ghost-order:amplitude=1e-6,order=31", 20.0, 15.0);
    assert!(amplitude(&added, 620.0) > 100.0 * amplitude(&added, 310.0), "the line moves with speed");
}

#[test]
fn theory_coupling_misalignment_appears_at_twice_the_shaft_rate() {
    appears("coupling-misalignment:force=20", &[20.0]);
    appears("coupling-misalignment:force=0,torque=0.2", &[20.0, 170.0, 210.0]);
    let rig = rig();
    let added = added(&rig, "coupling-misalignment:force=20", 10.0, 15.0);
    assert!(amplitude(&added, 20.0) > 20.0 * amplitude(&added, 10.0));
}

#[test]
fn theory_imbalance_acceleration_grows_with_the_fourth_power_of_speed() {
    let rig = rig();
    let at = |speed: f64| amplitude(&added(&rig, "imbalance:moment=1e-3", speed, 15.0), speed);
    let (slow, fast) = (at(10.0), at(20.0));
    assert!((fast / slow / 16.0 - 1.0).abs() < 0.02, "{slow:.3e} became {fast:.3e}");
}

#[test]
fn theory_bearing_passage_appears_at_its_order_and_around_the_mesh() {
    appears("bearing-stiffness-modulation:share=0.05,order=3.5", &[35.0, 155.0, 225.0]);
    // Modulations of one bearing add up, and any number of them fits.
    let rig = rig();
    let one = added(&rig, "bearing-stiffness-modulation:share=0.05,order=3.5", 10.0, 15.0);
    let part = "bearing-stiffness-modulation:share=0.01,order=3.5";
    let five = signal(&rig, &[part; 5], 10.0, 15.0);
    let five = difference(&five, &signal(&rig, &[], 10.0, 15.0));
    assert!(rms(&difference(&one, &five)) < 1e-6 * rms(&one));
}

#[test]
fn theory_bearing_impacts_ring_the_mode_and_beat_at_the_passage_order() {
    let rig = rig();
    let envelope = |jitter: &str| {
        let added = added(&rig, &format!("bearing-impacts:peak=5,order=3.6,frequency=3200{jitter}"), 10.0, 15.0);
        let band: f64 = (2900..3500).map(|hz| amplitude(&added, f64::from(hz)).powi(2)).sum();
        let low: f64 = (100..700).map(|hz| amplitude(&added, f64::from(hz)).powi(2)).sum();
        assert!(band > 30.0 * low, "{band:.1e} in the mode's band, {low:.1e} below");
        added.iter().map(|x| x * x).collect::<Vec<f64>>()
    };
    let steady = envelope(",jitter=0");
    assert!(amplitude(&steady, 36.0) > 30.0 * amplitude(&steady, 41.0));
    assert!(amplitude(&steady, 360.0) > 30.0 * amplitude(&steady, 365.0));
    let jittered = envelope(",jitter=0.03");
    // The low harmonic stays, the tenth smears.
    let share = |signal: &[f64], hz: f64| amplitude(signal, hz) / rms(signal);
    assert!(share(&jittered, 36.0) > 0.3 * share(&steady, 36.0));
    assert!(share(&jittered, 360.0) < 0.7 * share(&steady, 360.0));
}

#[test]
fn theory_a_cracked_tooth_fills_a_wide_comb() {
    only_on("tooth-crack:loss=0.2,tooth=4", 10.0);
    let rig = rig();
    let added = added(&rig, "tooth-crack:loss=0.2,tooth=4", 10.0, 15.0);
    let comb: Vec<f64> =
        (1..=4).flat_map(|n| [-n, n]).map(|n| amplitude(&added, 190.0 + 10.0 * f64::from(n))).collect();
    let (low, high) = comb.iter().fold((f64::MAX, 0.0_f64), |(l, h), &a| (l.min(a), h.max(a)));
    assert!(low > 0.05 * high && low > 1e-7, "{comb:?}");
    // On the gear the comb is that of the slower shaft.
    let gear = added_gear_crack(&rig);
    let spacing = 190.0 / 48.0;
    assert!(amplitude(&gear, 190.0 + 2.0 * spacing) > 3.0 * amplitude(&gear, 190.0 + 2.5 * spacing));
}

fn added_gear_crack(rig: &Rig) -> Vec<f64> {
    added(rig, "gear-tooth-crack:loss=0.2", 10.0, 15.0)
}

#[test]
fn theory_a_declared_crack_is_simulated_and_grows_with_its_depth() {
    let mut machine = machine();
    let plain = signal(&rig_of(&machine), &[], 10.0, 15.0);
    let mut levels = Vec::new();
    for depth_m in [0.5e-3, 1.0e-3, 2.0e-3] {
        let side = Side::Pinion;
        machine.crack = Some(Crack { side, tooth: 5, depth_m, angle_deg: 70.0, rule: CrackRule::Straight });
        let rig = rig_of(&machine);
        let added = difference(&signal(&rig, &[], 10.0, 15.0), &plain);
        levels.push(amplitude(&added, 180.0));
    }
    assert!(levels[0] > 1e-8 && levels[1] > 1.3 * levels[0] && levels[2] > 1.3 * levels[1], "{levels:?}");
}

#[test]
fn theory_speed_fluctuation_modulates_frequency() {
    appears("speed-fluctuation:angle=1e-2,frequency=3", &[187.0, 193.0, 377.0, 383.0]);
    let rig = rig();
    // At crawling speed the response is quasi-static and every line follows the force's index, n times the first.
    let slow = signal(&rig, &["speed-fluctuation:angle=1e-3,frequency=1"], 3.0, 15.0);
    let index = |n: f64| {
        let carrier = 57.0 * n;
        let side = 0.5 * (amplitude(&slow, carrier - 1.0) + amplitude(&slow, carrier + 1.0));
        side / amplitude(&slow, carrier)
    };
    for n in [1.0, 2.0, 3.0] {
        // Half the modulation index: n z angle / 2.
        let expected = 0.5 * n * 19.0 * 1e-3;
        assert!((index(n) / expected - 1.0).abs() < 0.15, "harmonic {n}: {} instead of {expected}", index(n));
    }
    let swing = record(&rig, &["speed-fluctuation:angle=1e-2,frequency=3"], 10.0, 15.0, 1);
    let worst = swing.edges_s.iter().enumerate().map(|(i, t)| (t - 0.1 * i as f64).abs()).fold(0.0, f64::max);
    assert!((5e-5..3e-4).contains(&worst), "the tach sees the swing: {worst} s");
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
fn theory_backlash_is_silent_until_the_mesh_unloads() {
    let rig = rig();
    assert!(rms(&added(&rig, "backlash", 10.0, 15.0)) < 1e-9);
    let rough = "pitch-error:random=15e-6";
    let loose = record(&rig, &[rough, "backlash"], 10.0, 2.0, 1);
    assert!(loose.statistics.contact_events > 10);
    // Linear contact pulls the teeth together; with contact loss impacts fill the high band.
    let tied = signal(&rig, &[rough], 10.0, 2.0);
    let high = |x: &[f64]| (3000..4000).map(|hz| amplitude(x, f64::from(hz)).powi(2)).sum::<f64>();
    assert!(high(&loose.channels[0]) > 2.0 * high(&tied));
}

#[test]
fn theory_resonances_and_paths_multiply_every_line_by_their_response() {
    let rig = rig();
    let plain = signal(&rig, &[], 10.0, 15.0);
    let mode = |hz: f64, f0: f64, z: f64| {
        let r = hz / f0;
        1.0 / rustfft::num_complex::Complex64::new(1.0 - r * r, 2.0 * z * r)
    };
    type Response<'a> = Box<dyn Fn(f64) -> rustfft::num_complex::Complex64 + 'a>;
    let cases: [(&str, Response); 4] = [
        (
            "transfer-path-resonance:gain=0.3,frequency=1900,damping=0.02",
            Box::new(|f| 1.0 + 0.3 * mode(f, 1900.0, 0.02)),
        ),
        (
            "casing-resonance:gain=0.5,frequency=525,damping=0.016",
            Box::new(|f| 1.0 + 0.5 * (f / 525.0).powi(2) * mode(f, 525.0, 0.016)),
        ),
        ("sensor-resonance:frequency=3000,damping=0.05", Box::new(|f| mode(f, 3000.0, 0.05))),
        (
            "transfer-path:gain=0.7,delay=1e-4,corner=1000",
            Box::new(|f| {
                let later = rustfft::num_complex::Complex64::from_polar(0.7, -std::f64::consts::TAU * f * 1e-4);
                later / rustfft::num_complex::Complex64::new(1.0, f / 1000.0)
            }),
        ),
    ];
    for (effect, response) in cases {
        let with = signal(&rig, &[effect], 10.0, 15.0);
        for n in [1.0, 2.0, 3.0, 5.0, 10.0, 15.0] {
            let hz = 190.0 * n;
            let (found, expected) = (line(&with, hz), line(&plain, hz) * response(hz));
            // The ends of a run ring on for a few time constants.
            let error = (found - expected).norm() / expected.norm();
            assert!(error < 0.05, "{effect} at {hz} Hz: {error:.3}");
        }
    }
}

#[test]
fn theory_a_channel_can_be_chosen() {
    let rig = rig();
    let [a, b] = record(&rig, &[], 10.0, 15.0, 1).channels;
    let [c, d] = record(&rig, &["transfer-path:gain=2,channel=1"], 10.0, 15.0, 1).channels;
    assert!(rms(&difference(&a, &c)) < 1e-12 && (rms(&d) / rms(&b) - 2.0).abs() < 1e-6);
}

#[test]
fn theory_thermal_drift_changes_the_level_over_the_run() {
    let rig = rig();
    let (with, plain) = (signal(&rig, &["thermal-drift:share=0.4"], 10.0, 15.0), signal(&rig, &[], 10.0, 15.0));
    let part = |x: &[f64], quarter: usize| rms(&x[quarter * x.len() / 4..(quarter + 1) * x.len() / 4]);
    for (quarter, expected) in [0.85, 0.95, 1.05, 1.15].into_iter().enumerate() {
        let found = part(&with, quarter) / part(&plain, quarter);
        assert!((found / expected - 1.0).abs() < 0.01, "quarter {quarter}: {found}");
    }
}

#[test]
fn theory_a_nonlinear_sensor_grows_with_the_square() {
    let rig = rig();
    let one = rms(&added(&rig, "sensor-nonlinearity:quadratic=1e-3", 10.0, 15.0));
    let two = rms(&added(&rig, "sensor-nonlinearity:quadratic=1e-3", 10.0, 30.0));
    assert!((two / one / 4.0 - 1.0).abs() < 1e-3, "{one:.2e} and {two:.2e}");
    let square = added(&rig, "sensor-nonlinearity:quadratic=1e-3", 10.0, 15.0);
    assert!(square.iter().all(|x| *x >= -1e-12), "a square has a mean value");
}

#[test]
fn theory_clipping_is_silent_below_its_limit_and_flat_above() {
    let rig = rig();
    let plain = signal(&rig, &[], 10.0, 15.0);
    let peak = plain.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    assert!(rms(&added(&rig, &format!("clipping:limit={}", 1.01 * peak), 10.0, 15.0)) == 0.0);
    let limit = 0.5 * peak;
    let clipped = signal(&rig, &[&format!("clipping:limit={limit}")], 10.0, 15.0);
    let highest = clipped.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    assert!((highest - limit).abs() < 1e-12);
}

#[test]
fn theory_without_the_filter_mesh_harmonics_fold() {
    let mut machine = machine();
    // A hard switch: harmonics fall only as 1 / n.
    machine.engagement = None;
    let rig = rig_of(&machine);
    let (with, without) = (signal(&rig, &["aliasing"], 10.0, 15.0), signal(&rig, &[], 10.0, 15.0));
    // Harmonics 33 and 40 at 6270 and 7600 Hz fold to 3970 and 2640 Hz, where no mesh harmonic is.
    for harmonic in [33.0, 40.0] {
        let folded = RATE_HZ - 190.0 * harmonic;
        let (with, without) = (amplitude(&with, folded), amplitude(&without, folded));
        assert!(with > 30.0 * without && with > 1e-6, "{folded} Hz: {with:.2e} and {without:.2e}");
    }
}

#[test]
fn theory_quantisation_leaves_a_floor_of_a_step_over_root_twelve() {
    let rig = rig();
    let step = 0.01 * rms(&signal(&rig, &[], 10.0, 15.0));
    let floor = rms(&added(&rig, &format!("quantisation:step={step}"), 10.0, 15.0));
    assert!((floor / (step / 12.0_f64.sqrt()) - 1.0).abs() < 0.05, "{floor:.2e}");
}

#[test]
fn theory_noise_has_its_level_and_colour() {
    let rig = rig();
    for colour in [0.0, 0.9] {
        let noise = added(&rig, &format!("noise:rms=0.5,colour={colour}"), 10.0, 15.0);
        let level = rms(&noise);
        let neighbours = noise.windows(2).map(|w| w[0] * w[1]).sum::<f64>() / noise.len() as f64 / (level * level);
        assert!((level / 0.5 - 1.0).abs() < 0.1, "{level}");
        assert!((neighbours - colour).abs() < 0.05, "{neighbours} instead of {colour}");
    }
    let [a, b] = record(&rig, &["noise:rms=0.5"], 10.0, 15.0, 1).channels;
    let [c, _] = record(&rig, &["noise:rms=0.5"], 10.0, 15.0, 1).channels;
    let [d, _] = record(&rig, &["noise:rms=0.5"], 10.0, 15.0, 2).channels;
    assert_eq!(a, c, "the same seed gives the same noise");
    assert!(rms(&difference(&a, &d)) > 0.5 && rms(&difference(&a, &b)) > 0.5);
}

#[test]
fn theory_fixed_tones_stay_at_every_speed_and_start_anywhere() {
    let rig = rig();
    for speed in [10.0, 17.0] {
        let hum = added(&rig, "mains-hum:first=0.05,second=0.02", speed, 15.0);
        assert!((amplitude(&hum, 50.0) / 0.05 - 1.0).abs() < 1e-6);
        assert!((amplitude(&hum, 100.0) / 0.02 - 1.0).abs() < 1e-6);
        let tone = added(&rig, "fixed-tone:amplitude=0.05,frequency=333", speed, 15.0);
        assert!((amplitude(&tone, 333.0) / 0.05 - 1.0).abs() < 1e-6);
    }
    let phase = |seed: u64| line(&record(&rig, &["mains-hum:first=100"], 10.0, 15.0, seed).channels[0], 50.0).arg();
    assert!((phase(1) - phase(2)).abs() > 0.01);
}

#[test]
fn regress_every_effect_runs_with_its_defaults_and_its_example() {
    let rig = rig();
    for entry in effects::REGISTRY {
        for text in [entry.name.to_string(), effects::catalogue::argument(entry)] {
            // Where one of two values must be given, the bare name would change nothing, and is refused.
            if ["pitch-error", "torque-ripple", "load-fluctuation", "speed-fluctuation"].contains(&text.as_str()) {
                assert!(effects::parse(&text).is_err_and(|e| e.to_string().contains("changes nothing")));
                continue;
            }
            let [a, b] = record(&rig, &[&text], 10.0, 15.0, 1).channels;
            assert!(a.iter().chain(&b).all(|x| x.is_finite()), "{text}");
        }
    }
}

#[test]
fn regress_the_page_of_effects_is_the_library_s_and_has_a_picture_of_each() {
    let docs = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../book/src/reference");
    let page = std::fs::read_to_string(docs.join("effects.md")).expect("the page");
    assert_eq!(page, effects::catalogue::markdown(), "meshband effects --docs book/src/reference/effects.md --force");
    for entry in effects::REGISTRY {
        let svg = std::fs::read_to_string(docs.join("effects").join(format!("{}.svg", entry.name))).expect("a picture");
        assert!(svg.starts_with("<svg") && svg.len() < 100_000, "{}", entry.name);
    }
}

#[test]
fn regress_the_closed_loop_s_names_are_known() {
    for name in [
        "pinion-eccentricity",
        "gear-eccentricity",
        "pinion-imbalance",
        "gear-imbalance",
        "ghost-order",
        "pinion-pitch-error",
        "gear-pitch-error",
        "pinion-tooth-crack",
        "gear-tooth-crack",
        "coupling-misalignment",
        "torque-ripple",
        "load-fluctuation",
        "bearing-stiffness-modulation",
        "speed-fluctuation",
        "mains-hum",
        "profile-error",
        "tip-relief",
        "wear",
        "friction",
        "thermal-drift",
        "sensor-nonlinearity",
        "transfer-path-resonance",
    ] {
        assert!(effects::entry(name).is_ok(), "{name}");
    }
}

#[test]
fn fault_senseless_effects_are_refused_with_the_reason() {
    for (text, expected) in [
        ("nothing", "is no effect"),
        ("ghost:order=x", "key=number"),
        ("ghost:order=NaN", "not within"),
        ("ghost:size=1", "is not one of"),
        ("gear-noise", "is no effect"),
    ] {
        let error = effects::parse(text).err().expect("refused").to_string();
        assert!(error.contains(expected), "{text}: {error}");
    }
}
