//! What `import`, `analyse` and `check` say of a recording: encoders that fold, wheels with gaps, slip, limits,
//! clocks, edge times.

use crate::common::{accepted, folder, refused, text};
use meshband_host::record::npy;
use serde_json::Value;
use std::f64::consts::TAU;
use std::path::Path;

const RATE_HZ: f64 = 12_800.0;
const SPEED_HZ: f64 = 25.0;

/// Turns of the pinion at a time: half a percent of wander at 0.5 Hz.
fn turns(t: f64) -> f64 {
    SPEED_HZ * t + 0.005 * SPEED_HZ * (1.0 - (0.5 * TAU * t).cos()) / (0.5 * TAU)
}

fn times(seconds: f64) -> impl Iterator<Item = f64> {
    (0..(seconds * RATE_HZ) as usize).map(|n| n as f64 / RATE_HZ)
}

/// A channel of a pair of 20 and 40 teeth: three mesh harmonics with sidebands, and noise.
fn housing(times: impl Iterator<Item = f64>, seed: u64) -> Vec<f64> {
    let mut state = seed;
    times
        .map(|t| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let noise = (state >> 33) as f64 / f64::from(1_u32 << 31) - 0.5;
            let a = turns(t);
            let sway = 1.0 + 0.2 * (TAU * a).cos() + 0.1 * (0.5 * TAU * a).cos();
            let mesh = |h: f64| (TAU * 20.0 * h * a + h).cos() / h;
            4.0 * sway * (mesh(1.0) + mesh(2.0) + mesh(3.0)) + noise
        })
        .collect()
}

/// Volts of a wheel at every turn of the pinion: high over half of each mark that is there.
fn wheel(times: impl Iterator<Item = f64>, marks: usize, missing: &[usize]) -> Vec<f64> {
    let high = |t: f64| {
        let place = turns(t) * marks as f64;
        place.fract() < 0.5 && !missing.contains(&(place as usize % marks))
    };
    times.map(|t| if high(t) { 5.0 } else { 0.0 }).collect()
}

fn array(path: &Path, channels: &[Vec<f64>]) -> String {
    let rows = (0..channels[0].len()).flat_map(|n| channels.iter().map(move |c| c[n] as f32)).collect::<Vec<_>>();
    std::fs::write(path, npy::bytes_f32(&rows, channels.len())).expect("written");
    text(path)
}

/// Imports, and gives the summary and what was printed.
fn imported(folder: &Path, files: &[&str], options: &[&str]) -> (Value, String) {
    let (out, json) = (text(&folder.join("out")), text(&folder.join("out.json")));
    let mut arguments = vec!["import"];
    arguments.extend(files);
    arguments.extend(["-o", &out, "--json", &json, "--force", "--rate", "12800", "--teeth", "20,40"]);
    arguments.extend(options);
    let printed = accepted(&arguments);
    (serde_json::from_slice(&std::fs::read(&json).expect("json")).expect("valid"), printed)
}

fn analysed(folder: &Path) -> String {
    accepted(&["analyse", &text(&folder.join("out"))])
}

#[test]
fn fault_an_encoder_above_the_sampling_rate_is_refused_with_the_rate_that_would_do() {
    let folder = folder("judged-encoder");
    for marks in [500, 1000, 2000] {
        let channels = [housing(times(4.0), 1), housing(times(4.0), 2), wheel(times(4.0), marks, &[])];
        let file = array(&folder.join("q.npy"), &channels);
        let (out, marks) = (text(&folder.join("out")), marks.to_string());
        let arguments = ["import", &file, "-o", &out, "--rate", "12800", "--teeth", "20,40", "--tach", "3"];
        let arguments = [&arguments[..], &["--pulses", &marks]].concat();
        refused(&arguments, &["folded", "more than half of the 12800 Hz", "three samples per pulse"]);
        assert!(!Path::new(&out).exists());
    }
    // 200 marks: 2.6 samples per pulse.
    let channels = [housing(times(4.0), 1), housing(times(4.0), 2), wheel(times(4.0), 200, &[])];
    let file = array(&folder.join("q.npy"), &channels);
    let out = text(&folder.join("out"));
    let arguments = ["import", &file, "-o", &out, "--rate", "12800", "--tach", "3", "--pulses", "200"];
    refused(&arguments, &["a pulse every 2.", "three samples per pulse", "fewer marks"]);
}

#[test]
fn fault_an_encoder_without_teeth_is_taken_with_the_speed_above_which_it_folds() {
    let folder = folder("judged-fold-note");
    let channels = [housing(times(4.0), 1), wheel(times(4.0), 100, &[])];
    let file = array(&folder.join("q.npy"), &channels);
    let out = text(&folder.join("out"));
    let arguments = ["import", &file, "-o", &out, "--rate", "12800", "--no-gears", "--tach", "2", "--pulses", "100"];
    let printed = accepted(&arguments);
    assert!(printed.contains("they fold above 64.00 turns/s"), "{printed}");
}

#[test]
fn theory_wheels_with_missing_marks_are_read_at_eight_samples_per_mark() {
    let folder = folder("judged-gaps");
    let wheels: [(usize, &[usize]); 4] = [(60, &[58, 59]), (60, &[59]), (36, &[0, 12, 13]), (12, &[11])];
    for (marks, missing) in wheels {
        let channels = [housing(times(4.0), 1), wheel(times(4.0), marks, missing)];
        let file = array(&folder.join("q.npy"), &channels);
        let (summary, printed) = imported(&folder, &[&file], &["--tach", "2", "--pulses", &marks.to_string()]);
        let figures = &summary["measured_tach"][0];
        let speed = |key: &str| figures["shaft_speed_hz"][key].as_f64().expect("a speed");
        assert!((speed("mean") / SPEED_HZ - 1.0).abs() < 1e-3, "{marks}: {figures}");
        assert!(speed("least") <= speed("mean") && speed("mean") <= speed("most"), "{marks}: {figures}");
        assert_eq!(figures["missing_marks"].as_array().map(Vec::len), Some(missing.len()), "{marks}: {figures}");
        assert_eq!((&figures["mesh"]["doubtful"], &figures["count_is_sure"]), (&false.into(), &true.into()));
        assert!(printed.contains(&format!("the wheel is a {marks}-{}", missing.len())), "{printed}");
    }
    let out = text(&folder.join("refused"));
    let channels = [housing(times(4.0), 1), wheel(times(4.0), 60, &[58, 59])];
    let file = array(&folder.join("q.npy"), &channels);
    let arguments = ["import", &file, "-o", &out, "--rate", "12800", "--tach", "2", "--pulses", "58"];
    refused(&arguments, &["60-2", "--pulses 60"]);
}

#[test]
fn fault_a_name_plates_speed_beside_the_mesh_is_said_by_import_analyse_and_check() {
    let folder = folder("judged-slip");
    let file = array(&folder.join("x.npy"), &[housing(times(8.0), 1), housing(times(8.0), 2)]);
    let (_, printed) = imported(&folder, &[&file], &["--speed", "1530"]);
    for said in [printed, analysed(&folder), accepted(&["check", &text(&folder.join("out"))])] {
        assert!(said.contains("no mesh line there") && (said.contains("-1.9") || said.contains("-1.6")), "{said}");
        assert!(said.contains("turns at 150"), "{said}");
    }
}

#[test]
fn theory_every_import_can_be_checked() {
    let folder = folder("judged-check");
    let channels = [housing(times(4.0), 1), housing(times(4.0), 2), wheel(times(4.0), 1, &[])];
    let (all, alone) = (array(&folder.join("m.npy"), &channels), array(&folder.join("x.npy"), &channels[..2]));
    for (file, options) in [(&all, ["--tach", "3"]), (&alone, ["--mesh", "500"]), (&alone, ["--speed", "1500"])] {
        imported(&folder, &[file], &options);
        let json = text(&folder.join("check.json"));
        let said = accepted(&["check", &text(&folder.join("out")), "--json", &json, "--force"]);
        assert!(said.contains("not checked: samples and pulses against a declared machine"), "{said}");
        let json: Value = serde_json::from_slice(&std::fs::read(&json).expect("json")).expect("valid");
        assert_eq!(json["recording"].as_array().map(Vec::len), Some(1));
    }
    imported(&folder, &[&alone], &["--no-tach"]);
    let said = accepted(&["check", &text(&folder.join("out"))]);
    assert!(said.contains("the record has no tach"), "{said}");
}

#[test]
fn fault_flat_tops_standstill_and_two_clocks_are_said_by_import_and_analyse() {
    let folder = folder("judged-samples");
    let (sound, tach) = (housing(times(8.0), 1), wheel(times(8.0), 1, &[]));
    let clipped: Vec<f64> = sound.iter().map(|x| x.clamp(-3.0, 3.0)).collect();
    let mut still = sound.clone();
    still[30_000..70_000].fill(1.5);
    let faster = housing(times(8.0).map(|t| t * (1.0 + 2e-4)), 5);
    for (channel, word) in [(clipped, "is clipped at"), (still, "is constant at 1."), (faster, "two clocks")] {
        let file = array(&folder.join("q.npy"), &[sound.clone(), channel, tach.clone()]);
        let (_, printed) = imported(&folder, &[&file], &["--tach", "3"]);
        assert!(printed.contains(word), "{word}: {printed}");
        let said = analysed(&folder);
        assert!(said.contains(word), "{word}: {said}");
    }
    let file = array(&folder.join("q.npy"), &[sound.clone(), housing(times(8.0), 9), tach]);
    let (_, printed) = imported(&folder, &[&file], &["--tach", "3"]);
    assert!(!["clipped", "constant at", "clocks", "repeats"].iter().any(|word| printed.contains(word)), "{printed}");
}

#[test]
fn theory_edge_times_are_read_by_any_name_and_in_any_unit() {
    let folder = folder("judged-edges");
    let file = array(&folder.join("x.npy"), &[housing(times(4.0), 1)]);
    // Where the pinion has turned once more.
    let at = |turn: f64| {
        let (mut low, mut high) = (0.0, 5.0);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if turns(middle) < turn { low = middle } else { high = middle }
        }
        low
    };
    let edges: Vec<f64> = (1..99).map(|turn| at(f64::from(turn))).collect();
    let forms = [("time\n", 1.0), ("", 1.0), ("", 1e3), ("tacho_us\n", 1e6), ("edge;\n", RATE_HZ)];
    for (head, scale) in forms {
        let rows: String = edges.iter().map(|t| format!("{:.7}\n", scale * t)).collect();
        let path = folder.join("edges.csv");
        std::fs::write(&path, format!("{head}{rows}")).expect("written");
        let (summary, _) = imported(&folder, &[&file], &["--tach", &text(&path)]);
        let speed = summary["measured_tach"][0]["shaft_speed_hz"]["mean"].as_f64().expect("a speed");
        assert!((speed / SPEED_HZ - 1.0).abs() < 1e-3, "{head} {scale}: {speed}");
    }
    let out = text(&folder.join("refused"));
    let path = folder.join("ticks.csv");
    std::fs::write(&path, edges.iter().map(|t| format!("{:.0}\n", 84e6 * t)).collect::<String>()).expect("written");
    refused(&["import", &file, "-o", &out, "--rate", "12800", "--tach", &text(&path)], &["ticks.csv", "in ticks"]);
}

/// First sentences of the page of an analysis.
fn letter(folder: &Path) -> String {
    let page = folder.join("page.html");
    accepted(&["analyse", &text(&folder.join("out")), "--report", &text(&page), "--force"]);
    let page = std::fs::read_to_string(page).expect("a page");
    page.split("<h2>").next().expect("a head").to_owned()
}

#[test]
fn regress_a_letter_names_a_pattern_that_outshines_the_mesh_and_what_is_wrong_with_the_recording() {
    let folder = folder("judged-letter");
    // 17 waves about the gear, three times as strong as the mesh.
    let pattern = |t: f64| 12.0 * (TAU * 17.0 * 0.5 * turns(t)).cos();
    let own: Vec<f64> = housing(times(12.0), 1).iter().zip(times(12.0)).map(|(x, t)| x + pattern(t)).collect();
    let tach = wheel(times(12.0), 1, &[]);
    imported(&folder, &[&array(&folder.join("q.npy"), &[own.clone(), tach.clone()])], &["--tach", "2"]);
    let said = letter(&folder);
    assert!(said.contains("17 x the gear") && said.contains("Next, for the gear"), "{said}");
    assert!(!said.contains("recording is at fault") && !said.contains("Nothing is concluded"), "{said}");
    let clipped: Vec<f64> = own.iter().map(|x| x.clamp(-9.0, 9.0)).collect();
    imported(&folder, &[&array(&folder.join("q.npy"), &[clipped, tach.clone()])], &["--tach", "2"]);
    let said = letter(&folder);
    assert!(said.contains("recording is at fault: channel 0") && said.contains("is clipped"), "{said}");
    // 23 teeth are declared where 20 turn.
    let sound = [housing(times(12.0), 1), tach];
    imported(&folder, &[&array(&folder.join("q.npy"), &sound)], &["--tach", "2"]);
    let declared = folder.join("out").join("record.toml");
    let wrong = std::fs::read_to_string(&declared).expect("a record").replace("teeth = [20, 40]", "teeth = [23, 46]");
    std::fs::write(&declared, wrong).expect("written");
    let said = letter(&folder);
    assert!(said.contains("Nothing is concluded") && said.contains("check the tooth counts"), "{said}");
}
