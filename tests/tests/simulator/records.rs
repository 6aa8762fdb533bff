//! Record folders: what is written is read back, and every kind of broken record is refused in one line.

use meshband_host::Error;
use meshband_host::machine::Machine;
use meshband_host::record::{
    Acquisition, Declaration, Record, Run, RunDeclaration, Tach, encode, npy, suggested_full_scale,
};
use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

const RATE_HZ: f64 = 10_240.0;

fn acquisition(full_scale: f64) -> Acquisition {
    Acquisition {
        sample_rate_hz: RATE_HZ,
        channels: vec!["pinion".into(), "gear".into()],
        full_scale_m_s2: full_scale,
        code_bits: 16,
        unit: None,
        other: toml::Table::new(),
    }
}

fn tach() -> Tach {
    Tach {
        shaft: "pinion".into(),
        turns_per_pinion_turn: None,
        pulses_per_rev: 2,
        jitter_s: None,
        source: None,
        other: toml::Table::new(),
    }
}

fn signals() -> Vec<Vec<f64>> {
    let tone = |hz: f64, amplitude: f64| {
        (0..2048).map(|n| amplitude * (TAU * hz * f64::from(n) / RATE_HZ).sin()).collect::<Vec<f64>>()
    };
    vec![tone(190.0, 40.0), tone(380.0, 7.5)]
}

/// A sound two-channel record in a fresh folder.
fn sound() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let acquisition = acquisition(50.0);
    let mut declaration = Declaration::of_import("sound", Some([19, 48]), acquisition.clone(), Some(tach()));
    let edges: Vec<f64> = (0..4).map(|k| 0.01 + 0.05 * f64::from(k)).collect();
    let run = Run::from_signals(RunDeclaration::numbered(0, true, Some(8.0)), &acquisition, &signals(), edges).unwrap();
    declaration.runs.push(run.declaration.clone());
    let record = Record { folder: folder.path().to_owned(), declaration, runs: vec![run] };
    let path = folder.path().join("record");
    record.write(&path).unwrap();
    (folder, path)
}

fn refusal(path: &Path) -> String {
    let text = Record::read(path).expect_err("a broken record is refused").to_string();
    assert!(!text.contains('\n'), "one line: {text}");
    text
}

fn edit(path: &Path, from: &str, to: &str) {
    let file = path.join("record.toml");
    let text = std::fs::read_to_string(&file).unwrap();
    assert!(text.contains(from), "'{from}' is in\n{text}");
    std::fs::write(file, text.replace(from, to)).unwrap();
}

#[test]
fn theory_written_signals_return_within_half_a_code() {
    let (_keep, path) = sound();
    let record = Record::read(&path).unwrap();
    let run = record.run(0).unwrap();
    assert_eq!((run.channels(), run.samples()), (2, 2048));
    for (channel, original) in signals().iter().enumerate() {
        for (a, b) in run.signal_m_s2(channel).iter().zip(original) {
            assert!((a - b).abs() <= 0.5 * run.step() * (1.0 + 1e-9), "{a} for {b}");
        }
    }
    assert!((run.mean_speed_hz(2).unwrap() - 10.0).abs() < 1e-6);
    assert_eq!(record.declaration.teeth(), Some([19, 48]));
    assert_eq!(run.declaration.input_torque_n_m, Some(8.0));
}

#[test]
fn regress_reading_and_writing_keeps_codes_edges_and_unknown_keys() {
    let (keep, path) = sound();
    edit(&path, "title = ", "site = \"bench 3\"\ntitle = ");
    edit(&path, "sample_rate_hz", "sensor = \"accelerometer A\"\nsample_rate_hz");
    let first = Record::read(&path).unwrap();
    let copy = keep.path().join("copy");
    first.write(&copy).unwrap();
    let second = Record::read(&copy).unwrap();
    assert_eq!(first.runs[0].codes(), second.runs[0].codes());
    assert_eq!(first.runs[0].edges_s, second.runs[0].edges_s);
    assert_eq!(first.declaration.rest, second.declaration.rest);
    assert_eq!(first.declaration.acquisition, second.declaration.acquisition);
    assert_eq!(second.declaration.rest["site"].as_str(), Some("bench 3"));
    assert_eq!(second.declaration.acquisition.other["sensor"].as_str(), Some("accelerometer A"));
}

#[test]
fn regress_a_copied_record_takes_its_stiffness_table_along() {
    let (keep, path) = sound();
    edit(&path, "[pair]", "[pair]\npair_stiffness = \"k.csv\"");
    std::fs::write(path.join("k.csv"), "a,b\n").unwrap();
    let copy = keep.path().join("copy");
    Record::read(&path).unwrap().write(&copy).unwrap();
    assert_eq!(std::fs::read_to_string(copy.join("k.csv")).unwrap(), "a,b\n");
}

#[test]
fn regress_a_copied_record_takes_a_table_of_the_whole_mesh_along_too() {
    let (keep, path) = sound();
    edit(&path, "[pair]", "[pair]\ntotal_stiffness = \"t/total.csv\"");
    std::fs::create_dir(path.join("t")).unwrap();
    std::fs::write(path.join("t/total.csv"), "a,b\n").unwrap();
    let copy = keep.path().join("copy");
    Record::read(&path).unwrap().write(&copy).unwrap();
    assert_eq!(std::fs::read_to_string(copy.join("total.csv")).unwrap(), "a,b\n");
    assert_eq!(Record::read(&copy).unwrap().declaration.stiffness_tables()[0].1, Path::new("total.csv"));
}

#[test]
fn fault_a_record_of_two_files_with_one_name_is_not_written() {
    let (keep, path) = sound();
    let mut record = Record::read(&path).unwrap();
    record.runs.push(record.runs[0].clone());
    let copy = keep.path().join("copy");
    assert!(record.write(&copy).unwrap_err().to_string().contains("run00.npy"));
    assert!(!copy.exists());
}

#[test]
fn fault_clipping_nan_and_unequal_channels_are_refused() {
    let refuse = |signals: &[Vec<f64>], full_scale: f64| encode("run", signals, full_scale).unwrap_err().to_string();
    assert!(refuse(&signals(), 30.0).contains("would clip"));
    assert!(refuse(&[vec![0.0, f64::NAN]], 1.0).contains("NaN"));
    assert!(refuse(&[vec![0.0, 1.0], vec![0.0]], 1.0).contains("channel 1 has 1 samples"));
    assert!(refuse(&[vec![0.0]], f64::INFINITY).contains("full scale"));
    let full_scale = suggested_full_scale(&signals());
    assert!((44.0..45.1).contains(&full_scale), "{full_scale}");
    assert!(encode("run", &signals(), full_scale).is_ok());
}

#[test]
fn fault_missing_files_are_named() {
    let (keep, path) = sound();
    assert!(refusal(&keep.path().join("nowhere")).contains("record.toml"));
    std::fs::remove_file(path.join("run00.tach.csv")).unwrap();
    assert!(refusal(&path).contains("run00.tach.csv"));
    std::fs::remove_file(path.join("run00.npy")).unwrap();
    assert!(refusal(&path).contains("run00.npy"));
    assert!(matches!(Record::read(&path), Err(Error::File { .. })));
}

#[test]
fn fault_broken_arrays_are_refused() {
    let (_keep, path) = sound();
    let file = path.join("run00.npy");
    let whole = std::fs::read(&file).unwrap();
    for length in [0, 5, 60, 127, whole.len() - 1, whole.len() / 2] {
        std::fs::write(&file, &whole[..length]).unwrap();
        let text = refusal(&path);
        assert!(text.contains("run00.npy"), "{text}");
    }
    std::fs::write(&file, [whole.clone(), vec![0; 4]].concat()).unwrap();
    assert!(refusal(&path).contains("too long"));
    std::fs::write(&file, npy::bytes_f32(&[0.0; 8], 2)).unwrap();
    assert!(refusal(&path).contains("dtype is <f4"));
    std::fs::write(&file, npy::bytes_i16(&[0; 9], 3)).unwrap();
    assert!(refusal(&path).contains("has 3 channels"));
    std::fs::write(&file, npy::bytes_i16(&[], 2)).unwrap();
    assert!(refusal(&path).contains("no samples"));
}

#[test]
fn fault_broken_tach_files_are_refused() {
    let (_keep, path) = sound();
    for (text, expected) in [
        ("edge_time_s\n", "has no tach edges"),
        ("edge_time_s\n0.1\n", "one tach edge"),
        ("0.1\n0.2\n", "header"),
        ("", "header"),
        ("edge_time_s\n0.1\n0.1\n", ":3"),
        ("edge_time_s\n0.2\n0.1\n", "does not come after"),
        ("edge_time_s\n0.1\nNaN\n", "NaN"),
        ("edge_time_s\n0.1\ninf\n", "inf"),
        ("edge_time_s\n0.1\nabc\n", "'abc'"),
        ("edge_time_s\n100\n200\n", "do not belong"),
    ] {
        std::fs::write(path.join("run00.tach.csv"), text).unwrap();
        let refused = refusal(&path);
        assert!(refused.contains(expected), "{refused} for {text:?}");
    }
}

#[test]
fn fault_broken_declarations_name_table_and_key() {
    for (from, to, expected) in [
        ("teeth = [19, 48]", "teeth = [0, 48]", "[pair] teeth"),
        ("teeth = [19, 48]", "teeth = [19, 4800000]", "4800000"),
        ("teeth = [19, 48]", "teeth = [19]", "two whole numbers"),
        ("teeth = [19, 48]", "teeth = [19, 48.5]", "two whole numbers"),
        ("full_scale_m_s2 = 50.0", "full_scale_m_s2 = nan", "[acquisition] full_scale_m_s2: is NaN"),
        ("input_torque_n_m = 8.0", "input_torque_n_m = inf", "[run] 0 input_torque_n_m: is inf"),
        ("sample_rate_hz = 10240.0", "", "missing field `sample_rate_hz`"),
        ("sample_rate_hz = 10240.0", "sample_rate_hz = -1.0", "sample_rate_hz"),
        ("code_bits = 16", "code_bits = 24", "code_bits"),
        ("pulses_per_rev = 2", "pulses_per_rev = 0", "pulses_per_rev"),
        ("shaft = \"pinion\"", "shaft = \"third\"", "[tach] shaft"),
        ("shaft = \"pinion\"", "shaft = \"other\"", "[tach] turns_per_pinion_turn: is needed"),
        ("shaft = \"pinion\"", "shaft = \"other\"\nturns_per_pinion_turn = 0.0", "[tach] turns_per_pinion_turn: 0"),
        ("shaft = \"pinion\"", "shaft = \"gear\"\nturns_per_pinion_turn = 0.5", "belongs to shaft = \"other\""),
        ("first_pulse_index = 0", "first_pulse_index = 2", "first_pulse_index"),
        ("[acquisition]", "[acquisition", "record.toml:"),
        ("[acquisition]", "[other]", "has no table [acquisition]"),
    ] {
        let (_keep, path) = sound();
        edit(&path, from, to);
        let refused = refusal(&path);
        assert!(refused.contains(expected), "{refused} for {to:?}");
    }
}

#[test]
fn fault_a_record_with_only_teeth_has_no_machine_to_simulate() {
    let (_keep, path) = sound();
    let record = Record::read(&path).unwrap();
    assert!(!record.declaration.has_machine());
    assert!(record.declaration.machine().unwrap_err().to_string().contains("declares no machine"));
}

#[test]
fn regress_shipped_style_record_reads_with_its_machine() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/blind/case-a");
    if !folder.exists() {
        println!("skipped: ../shared/blind is absent");
        return;
    }
    let record = Record::read(&folder).unwrap();
    assert_eq!(record.runs.len(), 8);
    assert_eq!(record.declaration.teeth(), Some([19, 48]));
    let machine = record.declaration.machine().unwrap();
    assert_eq!(machine.pair.teeth, [19, 48]);
    assert_eq!(record.runs[0].samples(), 102_400);
    let speed = record.runs[7].mean_speed_hz(1).unwrap();
    assert!((23.0..25.0).contains(&speed), "{speed}");
    let target = tempfile::tempdir().unwrap();
    record.write(target.path()).unwrap();
    let copy = Record::read(target.path()).unwrap();
    let copied = copy.declaration.machine().unwrap();
    assert_eq!(Machine { folder: machine.folder.clone(), ..copied }, machine);
    assert_eq!(copy.runs[3].codes(), record.runs[3].codes());
}

#[test]
fn regress_a_records_machine_is_the_one_read_from_its_folder_and_is_checked() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("vectors/check-19-48");
    let machine = Record::read(&folder).unwrap().declaration.machine().unwrap();
    assert_eq!(machine, Machine::read(&folder).unwrap());
    assert!(machine.pair_stiffness().is_ok(), "its table is found beside it");
    let text = std::fs::read_to_string(folder.join("record.toml")).unwrap();
    let at = text.find("module_m").unwrap();
    let end = at + text[at..].find('\n').unwrap();
    let text = format!("{}module_m = -1.0{}", &text[..at], &text[end..]);
    let declaration = Declaration::parse(&text, "somewhere/record.toml").unwrap();
    let refused = declaration.machine().unwrap_err().to_string();
    assert!(refused.contains("module_m") && refused.contains("somewhere"), "{refused}");
}
