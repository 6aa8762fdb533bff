//! `meshband commission` as a user runs it: what is refused before a node is asked, and the released image in the
//! emulated chip from its first start to a node that watches its machine.

use crate::common::{accepted, altered, folder, machine, refused, text};
use crate::emulated_line::Line;
use meshband::config::Configuration;
use meshband::events::EventKind;
use meshband::message::{Message, Status};
use meshband_host::law::file::LawFile;
use meshband_host::law::forms::Law;
use meshband_host::link::Client;
use meshband_host::machine::{EngagementKind, Machine};
use meshband_host::virtual_node::emulated::run::Emulated;
use serde_json::Value;
use std::f64::consts::TAU;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Teeth of the pinion of machines/19-48.toml.
const TEETH: f64 = 19.0;
/// The shaft: so many hertz, so many more and less, within so many seconds.
const SPEED: (f64, f64, f64) = (20.0, 4.6, 60.0);
/// The board's time for which there are tach edges, s.
const TURNING_S: f64 = 900.0;

/// Turns of the pinion since the start.
fn turns(time_s: f64) -> f64 {
    let (mean, swing, period) = SPEED;
    mean * time_s + swing * period / TAU * (1.0 - (TAU * time_s / period).cos())
}

/// The instants of whole turns.
fn edges() -> Vec<f64> {
    let (mean, swing, _) = SPEED;
    let mut at = 0.3;
    let mut next = turns(at).ceil();
    let mut edges = Vec::new();
    while at < TURNING_S {
        // The speed is never far from what it was: few steps are exact to a nanosecond.
        for _ in 0..60 {
            at += (next - turns(at)) / (mean + swing);
        }
        edges.push(at);
        next += 1.0;
    }
    edges
}

/// Share of the converter's range: mesh harmonics with sidebands, stronger where the machine is faulty.
fn vibration(time_s: f64, is_faulty: bool) -> f64 {
    let turns = turns(time_s);
    let modulation = 1.0 + 0.2 * (TAU * turns).cos();
    let mesh: f64 = (1..=4).map(|h| (TAU * f64::from(h) * TEETH * turns).cos() / f64::from(h)).sum();
    let strength = if is_faulty { 0.09 } else { 0.03 };
    0.5 + strength * modulation * mesh + 0.004 * (TAU * turns).cos()
}

fn law(folder: &Path) -> PathBuf {
    let machine = Machine::read(&machine("19-48.toml")).expect("a machine");
    let file = LawFile {
        machine: machine.title.clone(),
        machine_hash: format!("{:#018x}", machine.hash()),
        ramp: EngagementKind::Loaded,
        measured: None,
        domain_hz: [1.0, 25.0],
        relative_uncertainty: 0.02,
        law: Law::Quadratic { a: 0.0, b: 400.0, c: 0.0 },
    };
    let path = folder.join("law.toml");
    std::fs::write(&path, file.to_toml()).expect("writable");
    path
}

/// Whether an alarm is raised within so many seconds of the board.
fn alarm_within(port: &str, seconds: f64, ticks_per_second: f64) -> bool {
    let mut client = Client::open(port).expect("connects");
    let mut first = None;
    loop {
        match client.next_message(Duration::from_secs(60)).expect("speaks") {
            Some(Message::Event(event)) if event.kind == EventKind::AlarmRaised => return true,
            Some(Message::Status(Status { tick, .. })) => {
                let now_s = tick as f64 / ticks_per_second;
                if now_s - *first.get_or_insert(now_s) > seconds {
                    return false;
                }
            }
            Some(_) => {}
            None => panic!("silent"),
        }
    }
}

#[test]
fn loop_the_command_takes_the_emulated_board_from_wired_to_watching() {
    let Some(emulated) = Emulated::of_board() else {
        println!("skipped: Unicorn or the firmware image is absent (cargo xtask setup, cargo xtask node-build)");
        return;
    };
    let folder = folder("commission-emulated");
    let is_faulty = Arc::new(AtomicBool::new(false));
    let mut board = emulated.power_up(None).expect("powers up");
    let fault = is_faulty.clone();
    board.set_analogue(Arc::new(move |time_s| vibration(time_s, fault.load(Ordering::Relaxed))));
    board.add_tach_edges(&edges());
    let line = Line::open(board, 0);
    let (machine, law, out) = (text(&machine("19-48.toml")), text(&law(&folder)), folder.join("result"));
    let out_text = text(&out);
    let options = ["--speeds", "15.6..24.4", "--values", "8", "--time", "8", "--analogue-stop", "12000"];
    let more = ["--highest-adc", "60000", "--sensitivity", "0.005", "--unattended", "--yes"];
    let mut arguments = vec!["commission", &line.port, "--machine", &machine, "--law", &law, "-o", &out_text];
    arguments.extend(options.iter().chain(&more));
    let told = std::process::Command::new(env!("CARGO_BIN_EXE_meshband")).args(&arguments).output().expect("starts");
    let (stdout, stderr) = (String::from_utf8_lossy(&told.stdout), String::from_utf8_lossy(&told.stderr));
    assert!(told.status.success(), "{stdout}{stderr}");
    println!("{stdout}");
    let json: Value =
        serde_json::from_slice(&std::fs::read(out.join("commissioning.json")).expect("was written")).expect("JSON");
    assert_eq!(
        (&json["schema"], &json["stored"], &json["node"]["board"]),
        (&1.into(), &true.into(), &"stm32f405".into())
    );
    assert_eq!(json["steps"].as_array().map(Vec::len), Some(7));
    assert!(
        json["steps"][1]["outcome"] != "refused"
            && ["levels", "local_levels"]
                .iter()
                .all(|table| json["levels"][table].as_array().is_some_and(|all| all.len() > 1))
    );
    let page = std::fs::read_to_string(out.join("report.html")).expect("was written");
    let page = crate::common::without_tooltips(&page);
    for part in ["watching", "Baseline over speed", "<svg", "first mesh harmonic"] {
        assert!(page.contains(part), "the page lacks {part}");
    }
    assert!(stdout.contains("passed  watching"), "judged by what was learned: {stdout}");
    let mut client = Client::open(&line.port).expect("connects");
    let ticks_per_second = f64::from(client.identify().expect("answers").ticks_per_second);
    let held = client.configuration().expect("answers");
    drop(client);
    let mut written = Configuration { law: held.law, ..Configuration::default() };
    let settings = meshband_host::link::settings::Settings::read(&out.join("node.toml")).expect("reads");
    settings.apply(&mut written).expect("applies");
    assert_eq!(written, held, "what was written is what the node holds");
    // The first new one within a second would be an alarm of the healthy machine.
    assert!(!alarm_within(&line.port, 60.0, ticks_per_second), "a turn of its speeds without an alarm");
    is_faulty.store(true, Ordering::Relaxed);
    assert!(alarm_within(&line.port, 30.0, ticks_per_second), "9.5 dB more are seen");
}

#[test]
fn fault_what_is_asked_for_wrongly_is_refused_before_a_node_is_asked() {
    let folder = folder("commission-refused");
    let (path, out) = (text(&machine("19-48.toml")), folder.join("out"));
    let out_text = text(&out);
    let port = "tcp:127.0.0.1:1";
    let with = |more: &[&str], expected: &[&str]| {
        let mut arguments = vec!["commission", port, "--machine", &path, "-o", &out_text];
        arguments.extend(more);
        refused(&arguments, expected);
        assert!(!out.exists(), "nothing is written");
    };
    with(&[], &["tcp:127.0.0.1:1", "refused"]);
    with(&["--time", "0"], &["--time", "0.1 to 1440"]);
    with(&["--allowance=-1"], &["--allowance", "0 to 40"]);
    with(&["--false-alarms", "0"], &["--false-alarms"]);
    with(&["--values", "3"], &["--values"]);
    with(&["--speeds", "20..10"], &["--speeds", "LOW..HIGH"]);
    with(&["--law", "absent.toml"], &["absent.toml"]);
    refused(&["commission", port, "--machine", "absent.toml", "-o", &out_text], &["absent.toml"]);
    let without = folder.join("without.toml");
    altered(&machine("19-48.toml"), &without, "[nominal]", "[[not_a_table]]");
    refused(&["commission", port, "--machine", &text(&without), "-o", &out_text], &["without.toml"]);
}

#[test]
fn fault_a_folder_with_anything_else_in_it_is_never_replaced() {
    let folder = folder("commission-folder");
    let path = text(&machine("19-48.toml"));
    std::fs::write(folder.join("notes.txt"), "mine").expect("writable");
    let out = text(&folder);
    for force in [&[][..], &["--force"][..]] {
        let mut arguments = vec!["commission", "tcp:127.0.0.1:1", "--machine", &path, "-o", &out];
        arguments.extend(force);
        refused(&arguments, &["notes.txt", "not this command's own"]);
    }
    let help = accepted(&["commission", "--help"]);
    assert!(help.contains("--machine") && help.contains("--unattended"), "{help}");
}
