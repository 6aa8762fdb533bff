//! `meshband import --tach`: pulses of a tachometer that was recorded, against the motion that made them.

use crate::common::{accepted, folder, refused, text};
use meshband_host::record::{Record, npy};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};
use serde_json::Value;
use std::f64::consts::TAU;
use std::path::Path;

pub(crate) const RATE_HZ: f64 = 12_800.0;
const TEETH: [u32; 2] = [23, 61];

/// A pair that turns at a wandering speed, its housing and its tachometer.
pub(crate) struct Rig {
    speed_hz: f64,
    seconds: f64,
    /// Relative swings of the speed: share and frequency.
    wander: Vec<(f64, f64)>,
    /// Growth of the speed per second.
    run_up_hz_per_s: f64,
    /// Turns of the tach's shaft per turn of the pinion.
    ratio: f64,
    /// Turns of the tach's shaft at time 0.
    start: f64,
    /// Places of the marks behind their even places, shares of the pitch.
    places: Vec<f64>,
    /// Length of a tach edge, samples.
    rise: f64,
    /// Standard deviation of the tach's noise, V; levels are 0.2 and 4.8 V.
    noise_v: f64,
    /// Amplitude of a ghost order, 25, with two harmonics.
    ghost: f64,
}

impl Rig {
    pub(crate) fn new() -> Self {
        Self {
            speed_hz: 18.0,
            seconds: 8.0,
            wander: vec![(0.006, 0.21), (0.002, 0.83)],
            run_up_hz_per_s: 0.0,
            ratio: 1.0,
            start: 0.3,
            places: vec![0.0],
            rise: 2.0,
            noise_v: 0.01,
            ghost: 0.0,
        }
    }

    fn gear() -> Self {
        Self { ratio: f64::from(TEETH[0]) / f64::from(TEETH[1]), ..Self::new() }
    }

    /// A wheel of `marks` uneven marks, `percent` of the pitch root mean square.
    fn wheel(marks: usize, percent: f64) -> Self {
        let raw: Vec<f64> = (0..marks).map(|m| (7.3 * (m * m + m) as f64).sin()).collect();
        let mean = raw.iter().sum::<f64>() / marks as f64;
        let rms = (raw.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / marks as f64).sqrt();
        Self { places: raw.iter().map(|x| 0.01 * percent * (x - mean) / rms).collect(), ..Self::new() }
    }

    fn samples(&self) -> usize {
        (self.seconds * RATE_HZ) as usize
    }

    /// Turns of the pinion.
    fn turns(&self, t: f64) -> f64 {
        let swing = |(share, hz): &(f64, f64)| share * self.speed_hz / (TAU * hz) * (1.0 - (TAU * hz * t).cos());
        self.speed_hz * t + 0.5 * self.run_up_hz_per_s * t * t + self.wander.iter().map(swing).sum::<f64>()
    }

    /// Turns of the tach's shaft.
    fn tach_turns(&self, t: f64) -> f64 {
        self.start + self.ratio * self.turns(t)
    }

    /// When the tach's shaft has turned so far.
    fn time_at(&self, tach_turns: f64) -> f64 {
        let (mut low, mut high) = (-1.0, self.seconds + 1.0);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if self.tach_turns(middle) < tach_turns { low = middle } else { high = middle }
        }
        0.5 * (low + high)
    }

    /// Rising edges within the record.
    pub(crate) fn edges_s(&self) -> Vec<f64> {
        let marks = self.places.len();
        let first = (self.start * marks as f64).floor() as usize;
        let place = |k: usize| (k as f64 + self.places[k % marks]) / marks as f64;
        let times = (first..).map(|k| self.time_at(place(k)));
        times.skip_while(|t| *t < 0.0).take_while(|t| *t < self.seconds).collect()
    }

    /// The tachometer's voltage with a pulse behind each edge, high for a quarter of the shortest pitch.
    fn tach_v(&self, edges_s: &[f64]) -> Vec<f64> {
        let pitch = edges_s.windows(2).map(|w| w[1] - w[0]).fold(f64::INFINITY, f64::min);
        let width = 0.25 * pitch.max(0.02 / self.places.len() as f64);
        let ramp = |s: f64| (s * RATE_HZ / self.rise + 0.5).clamp(0.0, 1.0);
        let noise = self.noise(self.noise_v, 1, self.samples());
        let mut last = 0;
        let level = |n: usize| {
            let t = n as f64 / RATE_HZ;
            while last + 1 < edges_s.len() && edges_s[last + 1] < t + self.rise / RATE_HZ {
                last += 1;
            }
            let pulse = |edge: f64| ramp(t - edge) - ramp(t - edge - width);
            pulse(edges_s[last]) + if last > 0 { pulse(edges_s[last - 1]) } else { 0.0 }
        };
        (0..self.samples()).map(level).zip(noise).map(|(pulse, noise)| 0.2 + 4.6 * pulse + noise).collect()
    }

    fn noise(&self, sigma: f64, seed: u64, count: usize) -> Vec<f64> {
        let normal = Normal::new(0.0, sigma).expect("a deviation");
        normal.sample_iter(ChaCha8Rng::seed_from_u64(seed)).take(count).collect()
    }

    /// Two housing channels: three mesh harmonics with sidebands of both shafts.
    fn housing(&self) -> Vec<Vec<f64>> {
        let ghost = |turns: f64| (1..=3).map(|h| (TAU * 25.0 * f64::from(h) * turns).cos()).sum::<f64>();
        let channel = |c: u64| {
            let noise = self.noise(0.3, 10 + c, self.samples());
            let sample = |n: usize| {
                let turns = self.turns(n as f64 / RATE_HZ);
                let gear = turns * f64::from(TEETH[0]) / f64::from(TEETH[1]);
                let sway = 1.0 + 0.3 * (TAU * turns).cos() + 0.2 * (TAU * gear + 1.0).cos();
                let mesh = |h: u32| {
                    let h = f64::from(h);
                    (TAU * h * f64::from(TEETH[0]) * turns + h * h + c as f64).cos() / h
                };
                3.0 * sway * (1..=3).map(mesh).sum::<f64>() + self.ghost * ghost(turns) + noise[n]
            };
            (0..self.samples()).map(sample).collect()
        };
        vec![channel(0), channel(1)]
    }

    /// Housing and tach, in this order.
    pub(crate) fn channels(&self) -> Vec<Vec<f64>> {
        let mut channels = self.housing();
        channels.push(self.tach_v(&self.edges_s()));
        channels
    }
}

fn interleaved(channels: &[Vec<f64>]) -> Vec<f64> {
    (0..channels[0].len()).flat_map(|n| channels.iter().map(move |c| c[n])).collect()
}

fn writer(
    path: &Path,
    channels: usize,
    bits_per_sample: u16,
    sample_format: hound::SampleFormat,
) -> hound::WavWriter<std::io::BufWriter<std::fs::File>> {
    let spec =
        hound::WavSpec { channels: channels as u16, sample_rate: RATE_HZ as u32, bits_per_sample, sample_format };
    hound::WavWriter::create(path, spec).expect("a wav")
}

pub(crate) fn wav(path: &Path, channels: &[Vec<f64>]) -> String {
    let mut writer = writer(path, channels.len(), 32, hound::SampleFormat::Float);
    interleaved(channels).into_iter().for_each(|x| writer.write_sample(x as f32).expect("written"));
    writer.finalize().expect("written");
    text(path)
}

/// Every channel in 16 bits, nine tenths of them used.
fn integer_wav(path: &Path, channels: &[Vec<f64>]) -> String {
    let mut writer = writer(path, channels.len(), 16, hound::SampleFormat::Int);
    let largest = |c: &Vec<f64>| c.iter().fold(f64::MIN_POSITIVE, |m: f64, x| m.max(x.abs()));
    let shares: Vec<Vec<f64>> = channels.iter().map(|c| c.iter().map(|x| x / largest(c)).collect()).collect();
    interleaved(&shares).into_iter().for_each(|x| writer.write_sample((29_490.0 * x) as i16).expect("written"));
    writer.finalize().expect("written");
    text(path)
}

pub(crate) fn csv(path: &Path, names: &[&str], channels: &[Vec<f64>]) -> String {
    let mut rows = format!("time_s,{}\n", names.join(","));
    for n in 0..channels[0].len() {
        let cells: Vec<String> = channels.iter().map(|c| format!("{:.5}", c[n])).collect();
        rows.push_str(&format!("{:.9},{}\n", n as f64 / RATE_HZ, cells.join(",")));
    }
    std::fs::write(path, rows).expect("written");
    text(path)
}

/// A MAT-file of f64 column vectors.
fn mat(path: &Path, variables: &[(&str, &[f64])]) -> String {
    let element = |kind: u32, data: &[u8]| {
        let mut out = [kind.to_le_bytes(), (data.len() as u32).to_le_bytes()].concat();
        out.extend(data);
        out.resize(out.len().next_multiple_of(8), 0);
        out
    };
    let mut bytes = b"MATLAB 5.0 MAT-file, made for a test".to_vec();
    bytes.resize(124, b' ');
    bytes.extend([0, 1, b'I', b'M']);
    for (name, values) in variables {
        let data: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        let dimensions = [(values.len() as u32).to_le_bytes(), 1_u32.to_le_bytes()].concat();
        let body = [
            element(6, &[6_u32.to_le_bytes(), [0; 4]].concat()),
            element(5, &dimensions),
            element(1, name.as_bytes()),
            element(9, &data),
        ];
        bytes.extend(element(14, &body.concat()));
    }
    std::fs::write(path, bytes).expect("written");
    text(path)
}

pub(crate) fn edges_file(path: &Path, edges_s: &[f64]) -> String {
    let rows: String = edges_s.iter().map(|t| format!("{t:.9}\n")).collect();
    std::fs::write(path, format!("edge_time_s\n{rows}")).expect("written");
    text(path)
}

/// Imports and gives summary, record and what was printed.
pub(crate) fn imported(folder: &Path, files: &[&str], options: &[&str]) -> (Value, Record, String) {
    let (out, json) = (text(&folder.join("out")), text(&folder.join("out.json")));
    let mut arguments = vec!["import"];
    arguments.extend(files);
    arguments.extend(["-o", &out, "--json", &json, "--force"]);
    arguments.extend(options);
    let printed = accepted(&arguments);
    let summary = serde_json::from_slice(&std::fs::read(&json).expect("json")).expect("valid");
    (summary, Record::read(&folder.join("out")).expect("a record"), printed)
}

pub(crate) fn refused_import(folder: &Path, file: &str, options: &[&str], expected: &[&str]) {
    let out = text(&folder.join("refused"));
    let mut arguments = vec!["import", file, "-o", &out];
    arguments.extend(options);
    refused(&arguments, expected);
    assert!(!Path::new(&out).exists(), "a refused import leaves nothing behind");
}

/// Worst error of the record's angle, in turns of the tach's shaft, against the motion, and that of its mean speed,
/// as a share.
fn errors(rig: &Rig, record: &Record, run: usize) -> (f64, f64) {
    let (run, tach) = (&record.runs[run], record.declaration.tach.as_ref().expect("a tach"));
    let away: Vec<f64> = run
        .edges_s
        .iter()
        .enumerate()
        .map(|(k, t)| rig.tach_turns(*t) - run.edge_turns(k, tach.pulses_per_rev))
        .collect();
    let (least, most) = away.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(*x), b.max(*x)));
    let (first, last) = (run.edges_s[0], run.edges_s[run.edges_s.len() - 1]);
    let speed = (rig.tach_turns(last) - rig.tach_turns(first)) / (last - first);
    (most - least, run.mean_speed_hz(tach.pulses_per_rev).expect("a speed") / speed - 1.0)
}

fn near_truth(rig: &Rig, record: &Record, run: usize) {
    let (angle, speed) = errors(rig, record, run);
    assert!(angle < 0.01, "angle error {angle} turns");
    assert!(speed.abs() < 2e-4, "speed error {speed}");
}

fn count(summary: &Value, kind: &str) -> u64 {
    let places = summary["measured_tach"][0][kind].as_array().expect("places");
    places.iter().map(|place| place["pulses"].as_u64().expect("a count")).sum()
}

#[test]
fn theory_rising_and_falling_edges_of_a_wav_channel_follow_the_shaft() {
    let (folder, rig) = (folder("tach-wav"), Rig::new());
    let file = wav(&folder.join("run00.wav"), &rig.channels());
    for (edge, tach) in [("rising", "3"), ("falling", "run00 2")] {
        let (summary, record, printed) =
            imported(&folder, &[&file], &["--tach", tach, "--edge", edge, "--teeth", "23,61"]);
        near_truth(&rig, &record, 0);
        // The pulse is high for a quarter of the shortest turn.
        let truth = rig.edges_s();
        let shortest = truth.windows(2).map(|w| w[1] - w[0]).fold(f64::INFINITY, f64::min);
        let behind = if edge == "falling" { 0.25 * shortest } else { 0.0 };
        assert!((record.runs[0].edges_s[5] - truth[5] - behind).abs() < 5e-6, "{edge}");
        let declared = record.declaration.tach.as_ref().expect("a tach");
        assert_eq!((declared.shaft.as_str(), declared.pulses_per_rev), ("pinion", 1));
        assert_eq!((declared.source.as_deref(), declared.is_virtual()), (Some("measured"), false));
        assert_eq!(record.declaration.acquisition.channels, ["run00 0", "run00 1"]);
        let figures = &summary["measured_tach"][0];
        let threshold = figures["levels"]["threshold"].as_f64().expect("a level");
        assert!((threshold - 2.5).abs() < 0.01, "{threshold}");
        // 10 mV of noise on 4.6 V in 2 samples is 0.4 us; the wander is smooth.
        let jitter = declared.jitter_s.expect("a jitter");
        assert!((2e-7..5e-6).contains(&jitter), "{jitter}");
        assert!(figures["mesh"]["doubtful"] == false, "{figures}");
        assert!((figures["mesh"]["found_over_implied"].as_f64().expect("found") - 1.0).abs() < 1e-3, "{figures}");
        assert!(printed.contains("measured tach, channel 3 'run00 2': 1 pulse per turn of the pinion"), "{printed}");
    }
    let report = text(&folder.join("report.html"));
    imported(&folder, &[&file], &["--tach", "3", "--report", &report]);
    let html = std::fs::read_to_string(&report).expect("a report");
    assert!(html.contains("Speed of the tachometer") && html.contains("<svg"), "a picture of the speed");
}

#[test]
fn theory_a_table_of_full_scales_may_have_a_row_for_the_tachometer() {
    let (folder, rig) = (folder("tach-full-scale"), Rig::new());
    let file = integer_wav(&folder.join("run00.wav"), &rig.channels());
    let table = folder.join("full-scale.csv");
    std::fs::write(&table, "channel,unit,full_scale\n1,m/s2,64\n2,m/s2,32\n3,V,5\n").expect("written");
    let options = |scales: &'static str| ["--tach", "3", "--teeth", "23,61", "--source-full-scale", scales];
    let two = imported(&folder, &[&file], &options("64,32")).1;
    let table = text(&table);
    let all = imported(&folder, &[&file], &["--tach", "3", "--teeth", "23,61", "--source-full-scale", &table]).1;
    assert_eq!(all.runs[0].edges_s, two.runs[0].edges_s);
    assert_eq!((all.runs[0].codes(), all.runs[0].step()), (two.runs[0].codes(), two.runs[0].step()));
    assert_eq!(all.runs[0].channels(), 2);
    refused_import(&folder, &file, &options("64,32,5,5"), &["--source-full-scale", "4 values for 2 channels"]);
}

#[test]
fn theory_slow_edges_in_noise_count_once() {
    let folder = folder("tach-noise");
    let rig = Rig { noise_v: 0.35, rise: 12.0, ..Rig::new() };
    let mut channels = rig.channels();
    channels.rotate_right(1);
    let file = csv(&folder.join("run.csv"), &["tacho", "a1", "a2"], &channels);
    let (summary, record, _) = imported(&folder, &[&file], &["--tach", "tacho", "--teeth", "23,61"]);
    near_truth(&rig, &record, 0);
    assert_eq!(record.runs[0].edges_s.len(), rig.edges_s().len());
    assert_eq!((count(&summary, "lost"), count(&summary, "doubled"), count(&summary, "irregular")), (0, 0, 0));
    assert_eq!(record.declaration.acquisition.channels, ["a1", "a2"]);
    // A threshold elsewhere moves all edges alike.
    let (summary, record, _) = imported(&folder, &[&file], &["--tach", "1", "--threshold", "1.5"]);
    assert_eq!(summary["measured_tach"][0]["levels"]["threshold"], 1.5);
    near_truth(&rig, &record, 0);
}

#[test]
fn theory_a_tach_on_the_gear_gives_the_pinions_speed() {
    let (folder, rig) = (folder("tach-gear"), Rig::gear());
    let channels = rig.channels();
    let variables: [(&str, &[f64]); 4] =
        [("acc1", &channels[0]), ("acc2", &channels[1]), ("tacho", &channels[2]), ("fs", &[RATE_HZ])];
    let file = mat(&folder.join("run00.mat"), &variables);
    let options = ["--tach", "tacho", "--teeth", "23,61", "--unit", "g,m/s2", "--tach-shaft"];
    for (shaft, name) in [("gear", "gear"), ("23/61", "gear"), ("0.377", "other")] {
        let (summary, record, _) = imported(&folder, &[&file], &[&options[..], &[shaft]].concat());
        near_truth(&rig, &record, 0);
        let declared = record.declaration.tach.as_ref().expect("a tach");
        assert_eq!((declared.shaft.as_str(), declared.turns_per_pinion_turn.is_some()), (name, name == "other"));
        let pinion = summary["measured_tach"][0]["pinion_speed_hz"]["mean"].as_f64().expect("a speed");
        let edges = rig.edges_s();
        let (first, last) = (edges[0], edges[edges.len() - 1]);
        let truth = (rig.turns(last) - rig.turns(first)) / (last - first);
        let tolerance = if name == "gear" { 2e-4 } else { 3e-4 };
        assert!((pinion / truth - 1.0).abs() < tolerance, "{shaft}: {pinion} for {truth}");
        assert_eq!(summary["sample_rate_hz"], RATE_HZ);
        // The first channel is in g, the second in m/s2.
        let peak = |c: usize| record.runs[0].signal_m_s2(c).into_iter().fold(0.0, f64::max);
        assert!((peak(0) / peak(1) - 9.8).abs() < 1.5, "{} and {}", peak(0), peak(1));
        assert_eq!(summary["measured_tach"][0]["mesh"]["doubtful"], false, "{summary}");
    }
    // Where angle 0 lies against the teeth is not known: who needs it says so.
    refused(&["loop", &text(&folder.join("out")), "--level", "dynamic"], &["tach.source", "angle 0"]);
    let against = ["--tach", "tacho", "--rate", "25600"];
    refused_import(&folder, &file, &against, &["run00.mat", "states 12800 Hz", "--override-rate"]);
}

#[test]
fn theory_an_uneven_wheel_of_sixty_comes_out_even() {
    let folder = folder("tach-wheel");
    let rig = Rig { wander: vec![(0.008, 0.4), (0.003, 1.7), (0.001, 5.3)], ..Rig::wheel(60, 0.2) };
    let path = folder.join("run.npy");
    std::fs::write(
        &path,
        npy::bytes_f32(&interleaved(&rig.channels()).iter().map(|x| *x as f32).collect::<Vec<_>>(), 3),
    )
    .expect("written");
    let options = ["--tach", "3", "--pulses", "60", "--rate", "12800", "--teeth", "23,61"];
    let report = text(&folder.join("wheel.html"));
    let (summary, record, printed) =
        imported(&folder, &[&text(&path)], &[&options[..], &["--report", &report]].concat());
    near_truth(&rig, &record, 0);
    let wheel = &summary["measured_tach"][0]["wheel"];
    let figure = |key: &str| wheel[key].as_f64().expect("a figure");
    assert!((figure("irregularity_percent") - 0.2).abs() < 0.02, "{wheel}");
    assert!(figure("remaining_percent") < 0.03 && wheel["removed"] == true, "{wheel}");
    assert!(printed.contains("uneven by 0.") && printed.contains("taken out"), "{printed}");
    assert!(std::fs::read_to_string(&report).expect("a report").contains("Places of the wheel"));
    // The places that the edges written still have, against the motion: mean of each mark over the turns.
    let edges = &record.runs[0].edges_s;
    let away: Vec<f64> = edges.iter().enumerate().map(|(k, t)| 60.0 * rig.tach_turns(*t) - k as f64).collect();
    let marks: Vec<f64> = (0..60)
        .map(|m| {
            let of_mark: Vec<f64> = away.iter().skip(m).step_by(60).copied().collect();
            of_mark.iter().sum::<f64>() / of_mark.len() as f64
        })
        .collect();
    let mean = marks.iter().sum::<f64>() / 60.0;
    let rms = (marks.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / 60.0).sqrt();
    assert!(rms < 3e-4, "{rms} of the pitch remains");
    // The places learned, against the wheel: what is said to remain is their error.
    let first = (60.0 * rig.tach_turns(edges[0])).round() as usize;
    let learned: Vec<f64> = wheel["places"].as_array().expect("places").iter().filter_map(Value::as_f64).collect();
    let wrong = (0..60).map(|m| (learned[m] - rig.places[(first + m) % 60]).powi(2)).sum::<f64>();
    let wrong = (wrong / 60.0).sqrt();
    assert!(wrong < 3e-4, "{wrong} of the pitch");
    assert!((0.5..2.0).contains(&(figure("remaining_percent") / 100.0 / wrong)), "what is said of {wrong}: {wheel}");
}

#[test]
fn theory_a_cheap_wheel_is_in_step_all_the_same() {
    let (folder, rig) = (folder("tach-cheap"), Rig::wheel(60, 2.0));
    let file = wav(&folder.join("run.wav"), &rig.channels());
    let (summary, record, _) = imported(&folder, &[&file], &["--tach", "3", "--pulses", "60"]);
    near_truth(&rig, &record, 0);
    assert_eq!((count(&summary, "lost"), count(&summary, "doubled"), count(&summary, "irregular")), (0, 0, 0));
    let wheel = &summary["measured_tach"][0]["wheel"];
    assert!((wheel["irregularity_percent"].as_f64().expect("a figure") - 2.0).abs() < 0.05, "{wheel}");
}

#[test]
fn theory_the_marks_of_a_wheel_tell_where_each_run_begins() {
    let folder = folder("tach-runs");
    let rigs = [Rig::wheel(12, 1.0), Rig { start: 0.3 + 5.0 / 12.0, speed_hz: 24.0, ..Rig::wheel(12, 1.0) }];
    let files: Vec<String> =
        rigs.iter().enumerate().map(|(i, rig)| wav(&folder.join(format!("run{i}.wav")), &rig.channels())).collect();
    let options = ["--runs", "--tach", "3", "--pulses", "12"];
    let (summary, record, _) = imported(&folder, &[&files[0], &files[1]], &options);
    (0..2).for_each(|i| near_truth(&rigs[i], &record, i));
    let indices: Vec<u32> = record.runs.iter().map(|run| run.declaration.first_pulse_index).collect();
    assert_eq!(indices, [0, 5], "{}", summary["measured_tach"][1]);
}

#[test]
fn theory_lost_and_doubled_pulses_are_said_and_repaired() {
    let (folder, rig) = (folder("tach-lost"), Rig::new());
    let truth = rig.edges_s();
    let mut edges = truth.clone();
    edges.remove(120);
    edges.drain(80..82);
    edges.insert(41, truth[40] + 0.017);
    let mut channels = rig.housing();
    channels.push(rig.tach_v(&edges));
    let file = wav(&folder.join("run.wav"), &channels);
    let (summary, record, printed) = imported(&folder, &[&file], &["--tach", "3"]);
    assert_eq!((count(&summary, "lost"), count(&summary, "doubled"), count(&summary, "irregular")), (3, 1, 0));
    assert_eq!(record.runs[0].edges_s.len(), truth.len());
    near_truth(&rig, &record, 0);
    let place = format!("3 pulses lost, put in (after 2 at {:.3} s, {:.3} s)", truth[79], truth[119]);
    assert!(printed.contains(&place), "{place}: {printed}");
    assert!(printed.contains(&format!("1 pulse doubled, taken out (after {:.3} s)", truth[40])), "{printed}");
    let checked = accepted(&["check", &text(&folder.join("out"))]);
    assert!(checked.contains("pulses at import: 3 lost and put in, 1 doubled and taken out"), "{checked}");
}

#[test]
fn regress_edges_of_one_samples_width_have_a_samples_jitter() {
    let (folder, rig) = (folder("tach-sharp"), Rig::new());
    let mut channels = rig.housing();
    channels.push(rig.tach_v(&rig.edges_s()).iter().map(|v| if *v > 2.5 { 5.0 } else { 0.0 }).collect());
    let file = wav(&folder.join("run.wav"), &channels);
    let (summary, _, _) = imported(&folder, &[&file], &["--tach", "3"]);
    let jitter = summary["measured_tach"][0]["jitter_s"].as_f64().expect("a jitter");
    // Uniform over a sample: 0.289 of it.
    assert!((0.15..0.6).contains(&(jitter * RATE_HZ)), "{jitter} s at {RATE_HZ} Hz");
}

#[test]
fn theory_a_channel_of_few_steps_is_said_by_import_and_by_check() {
    let (folder, rig) = (folder("few-steps"), Rig::new());
    let mut channels = rig.channels();
    let peak = channels[0].iter().fold(0.0, |a: f64, x| a.max(x.abs()));
    channels[1] = channels[1].iter().map(|x| (x / peak * 8.0).round() * peak / 8.0).collect();
    let file = wav(&folder.join("run.wav"), &channels);
    let (_, _, printed) = imported(&folder, &[&file], &["--tach", "3"]);
    let checked = accepted(&["check", &text(&folder.join("out"))]);
    for said in [printed, checked] {
        assert!(said.contains("steps of the file's own numbers"), "{said}");
    }
}

#[test]
fn theory_a_step_that_cannot_be_explained_is_left_and_said() {
    let (folder, rig) = (folder("tach-step"), Rig::new());
    let file = wav(&folder.join("run.wav"), &rig.housing());
    let truth = rig.edges_s();
    let stepped: Vec<f64> = truth.iter().enumerate().map(|(i, t)| if i < 70 { *t } else { t + 0.02 }).collect();
    let edges = edges_file(&folder.join("tach.csv"), &stepped);
    let (summary, record, printed) = imported(&folder, &[&file], &["--tach", &edges]);
    assert_eq!((count(&summary, "lost"), count(&summary, "doubled")), (0, 0));
    assert!(count(&summary, "irregular") >= 1 && printed.contains("out of step, left as measured"), "{printed}");
    let kept = record.runs[0].edges_s.iter().zip(&stepped).all(|(a, b)| (a - b).abs() < 1e-8);
    assert!(kept && record.runs[0].edges_s.len() == stepped.len());
}

#[test]
fn theory_edges_and_recordings_of_their_own_serve_runs() {
    let folder = folder("tach-files");
    let rigs = [Rig::new(), Rig { speed_hz: 25.0, run_up_hz_per_s: 1.2, ..Rig::new() }];
    let files: Vec<String> =
        rigs.iter().enumerate().map(|(i, rig)| wav(&folder.join(format!("run{i}.wav")), &rig.housing())).collect();
    let edges = edges_file(&folder.join("e0.csv"), &rigs[0].edges_s());
    let tach = wav(&folder.join("tach1.wav"), &[rigs[1].tach_v(&rigs[1].edges_s())]);
    let both = format!("{edges},{tach}");
    let (summary, record, _) =
        imported(&folder, &[&files[0], &files[1]], &["--runs", "--tach", &both, "--teeth", "23,61"]);
    (0..2).for_each(|i| near_truth(&rigs[i], &record, i));
    assert_eq!(record.declaration.acquisition.channels.len(), 2);
    let most = summary["measured_tach"][1]["shaft_speed_hz"]["most"].as_f64().expect("a speed");
    assert!((most - 34.4).abs() < 0.4, "{most}");
    // A run-up smears the mesh line in time, not in angle.
    assert_eq!(summary["measured_tach"][1]["mesh"]["doubtful"], false, "{summary}");
    let three = format!("{both},{tach}");
    let out = text(&folder.join("refused"));
    let arguments = |tach: &'static str| {
        ["import", files[0].as_str(), files[1].as_str(), "-o", out.as_str(), "--runs", "--tach", tach]
    };
    let mut several = arguments("");
    several[7] = &three;
    refused(&several, &["--tach", "names 3 files for 2 run(s)"]);
    several[7] = &edges;
    refused(&several, &["--tach", "one file for 2 runs"]);
    refused_import(
        &folder,
        &files[0],
        &["--tach", &edges, "--threshold", "1"],
        &["e0.csv", "--threshold are for signals"],
    );
    refused_import(&folder, &files[0], &["--tach", &files[1]], &["run1.wav", "holds 2 channels"]);
    let short = wav(&folder.join("short.wav"), &[vec![0.0; 999]]);
    refused_import(&folder, &files[0], &["--tach", &short], &["short.wav", "0.078 s long"]);
    // The tach's file is an input: it is not written over.
    refused(&["import", &files[0], "-o", &out, "--tach", &edges, "--json", &edges, "--force"], &["e0.csv"]);
}

#[test]
fn hostile_sources_that_are_no_tachometer_are_refused() {
    let (folder, rig) = (folder("tach-refused"), Rig::new());
    let housing = rig.housing();
    let flat = vec![0.25; rig.samples()];
    let names = ["a1", "a2", "flat", "tacho"];
    let mut channels = housing.clone();
    channels.extend([flat, rig.tach_v(&rig.edges_s())]);
    let file = csv(&folder.join("run.csv"), &names, &channels);
    let list = "1 'a1', 2 'a2', 3 'flat', 4 'tacho'";
    refused_import(&folder, &file, &["--tach", "tach"], &["--tach", "'tach' is neither a channel of run.csv", list]);
    refused_import(&folder, &file, &["--tach", "5"], &["--tach", list]);
    refused_import(&folder, &file, &["--tach", "0"], &["--tach", list]);
    refused_import(&folder, &file, &["--tach", "flat"], &["run.csv", "channel flat is no tachometer", "constant"]);
    refused_import(&folder, &file, &["--tach", "a1"], &["run.csv", "channel a1 is no tachometer", "--threshold"]);
    refused_import(&folder, &file, &["--tach", "4", "--threshold", "9"], &["channel tacho", "never crosses 9"]);
    refused_import(&folder, &file, &["--tach", "4", "--pulses", "0"], &["--pulses"]);
    refused_import(&folder, &file, &["--tach", "4", "--tach-shaft", "third"], &["--tach-shaft", "'third'"]);
    refused_import(&folder, &file, &["--tach", "4", "--tach-shaft", "1/0"], &["--tach-shaft", "'1/0'"]);
    refused_import(&folder, &file, &["--tach", "4", "--unit", "g,g"], &["--unit", "2 values for 3 channels"]);
    refused_import(&folder, &file, &["--tach", "4", "--no-tach"], &["--tach"]);
    refused_import(&folder, &file, &["--pulses", "2"], &["--tach"]);
    let alone = wav(&folder.join("alone.wav"), &channels[3..]);
    refused_import(&folder, &alone, &["--tach", "1"], &["--tach", "only one", "no acceleration"]);
    let twice = [file.as_str(), file.as_str()];
    let out = text(&folder.join("refused"));
    refused(&["import", twice[0], twice[1], "-o", &out, "--tach", "tacho"], &["--tach", "names several channels"]);
    // Without --tach the channel is an acceleration as before, and the hint says so.
    let (summary, record, _) = imported(&folder, &[&file], &["--no-tach"]);
    assert_eq!(record.declaration.acquisition.channels.len(), 4);
    assert!(summary["remarks"].to_string().contains("--tach 4 makes it one"), "{summary}");
    assert!(!summary["remarks"].to_string().contains("--tach 1"), "{summary}");
}

#[test]
fn hostile_pulses_shorter_than_a_sampling_interval_are_said_to_be() {
    let folder = folder("tach-short");
    let rig = Rig { speed_hz: 20.0, run_up_hz_per_s: 8.0, rise: 0.1, ..Rig::wheel(60, 0.3) };
    let mut channels = rig.housing();
    channels.push(rig.tach_v(&rig.edges_s()));
    let file = wav(&folder.join("short.wav"), &channels);
    let options = ["--tach", "3", "--pulses", "60", "--threshold", "2.5"];
    refused_import(
        &folder,
        &file,
        &options,
        &["cannot be followed", "samples", "three samples per pulse", "use fewer marks"],
    );
}

#[test]
fn theory_measured_and_virtual_tach_agree() {
    let folder = folder("tach-virtual");
    let rig = Rig { wander: vec![(0.001, 0.3)], seconds: 15.0, ..Rig::new() };
    let file = wav(&folder.join("run.wav"), &rig.channels());
    let (_, record, _) = imported(&folder, &[&file], &["--tach", "3", "--teeth", "23,61"]);
    near_truth(&rig, &record, 0);
    let housing = wav(&folder.join("housing.wav"), &rig.housing());
    let (_, other, _) = imported(&folder, &[&housing], &["--teeth", "23,61", "--mesh", "414"]);
    let (angle, speed) = errors(&rig, &other, 0);
    assert!(angle < 0.01, "the virtual tach's angle is off by {angle} turns");
    let measured = errors(&rig, &record, 0).1;
    assert!((speed - measured).abs() < 2e-4, "{speed} and {measured}");
}

#[test]
fn theory_wrong_pulses_shaft_or_teeth_are_said_and_not_refused() {
    let (folder, rig) = (folder("tach-wrong"), Rig::wheel(8, 0.1));
    let file = wav(&folder.join("run.wav"), &rig.channels());
    let said = |options: &[&str]| {
        let (summary, _, printed) = imported(&folder, &[&file], &[&["--tach", "3"], options].concat());
        let mesh = summary["measured_tach"][0]["mesh"].clone();
        let sentence = mesh["sentence"].as_str().expect("a sentence").to_string();
        assert!(printed.contains(&sentence), "{printed}");
        (mesh["doubtful"] == true, sentence)
    };
    let (doubtful, sentence) = said(&["--pulses", "8", "--teeth", "23,61"]);
    assert!(!doubtful, "{sentence}");
    let (doubtful, sentence) = said(&["--pulses", "4", "--teeth", "23,61"]);
    assert!(doubtful && sentence.contains("8 pulses per turn of the pinion"), "{sentence}");
    let (doubtful, sentence) = said(&["--pulses", "8", "--teeth", "23,61", "--tach-shaft", "gear"]);
    assert!(doubtful && sentence.contains("per turn of the pinion"), "{sentence}");
    // One tooth more: the true mesh line is a sideband of what is declared.
    for teeth in ["29,61", "24,61", "22,61"] {
        let (doubtful, sentence) = said(&["--pulses", "8", "--teeth", teeth]);
        assert!(doubtful && sentence.contains("23 teeth of the pinion"), "{teeth}: {sentence}");
    }
}

#[test]
fn theory_a_ghost_order_does_not_put_the_teeth_in_doubt() {
    let (folder, rig) = (folder("tach-ghost"), Rig { ghost: 6.0, ..Rig::new() });
    let file = wav(&folder.join("run.wav"), &rig.channels());
    let (summary, _, _) = imported(&folder, &[&file], &["--tach", "3", "--teeth", "23,61"]);
    assert_eq!(summary["measured_tach"][0]["mesh"]["doubtful"], false, "{}", summary["measured_tach"][0]["mesh"]);
}
