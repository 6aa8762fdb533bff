//! Files of foreign formats, made by independent writers (`fixtures/formats/make.py`): every value as written, damage
//! said in one line.

use crate::common::{self, accepted, folder, refused, text};
use meshband_host::import::read;
use meshband_host::record::Record;
use std::path::{Path, PathBuf};

const RATE_HZ: f64 = 12_800.0;

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/formats").join(name)
}

/// What make.py writes into channel `c`.
fn channel(c: u32) -> Vec<f64> {
    let sample = |n: u32| f64::from(c + 1) * (f64::from((37 * n + 11 * c) % 256) - 128.0) / 64.0;
    (0..400).map(sample).collect()
}

fn assert_holds(name: &str, channels: &[(u32, f64)]) {
    let columns = read(&fixture(name)).expect(name);
    assert_eq!(columns.channels.len(), channels.len(), "{name}: {:?}", columns.names);
    for ((found, &(c, factor)), called) in columns.channels.iter().zip(channels).zip(&columns.names) {
        let expected: Vec<f64> = channel(c).iter().map(|x| factor * x).collect();
        assert_eq!(found, &expected, "{name}: {called}");
    }
    let rate = columns.rate_hz.unwrap_or_else(|| panic!("{name} states its rate"));
    assert!((rate / RATE_HZ - 1.0).abs() < 1e-6, "{name}: {rate}");
}

#[test]
fn ref_files_of_independent_writers_are_read_to_the_last_bit() {
    assert_holds("float.tdms", &[(0, 1.0), (1, 1.0)]);
    assert_holds("scaled.tdms", &[(0, 1.0)]);
    assert_holds("plain.h5", &[(0, 1.0), (1, 1.0), (2, 1.0)]);
    assert_holds("v73.mat", &[(0, 1.0), (1, 1.0)]);
    assert_holds("binary.uff", &[(0, 1.0), (1, 1.0)]);
    assert_holds("ascii.uff", &[(0, 1.0), (1, 1.0)]);
    assert_holds("pcm24.flac", &[(0, 0.125), (1, 0.125)]);
    assert_holds("float.wav", &[(0, 1.0), (1, 1.0)]);
    for name in ["plain.mf4", "packed.mf4", "table.parquet", "table.feather"] {
        assert_holds(name, &[(0, 1.0), (1, 1.0)]);
        let columns = read(&fixture(name)).expect(name);
        assert_eq!(columns.names, ["a0", "a1"], "{name}");
        assert!(columns.units.iter().all(|unit| unit.as_deref() == Some("g")), "{name}: {:?}", columns.units);
    }
}

/// A deterministic sequence of numbers.
fn draw(state: &mut u64) -> u64 {
    *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    *state >> 33
}

#[test]
fn fault_damaged_files_are_refused_or_read_and_never_panic() {
    let folder = folder("formats-damaged");
    let mut refusals = 0;
    let compressed = ["packed.mf4", "plain.mf4", "table.parquet", "table.feather"];
    let plain = ["float.tdms", "scaled.tdms", "plain.h5", "v73.mat", "binary.uff", "pcm24.flac"];
    for name in plain.into_iter().chain(compressed) {
        let whole = std::fs::read(fixture(name)).expect("a fixture");
        let mut state = 11;
        for trial in 0..60 {
            let mut bytes = whole.clone();
            if trial % 3 == 0 {
                bytes.truncate(draw(&mut state) as usize % whole.len());
            } else {
                for _ in 0..=trial % 5 {
                    let at = draw(&mut state) as usize % bytes.len();
                    bytes[at] = draw(&mut state) as u8;
                }
            }
            let path = folder.join(format!("{trial}-{name}"));
            std::fs::write(&path, bytes).expect("written");
            if let Err(error) = read(&path) {
                refusals += 1;
                let line = error.to_string();
                assert!(!line.contains('\n') && line.contains(name), "one line with the file: {line}");
            }
        }
    }
    assert!(refusals > 100, "{refusals} of 360");
}

#[test]
fn fault_announced_sizes_are_held_against_the_file() {
    let folder = folder("formats-announced");
    let whole = std::fs::read(fixture("float.tdms")).expect("a fixture");
    let path = folder.join("long.tdms");
    // A segment that announces a terabyte.
    let mut bytes = whole.clone();
    bytes[12..20].copy_from_slice(&(1_u64 << 40).to_le_bytes());
    std::fs::write(&path, &bytes).expect("written");
    refused(&["import", &text(&path), "-o", &text(&folder.join("record"))], &["long.tdms", "more bytes than follow"]);
    // A file that was not closed: the last segment reaches to the end.
    let mut bytes = whole.clone();
    let second = (1..whole.len() - 4).rfind(|i| &whole[*i..*i + 4] == b"TDSm").expect("two segments");
    bytes[second + 12..second + 20].copy_from_slice(&u64::MAX.to_le_bytes());
    std::fs::write(&path, &bytes).expect("written");
    assert_eq!(read(&path).expect("readable").channels[0], channel(0));
    // DAQmx raw data are codes whose scales lie elsewhere.
    let mut bytes = whole;
    bytes[4] |= 1 << 7;
    std::fs::write(&path, &bytes).expect("written");
    refused(&["import", &text(&path), "-o", &text(&folder.join("record"))], &["long.tdms", "DAQmx"]);
}

#[test]
fn theory_float_samples_keep_every_bit_of_a_24_bit_source() {
    let folder = folder("formats-float");
    let (flac, record) = (text(&fixture("pcm24.flac")), folder.join("record"));
    let scale = folder.join("scales.csv");
    std::fs::write(&scale, "channel,full scale\nfirst,8\nsecond,0.008\n").expect("written");
    let arguments = ["import", &flac, "--no-tach", "--float", "--torque", "12.5", "--source-full-scale", &text(&scale)];
    accepted(&[&arguments[..], &["-o", &text(&record)]].concat());
    let record = Record::read(&record).expect("a record");
    let run = record.run(0).expect("a run");
    assert_eq!(run.signal_m_s2(0), channel(0));
    // A thousandth of the other channel, which 16 bits of one full scale would leave 8 bits of.
    for (found, expected) in run.signal_m_s2(1).iter().zip(channel(1)) {
        assert_eq!(*found, f64::from((expected / 1000.0) as f32));
    }
    assert_eq!(run.declaration.input_torque_n_m, Some(12.5));
    let floats = text(&fixture("float.wav"));
    let out = text(&folder.join("other"));
    refused(
        &["import", &floats, "--no-tach", "--source-full-scale", "5", "-o", &out],
        &["--source-full-scale", "float.wav"],
    );
    refused(&["import", &flac, "--no-tach", "--torque", "1,2", "-o", &out], &["--torque", "2 values for 1 runs"]);
}

#[test]
fn theory_a_record_of_a_declared_machine_needs_no_tooth_counts() {
    let folder = folder("formats-machine");
    let (wav, machine) = (text(&fixture("float.wav")), text(&common::machine("20-40.toml")));
    let record = folder.join("record");
    accepted(&["import", &wav, "--no-tach", "--machine", &machine, "-o", &text(&record)]);
    let record = Record::read(&record).expect("a record");
    assert_eq!(record.declaration.machine().expect("declared").pair.teeth, [20, 40]);
    let out = text(&folder.join("other"));
    refused(
        &["import", &wav, "--no-tach", "--machine", &machine, "--teeth", "20,41", "-o", &out],
        &["--teeth", "20,40"],
    );
}
