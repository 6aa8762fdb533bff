//! What `meshband loop --apply` writes: effects that the simulator reproduces in phase, a machine that predicts the
//! record, a law for its node.

use meshband_host::dynamics::assembly::{Damping, Model};
use meshband_host::dynamics::simulate::{Acquisition, simulate};
use meshband_host::dynamics::{Motion, Rig};
use meshband_host::effects;
use meshband_host::law::file::LawFile;
use meshband_host::machine::Machine;
use meshband_host::model_based::apply::{Applied, Correction};
use meshband_host::model_based::candidate::{Parameter, Tuning};
use meshband_host::model_based::carry::{PHASE_FREE, carry};
use meshband_host::model_based::node_check::node_check;
use meshband_host::model_based::outcome::{Effect, Evidence, Outcome, Term, Value};
use meshband_host::model_based::start::Start;
use meshband_host::model_based::{Options, close_loop};
use meshband_host::observation::input;
use meshband_host::output::Outputs;
use meshband_host::predict::Predictor;
use meshband_host::record::{self, Declaration, Record, Run, RunDeclaration, Tach};
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
    let (name, phase_free, torque_exponent) = (name.into(), false, 0.0);
    Term { name, parameters, unknowns, channel_share, phase_free, tuning, torque_exponent, start }
}

fn rms<'a>(values: impl Iterator<Item = &'a f64>) -> f64 {
    values.map(|x| x * x).sum::<f64>().sqrt()
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
#[ignore = "long: cargo xtask test-long"]
fn loop_a_displacement_of_the_gear_predicts_every_run() {
    carries_over("eccentricity:amplitude=60e-6,phase=2.0,gear=1", 2.0);
}

#[test]
fn loop_a_cracked_tooth_of_the_gear_keeps_its_number_and_predicts_every_run() {
    carries_over("tooth-crack:loss=0.3,tooth=7,gear=1", 2.0);
}

#[test]
#[ignore = "long: cargo xtask test-long"]
fn loop_a_torque_locked_to_the_gear_predicts_every_run() {
    carries_over("load-fluctuation:depth=0.3,order=13,phase=0.9", 2.0);
}

#[test]
#[ignore = "long: cargo xtask test-long"]
fn loop_friction_of_the_flanks_predicts_every_run() {
    carries_over("friction:coefficient=0.01", 2.0);
}

#[test]
#[ignore = "long: cargo xtask test-long"]
fn loop_tells_a_swing_of_the_shaft_from_an_eccentric_gear_by_the_tachometer() {
    // Both carry the contact along its path once per turn of the gear; edges once per pinion turn see the swing as
    // order 1 - 19/48.
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
