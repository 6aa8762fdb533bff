//! Targets that read files: a record's folder, and measurement files of every format.

use crate::damage::byte_damage::{damage, damage_npy, damage_text};
use crate::damage::originals::import_files;
use meshband_host::Error;
use meshband_host::import::{Reading, read_as, read_full_scales};
use meshband_host::record::{Declaration, Record, edges_text};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use std::cell::OnceCell;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// Longest message, characters: a line that people read.
const LINE: usize = 2_000;

thread_local! {
    static FOLDER: OnceCell<TempDir> = const { OnceCell::new() };
}

/// The folder that inputs of this thread are written into.
fn folder() -> PathBuf {
    FOLDER.with(|folder| folder.get_or_init(|| tempfile::tempdir().expect("a temporary folder")).path().to_owned())
}

/// The input as a file.
pub fn input_file(name: &str, bytes: &[u8]) -> PathBuf {
    let path = folder().join(name);
    std::fs::write(&path, bytes).expect("the input as a file");
    path
}

/// The words of a refusal: one line without control characters that names the place.
pub fn refusal(error: &Error, place: &str) -> String {
    let line = error.to_string();
    assert!(!line.chars().any(char::is_control), "not one line: {line:?}");
    assert!(line.chars().count() <= LINE, "a message of {} characters", line.chars().count());
    assert!(line.contains(place), "{place} is not named: {line}");
    line.replace(&*folder().to_string_lossy(), "")
}

/// Between the parts of a record; the signal comes last.
const BORDER: &[u8] = b"\n#-- part --\n";
const PARTS: [&str; 3] = ["record.toml", "run00.tach.csv", "run00.npy"];

fn joined(parts: &[Vec<u8>]) -> Vec<u8> {
    parts.join(BORDER)
}

fn parts(bytes: &[u8]) -> Vec<Vec<u8>> {
    let mut parts = Vec::new();
    let mut rest = bytes;
    while let (Some(at), true) = (rest.windows(BORDER.len()).position(|w| w == BORDER), parts.len() < PARTS.len() - 1) {
        parts.push(rest[..at].to_vec());
        rest = &rest[at + BORDER.len()..];
    }
    parts.push(rest.to_vec());
    parts.resize(PARTS.len(), Vec::new());
    parts
}

/// Records of codes and of floats, with and without a machine.
pub fn record_seeds() -> Vec<Vec<u8>> {
    let machine = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/19-48.toml"));
    let machine = machine.expect("a machine of the project");
    let tables = |bits: u32, rest: &str| {
        let run = "[[run]]\nsignal = \"run00.npy\"\ntach = \"run00.tach.csv\"\nfirst_pulse_index = \
            0\ninput_torque_n_m = 10.0\n";
        let acquisition =
            format!("[acquisition]\nsample_rate_hz = 1000.0\ncode_bits = {bits}\nfull_scale_m_s2 = 50.0\n");
        let acquisition = acquisition + "channels = [\"first\", \"second\"]\n";
        let tach = "[tach]\nshaft = \"pinion\"\npulses_per_rev = 1\n";
        format!("{rest}\n{acquisition}{tach}{run}").into_bytes()
    };
    let edges: Vec<f64> = (0..8).map(|n| 0.002 + 0.0301 * f64::from(n)).collect();
    let edges = edges_text(&edges).into_bytes();
    let codes: Vec<i16> = (0..512).map(|n: i16| (n % 64) * 300 - 9_000).collect();
    let values: Vec<f32> = codes.iter().map(|code| f32::from(*code) / 700.0).collect();
    let with = |toml: Vec<u8>, npy: Vec<u8>| joined(&[toml, edges.clone(), npy]);
    vec![
        with(tables(16, "title = \"codes\""), meshband_host::record::npy::bytes_i16(&codes, 2)),
        with(tables(32, &machine), meshband_host::record::npy::bytes_f32(&values, 2)),
    ]
}

/// One part of a record.
pub fn change_record(bytes: &mut Vec<u8>, random: &mut ChaCha8Rng) {
    let mut all = parts(bytes);
    match random.random_range(0..8) {
        0..4 => super::texts::change_toml(&mut all[0], random),
        4 => drop(damage_text(&mut all[1], random)),
        5 if all[2].starts_with(b"\x93NUMPY") => drop(damage_npy(&mut all[2], random)),
        6 => drop(damage(&mut all[2], random)),
        _ => drop(damage(&mut all[random.random_range(0..PARTS.len())], random)),
    }
    *bytes = joined(&all);
}

/// A record that is taken is sound: whole rows of finite values, edges that ascend, a declaration that is written and
/// read again.
pub fn record(bytes: &[u8]) -> String {
    for (name, part) in PARTS.iter().zip(parts(bytes)) {
        input_file(name, &part);
    }
    let record = match Record::read(&folder()) {
        Ok(record) => record,
        Err(error) => return refusal(&error, &folder().to_string_lossy()),
    };
    for run in &record.runs {
        assert!(run.edges_s.iter().all(|edge| edge.is_finite()) && run.edges_s.is_sorted(), "edges do not ascend");
        for channel in 0..run.channels() {
            let signal = run.signal_m_s2(channel);
            assert_eq!(signal.len(), run.samples());
            assert!(signal.iter().all(|x| x.is_finite()), "a value that is no number");
        }
    }
    let text = record.declaration.to_toml().expect("what was read can be written");
    let again = Declaration::parse(&text, "again").expect("what was written is read");
    assert_eq!(again.to_toml().expect("as before"), text);
    let machine = record.declaration.has_machine().then(|| record.declaration.machine().is_ok());
    format!("a record of {} runs, machine {machine:?}", record.runs.len().min(9))
}

/// Endings by the first byte of an input; the last is a file of full scales.
const ENDINGS: [&str; 14] =
    ["csv", "csv.gz", "txt", "wav", "npy", "mat", "h5", "uff", "tdms", "flac", "mf4", "parquet", "feather", "lvm"];

/// A sound file of every format: our own short ones, and those of independent writers.
pub fn import_seeds() -> Vec<Vec<u8>> {
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("../host/tests/fixtures/formats");
    let theirs =
        ["ascii.uff", "binary.uff", "float.tdms", "float.wav", "pcm24.flac", "plain.h5", "scaled.tdms", "v73.mat"];
    let tables = ["plain.mf4", "packed.mf4", "table.parquet", "table.feather"];
    let theirs = theirs
        .into_iter()
        .chain(tables)
        .map(|name| (name.to_owned(), std::fs::read(fixtures.join(name)).expect("a fixture")));
    let own = import_files(600).expect("packed in memory");
    let files = own.into_iter().map(|(name, bytes)| (name.to_owned(), bytes)).chain(theirs);
    let mut seeds: Vec<Vec<u8>> = files
        .map(|(name, bytes)| {
            let ending = ENDINGS.iter().rposition(|ending| name.ends_with(&format!(".{ending}"))).expect("an ending");
            [&[ending as u8, 0][..], &bytes].concat()
        })
        .collect();
    seeds.push([&[ENDINGS.len() as u8, 0][..], b"channel,full scale\nfirst,8\nsecond,0.008\n"].concat());
    seeds
}

/// What the file holds; its ending and the way it is read now and then.
pub fn change_import(bytes: &mut Vec<u8>, random: &mut ChaCha8Rng) {
    let head: Vec<u8> = bytes.drain(..bytes.len().min(2)).collect();
    match random.random_range(0..8) {
        0 if bytes.starts_with(b"\x93NUMPY") => drop(damage_npy(bytes, random)),
        0..3 if std::str::from_utf8(bytes).is_ok() => drop(damage_text(bytes, random)),
        3 => return *bytes = [&[random.random_range(0..=ENDINGS.len() as u8), random.random()][..], bytes].concat(),
        _ => drop(damage(bytes, random)),
    }
    bytes.splice(0..0, head);
}

/// What is read has equally long channels of finite values with names fit for a table.
pub fn import(bytes: &[u8]) -> String {
    let [ending, how, content @ ..] = bytes else { return "too short".into() };
    let Some(ending) = ENDINGS.get(usize::from(*ending) % (ENDINGS.len() + 1)) else {
        return match read_full_scales(&input_file("scales.csv", content)) {
            Ok(scales) => {
                assert!(!scales.is_empty() && scales.iter().all(|scale| scale.is_finite() && *scale > 0.0));
                "full scales".into()
            }
            Err(error) => refusal(&error, "scales.csv"),
        };
    };
    let decimal_comma = [None, Some(true), Some(false)][usize::from(how % 3)];
    let name = format!("input.{ending}");
    match read_as(
        &input_file(&name, content),
        &Reading { decimal_comma, no_time: how & 0x80 != 0, ..Reading::default() },
    ) {
        Ok(columns) => {
            assert_eq!(columns.names.len(), columns.channels.len());
            let samples = columns.channels.first().map_or(0, Vec::len);
            assert!(samples >= 2 && columns.channels.iter().all(|channel| channel.len() == samples));
            assert!(columns.channels.iter().flatten().all(|x| x.is_finite()), "a value that is no number");
            assert!(!columns.names.iter().any(|name| name.chars().any(char::is_control)), "{:?}", columns.names);
            assert!(columns.rate_hz.is_none_or(|rate| rate.is_finite() && rate > 0.0), "{:?}", columns.rate_hz);
            format!("{ending}, {} channels, {} remarks", columns.channels.len().min(9), columns.remarks.len())
        }
        Err(error) => refusal(&error, &name),
    }
}
