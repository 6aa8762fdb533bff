//! `meshband configure` and `monitor` as a user runs them: against the image in QEMU over TCP and over a
//! pseudo-terminal, and against everything that is no node.

use meshband::config::{Configuration, TachEdge};
use meshband::replay::{Header, image_bytes, write};
use meshband_host::law::file::LawFile;
use meshband_host::law::forms::Law;
use meshband_host::machine::{EngagementKind, Machine};
use meshband_host::virtual_node::qemu::{Link, Qemu};
use serde_json::Value;
use std::f64::consts::TAU;
use std::io::{Read, Write};
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

fn meshband(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_meshband")).args(arguments).output().expect("the command starts")
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Exit code 2 and one line on stderr that holds all of `expected`.
fn refused(arguments: &[&str], expected: &[&str]) {
    let output = meshband(arguments);
    let stderr = stderr(&output);
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {stderr}");
    assert_eq!(stderr.lines().count(), 1, "one line for {arguments:?}: {stderr}");
    assert!(stderr.starts_with("meshband: "), "{arguments:?}: {stderr}");
    for part in expected {
        assert!(stderr.contains(part), "{arguments:?} should name `{part}`: {stderr}");
    }
}

/// Runs the command; gives its stdout.
fn accepted(arguments: &[&str]) -> String {
    let output = meshband(arguments);
    assert!(output.status.success(), "{arguments:?}: {}", stderr(&output));
    String::from_utf8_lossy(&output.stdout).into_owned()
}

fn folder(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    // What a former run wrote would be in the way of this one's.
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).expect("a folder for the test");
    folder
}

fn written(folder: &Path, name: &str, text: &str) -> String {
    let path = folder.join(name);
    std::fs::write(&path, text).expect("writable");
    path.display().to_string()
}

fn machine_file() -> String {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/19-48.toml").display().to_string()
}

/// A law of 500 Hz per hertz of speed.
fn law_text(machine_hash: u64) -> String {
    let file = LawFile {
        machine: "19-48".into(),
        machine_hash: format!("{machine_hash:#018x}"),
        ramp: EngagementKind::Loaded,
        measured: None,
        domain_hz: [1.0, 25.0],
        relative_uncertainty: 0.02,
        law: Law::Quadratic { a: 0.0, b: 500.0, c: 0.0 },
    };
    file.to_toml()
}

const SETTINGS: &str = "
policy = \"Spectrum\"
[sensor]
acceleration_per_code = 0.002
[limits]
analogue_stop = 12000.0
highest_adc = 60000
[mesh]
harmonics = 4
[front_end]
tach_edge = \"Falling\"
[[alarms]]
watched = \"Rms\"
from = 5.0
to = 25.0
raise = 1.0
clear = 0.5
persistence = 2
";

#[test]
fn fault_ports_without_a_node_are_refused_in_one_line() {
    refused(&["monitor", "/dev/no-such-port"], &["/dev/no-such-port", "o such"]);
    refused(&["configure", "/dev/no-such-port"], &["/dev/no-such-port"]);
    refused(&["monitor", "tcp:127.0.0.1:1"], &["tcp:127.0.0.1:1", "refused"]);
    refused(&["monitor", "tcp:127.0.0.1:99999"], &["tcp:127.0.0.1:99999"]);
    refused(&["monitor", "tcp:nonsense"], &["tcp:nonsense"]);
    let folder = folder("link-ports");
    refused(&["monitor", &folder.display().to_string()], &["link-ports"]);
    let capture = written(&folder, "capture.bin", "no frame\0 among these\0");
    refused(&["monitor", "--replay", &capture], &["capture.bin", "no intact frame"]);
    refused(&["monitor", "--replay", "absent.bin"], &["absent.bin"]);
    // What a node of the first firmware sent.
    let old = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/vectors/wire/frames-2.bin").display().to_string();
    let known = format!("speaks schema 2 of the link, this program knows {}", meshband::message::WIRE_SCHEMA);
    refused(&["monitor", "--replay", &old], &["frames-2.bin", &known]);
    refused(&["configure", &capture], &["captured"]);
    refused(&["monitor", "/dev/null", "--patience", "0"], &["--patience"]);
}

/// Plays a peer on a TCP port; `answer` gets the connection.
fn peer(answer: impl FnOnce(std::net::TcpStream) + Send + 'static) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a free port");
    let port = listener.local_addr().expect("bound").port();
    std::thread::spawn(move || {
        if let Ok((stream, _)) = listener.accept() {
            answer(stream);
        }
    });
    format!("tcp:127.0.0.1:{port}")
}

#[test]
fn fault_a_silent_a_garbled_and_a_vanishing_node_are_told_apart() {
    let silent = peer(|mut stream| {
        let _ = stream.read_to_end(&mut Vec::new());
    });
    // What another bit rate makes of a stream of frames: bytes without sense.
    let garbled = peer(|mut stream| {
        let mut state = 1_u32;
        let mut bytes = [0; 64];
        loop {
            bytes.fill_with(|| {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                (state >> 24) as u8
            });
            if stream.write_all(&bytes).is_err() {
                return;
            }
            std::thread::sleep(Duration::from_millis(5));
        }
    });
    let vanishing = peer(drop);
    std::thread::scope(|scope| {
        scope.spawn(|| refused(&["configure", &silent], &["node", "silent", "power"]));
        scope.spawn(|| refused(&["monitor", &garbled, "--once"], &["node", "no frame", "bit rate", "921600"]));
        scope.spawn(|| refused(&["monitor", &vanishing], &["node", "ended"]));
    });
}

#[test]
fn fault_bad_files_are_refused_with_table_and_key_before_any_node_is_asked() {
    let folder = folder("link-files");
    // No node listens there: the file's error comes first.
    let port = "tcp:127.0.0.1:1";
    for (name, text, expected) in [
        ("unknown-key", "[tach]\npulses = 3\n", vec!["[tach] pulses", "pulses_per_turn"]),
        ("unknown-table", "[tacho]\npulses = 3\n", vec!["tacho", "tach"]),
        ("not-finite", "[sensor]\nacceleration_per_code = nan\n", vec!["[sensor] acceleration_per_code", "NaN"]),
        ("a-text", "[limits]\nhighest_adc = \"fast\"\n", vec!["[limits] highest_adc", "number"]),
        ("a-fraction", "[tach]\nmissing = 1.5\n", vec!["[tach] missing", "whole"]),
        ("no-toml", "[tach]\nmissing = = 2\n", vec!["line 2"]),
        ("a-law", "[law]\nlowest = 1\n", vec!["law"]),
        ("an-alarm", "[[alarms]]\nwatched = \"Noise\"\n", vec!["[[alarms]] 1", "Noise"]),
        ("a-gain-as-number", "[front_end]\ngain = 4\n", vec!["[front_end] gain", "name"]),
        ("no-such-gain", "[front_end]\ngain = \"X3\"\n", vec!["front_end", "X3"]),
        ("a-policy", "policy = \"Fast\"\n", vec!["policy", "Fast"]),
    ] {
        let path = written(&folder, &format!("{name}.toml"), text);
        let mut expected = expected;
        let file = format!("{name}.toml");
        expected.push(&file);
        refused(&["configure", port, "--settings", &path], &expected);
    }
    let machine = std::fs::read_to_string(machine_file()).expect("our own machine");
    let bad = machine.replace("poisson = 0.3", "poisson = nan");
    let bad = written(&folder, "bad-machine.toml", &bad);
    refused(&["configure", port, "--machine", &bad], &["bad-machine.toml", "[pair]", "poisson"]);
    let law = written(&folder, "law.toml", &law_text(1));
    refused(&["configure", port, "--machine", &machine_file(), "--law", &law], &["law.toml", "another machine"]);
    refused(&["configure", port, "--settings", "absent.toml"], &["absent.toml"]);
    refused(&["configure", port, "--law", &machine_file()], &["19-48.toml"]);
}

/// A minute of mesh harmonics at 15 Hz; the board waits for `configure --start`, and a minute it will then be.
fn image() -> Vec<u8> {
    const RATE_HZ: u32 = 50_000;
    let value = |n: u32| {
        let turns = 15.0 * f64::from(n) / f64::from(RATE_HZ);
        let mesh = TAU * 19.0 * turns;
        let acceleration = (1.0 + 0.2 * (TAU * turns).cos()) * (10.0 * mesh.cos() + 5.0 * (2.0 * mesh).cos());
        (acceleration / 0.002) as i16
    };
    let samples: Vec<i16> = (0..60 * RATE_HZ).map(value).collect();
    let edges: Vec<u32> = (0..899).map(|turn| (f64::from(turn + 1) / 15.0 * 25e6) as u32).collect();
    let header = Header { waits_for_start: true, ..Header::new(25_000_000, 500, 0.002 * 32_767.0) };
    let mut bytes = vec![0; image_bytes(0, edges.len(), samples.len())];
    write(&header, &[], &edges, &samples, &mut bytes).expect("a sound record");
    bytes
}

/// The machine, or `None` after saying why the test is skipped.
fn machine(test: &str) -> Option<Qemu> {
    let machine = Qemu::of_board("an386");
    if machine.is_none() {
        println!("skipped {test}: QEMU or the firmware image is absent (cargo xtask node-build)");
    }
    machine
}

fn json(path: &str) -> Value {
    serde_json::from_str(&std::fs::read_to_string(path).expect("written")).expect("JSON")
}

/// The whole of a user's first session at this port.
fn session(port: &str, folder: &Path) {
    let path = |name: &str| folder.join(name).display().to_string();
    let settings = written(folder, "settings.toml", SETTINGS);
    let hash = Machine::read(Path::new(&machine_file())).expect("our own machine").hash();
    let law = written(folder, "law.toml", &law_text(hash));
    let (held, held_report) = (path("held.json"), path("held.html"));
    let said = accepted(&[
        "configure",
        port,
        "--machine",
        &machine_file(),
        "--law",
        &law,
        "--settings",
        &settings,
        "--pulses",
        "1",
        "--json",
        &held,
        "--report",
        &held_report,
    ]);
    assert!(said.contains("19 x 48 teeth") && said.contains("1 alarms; stored"), "{said}");
    let config: Configuration = serde_json::from_value(json(&held)).expect("a configuration");
    assert_eq!((config.gears.pinion_teeth, config.mesh.harmonics, config.alarms.len()), (19, 4, 1));
    assert_eq!(config.front_end.tach_edge, TachEdge::Falling);
    let report = std::fs::read_to_string(&held_report).expect("written");
    assert!(report.contains("limits.analogue_stop") && report.contains("12000"));

    refused(&["configure", port, "--teeth", "3", "48"], &["gears.pinion_teeth", "12 to 1000"]);
    refused(&["configure", port, "--sensitivity", "nan"], &["sensor.acceleration_per_code"]);
    let said = accepted(&["configure", port, "--volatile", "--start"]);
    assert!(said.contains("19 x 48 teeth") && said.contains("not stored"), "{said}");

    let (seen, seen_report) = (path("seen.json"), path("seen.html"));
    let said = accepted(&["monitor", port, "--once", "--json", &seen, "--report", &seen_report]);
    for part in ["mesh bands", "speed 15.0", "self-test passed"] {
        assert!(said.contains(part), "{part}: {said}");
    }
    let view = &json(&seen)["view"];
    let line = &view["spectrum"]["bands"][0]["line"];
    let (frequency, amplitude) = (line["frequency_hz"].as_f64(), line["amplitude"].as_f64());
    assert!(frequency.is_some_and(|hz| (hz / 285.0 - 1.0).abs() < 5e-4), "{line}");
    assert!(amplitude.is_some_and(|a| (a / 10.0 - 1.0).abs() < 0.06), "{line}");
    let report = std::fs::read_to_string(&seen_report).expect("written");
    assert!(report.contains("<svg") && report.contains("Mesh bands"));
    let said = accepted(&["monitor", port, "--frames", "5"]);
    assert!(said.contains("5 messages"), "{said}");
    interrupted(port, &path("late.json"));
}

/// Ctrl-C ends a live view, which then writes what it has heard, at once or, on a busy machine, on a later try.
fn interrupted(port: &str, late: &str) {
    let heard = [1, 3, 9, 27].into_iter().any(|seconds| {
        let words = ["monitor", port, "--json", late, "--force"];
        let mut child = Command::new(env!("CARGO_BIN_EXE_meshband")).args(words).spawn().expect("the command starts");
        std::thread::sleep(Duration::from_secs(seconds));
        Command::new("kill").args(["-INT", &child.id().to_string()]).status().expect("kill");
        assert_eq!(child.wait().expect("ends").code(), Some(130));
        // Asked before it listened: ended at once, with nothing to write.
        std::path::Path::new(late).exists() && json(late)["view"]["messages"].as_u64().is_some_and(|n| n > 0)
    });
    assert!(heard, "what was heard is kept");
}

#[test]
fn claim_a_node_is_configured_and_watched_over_tcp() {
    let Some(machine) = machine("TCP") else { return };
    let port = TcpListener::bind("127.0.0.1:0").and_then(|l| l.local_addr()).expect("a free port").port();
    let running = Qemu { link: Link::Tcp(port), at_wall_speed: true, ..machine }.start(&image()).expect("QEMU starts");
    // QEMU listens some moments later.
    let (start, address) = (Instant::now(), ("127.0.0.1", port));
    while std::net::TcpStream::connect(address).is_err() && start.elapsed() < Duration::from_secs(20) {
        std::thread::sleep(Duration::from_millis(20));
    }
    session(&format!("tcp:127.0.0.1:{port}"), &folder("link-tcp"));
    drop(running);
}

#[cfg(unix)]
#[test]
fn claim_the_same_over_a_pseudo_terminal() {
    use serialport::{SerialPort, TTYPort};

    // While nobody has the terminal open, reads and writes fail at once.
    fn pause() -> usize {
        std::thread::sleep(Duration::from_millis(2));
        0
    }
    let Some(machine) = machine("pseudo-terminal") else { return };
    let listener = TcpListener::bind("127.0.0.1:0").expect("a free port");
    let link = Link::Connect(listener.local_addr().expect("bound").port());
    let running = Qemu { link, at_wall_speed: true, ..machine }.start(&image()).expect("QEMU starts");
    let (mut node, _) = listener.accept().expect("QEMU connects");
    // Its own hold on the far end would keep the command out.
    let (mut near, far) = TTYPort::pair().expect("a pair");
    let name = far.name().expect("a path");
    drop(far);
    near.set_timeout(Duration::from_millis(20)).expect("settable");
    // Both directions between the board's line and the terminal, until the session is over.
    let over = AtomicBool::new(false);
    let mut to_terminal = near.try_clone_native().expect("a second handle");
    let mut from_node = node.try_clone().expect("a second handle");
    from_node.set_read_timeout(Some(Duration::from_millis(20))).expect("settable");
    std::thread::scope(|scope| {
        scope.spawn(|| {
            let mut buffer = [0; 512];
            while !over.load(Ordering::Relaxed) {
                match from_node.read(&mut buffer) {
                    Ok(0) => return,
                    // A terminal nobody reads takes no more: the line stalls, as a wire would.
                    Ok(count) => {
                        let mut rest = &buffer[..count];
                        while !rest.is_empty() && !over.load(Ordering::Relaxed) {
                            rest = &rest[to_terminal.write(rest).unwrap_or_else(|_| pause())..];
                        }
                    }
                    Err(_) => {}
                }
            }
        });
        scope.spawn(|| {
            let mut buffer = [0; 512];
            while !over.load(Ordering::Relaxed) {
                let count = near.read(&mut buffer).unwrap_or_else(|_| pause());
                if node.write_all(&buffer[..count]).is_err() {
                    return;
                }
            }
        });
        let outcome = std::panic::catch_unwind(|| session(&name, &folder("link-pty")));
        over.store(true, Ordering::Relaxed);
        drop(running);
        if let Err(panic) = outcome {
            std::panic::resume_unwind(panic);
        }
    });
}
