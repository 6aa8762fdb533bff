//! A campaign of drawn files as people have them, with known content: format, unit, time, rate, order of columns and
//! head are drawn.
//!
//! A file is right if values, unit, rate and channels come out as they were put in; refused well if the line names a
//! way out; else it is silently wrong, which no file may be. 200 files by default, `MESHBAND_FILES=3000` for the long
//! campaign; seed `MESHBAND_SEED`.

use meshband_record::import::{ImportOptions, Reading, TachChoice, import};
use meshband_record::record::{Acquisition, Run, RunDeclaration, export};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::PathBuf;

const GRAVITY: f64 = 9.80665;
/// Ways that a refusal may name.
const REMEDIES: [&str; 8] =
    ["--rate", "--time-unit", "--unit", "--columns", "--skip", "--decimal", "cut the file", "--no-time"];

/// What is in a file.
struct Truth {
    channels: Vec<Vec<f64>>,
    names: Vec<String>,
    rate_hz: f64,
    /// Factor from the file's numbers to the record's, and the record's unit.
    unit: (f64, &'static str),
    /// Steps that printed numbers are rounded to.
    rounding: f64,
}

/// A drawn file and how its owner would import it.
struct Drawn {
    kind: String,
    name: String,
    content: Vec<u8>,
    options: ImportOptions,
    truth: Truth,
}

fn pick<'a, T>(random: &mut ChaCha8Rng, from: &'a [T]) -> &'a T {
    &from[random.random_range(0..from.len())]
}

/// Vibration in m/s2: a few tones and noise.
fn signals(random: &mut ChaCha8Rng, count: usize, samples: usize, rate_hz: f64) -> Vec<Vec<f64>> {
    let mut channels = Vec::new();
    for _ in 0..count {
        let level = random.random_range(0.5..20.0);
        let tones: Vec<(f64, f64)> =
            (0..3).map(|_| (random.random_range(0.01..0.4) * rate_hz, random.random_range(0.0..6.0))).collect();
        let one = |i: usize| {
            let t = i as f64 / rate_hz;
            tones.iter().map(|(hz, phase)| (std::f64::consts::TAU * hz * t + phase).sin()).sum::<f64>()
        };
        channels.push((0..samples).map(|i| level * (one(i) + random.random_range(-0.3..0.3))).collect());
    }
    channels
}

const RATES_HZ: [f64; 8] = [5_000.0, 8_192.0, 10_000.0, 12_800.0, 20_000.0, 25_600.0, 48_000.0, 51_200.0];

fn drawn(seed: u64) -> Drawn {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let rate_hz = *pick(&mut random, &RATES_HZ);
    let (count, samples) = (random.random_range(1..4), random.random_range(400..3000));
    let channels = signals(&mut random, count, samples, rate_hz);
    match random.random_range(0..10) {
        0..6 => of_text(&mut random, channels, rate_hz),
        6 => of_lvm(&mut random, channels, rate_hz),
        _ => of_export(&mut random, channels, rate_hz),
    }
}

fn options() -> ImportOptions {
    ImportOptions { tach: TachChoice::None, units: Vec::new(), float: true, ..ImportOptions::default() }
}

/// A unit: how it is written, and what one of it is in the record.
const UNITS: [(&str, f64, &str); 7] = [
    ("g", GRAVITY, "m/s2"),
    ("mg", 1e-3 * GRAVITY, "m/s2"),
    ("m/s2", 1.0, "m/s2"),
    ("m/s^2", 1.0, "m/s2"),
    ("mm/s2", 1e-3, "m/s2"),
    ("in/s2", 0.0254, "m/s2"),
    ("", 1.0, "unknown"),
];

fn of_text(random: &mut ChaCha8Rng, channels: Vec<Vec<f64>>, rate_hz: f64) -> Drawn {
    let samples = channels[0].len();
    let (unit, factor, record_unit) = *pick(random, &UNITS);
    let (separator, decimal) = *pick(
        random,
        &[(",", "."), (";", "."), (";", ","), ("\t", "."), ("\t", ","), (" ", "."), ("  ", "."), (", ", ".")],
    );
    let time = *pick(random, &["none", "s", "ms", "us", "bare s", "bare us", "date", "clock", "coarse", "epoch"]);
    let head = *pick(random, &["brackets", "brackets", "row", "none", "comment"]);
    let counter = random.random_range(0..4) == 0;
    let aside = random.random_range(0..4) == 0;
    let last = random.random_range(0..3) == 0;
    let blanks = separator.starts_with(' ');
    // What one form cannot say with another is not drawn: blanks in dates, names without a row.
    let time = if (blanks && ["date", "clock"].contains(&time))
        || (head == "none" && ["ms", "us", "bare us", "coarse"].contains(&time))
    {
        "s"
    } else {
        time
    };
    let (head, aside, counter) = if head == "none" { (head, false, false) } else { (head, aside, counter) };
    let stated = if head == "none" || (head == "comment" && blanks) { "" } else { unit };
    let time_name = match time {
        "ms" => ["Time (ms)", "time_ms", "t [ms]"][random.random_range(0..3)],
        "us" => ["Time (us)", "time_us", "t [us]"][random.random_range(0..3)],
        "date" => "Timestamp",
        _ => ["Time", "time", "t", "Zeit"][random.random_range(0..4)],
    };
    let time_name = if blanks {
        time_name.replace(" (", "_").replace(" [", "_").replace([')', ']'], "")
    } else {
        time_name.to_owned()
    };
    let names: Vec<String> = (0..channels.len()).map(|c| format!("A{}", c + 1)).collect();
    let bracket = |name: &String| {
        if stated.is_empty() || head == "row" {
            name.clone()
        } else if blanks {
            format!("{name}[{stated}]")
        } else {
            format!("{name} [{stated}]")
        }
    };
    let mut titles: Vec<String> = names.iter().map(bracket).collect();
    let mut units: Vec<String> =
        names.iter().map(|_| if stated.is_empty() { "-".into() } else { stated.to_owned() }).collect();
    if aside {
        titles.push("Torque".into());
        units.push("Nm".into());
    }
    if time != "none" {
        let at = if last { titles.len() } else { 0 };
        titles.insert(at, time_name);
        units.insert(
            at,
            match time {
                "ms" => "ms".into(),
                "us" | "bare us" => "us".into(),
                _ => "s".to_owned(),
            },
        );
    }
    if counter {
        titles.insert(0, ["", "index", "Sample"][if blanks { 1 } else { random.random_range(0..3) }].into());
        units.insert(0, "-".into());
    }
    let stamp = |i: usize| -> String {
        let t = i as f64 / rate_hz;
        match time {
            "ms" => format!("{:.7}", 1e3 * t),
            "us" => format!("{:.4}", 1e6 * t),
            "bare us" => format!("{:.0}", 1e6 * t),
            "date" => format!("2024-03-01 12:00:{:09.6}", t),
            "clock" => format!("12:00:{:010.7}", t),
            "coarse" => format!("{:.3}", t),
            "epoch" => format!("{:.6}", 1_700_000_000.0 + t),
            _ => format!("{t:.9}"),
        }
    };
    let mut out = String::new();
    let line = |cells: &[String]| cells.join(separator);
    match head {
        "brackets" => out += &format!("{}\n", line(&titles)),
        "row" => out += &format!("{}\n{}\n", line(&titles), line(&units)),
        "comment" => out += &format!("# {}\n", line(&titles)),
        _ => {}
    }
    for i in 0..samples {
        let mut cells: Vec<String> = channels.iter().map(|channel| format!("{:.8e}", channel[i] / factor)).collect();
        if aside {
            cells.push(format!("{:.3}", 30.0 + 0.01 * (0.7 * i as f64).sin()));
        }
        if time != "none" {
            let at = if last { cells.len() } else { 0 };
            cells.insert(at, stamp(i));
        }
        if counter {
            cells.insert(0, i.to_string());
        }
        if decimal == "," {
            cells.iter_mut().for_each(|cell| *cell = cell.replace('.', ","));
        }
        let _ = writeln!(out, "{}", line(&cells));
    }
    let mut options = options();
    // Coarse stamps alone give no rate: refused, and drawn seldom.
    let needs_rate = time == "none" || (time == "coarse" && random.random_range(0..8) > 0);
    if needs_rate || random.random_range(0..3) == 0 {
        options.rate_hz = Some(rate_hz);
    }
    // What a row of units states holds for names in a comment, too.
    let unit = if stated.is_empty() { (factor, "unknown") } else { (factor, record_unit) };
    let content = match (random.random_range(0..6), out.is_ascii()) {
        (0, _) => [0xff, 0xfe].into_iter().chain(out.encode_utf16().flat_map(u16::to_le_bytes)).collect(),
        (1, _) => [b"\xef\xbb\xbf", out.as_bytes()].concat(),
        (2, _) => out.replace('\n', "\r\n").into_bytes(),
        _ => out.into_bytes(),
    };
    let kind = format!("text, time {time}, head {head}, separator {separator:?}, decimal {decimal}, unit '{stated}'");
    let factor = if unit.1 == "unknown" { 1.0 / factor } else { 1.0 };
    let channels: Vec<Vec<f64>> = channels.iter().map(|channel| channel.iter().map(|x| x * factor).collect()).collect();
    let truth = Truth { channels, names, rate_hz, unit: (1.0, unit.1), rounding: 1e-6 };
    Drawn { kind, name: ["log.csv", "log.txt", "log.dat"][random.random_range(0..3)].into(), content, options, truth }
}

fn of_lvm(random: &mut ChaCha8Rng, channels: Vec<Vec<f64>>, rate_hz: f64) -> Drawn {
    let (unit, factor, record_unit) = *pick(random, &UNITS);
    let (comma, columns) = (random.random_range(0..2) == 0, random.random_range(0..2) == 0);
    let each = |value: String| format!("\t{value}").repeat(channels.len());
    let names: Vec<String> = (0..channels.len()).map(|c| format!("A{}", c + 1)).collect();
    let samples = channels[0].len();
    let mut out = format!(
        "LabVIEW Measurement\t\nWriter_Version\t2\nSeparator\tTab\nDecimal_Separator\t{}\nMulti_Headings\tNo\n\
         X_Columns\t{}\n***End_of_Header***\t\n\n\
         Channels\t{}\nSamples{}\nY_Unit_Label{}\nX_Dimension{}\nX0{}\nDelta_X{}\n***End_of_Header***\nX_Value\t{}\
         \tComment\n",
        if comma { "," } else { "." },
        if columns { "One" } else { "No" },
        channels.len(),
        each(samples.to_string()),
        each(unit.into()),
        each("Time".into()),
        each("0.0".into()),
        each(format!("{:.9E}", 1.0 / rate_hz)),
        names.join("\t")
    );
    for i in 0..samples {
        let x = if columns { format!("{:.9}", i as f64 / rate_hz) } else { String::new() };
        let _ = writeln!(out, "{x}{}", channels.iter().map(|c| format!("\t{:.8}", c[i] / factor)).collect::<String>());
    }
    if comma {
        out = out.replace('.', ",");
    }
    let scale = if record_unit == "unknown" { 1.0 / factor } else { 1.0 };
    let channels = channels.iter().map(|channel| channel.iter().map(|x| x * scale).collect()).collect();
    let truth = Truth { channels, names, rate_hz, unit: (1.0, record_unit), rounding: 1e-6 * factor.max(1.0) };
    Drawn {
        kind: format!("lvm, unit '{unit}'"),
        name: "bench.lvm".into(),
        content: out.into_bytes(),
        options: options(),
        truth,
    }
}

/// Binary formats by the exporter, whose own test holds it against the importer and whose files other libraries read.
fn of_export(random: &mut ChaCha8Rng, channels: Vec<Vec<f64>>, rate_hz: f64) -> Drawn {
    let names: Vec<String> = (0..channels.len()).map(|c| format!("A{}", c + 1)).collect();
    let (format, ending, states_unit, states_rate) = *pick(
        random,
        &[
            (export::Format::Wav, "wav", false, true),
            (export::Format::Mat, "mat", true, true),
            (export::Format::Uff58, "uff", true, true),
            (export::Format::Npy, "npy", false, false),
            (export::Format::Csv, "csv", true, true),
            (export::Format::Mf4, "mf4", true, true),
            (export::Format::Parquet, "parquet", true, true),
        ],
    );
    let unit = *pick(random, &["m/s2", "g", "V", "Pa"]);
    let peak = channels.iter().flatten().fold(0.0_f64, |peak, x| peak.max(x.abs()));
    let acquisition = Acquisition {
        sample_rate_hz: rate_hz,
        channels: names.clone(),
        full_scale_m_s2: 2.0 * peak,
        code_bits: 32,
        unit: (unit != "m/s2").then(|| unit.to_owned()),
        other: toml::Table::new(),
    };
    let run = Run::from_signals(RunDeclaration::numbered(0, false, None), &acquisition, &channels, Vec::new())
        .expect("a run");
    let content = export::content(format, &run, &acquisition).expect("a file");
    let mut options = options();
    if !states_rate {
        options.rate_hz = Some(rate_hz);
    }
    let (factor, symbol) = match (states_unit, unit) {
        (false, _) => (1.0, "unknown"),
        (true, "g") => (GRAVITY, "m/s2"),
        (true, other) => (1.0, other),
    };
    let truth = Truth { channels, names, rate_hz, unit: (factor, symbol), rounding: 2e-6 };
    Drawn { kind: format!("{ending}, unit {unit}"), name: format!("run.{ending}"), content, options, truth }
}

/// Right, refused with a way out, or what is wrong.
fn judge(drawn: &Drawn, path: PathBuf) -> Result<&'static str, String> {
    let (record, summary) = match import(&[path], &drawn.options) {
        Ok(made) => made,
        Err(error) => {
            let line = error.to_string();
            return if REMEDIES.iter().any(|remedy| line.contains(remedy)) {
                Ok("refused")
            } else {
                Err(format!("refused without a way out: {line}"))
            };
        }
    };
    let truth = &drawn.truth;
    if (summary.sample_rate_hz / truth.rate_hz - 1.0).abs() > 2e-5 {
        return Err(format!("rate {} for {}", summary.sample_rate_hz, truth.rate_hz));
    }
    if summary.unit != truth.unit.1
        || summary.channels.len() != truth.names.len()
        || summary.samples != [truth.channels[0].len()]
    {
        return Err(format!("unit {}, channels {:?}, samples {:?}", summary.unit, summary.channels, summary.samples));
    }
    for (c, expected) in truth.channels.iter().enumerate() {
        let found = record.runs[0].signal_m_s2(c);
        let most = expected.iter().fold(0.0_f64, |most, x| most.max(x.abs())) * truth.unit.0;
        let off = found.iter().zip(expected).map(|(x, y)| (x - y * truth.unit.0).abs()).fold(0.0, f64::max);
        if off > truth.rounding * most.max(1e-9) + 1e-6 * truth.rounding {
            return Err(format!("channel {c} is off by {off:.3e} of {most:.3e}"));
        }
    }
    Ok("right")
}

fn number(name: &str, otherwise: u64) -> u64 {
    std::env::var(name).ok().and_then(|text| text.parse().ok()).unwrap_or(otherwise)
}

#[test]
fn claim_drawn_files_come_in_right_or_are_refused_with_a_way_out() {
    let (files, seed) = (number("MESHBAND_FILES", 200), number("MESHBAND_SEED", 1));
    let folder = std::env::temp_dir().join(format!("meshband-drawn-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder");
    let mut counts: BTreeMap<&str, u64> = BTreeMap::new();
    let mut wrong = Vec::new();
    for k in 0..files {
        let drawn = drawn(1_000_000 * seed + k);
        let path = folder.join(&drawn.name);
        std::fs::write(&path, &drawn.content).expect("written");
        match judge(&drawn, path) {
            Ok(verdict) => {
                if verdict == "refused" {
                    println!("refused {k}: {}", drawn.kind);
                }
                *counts.entry(verdict).or_default() += 1;
            }
            Err(what) => {
                let text: String = String::from_utf8_lossy(&drawn.content).chars().filter(|c| *c != '\0').collect();
                let head: Vec<&str> = text.lines().take(3).collect();
                wrong.push(format!("{k}: {} ({}): {what}; begins {head:?}", drawn.kind, drawn.name));
            }
        }
    }
    std::fs::remove_dir_all(&folder).expect("removed");
    println!("{files} files: {counts:?}, wrong {}", wrong.len());
    assert!(wrong.is_empty(), "{} of {files} wrong:\n{}", wrong.len(), wrong.join("\n"));
    let right = counts.get("right").copied().unwrap_or(0);
    assert!(right as f64 >= 0.97 * files as f64, "{right} of {files} right: {counts:?}");
}

/// Cut, changed, repeated and removed pieces.
fn damaged(random: &mut ChaCha8Rng, whole: &[u8]) -> Vec<u8> {
    let mut bytes = whole.to_vec();
    for _ in 0..random.random_range(1..4) {
        let at = random.random_range(0..bytes.len().max(1));
        match random.random_range(0..5) {
            0 => bytes.truncate(at.max(1)),
            1 => {
                let head = at % 300.min(bytes.len());
                bytes[head] = random.random();
            }
            2 => bytes[at] = random.random(),
            3 => {
                let end = (at + random.random_range(1..40)).min(bytes.len());
                bytes.drain(at..end);
            }
            _ => {
                let end = (at + random.random_range(1..40)).min(bytes.len());
                let piece = bytes[at..end].to_vec();
                bytes.splice(at..at, piece);
            }
        }
        if bytes.is_empty() {
            bytes.push(0);
        }
    }
    bytes
}

#[test]
fn fault_damaged_drawn_files_are_refused_or_read_and_never_panic() {
    let files = number("MESHBAND_FILES", 200);
    let folder = std::env::temp_dir().join(format!("meshband-damaged-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder");
    let mut refusals = 0;
    for k in 0..files {
        let mut random = ChaCha8Rng::seed_from_u64(7_000_000 + k);
        let drawn = drawn(9_000_000 + k);
        let path = folder.join(&drawn.name);
        std::fs::write(&path, damaged(&mut random, &drawn.content)).expect("written");
        if let Err(error) = import(&[path], &drawn.options) {
            let line = error.to_string();
            assert!(!line.chars().any(char::is_control), "not one line: {line:?}");
            refusals += 1;
        }
    }
    std::fs::remove_dir_all(&folder).expect("removed");
    assert!(refusals > files / 10, "{refusals} of {files}");
}

#[test]
fn theory_a_reading_without_options_is_the_default() {
    assert_eq!(ImportOptions::default().reading, Reading::default());
}
