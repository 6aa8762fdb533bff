//! Runs as a record has them: faults at the right rate, tach edges by exact ratio, seeds, refusals.

use super::{line, machine, rms};
use meshband_mechanics::dynamics::Motion;
use meshband_train_dynamics::effects::{Effect, Seat};
use meshband_train_dynamics::sensor::{Axis, Sensor};
use meshband_train_dynamics::{Run, TrainMachine, simulate};

/// Speed of shaft 0, Hz.
const SPEED_HZ: f64 = 30.0;

/// A planetary run of so many turns of a member that turns `per_turn` times per turn of the sun; one sensor each.
fn planetary(effects: Vec<Effect>, turns: f64, per_turn: f64) -> (Vec<f64>, f64) {
    let duration_s = turns / (per_turn * SPEED_HZ);
    let rate_hz = 40_960.0 / duration_s;
    let sensor = Sensor::Bearing { gear: 0, axis: Axis::X };
    let mut run = Run::steady(SPEED_HZ, 100.0, vec![sensor], rate_hz, duration_s);
    run.effects = effects;
    (simulate(&machine("train-planetary"), &run).expect("a run").channels.remove(0), rate_hz)
}

#[test]
fn theory_a_soft_tooth_of_each_gear_gives_lines_at_its_own_rate_only() {
    // 61 turns of shaft 0 are 23 of shaft 1; the fault of gear 1 repeats with it, that of gear 0 with shaft 0.
    let machine = machine("train-two-stage");
    let sensor = Sensor::on_shaft(&machine, 0, Axis::Y).expect("a sensor");
    let duration_s = 61.0 / SPEED_HZ;
    let rate_hz = 61.0 * 1000.0 / duration_s;
    let mut run = Run::steady(SPEED_HZ, 200.0, vec![sensor], rate_hz, duration_s);
    let of = |run: &Run| simulate(&machine, run).expect("a run").channels.remove(0);
    let sound = of(&run);
    let mut level = Vec::new();
    for gear in [0, 1] {
        run.effects = vec![Effect::ToothStiffness { at: Seat { gear, planet: None }, tooth: 5, loss: 0.4 }];
        let signal = of(&run);
        let difference: Vec<f64> = signal.iter().zip(&sound).map(|(a, b)| a - b).collect();
        assert!(rms(&difference) > 1e-3 * rms(&sound), "gear {gear} is felt");
        // Lines beside the mesh at whole orders of each shaft; meshes of the second stage do not take part.
        let order = |k: f64| line(&difference, rate_hz, k * SPEED_HZ / 61.0);
        let own = order(20.0 * 61.0).max(order(21.0 * 61.0));
        level.push((own, order(20.0 * 61.0 + 23.0)));
    }
    // Gear 1 has lines between those of shaft 0; gear 0 has none.
    let (of_first, of_second) = (level[0].1 / level[0].0, level[1].1 / level[1].0);
    assert!(of_first < 1e-3, "{level:?}");
    assert!(of_second > 10.0 * of_first, "{level:?}");
}

#[test]
fn theory_a_suns_tooth_comes_by_at_every_planet_in_turn() {
    // Against the carrier the sun turns 95/126 of its speed; a soft tooth meets three planets per such turn.
    let per_turn = 95.0 / 126.0;
    let (sound, _) = planetary(vec![], 31.0, per_turn);
    let at = Seat { gear: 0, planet: None };
    let (soft, rate_hz) = planetary(vec![Effect::ToothStiffness { at, tooth: 4, loss: 0.5 }], 31.0, per_turn);
    let difference: Vec<f64> = soft.iter().zip(&sound).map(|(a, b)| a - b).collect();
    // Seen in the housing along x, each contact pushes the sun elsewhere; its energy per contact is alike: the envelope
    // repeats three times per relative turn.
    let square: Vec<f64> = difference.iter().map(|x| x * x).collect();
    let hz = per_turn * SPEED_HZ;
    let (third, other) = (line(&square, rate_hz, 3.0 * hz), line(&square, rate_hz, 2.0 * hz));
    assert!(rms(&difference) > 1e-4, "it is felt");
    assert!(third > 2.0 * other, "{third} {other}");
}

#[test]
fn claim_tach_edges_follow_the_exact_ratio_of_their_shaft_and_noise_its_seed() {
    let machine = machine("train-two-stage");
    let sensor = Sensor::on_shaft(&machine, 2, Axis::X).expect("a sensor");
    let mut run = Run::steady(SPEED_HZ, 200.0, vec![sensor], 20_000.0, 1.0);
    (run.tach_shaft, run.pulses_per_turn) = (2, 4);
    run.motion = Motion::Constant { speed_hz: SPEED_HZ, turns_at_zero: 3.3 };
    let plain = simulate(&machine, &run).expect("a run");
    let ratio = 23.0 * 19.0 / (61.0 * 77.0);
    let first = (3.3 * ratio * 4.0_f64).ceil();
    assert_eq!(f64::from(plain.first_pulse_index), first.rem_euclid(4.0));
    assert_eq!(plain.edges_s.len(), (((3.3 + SPEED_HZ) * ratio * 4.0).floor() - first + 1.0) as usize);
    for (i, edge) in plain.edges_s.iter().enumerate() {
        let expected = ((first + i as f64) / (4.0 * ratio) - 3.3) / SPEED_HZ;
        assert!((edge - expected).abs() < 1e-9, "{i}: {edge} {expected}");
    }
    run.noise_m_s2 = 0.5;
    let noisy = [7, 7, 8].map(|seed| {
        run.seed = seed;
        simulate(&machine, &run).expect("a run")
    });
    assert_eq!(noisy[0].channels, noisy[1].channels);
    assert_ne!(noisy[0].channels, noisy[2].channels);
    assert_eq!(noisy[0].edges_s, plain.edges_s);
    let noise: Vec<f64> = noisy[0].channels[0].iter().zip(&plain.channels[0]).map(|(a, b)| a - b).collect();
    assert!((rms(&noise) / 0.5 - 1.0).abs() < 0.02, "{}", rms(&noise));
}

#[test]
fn theory_idlers_and_rings_of_parallel_shafts_run_at_their_order() {
    let text = "[[stage]]\nkind = \"pair\"\nteeth = [20, 50]\nidlers = [31]\n[[stage]]\nkind = \"pair\"\nteeth = [21, \
        85]\ninternal = true\n[[mesh]]\nmodule_mm = 2\nface_width_mm = 20\n[[mesh]]\nmodule_mm = 2\nface_width_mm \
        = 25\n";
    let machine = TrainMachine::parse(text, "m.toml").expect("a machine");
    // Five turns of shaft 0 are two of shaft 1: mesh orders 20 and 21 * 2 / 5.
    let (duration_s, samples) = (10.0 / SPEED_HZ, 20_000.0);
    let rate_hz = samples / duration_s;
    let sensors = vec![Sensor::Bearing { gear: 1, axis: Axis::X }, Sensor::Bearing { gear: 4, axis: Axis::Y }];
    let run = Run::steady(SPEED_HZ, 50.0, sensors, rate_hz, duration_s);
    let simulated = simulate(&machine, &run).expect("a run");
    for (channel, order) in [(0, 20.0), (1, 8.4)] {
        let signal = &simulated.channels[channel];
        let on = line(signal, rate_hz, order * SPEED_HZ);
        let off = line(signal, rate_hz, (order + 0.7) * SPEED_HZ);
        assert!(on > 1e-4 && on > 1e3 * off, "channel {channel}: {on:e} {off:e}");
    }
    assert!(simulated.statistics.least_mesh_force_n > 0.0);
}

#[test]
fn fault_runs_are_refused_with_what_is_wrong() {
    let machine = machine("train-planetary");
    let ring = Sensor::Ring { stage: 0, place_turns: 0.0 };
    let sound = Run::steady(SPEED_HZ, 100.0, vec![ring], 20_000.0, 0.1);
    let at = |gear, planet| Seat { gear, planet };
    let refused = |change: &dyn Fn(&mut Run)| {
        let mut run = sound.clone();
        change(&mut run);
        simulate(&machine, &run).expect_err("refused").to_string()
    };
    type Change<'a> = &'a dyn Fn(&mut Run);
    let cases: [(&str, Change); 13] = [
        ("rate", &|run| run.rate_hz = 10.0),
        ("duration", &|run| run.duration_s = f64::NAN),
        ("load torque", &|run| run.load_torque_n_m = -3.0),
        ("speed", &|run| run.motion = Motion::Constant { speed_hz: -1.0, turns_at_zero: 0.0 }),
        ("tach shaft", &|run| run.tach_shaft = 9),
        ("pulses", &|run| run.pulses_per_turn = 0),
        ("noise", &|run| run.noise_m_s2 = -1.0),
        ("sensor", &|run| run.sensors = vec![Sensor::Ring { stage: 3, place_turns: 0.0 }]),
        ("sensor", &|run| run.sensors = vec![Sensor::Bearing { gear: 1, axis: Axis::X }]),
        ("gear", &|run| {
            run.effects = vec![Effect::Runout { at: at(1, None), amplitude_m: 1e-6, phase_turns: 0.0 }];
        }),
        ("tooth", &|run| run.effects = vec![Effect::ToothError { at: at(0, None), tooth: 31, error_m: 1e-6 }]),
        ("loss", &|run| run.effects = vec![Effect::ToothStiffness { at: at(2, None), tooth: 94, loss: 1.0 }]),
        ("errors", &|run| run.effects = vec![Effect::Pitch { at: at(1, Some(2)), errors_m: vec![0.0; 30] }]),
    ];
    for (words, change) in cases {
        let error = refused(change);
        assert!(error.contains(words) && error.lines().count() == 1, "{words}: {error}");
    }
}
