//! Files to import that say something else than they seem to, and files that would exhaust the machine.

use crate::common::{accepted, folder, refused, text};
use flate2::Compression;
use flate2::write::{GzEncoder, ZlibEncoder};
use std::io::Write;
use std::path::{Path, PathBuf};

fn write(folder: &Path, name: &str, bytes: &[u8]) -> String {
    let path = folder.join(name);
    std::fs::write(&path, bytes).expect("written");
    text(&path)
}

fn gz(bytes: &[u8]) -> Vec<u8> {
    let mut gz = GzEncoder::new(Vec::new(), Compression::default());
    gz.write_all(bytes).expect("packed");
    gz.finish().expect("packed")
}

/// Imports without a tach and gives the summary.
fn imported(folder: &Path, file: &str, options: &[&str]) -> serde_json::Value {
    let (out, json) = (text(&folder.join("out")), text(&folder.join("out.json")));
    let _ = std::fs::remove_dir_all(&out);
    let mut arguments = vec!["import", file, "-o", &out, "--no-tach", "--json", &json, "--force"];
    arguments.extend(options);
    accepted(&arguments);
    serde_json::from_slice(&std::fs::read(&json).expect("json")).expect("valid")
}

fn refused_import(folder: &Path, file: &str, options: &[&str], expected: &[&str]) {
    let out = text(&folder.join("out"));
    let _ = std::fs::remove_dir_all(&out);
    let mut arguments = vec!["import", file, "-o", &out, "--no-tach"];
    arguments.extend(options);
    refused(&arguments, expected);
    assert!(!Path::new(&out).exists(), "a refused import leaves nothing behind");
}

/// First samples of channel 0 of the record just imported.
fn first_samples(folder: &Path) -> Vec<f64> {
    let record = meshband_host::record::Record::read(&folder.join("out")).expect("a record");
    let signal = record.runs[0].signal_m_s2(0);
    signal.into_iter().take(4).collect()
}

fn near(values: &[f64], expected: &[f64]) {
    assert_eq!(values.len(), expected.len());
    for (a, b) in values.iter().zip(expected) {
        assert!((a - b).abs() < 1e-3, "{values:?} for {expected:?}");
    }
}

#[test]
fn regress_decimal_commas_in_a_comma_separated_file_are_one_column() {
    let folder = folder("decimal-comma");
    let proved = write(&folder, "proved.csv", b"0,50\n-0,25\n0,75\n-0,05\n");
    let summary = imported(&folder, &proved, &["--rate", "1000"]);
    assert_eq!(summary["channels"].as_array().expect("names").len(), 1, "{summary}");
    near(&first_samples(&folder), &[0.5, -0.25, 0.75, -0.05]);
    let two = write(&folder, "two.csv", b"0,50,1,25\n-0,25,-1,50\n0,75,1,05\n");
    assert_eq!(imported(&folder, &two, &["--rate", "1000"])["channels"].as_array().expect("names").len(), 2);
    let named = write(&folder, "named.csv", b"signal\n3,50\n4,25\n2,75\n");
    assert_eq!(imported(&folder, &named, &["--rate", "1000"])["channels"], serde_json::json!(["signal"]));
    near(&first_samples(&folder), &[3.5, 4.25, 2.75]);
    let mixed = write(&folder, "mixed.csv", b"a;b\n0,5;1.5\n-0,25;2\n1;3,0\n");
    imported(&folder, &mixed, &["--rate", "1000"]);
    near(&first_samples(&folder), &[0.5, -0.25, 1.0]);
    let tabs = write(&folder, "tabs.tsv", b"0,5\t1,5\n-0,25\t2,0\n1,0\t3,0\n");
    imported(&folder, &tabs, &["--rate", "1000"]);
    near(&first_samples(&folder), &[0.5, -0.25, 1.0]);
}

#[test]
fn regress_commas_that_may_be_either_have_to_be_told() {
    let folder = folder("either-comma");
    let either = write(&folder, "either.csv", b"12,50\n13,25\n14,75\n");
    refused_import(&folder, &either, &["--rate", "1000"], &["either.csv", "--decimal comma"]);
    imported(&folder, &either, &["--rate", "1000", "--decimal", "comma"]);
    near(&first_samples(&folder), &[12.5, 13.25, 14.75]);
    let summary = imported(&folder, &either, &["--rate", "1000", "--decimal", "point", "--no-time"]);
    assert_eq!(summary["channels"].as_array().expect("names").len(), 2);
    let named = write(&folder, "named.csv", b"a,b\n12,50\n13,-25\n11,75\n");
    assert_eq!(imported(&folder, &named, &["--rate", "1000"])["channels"], serde_json::json!(["a", "b"]));
}

#[test]
fn regress_a_damaged_first_row_is_no_header() {
    let folder = folder("damaged-row");
    let damaged = write(&folder, "damaged.csv", b"0.1x,0.2\n0.3,0.4\n0.5,0.1\n");
    refused_import(&folder, &damaged, &["--rate", "1000"], &["damaged.csv:1", "'0.1x' is no number"]);
    let half = write(&folder, "half.csv", b"time,0.2\n0.3,0.4\n0.5,0.1\n");
    refused_import(&folder, &half, &["--rate", "1000"], &["half.csv:1", "'time' is no number"]);
}

#[test]
fn regress_every_member_of_a_gzip_file_is_read() {
    let folder = folder("gzip-members");
    let both = [gz(b"0.5\n-0.5\n0.25\n"), gz(b"0.75\n-0.25\n")].concat();
    let summary = imported(&folder, &write(&folder, "both.csv.gz", &both), &["--rate", "1000"]);
    assert_eq!(summary["samples"], serde_json::json!([5]));
}

/// Times of 200 samples at 1 kHz with a wobble beside them; `gap` samples are missing after the hundredth.
fn timed(header: &str, gap: usize) -> String {
    let rows = (0..200).map(|i| i + if i < 100 { 0 } else { gap });
    let rows: String = rows.map(|i| format!("{:.4},{:.3}\n", i as f64 * 1e-3, (0.7 * i as f64).sin())).collect();
    format!("{header}{rows}")
}

#[test]
fn regress_a_time_column_with_a_gap_is_refused_with_its_place() {
    let folder = folder("time-gap");
    for (header, options) in [("", vec!["--rate", "1000"]), ("time,a\n", vec!["--rate", "1000"]), ("", vec![])] {
        let gap = write(&folder, "gap.csv", timed(header, 7).as_bytes());
        refused_import(&folder, &gap, &options, &["gap.csv", "7 samples are missing", "value 100"]);
    }
    let whole = imported(&folder, &write(&folder, "whole.csv", timed("", 0).as_bytes()), &[]);
    assert_eq!((&whole["sample_rate_hz"], whole["channels"].as_array().map(Vec::len)), (&1000.0.into(), Some(1)));
    let gap = write(&folder, "gap.csv", timed("", 7).as_bytes());
    let summary = imported(&folder, &gap, &["--rate", "1000", "--no-time"]);
    assert_eq!(summary["channels"].as_array().map(Vec::len), Some(2));
}

#[test]
fn regress_a_rate_against_the_files_own_is_refused_unless_overridden() {
    let folder = folder("rate");
    let file = write(&folder, "timed.csv", timed("", 0).as_bytes());
    refused_import(&folder, &file, &["--rate", "2000"], &["timed.csv", "1000 Hz", "2000 Hz", "--override-rate"]);
    imported(&folder, &file, &["--rate", "1000.00001"]);
    let summary = imported(&folder, &file, &["--rate", "2000", "--override-rate"]);
    assert_eq!(summary["sample_rate_hz"], 2000.0);
    assert!(summary["remarks"].to_string().contains("states 1000 Hz"), "{summary}");
}

/// A NumPy file of f64 in C order.
fn npy(shape: &str, values: impl Iterator<Item = f64>) -> Vec<u8> {
    let mut header = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}");
    while (10 + header.len() + 1) % 64 != 0 {
        header.push(' ');
    }
    header.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    values.for_each(|x| bytes.extend(x.to_le_bytes()));
    bytes
}

#[test]
fn regress_npy_whose_shape_is_beyond_any_file_is_refused() {
    let folder = folder("npy-shape");
    for shape in ["(4294967296, 4294967296)", "(18446744073709551615, 2)", "(99999999999999999999999, 2)"] {
        let path = write(&folder, "vast.npy", &npy(shape, std::iter::empty()));
        refused(&["import", &path, "--rate", "1000", "--no-tach", "-o", &text(&folder.join("r"))], &["more values"]);
    }
}

#[test]
fn regress_npy_of_channels_by_samples_is_turned() {
    let folder = folder("npy");
    let values = || (0..600).map(|i| (0.7 * f64::from(i)).sin());
    let wide = write(&folder, "wide.npy", &npy("(2, 300)", values()));
    let summary = imported(&folder, &wide, &["--rate", "1000"]);
    assert_eq!(summary["samples"], serde_json::json!([300]));
    near(&first_samples(&folder), &values().take(4).collect::<Vec<_>>());
    let packed = write(&folder, "packed.npy.gz", &gz(&npy("(300, 2)", values())));
    assert_eq!(imported(&folder, &packed, &["--rate", "1000"])["samples"], serde_json::json!([300]));
}

fn element(kind: u32, data: &[u8]) -> Vec<u8> {
    let mut out = [kind.to_le_bytes(), (data.len() as u32).to_le_bytes()].concat();
    out.extend(data);
    out.resize(out.len().next_multiple_of(8), 0);
    out
}

fn mat_array(name: &str, kind: u32, data: &[u8], rows: u32) -> Vec<u8> {
    let mut body = element(6, &[6_u32.to_le_bytes(), [0; 4]].concat());
    body.extend(element(5, &[rows.to_le_bytes(), 1_u32.to_le_bytes()].concat()));
    body.extend(element(1, name.as_bytes()));
    body.extend(element(kind, data));
    element(14, &body)
}

fn mat_doubles(name: &str, values: impl Iterator<Item = f64>) -> Vec<u8> {
    let data: Vec<u8> = values.flat_map(f64::to_le_bytes).collect();
    mat_array(name, 9, &data, (data.len() / 8) as u32)
}

fn mat_file(elements: &[Vec<u8>]) -> Vec<u8> {
    let mut bytes = b"MATLAB 5.0 MAT-file, made for a test".to_vec();
    bytes.resize(124, b' ');
    bytes.extend([0, 1, b'I', b'M']);
    bytes.extend(elements.concat());
    bytes
}

#[test]
fn regress_a_matlab_time_vector_gives_the_rate_and_is_no_channel() {
    let folder = folder("mat-time");
    let signal = || (0..300).map(|i| (0.7 * f64::from(i)).sin());
    let time = mat_doubles("t", (0..300).map(|i| 2.5 + f64::from(i) / 2000.0));
    let file = write(&folder, "timed.mat", &mat_file(&[mat_doubles("x", signal()), time]));
    let summary = imported(&folder, &file, &[]);
    assert_eq!(summary["sample_rate_hz"], 2000.0);
    assert_eq!(summary["channels"], serde_json::json!(["timed x"]));
    let broken = mat_doubles("time", (0..300).map(|i| f64::from(i + i32::from(i > 9)) / 2000.0));
    let file = write(&folder, "broken.mat", &mat_file(&[broken, mat_doubles("x", signal())]));
    refused_import(&folder, &file, &["--rate", "2000"], &["broken.mat", "1 samples are missing"]);
}

#[test]
fn regress_a_spike_or_a_full_scale_that_eats_the_resolution_is_refused_with_figures() {
    let folder = folder("spike");
    let mut values: Vec<f64> = (0..2000).map(|i| (0.7 * f64::from(i)).sin()).collect();
    let lines = |values: &[f64]| values.iter().map(|x| format!("{x:.6}\n")).collect::<String>();
    let clean = write(&folder, "clean.csv", lines(&values).as_bytes());
    refused_import(&folder, &clean, &["--rate", "1000", "--full-scale", "1e300"], &["1.000e300", "--full-scale"]);
    refused_import(&folder, &clean, &["--rate", "1000", "--full-scale", "0"], &["--full-scale: 0"]);
    let summary = imported(&folder, &clean, &["--rate", "1000"]);
    assert!(summary["quantisation_snr_db"][0].as_f64().expect("a number") > 90.0);
    values[777] = 1e9;
    let spiked = write(&folder, "spiked.csv", lines(&values).as_bytes());
    refused_import(&folder, &spiked, &["--rate", "1000"], &["spiked.csv", "sample 777", "code steps"]);
    values[777] = 3e3;
    let poor = write(&folder, "poor.csv", lines(&values).as_bytes());
    let summary = imported(&folder, &poor, &["--rate", "1000"]);
    let snr_db = summary["quantisation_snr_db"][0].as_f64().expect("a number");
    assert!((20.0..30.0).contains(&snr_db), "against the typical level, not the spike's mean square: {snr_db}");
    assert!(summary["remarks"].to_string().contains("sample 777"), "{summary}");
}

#[test]
fn fault_compressed_bombs_are_refused_within_memory() {
    let folder = folder("bombs");
    let mut bomb = GzEncoder::new(Vec::new(), Compression::default());
    let block = b"1\n2\n".repeat(1 << 18);
    (0..1024).for_each(|_| bomb.write_all(&block).expect("packed"));
    let bomb = write(&folder, "bomb.csv.gz", &bomb.finish().expect("packed"));
    refused_import(&folder, &bomb, &["--rate", "1000"], &["bomb.csv.gz", "limit"]);
    let mut zlib = ZlibEncoder::new(Vec::new(), Compression::default());
    let count: u32 = 300 << 20;
    let mut head = mat_array("x", 2, &[], count);
    let length = head.len() as u32 - 8 + count;
    head[4..8].copy_from_slice(&length.to_le_bytes());
    let tag = head.len() - 4;
    head[tag..].copy_from_slice(&count.to_le_bytes());
    zlib.write_all(&head).expect("packed");
    let block = vec![1; 1 << 20];
    (0..300).for_each(|_| zlib.write_all(&block).expect("packed"));
    let packed = zlib.finish().expect("packed");
    let compressed = [15_u32.to_le_bytes().to_vec(), (packed.len() as u32).to_le_bytes().to_vec(), packed].concat();
    let bomb = write(&folder, "bomb.mat", &mat_file(&[compressed]));
    refused_import(&folder, &bomb, &["--rate", "1000"], &["bomb.mat", "values", "limit"]);
}

#[test]
fn fault_names_and_cells_of_any_length_stay_on_one_line() {
    let folder = folder("long-names");
    let name = "n".repeat(1 << 20);
    let signal = mat_doubles(&name, (0..300).map(|i| (0.7 * f64::from(i)).sin()));
    let summary = imported(&folder, &write(&folder, "named.mat", &mat_file(&[signal])), &["--rate", "1000"]);
    assert!(summary["channels"][0].as_str().expect("a name").len() < 100);
    let quote = format!("1,2\n\"{}\n", "3,4\n".repeat(5000));
    refused_import(&folder, &write(&folder, "quote.csv", quote.as_bytes()), &["--rate", "1000"], &["quote.csv:3"]);
    let cell = format!("1\n{}\n", "x".repeat(100_000));
    refused_import(&folder, &write(&folder, "cell.csv", cell.as_bytes()), &["--rate", "1000"], &["cell.csv:2"]);
}

#[test]
#[cfg(unix)]
fn fault_pipes_and_devices_are_refused_at_once() {
    let folder = folder("special");
    let pipe: PathBuf = folder.join("pipe.csv");
    let made = std::process::Command::new("mkfifo").arg(&pipe).status().expect("mkfifo starts");
    assert!(made.success());
    let pipe = text(&pipe);
    refused_import(&folder, &pipe, &["--rate", "1000"], &["pipe.csv", "regular file"]);
    refused_import(&folder, "/dev/zero", &["--rate", "1000"], &["/dev/zero", "regular file"]);
    refused(&["predict", &pipe, "-o", "out"], &["pipe.csv"]);
    refused(&["stiffness", &pipe], &["pipe.csv", "regular file"]);
    refused(&["monitor", "--replay", "/dev/zero"], &["/dev/zero", "regular file"]);
    refused(&["monitor", "--replay", &pipe], &["pipe.csv", "regular file"]);
}
