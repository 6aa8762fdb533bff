//! A part of a recording: `--from` and `--to` of import, analyse and diagnose.

use crate::common::{accepted, folder, refused, text};
use crate::import_tach::{RATE_HZ, Rig, csv, edges_file, imported, refused_import, wav};
use meshband_host::record::Record;
use serde_json::Value;
use std::io::Write;
use std::path::Path;

const PART: [&str; 4] = ["--from", "2", "--to", "6.5"];

fn with<'a>(options: &[&'a str]) -> Vec<&'a str> {
    [&PART[..], options].concat()
}

/// The part's samples and edges are those of the whole, counted from its first sample.
fn is_part_of(part: &Record, whole: &Record) {
    let (part, whole) = (&part.runs[0], &whole.runs[0]);
    let first = (2.0 * RATE_HZ) as usize;
    assert_eq!(part.samples(), (4.5 * RATE_HZ) as usize);
    let step = part.step().max(whole.step());
    for channel in 0..part.channels() {
        let (own, all) = (part.signal_m_s2(channel), whole.signal_m_s2(channel));
        assert!(own.iter().zip(&all[first..]).all(|(a, b)| (a - b).abs() <= step), "channel {channel}");
    }
    let inside: Vec<f64> = whole.edges_s.iter().filter(|edge| (2.0..=6.5).contains(*edge)).map(|t| t - 2.0).collect();
    assert_eq!(part.edges_s.len(), inside.len());
    assert!(part.edges_s.iter().zip(&inside).all(|(a, b)| (a - b).abs() < 2e-6), "edges");
    assert_eq!(part.declaration.part(), Some("2 s to 6.5 s of 8 s"));
}

#[test]
fn theory_a_part_of_a_wav_or_csv_file_is_that_part_of_its_record() {
    let (folder, rig) = (folder("part-files"), Rig::new());
    let files = [
        wav(&folder.join("a.wav"), &rig.channels()),
        csv(&folder.join("a.csv"), &["a1", "a2", "tacho"], &rig.channels()),
    ];
    for file in &files {
        let options = ["--tach", "3", "--teeth", "23,61"];
        let whole = imported(&folder, &[file], &options).1;
        let (_, part, printed) = imported(&folder, &[file], &with(&options));
        is_part_of(&part, &whole);
        assert!(printed.contains("2 s to 6.5 s of 8 s"), "{printed}");
    }
}

#[test]
fn theory_edge_times_of_a_file_of_their_own_are_moved_with_the_part() {
    let (folder, rig) = (folder("part-edges"), Rig::new());
    let channels = rig.channels();
    let file = wav(&folder.join("a.wav"), &channels[..2]);
    let edges_s = rig.edges_s();
    let named = edges_file(&folder.join("edges.csv"), &edges_s);
    let bare = folder.join("bare.csv");
    let rows: String = edges_s.iter().map(|edge| format!("{:.6}\n", 1e3 * edge)).collect();
    std::fs::write(&bare, rows).expect("written");
    let tacho = wav(&folder.join("tacho.wav"), &channels[2..]);
    for tach in [&named, &text(&bare), &tacho] {
        let options = ["--tach", tach, "--teeth", "23,61"];
        let whole = imported(&folder, &[&file], &options).1;
        let part = imported(&folder, &[&file], &with(&options)).1;
        is_part_of(&part, &whole);
    }
}

#[test]
fn claim_a_part_of_a_file_beyond_the_limit_is_read_without_the_rest() {
    let (folder, rig) = (folder("part-huge"), Rig::new());
    let path = folder.join("a.wav");
    let file = wav(&path, &rig.channels());
    let options = ["--tach", "3", "--teeth", "23,61"];
    let whole = imported(&folder, &[&file], &options).1;
    // The same samples before silence that a disk keeps as a hole: 3.6 GB, more than any limit of a whole file.
    let content = std::fs::read(&path).expect("a wav");
    let at = content.windows(4).position(|four| four == b"data").expect("data") + 4;
    let begin = at + 4;
    let samples = 300_000_000_u32;
    let mut long = std::fs::File::create(&path).expect("a file");
    long.write_all(&content[..at]).expect("written");
    long.write_all(&(12 * samples).to_le_bytes()).expect("written");
    long.write_all(&content[begin..]).expect("written");
    long.set_len(begin as u64 + 12 * u64::from(samples)).expect("a long file");
    drop(long);
    refused_import(&folder, &file, &options, &["9.000e8 values", "take a part with --from and --to"]);
    let part = imported(&folder, &[&file], &with(&options)).1;
    std::fs::remove_file(&path).expect("removed");
    assert_eq!(part.runs[0].samples(), (4.5 * RATE_HZ) as usize);
    assert_eq!(part.runs[0].edges_s.len(), whole.runs[0].edges_s.iter().filter(|t| (2.0..=6.5).contains(*t)).count());
}

#[test]
fn fault_a_part_that_is_none_is_refused() {
    let (folder, rig) = (folder("part-refused"), Rig::new());
    let file = wav(&folder.join("a.wav"), &rig.channels());
    refused_import(&folder, &file, &["--no-tach", "--from", "9"], &["a.wav", "lasts 8 s", "holds no signal"]);
    refused_import(&folder, &file, &["--no-tach", "--from", "-1"], &["--from", "from 0 on"]);
    refused_import(&folder, &file, &["--no-tach", "--from", "3", "--to", "3"], &["--to", "does not lie behind 3 s"]);
    let early: Vec<f64> = rig.edges_s().into_iter().filter(|edge| *edge < 4.0).collect();
    let edges = edges_file(&folder.join("early.csv"), &early);
    refused_import(&folder, &file, &["--tach", &edges, "--from", "5"], &["early.csv has 0 edges in 5 s to 8 s of 8 s"]);
    let bare = folder.join("bare.npy");
    let values: Vec<f64> = rig.channels()[0].clone();
    std::fs::write(&bare, meshband_host::record::npy::bytes_f64(&values, 1)).expect("written");
    refused_import(&folder, &text(&bare), &["--no-tach", "--to", "3"], &["bare.npy", "--rate"]);
}

#[test]
fn theory_analyse_looks_at_a_part_of_a_record_and_says_so() {
    let (folder, rig) = (folder("part-analyse"), Rig::new());
    let file = wav(&folder.join("a.wav"), &rig.channels());
    let options = ["--tach", "3", "--teeth", "23,61"];
    imported(&folder, &[&file], &options);
    let (record, json) = (text(&folder.join("out")), folder.join("part.json"));
    let printed = accepted(&["analyse", &record, "--from", "2", "--to", "6.5", "--json", &text(&json)]);
    assert!(printed.contains("part of a longer recording: 2 s to 6.5 s of 8 s"), "{printed}");
    let of_part = harmonic(&json);
    imported(&folder, &[&file], &with(&options));
    accepted(&["analyse", &record, "--json", &text(&json), "--force"]);
    let of_import = harmonic(&json);
    assert!((of_part / of_import - 1.0).abs() < 1e-3, "{of_part} {of_import}");
    refused(&["analyse", &record, "--from", "7"], &["run 0", "lasts 4.5 s"]);
}

/// Amplitude of the first mesh harmonic of the first channel.
fn harmonic(json: &Path) -> f64 {
    let outcome: Value = serde_json::from_slice(&std::fs::read(json).expect("json")).expect("valid");
    outcome["runs"][0]["channels"][0]["mesh"][0]["line"]["amplitude"].as_f64().expect("an amplitude")
}
