//! What `meshband loop --apply` writes: effects that the simulator reproduces in phase, a machine that predicts the record, a law for its node.

use meshband_host::closed_loop::apply::{Applied, Correction};
use meshband_host::closed_loop::candidate::{Parameter, Tuning};
use meshband_host::closed_loop::carry::{PHASE_FREE, carry};
use meshband_host::closed_loop::generate::{self, Effect as Generated, Point};
use meshband_host::closed_loop::node_check::node_check;
use meshband_host::closed_loop::outcome::{Effect, Evidence, Outcome, Term, Value};
use meshband_host::closed_loop::start::Start;
use meshband_host::closed_loop::{Options, close_loop};
use meshband_host::dynamics::assembly::{Damping, Model};
use meshband_host::dynamics::predict::Predictor;
use meshband_host::dynamics::simulate::{Acquisition, simulate};
use meshband_host::dynamics::{Motion, Rig};
use meshband_host::effects;
use meshband_host::law::file::LawFile;
use meshband_host::machine::Machine;
use meshband_host::model::harmonic_balance;
use meshband_host::observation::input;
use meshband_host::output::Outputs;
use meshband_host::record::{self, Declaration, Record, Run, RunDeclaration, Tach};
use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

fn vectors() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("vectors/check-19-48")
}

/// A named effect as the loop reports it.
fn found(name: &str, shaft: &str, order: Option<f64>, values: &[(&str, f64)]) -> Effect {
    let value = |v: f64| Value { value: v, ci95: [v, v], unit: String::new() };
    Effect {
        verdict: "named".into(),
        name: name.into(),
        family: "shaft-order".into(),
        shaft: shaft.into(),
        order_of_pinion: order,
        frequency_hz: None,
        parameters: values.iter().map(|(name, v)| ((*name).to_string(), value(*v))).collect(),
        evidence: Evidence::default(),
        ..Effect::default()
    }
}

fn term(name: &str, parameters: Vec<Parameter>, unknowns: Vec<f64>, tuning: Option<Tuning>) -> Term {
    let (channel_share, start) = ([1.0, 1.0], Start::Counted);
    Term { name: name.into(), parameters, unknowns, channel_share, phase_free: false, tuning, start }
}

fn rms<'a>(values: impl Iterator<Item = &'a f64>) -> f64 {
    values.map(|x| x * x).sum::<f64>().sqrt()
}

/// Every class of effect with a phase, a tooth or an order, in the loop's convention (the generator's) and as carried over.
fn cases(ratio: f64) -> Vec<(Generated, Effect, Option<Term>)> {
    let phase = 0.7;
    let (pinion, gear) = ("pinion", "gear");
    let mut all = Vec::new();
    for (shaft, name, order) in [(0, pinion, 1.0), (1, gear, ratio)] {
        let own = |what: &str| format!("{name}-{what}");
        let mut add = |generated, effect| all.push((generated, effect, None));
        add(
            Generated::Eccentricity { shaft, amplitude_m: 20e-6, phase_rad: phase },
            found(&own("eccentricity"), name, Some(order), &[("amplitude", 20e-6), ("amplitude_phase", phase)]),
        );
        add(
            Generated::Imbalance { shaft, kg_m: 0.01, phase_rad: phase },
            found(&own("imbalance"), name, Some(order), &[("unbalance", 0.01), ("unbalance_phase", phase)]),
        );
        add(
            Generated::Ghost { order: 31.0 * order, amplitude_m: 1e-6, phase_rad: phase },
            found("ghost-order", name, Some(31.0 * order), &[("amplitude", 1e-6), ("amplitude_phase", phase)]),
        );
        let values = [("share_of_torque", 0.2), ("share_of_torque_phase", phase)];
        let torque = ["torque-ripple", "load-fluctuation"][shaft];
        add(
            Generated::TorqueRipple { at: 3 * shaft, order: 7.0 * order, share: 0.2, phase_rad: phase },
            found(torque, name, Some(7.0 * order), &values),
        );
        add(
            Generated::Misalignment { shaft, force_n: 60.0, phase_rad: phase },
            found(
                "coupling-misalignment",
                name,
                Some(2.0 * order),
                &[("radial_force", 60.0), ("radial_force_phase", phase)],
            ),
        );
        add(
            Generated::BearingModulation { shaft, order: 3.57 * order, share: 0.05, phase_rad: phase },
            found(
                "bearing-stiffness-modulation",
                name,
                Some(3.57 * order),
                &[("share_of_stiffness", 0.05), ("share_of_stiffness_phase", phase)],
            ),
        );
        add(
            Generated::Crack { shaft, tooth: 7, share: 0.2 },
            found(&own("tooth-crack"), name, Some(order), &[("stiffness_loss of tooth 7", 0.2)]),
        );
        let teeth = [19, 48][shaft];
        let mut single = vec![0.0; teeth];
        single[5] = 2e-6;
        let effect = found(&own("pitch-error"), name, Some(order), &[("single_tooth_offset of tooth 5", 2e-6)]);
        let none = term(&effect.name, Vec::new(), Vec::new(), None);
        all.push((Generated::PitchError { shaft, offsets_m: single }, effect, Some(none)));
        // A table by its harmonics over the turn: the mean is no error.
        let offsets: Vec<f64> = (0..teeth).map(|i| 1e-6 * ((i * i) as f64 * 0.37).sin()).collect();
        let mean = offsets.iter().sum::<f64>() / teeth as f64;
        let offsets: Vec<f64> = offsets.iter().map(|e| e - mean).collect();
        let part = |m: usize| -> [f64; 2] {
            let angle = |i: usize| TAU * (m * i) as f64 / teeth as f64;
            let sum = |f: &dyn Fn(f64) -> f64| offsets.iter().enumerate().map(|(i, e)| e * f(angle(i))).sum::<f64>();
            [sum(&f64::cos), -sum(&f64::sin)]
        };
        let unknowns: Vec<f64> = (1..=teeth / 2).flat_map(part).collect();
        let parameters = (0..teeth / 2)
            .map(|m| Parameter {
                name: format!("tooth_table_harmonic_{}", m + 1),
                unit: "m",
                first: 2 * m,
                complex: true,
            })
            .collect();
        let effect = found(&own("pitch-error"), name, Some(order), &[("tooth_table_harmonic_1", 1e-6)]);
        let table = term(&effect.name, parameters, unknowns, None);
        all.push((Generated::PitchError { shaft, offsets_m: offsets }, effect, Some(table)));
    }
    all.push((Generated::Wear { depth_m: 1e-6 }, found("wear", "none", None, &[("depth", 1e-6)]), None));
    let relief = found("tip-relief", "none", None, &[("amount", 1e-6)]);
    let share = term("tip-relief", Vec::new(), vec![1e-6], Some(Tuning::Relief { share: 0.2, exponent: 1 }));
    all.push((Generated::TipRelief { amount_m: 1e-6, share: 0.2 }, relief, Some(share)));
    all
}

#[test]
fn ref_effects_carry_over_from_the_generator_to_the_simulator_in_phase() {
    let declared = input::read(&vectors()).unwrap();
    let machine = Machine::read(&vectors()).unwrap();
    let model = harmonic_balance::Machine::new(&declared.pair, &declared.shafts, &declared.curve);
    let rig = Rig::new(&machine, Model::BendingTorsional, Damping::Declared).unwrap();
    let (samples, rate_hz) = (8192, 51_200.0);
    // Into the third turn of the pinion: the gear's teeth and phase then differ from the first turn's.
    let at = Point { start_rad: 2.3 * TAU, speed_hz: 17.3, torque_n_m: 15.0, free_phase_rad: 0.0 };
    let motion = Motion::Constant { speed_hz: at.speed_hz, turns_at_zero: 2.3 };
    let simulated = |carried: &[Box<dyn meshband_host::dynamics::Effect>]| {
        rig.accelerations(&motion, at.torque_n_m, carried, rate_hz, samples).unwrap().0
    };
    let (plain, plain_other) = (simulated(&[]), generate::response(&model, &[], at, samples, rate_hz));
    for (generated, effect, term) in cases(19.0 / 48.0) {
        let carried = carry(&effect, term.as_ref(), &machine).unwrap().expect("a counterpart");
        let list: Vec<_> = carried.tables.iter().map(|(name, t)| effects::from_table(name, t).unwrap()).collect();
        let (with, other) = (simulated(&list), generate::response(&model, &[generated], at, samples, rate_hz));
        let change = |a: &[Vec<f64>; 2], b: &[Vec<f64>; 2]| -> Vec<f64> {
            a.iter().flatten().zip(b.iter().flatten()).map(|(a, b)| a - b).collect()
        };
        let (own, own_other) = (change(&with, &plain), change(&other, &plain_other));
        let difference: Vec<f64> = own.iter().zip(&own_other).map(|(a, b)| a - b).collect();
        let error = rms(difference.iter()) / rms(own_other.iter());
        println!("{} on the {}: {:.3} % of its own response", effect.name, effect.shaft, 100.0 * error);
        assert!(error < 0.005, "{} on the {}: {error} of its own response", effect.name, effect.shaft);
    }
}

#[test]
fn theory_path_effects_carry_channel_and_shape() {
    let machine = Machine::read(&vectors()).unwrap();
    let complex = |name: &str| vec![Parameter { name: name.into(), unit: "", first: 0, complex: true }];
    let on = |mut t: Term, channel_share: [f64; 2]| {
        t.channel_share = channel_share;
        t
    };
    let table = |effect: &Effect, t: &Term| carry(effect, Some(t), &machine).unwrap().unwrap().tables.remove(0);
    let number = |t: &toml::Table, key: &str| t[key].as_float().unwrap();
    let mode = on(
        term("m", complex("gain"), vec![-0.2, 0.0], Some(Tuning::Mode { channel: 1, f0: 1900.0, zeta: 0.02 })),
        [0.0, 1.0],
    );
    let (name, t) = table(&found("transfer-path-resonance", "none", None, &[("gain", 0.2)]), &mode);
    assert_eq!(name, "transfer-path-resonance");
    assert_eq!([number(&t, "gain"), number(&t, "damping"), number(&t, "channel")], [-0.2, 0.02, 1.0]);
    let first = on(term("d", Vec::new(), vec![1.0], None), [1.0, 0.0]);
    let (name, t) = table(&found("channel-delay", "none", None, &[("share_of_a_delay_of_-12.50_us", 0.98)]), &first);
    assert_eq!((name, number(&t, "channel")), ("transfer-path", 0.0));
    assert!((number(&t, "delay") + 12.25e-6).abs() < 1e-12);
    let (_, t) = table(&found("sensor-nonlinearity", "none", None, &[("cubic", 1e-5)]), &first);
    assert_eq!([number(&t, "quadratic"), number(&t, "cubic")], [0.0, 1e-5]);
    let mut hum = found("mains-hum", "none", None, &[("acceleration_of_the_larger_channel", 0.5)]);
    hum.frequency_hz = Some(450.0);
    let free = Term { phase_free: true, ..on(term("h", complex("a"), vec![0.5, 0.0], None), [0.4, 1.0]) };
    let carried = carry(&hum, Some(&free), &machine).unwrap().unwrap();
    assert_eq!(carried.remark.as_deref(), Some(PHASE_FREE));
    // Nine times 50 Hz is beyond the simulator's line frequencies: a tone, one per channel.
    assert_eq!(carried.tables.iter().map(|t| t.0).collect::<Vec<_>>(), ["fixed-tone"; 2]);
    assert_eq!(carried.tables.iter().map(|t| number(&t.1, "amplitude")).collect::<Vec<_>>(), [0.2, 0.5]);
}

struct Made {
    folder: tempfile::TempDir,
    record: Record,
}

/// A record of the check machine with undeclared effects, every run from another angle.
fn made(hidden: &[&str], speeds_hz: &[f64], duration_s: f64) -> Made {
    let machine = Machine::read(&vectors()).unwrap();
    let rig = Rig::new(&machine, Model::BendingTorsional, Damping::Declared).unwrap();
    let list: Vec<_> = hidden.iter().map(|text| effects::parse(text).unwrap()).collect();
    let points = speeds_hz.iter().flat_map(|&f| [(f, 8.0), (f, 20.0)]);
    let simulated: Vec<_> = points
        .enumerate()
        .map(|(i, (speed_hz, torque))| {
            let acquisition = Acquisition {
                rate_hz: 51_200.0,
                duration_s,
                pulses_per_turn: 1,
                jitter_s: 2e-8,
                noise_m_s2: 0.1,
                seed: 100 + i as u64,
            };
            // Another turn of the hunting period in every run, but for the first: teeth keep their numbers.
            let turns_at_zero = (7 * i % 48) as f64 - 0.1 - 0.11 * i as f64;
            let motion = Motion::Constant { speed_hz, turns_at_zero };
            (torque, simulate(&rig, &motion, torque, &list, &acquisition).unwrap())
        })
        .collect();
    let all: Vec<Vec<f64>> = simulated.iter().flat_map(|(_, s)| s.channels.clone()).collect();
    let acquisition = record::Acquisition {
        sample_rate_hz: 51_200.0,
        channels: vec!["pinion bearing, line of action".into(), "gear bearing, line of action".into()],
        full_scale_m_s2: record::suggested_full_scale(&all),
        code_bits: 16,
        unit: None,
        other: toml::Table::new(),
    };
    let tach = Tach {
        shaft: "pinion".into(),
        turns_per_pinion_turn: None,
        pulses_per_rev: 1,
        jitter_s: Some(2e-8),
        source: None,
        other: toml::Table::new(),
    };
    let mut declaration = Declaration::of_machine(&machine, acquisition.clone(), Some(tach)).unwrap();
    let mut runs = Vec::new();
    for (i, (torque, s)) in simulated.iter().enumerate() {
        let mut table = RunDeclaration::numbered(i, true, Some(*torque));
        table.first_pulse_index = s.first_pulse_index;
        declaration.runs.push(table.clone());
        runs.push(Run::from_signals(table, &acquisition, &s.channels, s.edges_s.clone()).unwrap());
    }
    let folder = tempfile::tempdir().unwrap();
    Record { folder: machine.folder, declaration, runs }.write(folder.path()).unwrap();
    let record = Record::read(folder.path()).unwrap();
    Made { folder, record }
}

/// Runs the loop and writes its correction into the record's folder.
fn corrected(made: &Made) -> (Outcome, Applied) {
    let outcome = close_loop(&input::view(&made.record).unwrap(), &Options::default()).unwrap();
    let announced = Correction::announce(made.folder.path(), &made.record, &mut Outputs::default()).unwrap();
    let applied = announced.write(&outcome).unwrap();
    println!("{}{applied:#?}", outcome.summary());
    (outcome, applied)
}

/// What the declared and the corrected machine leave of every run, over what its noise of 0.1 m/s2 does.
fn left_over_noise(made: &Made, applied: &Applied) -> Vec<[f64; 2]> {
    let declared = Predictor::new(&made.record, Model::BendingTorsional, Damping::Declared).unwrap();
    let mut after = Predictor::new(&made.record, Model::BendingTorsional, Damping::Declared).unwrap();
    let machine = Machine::read(&applied.machine).unwrap();
    after.rig = Rig::new(&machine, Model::BendingTorsional, Damping::Declared).unwrap();
    after.start_later(&made.record, &effects::read_pinion_turns(&applied.effects).unwrap()).unwrap();
    after.torque_factor = effects::read_torque_factor(&applied.effects).unwrap();
    let added = effects::read(&applied.effects).unwrap();
    let left = |run: &Run, predicted: [Vec<f64>; 2]| {
        let rest =
            |c: usize| -> Vec<f64> { run.signal_m_s2(c).iter().zip(&predicted[c]).map(|(m, p)| m - p).collect() };
        let (a, b) = (rest(0), rest(1));
        rms(a.iter().chain(&b)) / (0.1 * (2.0 * run.samples() as f64).sqrt())
    };
    let row = |run: &Run| {
        [left(run, declared.predict(run, &[]).unwrap().0), left(run, after.predict(run, &added).unwrap().0)]
    };
    made.record.runs.iter().map(row).collect()
}

fn carries_over(hidden: &str, least: f64) {
    let made = made(&[hidden], &[14.1, 18.9, 24.2], 0.6);
    let (_, applied) = corrected(&made);
    assert!(!applied.written.is_empty(), "{hidden}: nothing was named");
    for (run, [before, after]) in left_over_noise(&made, &applied).into_iter().enumerate() {
        println!("{hidden}, run {run}: {before:.3} as declared, {after:.3} corrected, times the noise");
        assert!(after < 1.1 && before > least, "{hidden}, run {run}: {before} -> {after} times the noise");
    }
}

#[test]
fn loop_a_displacement_of_the_gear_predicts_every_run() {
    carries_over("eccentricity:amplitude=60e-6,phase=2.0,gear=1", 2.0);
}

#[test]
fn loop_a_cracked_tooth_of_the_gear_keeps_its_number_and_predicts_every_run() {
    carries_over("tooth-crack:loss=0.3,tooth=7,gear=1", 2.0);
}

#[test]
fn loop_a_torque_locked_to_the_gear_predicts_every_run() {
    carries_over("load-fluctuation:depth=0.3,order=13,phase=0.9", 2.0);
}

#[test]
fn loop_friction_of_the_flanks_predicts_every_run() {
    carries_over("friction:coefficient=0.01", 2.0);
}

#[test]
fn loop_tells_a_swing_of_the_shaft_from_an_eccentric_gear_by_the_tachometer() {
    // Both carry the contact along its path once per turn of the gear; edges once per pinion turn see the swing as order 1 - 19/48.
    let made = made(&["speed-fluctuation:angle=0.004,order=0.3958333333"], &[11.7, 14.1, 18.9, 24.2], 0.8);
    let outcome = close_loop(&input::view(&made.record).unwrap(), &Options::default()).unwrap();
    print!("{}", outcome.summary());
    let [found] = &outcome.effects[..] else { panic!("one effect: {:?}", outcome.effects) };
    assert_eq!((found.verdict.as_str(), found.name.as_str()), ("named", "speed-fluctuation"));
    assert!((found.order_of_pinion.unwrap() - 19.0 / 48.0).abs() < 2e-3, "{:?}", found.order_of_pinion);
}

#[test]
fn loop_wear_refits_the_law_and_the_virtual_node_comes_closer() {
    let made = made(&["wear:depth=1e-6"], &[17.1, 20.3, 24.2], 1.0);
    let (outcome, applied) = corrected(&made);
    let law = LawFile::read(applied.law.as_ref().expect("a law")).unwrap();
    assert!(law.domain_hz[0] < 10.0 && law.relative_uncertainty < 0.1, "{law:?}");
    let check = node_check(&made.record, &outcome, &applied).unwrap().expect("a law to run a node with");
    for rows in check.rows() {
        rows.iter().for_each(|row| println!("{}", row.join("  ")));
    }
    assert!(check.runs.iter().all(|run| run.record.bands_db.len() == 5), "every run gives a spectrum");
    let [declared, corrected] = check.rms.bands_db;
    assert!(corrected < 0.5 && corrected < 0.2 * declared, "bands: {declared} -> {corrected} dB off");
    let [declared, corrected] = check.rms.law.expect("edges are timed");
    assert!(corrected < declared, "law against the bandwidth measured on the record: {declared} -> {corrected}");
}
