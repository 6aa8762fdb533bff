//! The built command on bad input: exit code 2, nothing on stdout, exactly one line on stderr that names the place.

use std::path::Path;
use std::process::{Command, Output};

fn meshband(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_meshband")).args(arguments).output().expect("the command starts")
}

fn refused(arguments: &[&str], expected: &str) {
    let output = meshband(arguments);
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {stderr}");
    assert_eq!(stderr.lines().count(), 1, "one line for {arguments:?}: {stderr}");
    assert!(stderr.starts_with("meshband: ") && stderr.contains(expected), "{arguments:?}: {stderr}");
    assert!(output.stdout.is_empty());
}

fn folder(name: &str) -> std::path::PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    // What a former run wrote would be in the way of this one's.
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).expect("a folder for the test");
    folder
}

/// A tone with harmonics and shaft sidebands in a little noise as csv, one column.
fn tone_csv(path: &Path) {
    let mut state = 1_u64;
    let mut noise = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f64 / f64::from(1 << 24) - 0.5
    };
    let text: String = (0..40_000)
        .map(|n| {
            let mesh = std::f64::consts::TAU * 460.0 * f64::from(n) / 5120.0;
            let swing = 1.0 + 0.3 * (mesh / 23.0).cos();
            format!(
                "{:.6}\n",
                swing * (mesh.cos() + 0.5 * (2.0 * mesh).cos() + 0.2 * (3.0 * mesh).sin())
                    + 0.2 * (mesh / 23.0).cos()
                    + 0.1 * noise()
            )
        })
        .collect();
    std::fs::write(path, text).expect("written");
}

#[test]
fn fault_import_refuses_bad_input_in_one_line() {
    let folder = folder("import");
    let path = |name: &str| folder.join(name).display().to_string();
    let out = path("out");
    let (good, cut, nan) = (path("good.csv"), path("cut.mat"), path("nan.csv"));
    tone_csv(Path::new(&good));
    let mut mat = b"MATLAB 5.0 MAT-file".to_vec();
    mat.resize(124, b' ');
    mat.extend([0, 1, b'I', b'M', 14, 0, 0, 0, 255, 0, 0, 0, 1, 2, 3]);
    std::fs::write(&cut, mat).expect("written");
    std::fs::write(&nan, "1\nnan\n").expect("written");
    for (arguments, expected) in [
        (vec!["import", "missing.mat", "-o", &out], "missing.mat"),
        (vec!["import", &cut, "-o", &out], "truncated"),
        (vec!["import", &nan, "-o", &out, "--rate", "1000"], "NaN"),
        (vec!["import", &good, "-o", &out], "--rate"),
        (vec!["import", &good, "-o", &out, "--rate", "nan"], "--rate"),
        (vec!["import", &good, "-o", &out, "--rate", "5120"], "--teeth"),
        (vec!["import", &good, "-o", &out, "--rate", "5120", "--teeth", "23,46000"], "46000"),
        (vec!["import", &good, "-o", &out, "--rate", "5120", "--teeth", "23"], "--teeth"),
        (vec!["import", &good, "-o", &out, "--rate", "5120", "--teeth", "23,46", "--mesh=-5"], "--mesh"),
        (vec!["import", &good, "-o", &out, "--rate", "5120", "--no-tach", "--full-scale", "0.5"], "would clip"),
        (vec!["import", &good, "-o", &out, "--rate", "5120", "--no-tach", "--channel-names", "a,b"], "--channel-names"),
    ] {
        refused(&arguments, expected);
    }
    assert!(!Path::new(&out).exists(), "a refused import leaves nothing behind");
}

#[test]
fn fault_alias_refuses_bad_input_in_one_line() {
    refused(&["alias", "--mesh", "nan", "--rate", "10000"], "--mesh");
    refused(&["alias", "--mesh", "293.3", "--rate=-1"], "--rate");
    refused(&["alias", "--mesh", "293.3", "--rate", "10000", "--lines", "6000"], "--lines");
    refused(&["alias", "--mesh", "293.3", "--rate", "10000", "--harmonics", "0"], "--harmonics");
    refused(&["alias", "--mesh", "293.3", "--rate", "10000", "--json", "/nonexistent/x.json"], "x.json");
}

#[test]
fn claim_the_papers_two_lines_are_folded_harmonics_35_and_36() {
    let output = meshband(&["alias", "--mesh", "293.303", "--rate", "10000", "--lines", "265.6,559.0"]);
    let stdout = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success());
    let row =
        |line: &str| stdout.lines().find(|l| l.starts_with(line)).map(|l| l.split_whitespace().last().unwrap_or(""));
    assert_eq!(row("265.600"), Some("35x"), "{stdout}");
    assert_eq!(row("559.000"), Some("36x"), "{stdout}");
}

#[test]
fn regress_import_writes_record_json_and_report() {
    let folder = folder("whole");
    let path = |name: &str| folder.join(name).display().to_string();
    tone_csv(Path::new(&path("tone.csv")));
    let (record, json, html) = (path("record"), path("o.json"), path("o.html"));
    let output = meshband(&[
        "import",
        &path("tone.csv"),
        "-o",
        &record,
        "--rate",
        "5120",
        "--teeth",
        "23,46",
        "--json",
        &json,
        "--report",
        &html,
    ]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let json: serde_json::Value = serde_json::from_slice(&std::fs::read(&json).expect("json")).expect("valid");
    let mesh = json["tach"][0]["mesh_hz"].as_f64().expect("a number");
    assert!((mesh - 460.0).abs() < 0.01, "{mesh}");
    let html = std::fs::read_to_string(&html).expect("html");
    assert!(html.contains("<svg") && !html.contains("<script") && !html.contains("src=\"http"));
    assert!(Path::new(&record).join("run00.tach.csv").exists());
}

/// A sound record of half a second with one channel, as (file, text) pairs beside its codes.
fn small_record(name: &str) -> std::path::PathBuf {
    let folder = folder(name);
    let toml = "title = \"small\"\n[pair]\nteeth = [23, 46]\n[acquisition]\nsample_rate_hz = 10240.0\n\
                channels = [\"case\"]\nfull_scale_m_s2 = 10.0\n[tach]\nshaft = \"pinion\"\npulses_per_rev = 1\n\
                [[run]]\nsignal = \"run00.npy\"\ntach = \"run00.tach.csv\"\n";
    std::fs::write(folder.join("record.toml"), toml).expect("written");
    let codes: Vec<i16> = (0..5120).map(|n| (8000.0 * (0.2 * f64::from(n)).sin()) as i16).collect();
    std::fs::write(folder.join("run00.npy"), meshband_host::record::npy::bytes_i16(&codes, 1)).expect("written");
    let edges: String = (1..10).map(|n| format!("{}\n", 0.05 * f64::from(n))).collect();
    std::fs::write(folder.join("run00.tach.csv"), format!("edge_time_s\n{edges}")).expect("written");
    folder
}

#[test]
fn fault_node_refuses_bad_records_in_one_line() {
    type Damage = fn(&Path);
    let edit = |path: &Path, from: &str, to: &str| {
        let file = path.join("record.toml");
        let text = std::fs::read_to_string(&file).expect("text");
        assert!(text.contains(from));
        std::fs::write(file, text.replace(from, to)).expect("written");
    };
    refused(&["node", "nowhere"], "nowhere");
    let cases: [(&str, Damage, &str); 5] = [
        ("no-toml", |p| std::fs::remove_file(p.join("record.toml")).expect("removed"), "record.toml"),
        ("no-signal", |p| std::fs::remove_file(p.join("run00.npy")).expect("removed"), "run00.npy"),
        (
            "truncated",
            |p| {
                let bytes = std::fs::read(p.join("run00.npy")).expect("bytes");
                std::fs::write(p.join("run00.npy"), &bytes[..bytes.len() / 2]).expect("written");
            },
            "truncated",
        ),
        ("no-edges", |p| std::fs::write(p.join("run00.tach.csv"), "edge_time_s\n").expect("written"), "no tach edges"),
        (
            "nan-edge",
            |p| std::fs::write(p.join("run00.tach.csv"), "edge_time_s\n0.1\nnan\n").expect("written"),
            "edge time is NaN",
        ),
    ];
    for (name, damage, expected) in cases {
        let path = small_record(&format!("node-{name}"));
        damage(&path);
        refused(&["node", &path.display().to_string()], expected);
    }
    for (name, from, to, expected) in [
        ("teeth-many", "[23, 46]", "[23, 46000]", "46000"),
        ("teeth-few", "[23, 46]", "[2, 46]", "2 is not a tooth count"),
        ("nan", "10240.0", "nan", "sample_rate_hz"),
        ("pulses", "pulses_per_rev = 1", "pulses_per_rev = 9000", "pulses_per_turn"),
        ("no-tach", "[tach]\nshaft = \"pinion\"\npulses_per_rev = 1\n", "", "[tach]"),
    ] {
        let path = small_record(&format!("node-{name}"));
        edit(&path, from, to);
        refused(&["node", &path.display().to_string()], expected);
    }
}

#[test]
fn fault_node_refuses_bad_options_in_one_line() {
    let record = small_record("node-options").display().to_string();
    let machine = Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/paper-rig.toml").display().to_string();
    let broken = folder("node-machine").join("broken.toml");
    let text = std::fs::read_to_string(&machine).expect("text");
    std::fs::write(&broken, text.replace("module_m = 0.002 ", "module_m = nan ")).expect("written");
    let broken = broken.display().to_string();
    for (arguments, expected) in [
        (vec!["node", &record, "--run", "3"], "no run 3"),
        (vec!["node", &record, "--channel", "4"], "--channel"),
        (vec!["node", &record, "--channel", "casing"], "casing"),
        (vec!["node", &record, "--start", "9"], "--start"),
        (vec!["node", &record, "--duration", "nan"], "--duration"),
        (vec!["node", &record, "--start", "0.46", "--duration", "0.03"], "tach"),
        (vec!["node", &record, "--rate", "nan"], "--rate"),
        (vec!["node", &record, "--rate", "9e9"], "--rate"),
        (vec!["node", &record, "--speed", "10"], "--speed"),
        (vec!["node", &record, "--firmware", "nowhere.elf"], "nowhere.elf"),
        (vec!["node", &machine, "--speed", "nan"], "--speed"),
        (vec!["node", &machine, "--run-up", "3"], "--run-up"),
        (vec!["node", &machine, "--torque=-5"], "--torque"),
        (vec!["node", &machine, "--duration", "1e9"], "--duration"),
        (vec!["node", &machine, "--signal-rate", "nan"], "--rate"),
        (vec!["node", &machine, "--channel", "2"], "--channel"),
        (vec!["node", &machine, "--effect", "magic"], "magic"),
        (vec!["node", &broken], "module_m"),
    ] {
        refused(&arguments, expected);
    }
}

#[test]
fn fault_predict_refuses_bad_effects_files_in_one_line() {
    let record = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/vectors/check-19-48").display().to_string();
    let place = folder("predict-effects");
    let output = place.join("predicted").display().to_string();
    for (name, text, expected) in [
        ("turns-few", "pinion_turns = [1]\n", "1 values for 2 runs"),
        ("turns-half", "pinion_turns = [0, 1.5]\n", "pinion_turns: must be a list of whole numbers"),
        ("turns-negative", "pinion_turns = [0, -3]\n", "pinion_turns: must be a list of whole numbers"),
        ("turns-one", "pinion_turns = 3\n", "pinion_turns: must be a list of whole numbers"),
        ("torque", "torque_factor = 9.0\n", "torque_factor: must lie between 0.5 and 2"),
        ("broken", "pinion_turns = [0, 1\n", "broken.toml"),
        ("nameless", "[[effect]]\ndepth = 1e-6\n", "`name` is missing"),
    ] {
        let file = place.join(format!("{name}.toml"));
        std::fs::write(&file, text).expect("written");
        refused(&["predict", &record, "-o", &output, "--effects", &file.display().to_string()], expected);
    }
}

/// Mistakes that a newcomer made, each with what the command must answer.
#[test]
fn regress_what_newcomers_mistook_is_answered_with_the_way_on() {
    let folder = folder("newcomer");
    let text = |path: &Path| path.to_str().expect("unicode").to_owned();
    let recording = folder.join("a.wav");
    std::fs::write(&recording, b"RIFF").expect("written");
    refused(&["analyse", &text(&recording)], "is a file, not a record");
    refused(&["diagnose", &text(&folder)], "has no record.toml");
    refused(&["monitor", "tcp:localhost:1", "--once"], "Connection refused");
    refused(&["monitor", "localhost:1", "--once"], "Connection refused");
    let machine = concat!(env!("CARGO_MANIFEST_DIR"), "/../machines/19-48.toml");
    let out = text(&folder.join("out"));
    let simulate = ["simulate", machine, "--speed", "20", "-o", &out];
    refused(&[&simulate[..], &["--effect", "bearing-outer:peak=3"]].concat(), "nearest: bearing-stiffness-modulation");
    let new = ["machine", "new", "-o", &out, "--teeth", "21,83", "--module", "4", "--width", "40"];
    refused(&[&new[..], &["--speed", "1485rpm", "--helix", "12"]].concat(), "helical gears are outside the model");
}
