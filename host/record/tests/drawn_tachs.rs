//! A campaign of drawn tachometers with known turns: kind of pick-up, marks, gaps, faults, course of the speed, form
//! of the file.
//!
//! A file is right if the count is sure and the mean speed within 0.25 %, or if an encoder too fast for the rate is
//! refused; unsure if the import says so; else it is silently wrong, which no file may be. 60 files by default,
//! `MESHBAND_FILES=3000` for the long campaign; seed `MESHBAND_SEED`.

use meshband_record::import::tach::{Shaft, TachOptions};
use meshband_record::import::{ImportOptions, TachChoice, Unit, import};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

const SECONDS: f64 = 4.0;
/// Most that a mean speed may be off.
const SPEED: f64 = 2.5e-3;
/// Ways that a refusal may name.
const REMEDIES: [&str; 5] = ["sample faster", "fewer marks", "--threshold", "--tach", "--pulses"];

/// A machine whose shaft turns by a smooth course.
struct Turning {
    rate_hz: f64,
    start_hz: f64,
    rise_hz_s: f64,
    swing: f64,
    swing_hz: f64,
    phase: f64,
}

impl Turning {
    fn drawn(random: &mut ChaCha8Rng) -> Self {
        let start_hz = random.random_range(8.0..40.0);
        let runs_up = random.random_range(0..5) == 0;
        Self {
            rate_hz: [12_800.0, 25_600.0, 51_200.0][random.random_range(0..3)],
            start_hz,
            rise_hz_s: if runs_up { random.random_range(0.5..0.1 * start_hz.max(6.0)) } else { 0.0 },
            swing: random.random_range(0.0..0.01),
            swing_hz: random.random_range(0.1..1.5),
            phase: random.random_range(0.0..1.0),
        }
    }

    /// Turns since an arbitrary angle.
    fn turns(&self, t: f64) -> f64 {
        let swing = self.swing * self.start_hz / (TAU * self.swing_hz) * (1.0 - (TAU * self.swing_hz * t).cos());
        self.phase + self.start_hz * t + 0.5 * self.rise_hz_s * t * t + swing
    }

    /// When it has turned so far, by bisection.
    fn time(&self, turns: f64) -> f64 {
        let (mut low, mut high) = (-1.0, SECONDS + 1.0);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if self.turns(middle) < turns { low = middle } else { high = middle }
        }
        0.5 * (low + high)
    }
}

/// A wheel: marks of a whole one, and those that it lacks.
#[derive(Clone)]
struct Marks {
    whole: u32,
    lacking: Vec<u32>,
}

/// What is drawn of a tachometer.
struct Drawn {
    kind: String,
    turning: Turning,
    marks: Marks,
    /// Whether pulses come too fast for the rate.
    too_fast: bool,
    faults: bool,
    edges_s: Vec<f64>,
}

fn drawn(seed: u64) -> (Drawn, ChaCha8Rng) {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let turning = Turning::drawn(&mut random);
    let fastest = turning.start_hz + turning.rise_hz_s * SECONDS;
    let (name, marks) = match random.random_range(0..10) {
        0..6 => ("wheel", Marks { whole: random.random_range(1..=60), lacking: Vec::new() }),
        6 | 7 => {
            let (whole, gap) = [(12, 1), (24, 1), (36, 1), (36, 2), (60, 1), (60, 2)][random.random_range(0..6)];
            ("missing marks", Marks { whole, lacking: (0..gap).collect() })
        }
        8 => ("two gaps", Marks { whole: 36, lacking: vec![0, 18] }),
        _ => {
            let whole = [500, 1000, 1024, 2000][random.random_range(0..4)];
            ("encoder", Marks { whole, lacking: Vec::new() })
        }
    };
    let samples = turning.rate_hz / (fastest * f64::from(marks.whole));
    let too_fast = samples < 3.0;
    let share =
        if marks.lacking.is_empty() && random.random_range(0..2) == 0 { random.random_range(0.01..0.05) } else { 0.0 };
    let jitter_s = random.random_range(0.0..20e-6_f64).min(0.02 / (fastest * f64::from(marks.whole)));
    let mut edges_s = Vec::new();
    let (first, last) = (turning.turns(0.0), turning.turns(SECONDS));
    let whole = f64::from(marks.whole);
    for k in (first * whole).ceil() as i64..(last * whole).floor() as i64 {
        if marks.lacking.contains(&(k.rem_euclid(i64::from(marks.whole)) as u32)) || random.random::<f64>() < share {
            continue;
        }
        edges_s.push(turning.time(k as f64 / whole) + jitter_s * random.random_range(-1.7..1.7));
    }
    let kind = format!("{name} {}, {share:.3} lost, {samples:.1} samples a mark", marks.whole);
    (Drawn { kind, turning, marks, too_fast, faults: share > 0.0, edges_s }, random)
}

/// The pick-up's signal: pulses of a third of the usual interval, from 0 to 5 V, up, down or without its mean.
fn signal(drawn: &Drawn, random: &mut ChaCha8Rng) -> (Vec<f64>, &'static str) {
    let count = (SECONDS * drawn.turning.rate_hz) as usize;
    let usual = SECONDS / drawn.edges_s.len() as f64;
    let width = if usual * drawn.turning.rate_hz > 400.0 { 0.1 * usual } else { 0.4 * usual };
    let mut out = vec![0.0; count];
    for edge in &drawn.edges_s {
        // Half a sample of a linear ramp: what an input filter leaves of an edge.
        let at = |t: f64| (t * drawn.turning.rate_hz).max(0.0);
        let (from, to) = (at(*edge), at(edge + width));
        for (i, x) in out.iter_mut().enumerate().take(count.min(to.ceil() as usize + 2)).skip(from as usize) {
            let i = i as f64;
            let up = (i - from + 0.5).clamp(0.0, 1.0);
            let down = (to - i + 0.5).clamp(0.0, 1.0);
            *x = f64::max(*x, 5.0 * up.min(down));
        }
    }
    let form = ["pulses", "no mean", "noise"][random.random_range(0..3)];
    let mean = out.iter().sum::<f64>() / count as f64;
    for x in &mut out {
        match form {
            "no mean" => *x -= mean,
            "noise" => *x += random.random_range(-0.1..0.1),
            _ => {}
        }
    }
    (out, form)
}

fn vibration(drawn: &Drawn, random: &mut ChaCha8Rng) -> Vec<f64> {
    let count = (SECONDS * drawn.turning.rate_hz) as usize;
    let mesh = |t: f64| (TAU * 20.0 * drawn.turning.turns(t)).cos();
    (0..count).map(|i| mesh(i as f64 / drawn.turning.rate_hz) + random.random_range(-0.5..0.5)).collect()
}

/// Writes the file or files, and says how the owner imports them.
fn written(folder: &Path, drawn: &Drawn, random: &mut ChaCha8Rng) -> (PathBuf, TachOptions, String) {
    let vibration = vibration(drawn, random);
    let path = folder.join("log.csv");
    let mut text = String::new();
    let (source, form) = if random.random_range(0..4) == 0 && !drawn.too_fast {
        let (unit, scale) = [("s", 1.0), ("ms", 1e3), ("us", 1e6)][random.random_range(0..3)];
        let edges: String = drawn.edges_s.iter().map(|t| format!("{:.6}\n", t * scale)).collect();
        let file = folder.join("edges.csv");
        std::fs::write(&file, format!("edge_time_{unit}\n{edges}")).expect("written");
        let rows: String = vibration.iter().map(|x| format!("{x:.5}\n")).collect();
        text += &format!("A1 [m/s2]\n{rows}");
        (file.display().to_string(), format!("edge times in {unit}"))
    } else {
        let (signal, form) = signal(drawn, random);
        text += "A1 [m/s2],Key [V]\n";
        for (x, key) in vibration.iter().zip(signal) {
            let _ = writeln!(text, "{x:.5},{key:.4}");
        }
        ("Key".into(), form.to_owned())
    };
    std::fs::write(&path, text).expect("written");
    let tach = TachOptions {
        sources: vec![source],
        pulses: drawn.marks.whole,
        shaft: Shaft::Pinion,
        falling: None,
        threshold: None,
    };
    (path, tach, form)
}

/// Right, unsure, refused, or what is wrong.
fn judge(drawn: &Drawn, path: PathBuf, tach: TachOptions) -> Result<&'static str, String> {
    let options = ImportOptions {
        tach: TachChoice::Measured(tach),
        rate_hz: Some(drawn.turning.rate_hz),
        units: Vec::<Unit>::new(),
        teeth: Some([20, 40]),
        float: true,
        ..ImportOptions::default()
    };
    let figures = match import(&[path], &options) {
        Ok((_, summary)) => summary.measured_tach.into_iter().next().ok_or("no tachometer in the summary")?,
        Err(error) if drawn.too_fast => {
            let helps = REMEDIES[..2].iter().any(|remedy| error.to_string().contains(remedy));
            let without = || format!("an encoder too fast is refused without a way out: {error}");
            return helps.then_some("right").ok_or_else(without);
        }
        Err(error) => {
            let line = error.to_string();
            let helps = REMEDIES.iter().any(|remedy| line.contains(remedy));
            return if helps { Ok("refused") } else { Err(format!("refused without a way out: {line}")) };
        }
    };
    let (first, last) = (drawn.edges_s[0], drawn.edges_s[drawn.edges_s.len() - 1]);
    let mean = (drawn.turning.turns(last) - drawn.turning.turns(first)) / (last - first);
    let off = (figures.shaft_speed_hz.mean / mean - 1.0).abs();
    match (figures.count_is_sure, off <= SPEED) {
        (true, true) => Ok("right"),
        (true, false) => Err(format!("{:.4} turns/s for {mean:.4}", figures.shaft_speed_hz.mean)),
        (false, _) => Ok("unsure"),
    }
}

fn number(name: &str, otherwise: u64) -> u64 {
    std::env::var(name).ok().and_then(|text| text.parse().ok()).unwrap_or(otherwise)
}

#[test]
fn claim_drawn_tachometers_are_counted_right_or_said_to_be_unsure() {
    let (files, seed) = (number("MESHBAND_FILES", 60), number("MESHBAND_SEED", 1));
    let folder = std::env::temp_dir().join(format!("meshband-tachs-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder");
    let mut counts: BTreeMap<&str, u64> = BTreeMap::new();
    let mut wrong = Vec::new();
    for k in 0..files {
        let (drawn, mut random) = drawn(1_000_000 * seed + k);
        let (path, tach, form) = written(&folder, &drawn, &mut random);
        let kind = format!("{}, {form}", drawn.kind);
        match judge(&drawn, path, tach) {
            Ok(verdict) => {
                if verdict != "right" {
                    println!("{verdict} {k}: {kind}, faults {}", drawn.faults);
                }
                *counts.entry(verdict).or_default() += 1;
            }
            Err(what) => wrong.push(format!("{k}: {kind}: {what}")),
        }
    }
    std::fs::remove_dir_all(&folder).expect("removed");
    println!("{files} tachometers: {counts:?}, wrong {}", wrong.len());
    assert!(wrong.is_empty(), "{} of {files} wrong:\n{}", wrong.len(), wrong.join("\n"));
    let right = counts.get("right").copied().unwrap_or(0);
    assert!(right as f64 >= 0.9 * files as f64, "{right} of {files} right: {counts:?}");
}
