//! Machines from a few figures, checks of machines, keys all at once.

use meshband_host::law::domain::Domain;
use meshband_host::law::guesses::{bandwidths, ratio, sensitivity};
use meshband_host::machine::estimate::{Bearings, Known, estimate};
use meshband_host::machine::{Casing, Crack, CrackRule, Engagement, EngagementKind, Load, Machine, Motor, Side, keys};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn machines() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines")
}

fn meshband(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_meshband")).args(arguments).output().expect("the command starts")
}

/// Ten answers about a described machine: teeth (2), module, width, speed, torque, pressure angle, bores, bearings,
/// ramp or relief.
fn answers(full: &Machine) -> Known {
    let nominal = full.nominal.expect("an operating point");
    let engagement = full.engagement.expect("an engagement");
    let stiff = full.shafts.bearing_stiffness_n_per_m[0] > 1.5e8;
    Known {
        title: full.title.clone(),
        teeth: full.pair.teeth,
        module_m: full.pair.module_m,
        face_width_m: full.pair.face_width_m,
        speed_hz: nominal.speed_hz,
        torque_n_m: nominal.torque_n_m,
        pressure_angle_deg: Some(full.pair.pressure_angle_deg),
        bore_radius_m: Some(full.pair.bore_radius_m),
        ramp_rad: engagement.width_rad.filter(|_| engagement.kind == EngagementKind::Paper),
        relief_m: engagement.relief_m.map(|relief| relief[0]),
        bearings: Some(if stiff { Bearings::Plain } else { Bearings::Ball }),
    }
}

#[test]
fn claim_ten_answers_give_the_law_within_its_stated_uncertainty() {
    for name in ["17-38", "19-48", "20-40", "62-62", "paper-rig"] {
        let full = Machine::read(&machines().join(format!("{name}.toml"))).expect("a machine");
        let estimated = estimate(&answers(&full)).expect("an estimate");
        let stated = sensitivity(&estimated, &|| ()).expect("a law");
        let speeds_hz = Domain::of(&full).named_speeds();
        assert_eq!(speeds_hz, stated.speeds_hz);
        let true_law = bandwidths(&full, speeds_hz).expect("a law");
        let off = ratio(true_law, stated.bandwidth_hz).expect("edges at one speed at least");
        let edges = stated.bandwidth_hz.iter().filter(|hz| hz.is_some()).count();
        println!(
            "{name}: {} guesses, law off by a factor {off:.3}, stated {:.2}; largest {} ({:.2}); edges at {edges} of \
             3 speeds",
            estimated.guesses.len(),
            stated.within_factor,
            stated.shares[0].guess.key,
            stated.shares[0].moves.unwrap_or(f64::NAN)
        );
        assert!(off <= stated.within_factor, "{name}: off by {off}, stated {}", stated.within_factor);
    }
}

#[test]
fn claim_a_written_file_reads_back_as_the_same_machine() {
    let full = Machine::read(&machines().join("19-48.toml")).expect("a machine");
    let estimated = estimate(&answers(&full)).expect("an estimate");
    let text = estimated.to_toml();
    let again = Machine::from_toml(&text, "written", Path::new("")).expect("reads");
    assert_eq!(again.pair.teeth, estimated.machine.pair.teeth);
    let (a, b) = (again.shafts.mass_kg[0], estimated.machine.shafts.mass_kg[0]);
    assert!((a / b - 1.0).abs() < 1e-3, "{a} {b}");
    let marks = text.matches("# GUESS, ").count();
    assert_eq!(marks, estimated.guesses.len(), "every guess is marked:\n{text}");
}

#[test]
fn claim_the_wizard_writes_what_check_explains() {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("wizard");
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).expect("a folder");
    let file = folder.join("mill.toml").display().to_string();
    let words = ["machine", "new", "-o", &file, "--teeth", "21,64", "--module", "3", "--width", "25", "--power", "5"];
    let output = meshband(&[&words[..], &["--speed", "24.3", "--quick"]].concat());
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let output = meshband(&["machine", "check", &file]);
    let said = String::from_utf8_lossy(&output.stdout);
    for part in [
        "contact ratio 1.",
        "after 64 turns",
        "ISO 6336-1",
        "met by the mesh at",
        "turns",
        "a law can be fitted from 1 to",
    ] {
        assert!(said.contains(part), "{part}: {said}");
    }
    let swapped = folder.join("swapped.toml").display().to_string();
    let words =
        ["machine", "new", "-o", &swapped, "--teeth", "64,21", "--module", "3", "--width", "25", "--power", "5"];
    let output = meshband(&[&words[..], &["--speed", "24.3", "--quick"]].concat());
    assert!(output.status.success(), "a pair may speed up");
    assert!(String::from_utf8_lossy(&output.stderr).contains("64 teeth drive 21: the pair speeds up by 3.05"));
    let output = meshband(&["machine", "new", "-o", &file, "--teeth", "21,64"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&output.stderr).contains("exists"), "checked before anything is asked");
}

#[test]
fn fault_unknown_keys_are_named_all_at_once_with_the_nearest_known() {
    let text = std::fs::read_to_string(machines().join("17-38.toml")).expect("a file");
    let wrong = text.replace("module_m", "modul_m").replace("mass_kg", "masses_kg") + "\n[gearbox]\noil = 1\n";
    let error = Machine::from_toml(&wrong, "wrong.toml", Path::new("")).expect_err("refused").to_string();
    for part in ["wrong.toml", "[pair] modul_m (module_m?)", "[shafts] masses_kg (mass_kg?)", "gearbox"] {
        assert!(error.contains(part), "{part}: {error}");
    }
    assert_eq!(error.lines().count(), 1);
}

#[test]
fn fault_values_out_of_range_are_named_all_at_once() {
    let text = std::fs::read_to_string(machines().join("19-48.toml")).expect("a file");
    let mut table: toml::Table = text.parse().expect("TOML");
    for (name, key, value) in
        [("pair", "poisson", 3.0), ("shafts", "inertia_motor_kg_m2", -1.0), ("engagement", "width_rad", 7.0)]
    {
        table[name].as_table_mut().expect("a table").insert(key.into(), value.into());
    }
    let error = Machine::from_toml(&table.to_string(), "wrong.toml", Path::new("")).expect_err("refused").to_string();
    for part in ["wrong.toml", "[pair] poisson: 3", "[shafts] inertia_motor_kg_m2: -1", "[engagement] width_rad: 7"] {
        assert!(error.contains(part), "{part}: {error}");
    }
    assert_eq!(error.lines().count(), 1);
}

/// A machine with every optional table and key.
fn everything() -> Machine {
    let mut machine = Machine::read(&machines().join("20-40.toml")).expect("a machine");
    machine.pair.pair_stiffness = Some("a.csv".into());
    machine.pair.total_stiffness = Some("b.csv".into());
    machine.engagement = Some(Engagement {
        kind: EngagementKind::TipRelief,
        width_rad: Some(0.01),
        relief_m: Some([1e-6; 2]),
        relief_length_base_pitches: Some(0.2),
        relief_exponent: Some(1),
        torque_n_m: Some(1.0),
    });
    machine.crack =
        Some(Crack { side: Side::Gear, tooth: 0, depth_m: 1e-3, angle_deg: 70.0, rule: CrackRule::Straight });
    machine.motor = machine.motor.or(Some(Motor {
        line_frequency_hz: 50.0,
        pole_pairs: 2,
        breakdown_torque_n_m: 1.0,
        breakdown_slip: 0.1,
    }));
    machine.load = Some(Load { speed_exponent: 1.0 });
    machine.casing = Some(Casing { mass_kg: 1.0, stiffness_n_per_m: [1.0; 2], damping_n_s_per_m: [0.0; 2] });
    machine
}

#[test]
fn ref_the_key_list_is_what_the_reader_takes_and_the_documentation_shows() {
    let table = toml::Table::try_from(everything()).expect("TOML");
    let mut taken = BTreeSet::new();
    for (name, value) in &table {
        match value {
            toml::Value::Table(inner) => taken.extend(inner.keys().map(|key| format!("{name}.{key}"))),
            _ => drop(taken.insert(format!(".{name}"))),
        }
    }
    let listed: BTreeSet<String> = keys::KEYS.iter().map(|key| format!("{}.{}", key.table, key.name)).collect();
    assert_eq!(listed, taken);
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("../book/src/reference/machine.md");
    let page = std::fs::read_to_string(page).expect("the page");
    assert!(page.contains(&keys::markdown()), "reference/machine.md: `meshband machine keys --markdown`");
}

#[test]
fn regress_a_law_that_predicts_no_single_edge_says_what_it_is_good_for() {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("law-average");
    std::fs::create_dir_all(&folder).expect("a folder");
    let (machine, law) = (machines().join("19-48.toml").display().to_string(), folder.join("law.toml"));
    let output = meshband(&["law", "fit", &machine, "-o", &law.display().to_string(), "--force"]);
    let said = String::from_utf8_lossy(&output.stdout);
    for part in ["it is an average: good for sampling rates with that margin", "`meshband law learn`"] {
        assert!(said.contains(part), "{part}: {said}");
    }
}
