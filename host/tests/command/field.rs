//! `simulate --field`, then `import` of its files: what is measured against the truth that no import reads.

use crate::common::{accepted, folder, machine, refused, text};
use meshband_host::record::Record;
use meshband_host::spectral::AngleMap;
use serde_json::Value;
use std::path::Path;

const HEAD: &str = "
[[channel]]
name = 'pinion'
unit = 'g'
noise_rms_m_s2 = 0.05
noise_slope = 1.0

[[channel]]
name = 'gear'
unit = 'g'
noise_rms_m_s2 = 0.05
noise_slope = 1.0

[[channel]]
name = 'foot'
unit = 'g'
gain = -1.05
noise_rms_m_s2 = 0.02
";

/// A simulated recording of the 20/40 pair: file and truth.
fn recording(folder: &Path, field: &str, options: &[&str]) -> (String, Value) {
    let (declaration, truth, files) = (folder.join("field.toml"), folder.join("truth.json"), folder.join("files"));
    std::fs::write(&declaration, format!("{field}\n{HEAD}")).expect("written");
    let (machine, declaration, out) = (text(&machine("20-40.toml")), text(&declaration), text(&files));
    let start = ["simulate", &machine, "--field", &declaration, "--as", "wav", "--rate", "20480", "-o", &out];
    accepted(&[&start[..], &["--truth", &text(&truth)], options].concat());
    let truth = serde_json::from_str(&std::fs::read_to_string(truth).expect("truth")).expect("JSON");
    (text(&files.join("run00.wav")), truth)
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().expect("a list").iter().map(|x| x.as_f64().expect("a number")).collect()
}

/// Turns of the pinion over time, as they were.
fn true_turns(truth: &Value) -> AngleMap {
    let run = &truth["runs"][0];
    let first = run["first_turn"].as_f64().expect("a number");
    AngleMap::new(&numbers(&run["turn_times_s"]), 1, first).expect("turns")
}

/// Departure of a record's angle and speed from the truth: largest of the angle without its mean in turns of the
/// pinion, relative error of the mean speed, and root mean square of that of single turns.
fn departure(record: &Path, truth: &Value, ratio: f64) -> [f64; 3] {
    let record = Record::read(record).expect("a record");
    let (run, tach) = (record.run(0).expect("a run"), record.declaration.tach.as_ref().expect("a tach"));
    let truth = true_turns(truth);
    let per_edge = 1.0 / f64::from(tach.pulses_per_rev) / ratio;
    let off: Vec<f64> = run.edges_s.iter().enumerate().map(|(k, t)| k as f64 * per_edge - truth.turns_at(*t)).collect();
    // The ends are extrapolated, of the truth as of the virtual tach.
    let margin = (6.0 / per_edge) as usize;
    let inner = &off[margin..off.len() - margin];
    let mean = inner.iter().sum::<f64>() / inner.len() as f64;
    let angle = inner.iter().map(|x| (x - mean).abs()).fold(0.0, f64::max);
    let whole = (inner[inner.len() - 1] - inner[0]) / (inner.len() as f64 * per_edge);
    let turn = (1.0 / per_edge).round() as usize;
    let turns: Vec<f64> = inner.windows(turn + 1).step_by(turn).map(|w| (w[turn] - w[0]).powi(2)).collect();
    let single = (turns.iter().sum::<f64>() / turns.len() as f64).sqrt();
    [angle, whole.abs(), single]
}

fn imported(folder: &Path, file: &str, options: &[&str]) -> Value {
    let (record, json) = (folder.join("record"), folder.join("import.json"));
    let start =
        ["import", file, "--teeth", "20,40", "--unit", "g", "-o", &text(&record), "--json", &text(&json), "--force"];
    accepted(&[&start[..], options].concat());
    serde_json::from_str(&std::fs::read_to_string(json).expect("written")).expect("JSON")
}

#[test]
fn theory_a_wheel_of_60_uneven_marks_is_known_and_its_angle_is_the_pinions() {
    let folder = folder("field-wheel");
    let field = "[wander]\nshare = 0.015\n[tach]\npulses = 60\nirregularity_percent = 0.2\nrise_s = 5e-5";
    let (file, truth) = recording(&folder, field, &["--speed", "20", "--duration", "12"]);
    let summary = imported(&folder, &file, &["--tach", "4", "--pulses", "60"]);
    let wheel = &summary["measured_tach"][0]["wheel"];
    let (found, left) = (&wheel["irregularity_percent"], &wheel["remaining_percent"]);
    println!("wheel {found} %, {left} % remain");
    assert!((found.as_f64().expect("a number") / 0.2 - 1.0).abs() < 0.1 && left.as_f64().expect("a number") < 0.03);
    let [angle, speed, _] = departure(&folder.join("record"), &truth, 1.0);
    println!("angle within {angle:.6} turns, mean speed within {speed:.1e}");
    assert!(angle < 0.01 && speed < 2e-4, "{angle} {speed}");
}

#[test]
fn theory_a_virtual_tach_follows_three_per_cent_of_wander_and_agrees_with_the_wheel() {
    let folder = folder("field-wander");
    let field = "[wander]\nshare = 0.03\nband_hz = [0.05, 0.5]\n[tach]\nshaft = 'gear'\npulses = 1\nrise_s = 1e-4";
    let options = ["--speed", "21", "--duration", "20", "--force"];
    let (file, truth) = recording(&folder, field, &options);
    imported(&folder, &file, &["--tach", "4", "--tach-shaft", "gear"]);
    let [angle, speed, _] = departure(&folder.join("record"), &truth, 0.5);
    println!("wheel on the gear: angle within {angle:.6} turns, mean speed within {speed:.1e}");
    assert!(angle < 0.01 && speed < 2e-4, "{angle} {speed}");
    // The same motion and housing without the wheel, whose voltage would be the best mesh line of all.
    let (file, truth) = recording(&folder, "[wander]\nshare = 0.03\nband_hz = [0.05, 0.5]", &options);
    let summary = imported(&folder, &file, &["--mesh", "425"]);
    let lines = summary["tach"][0]["followed_lines"].as_u64().expect("followed");
    let [angle, speed, single] = departure(&folder.join("record"), &truth, 1.0);
    println!(
        "virtual, {lines} lines: angle within {angle:.6} turns, mean speed {speed:.1e}, single turns {single:.1e}"
    );
    assert!(angle < 0.01 && speed < 2e-4, "{angle} {speed}");
}

#[test]
fn theory_a_virtual_tach_follows_a_run_up_to_twice_the_speed_within_a_range() {
    let folder = folder("field-run-up");
    let field = "[wander]\nshare = 0.005";
    let (file, truth) = recording(&folder, field, &["--run-up", "15,30,10"]);
    let summary = imported(&folder, &file, &["--mesh", "270,660"]);
    let [angle, speed, single] = departure(&folder.join("record"), &truth, 1.0);
    println!(
        "run-up: angle within {angle:.6} turns, mean speed {speed:.1e}, single turns {single:.1e}, {}",
        summary["tach"][0]
    );
    assert!(angle < 0.01 && speed < 2e-4, "{angle} {speed}");
}

#[test]
fn fault_noise_within_a_range_is_no_mesh_line() {
    let folder = folder("field-noise");
    let mut state = 3_u64;
    let mut draw = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1 << 24) as f32 - 0.5
    };
    let values: Vec<f32> = (0..120_000).map(|_| (0..6).map(|_| draw()).sum()).collect();
    let path = folder.join("noise.npy");
    std::fs::write(&path, meshband_host::record::npy::bytes_f32(&values, 1)).expect("written");
    for mesh in ["400", "300,600"] {
        let arguments = ["--rate", "20480", "--teeth", "20,40", "--mesh", mesh, "-o", &text(&folder.join("record"))];
        refused(&[&["import", &text(&path)][..], &arguments].concat(), &["noise.npy", "mesh line"]);
    }
}

#[test]
fn fault_a_field_file_is_checked_key_by_key() {
    let folder = folder("field-refused");
    let (path, out) = (folder.join("field.toml"), text(&folder.join("record")));
    let cases = [
        ("[wander]\nshare = 0.5", "[wander] share"),
        ("[wander]\nshares = 0.1", "shares"),
        ("[tach]\npulses = 0", "[tach] pulses"),
        ("[housing]\nband_hz = [900.0, 300.0]", "[housing] band_hz"),
        ("[[mode]]\nfrequency_hz = nan\ndamping = 0.01", "[[mode]] frequency_hz"),
        ("[[channel]]\nname = 'x'\nresidues_per_kg = [[1.0, 0.0, 0.0, 0.0]]", "residues_per_kg"),
    ];
    for (field, expected) in cases {
        std::fs::write(&path, format!("{field}\n{HEAD}")).expect("written");
        let (machine, field) = (text(&machine("20-40.toml")), text(&path));
        refused(&["simulate", &machine, "--field", &field, "-o", &out], &[expected, "field.toml"]);
    }
    std::fs::write(&path, HEAD).expect("written");
    let (machine, field) = (text(&machine("20-40.toml")), text(&path));
    let long = ["simulate", &machine, "--field", &field, "--duration", "100000", "-o", &out];
    refused(&long, &["--duration", "limit"]);
}

#[test]
fn theory_a_channel_is_the_sum_of_its_modes_under_the_bearings_forces() {
    let folder = folder("field-modes");
    // One mode far below the mesh passes forces as a mass does: residue times force; the same force on the second
    // channel, twice.
    let channel =
        |name: &str, r: f64| format!("[[channel]]\nname = '{name}'\nresidues_per_kg = [[{r}, 0.0, 0.0, 0.0]]\n");
    let field = format!("[[mode]]\nfrequency_hz = 5.0\ndamping = 0.4\n{}{}", channel("one", 0.05), channel("two", 0.1));
    let path = folder.join("field.toml");
    std::fs::write(&path, field).expect("written");
    let (machine, plain, housing) = (text(&machine("20-40.toml")), folder.join("plain"), folder.join("housing"));
    let common = ["--speed", "20", "--duration", "2", "--rate", "20480"];
    accepted(&[&["simulate", &machine, "-o", &text(&plain)][..], &common].concat());
    accepted(&[&["simulate", &machine, "--field", &text(&path), "-o", &text(&housing)][..], &common].concat());
    let signal =
        |folder: &Path, c: usize| Record::read(folder).expect("a record").run(0).expect("a run").signal_m_s2(c);
    let [one, two] = [0, 1].map(|c| signal(&housing, c));
    let rms = |x: &[f64]| (x.iter().map(|x| x * x).sum::<f64>() / x.len() as f64).sqrt();
    let half: Vec<f64> = one.iter().zip(&two).map(|(a, b)| 2.0 * a - b).collect();
    assert!(rms(&half) < 1e-3 * rms(&two), "twice the residue, twice the signal");
    // k q of a body that moves at the mesh frequency f is k a / (2 pi f)^2: both are in proportion at the first
    // harmonic.
    let rate = 20_480.0;
    let line = |x: &[f64]| {
        let at = |n: usize| std::f64::consts::TAU * 400.0 * n as f64 / rate;
        let (c, s) = x.iter().enumerate().fold((0.0, 0.0), |(c, s), (n, x)| (c + x * at(n).cos(), s + x * at(n).sin()));
        2.0 * f64::hypot(c, s) / x.len() as f64
    };
    let shafts = Record::read(&plain).expect("a record").declaration.machine().expect("declared").shafts;
    let omega = std::f64::consts::TAU * 400.0;
    let (k, d) = (shafts.bearing_stiffness_n_per_m[0], shafts.bearing_damping_n_s_per_m[0]);
    let force = f64::hypot(k, d * omega) * line(&signal(&plain, 0)) / (omega * omega);
    let expected = 0.05 * force;
    let found = line(&one);
    println!("mesh line {found:.5} m/s2, {expected:.5} by the plain simulation's body");
    assert!((found / expected - 1.0).abs() < 0.02, "{found} {expected}");
}
