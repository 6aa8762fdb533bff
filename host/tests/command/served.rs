//! The served node: its loop has no seam, all viewers hear the same, an alarm that stands is shown to whoever comes,
//! and a machine of one speed is commissioned on it.

use crate::common::{accepted, folder, text};
use crate::in_process::{Direct, signal};
use meshband::alarm::Watched;
use meshband::frame::Packet;
use meshband::message::Message;
use meshband_host::commissioning::ear::Operator;
use meshband_host::commissioning::{Plan, commission, report, run_up};
use meshband_host::link::Client;
use meshband_host::link::setup::{Installation, Sources};
use meshband_host::machine::Machine;
use meshband_host::virtual_node::looped::{Channel, Loop};
use meshband_host::virtual_node::serve::Looped;
use meshband_host::virtual_node::setup::configuration;
use serde_json::Value;
use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// How long anything may take that is waited for; machines are busy.
const PATIENCE: Duration = Duration::from_secs(90);

/// A served node of the command; gives its port.
struct Node(Child, u16);

impl Node {
    fn start(machine: &str, more: &[&str]) -> Self {
        let mut child = Command::new(env!("CARGO_BIN_EXE_meshband"))
            .args(["node", "--serve", "tcp:127.0.0.1:0", "--loop"])
            .arg(crate::common::machine(machine))
            .args(more)
            .stdout(Stdio::piped())
            .spawn()
            .expect("the command starts");
        let mut line = String::new();
        BufReader::new(child.stdout.take().expect("piped")).read_line(&mut line).expect("a line");
        let port = line.split("tcp:127.0.0.1:").nth(1).and_then(|rest| rest.split(',').next()?.parse().ok());
        Self(child, port.unwrap_or_else(|| panic!("no port in '{line}'")))
    }

    fn port(&self) -> String {
        format!("tcp:127.0.0.1:{}", self.1)
    }
}

impl Drop for Node {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn regress_a_long_loop_is_never_silent_and_its_angles_go_on() {
    // 20 s: more than the memory of a board holds.
    let signal = signal(20.0, 20.0, 0.0);
    let config = configuration(&signal, Some(25_600.0)).expect("a configuration");
    let mut node = Looped::new(&signal, &config).expect("loops");
    let seconds = node.repeated().seconds();
    assert!(seconds > 15.0 && node.repeated().jump_deg() == 0.0, "{seconds} s");
    let (mut levels, mut restless) = (Vec::new(), 0);
    while node.block_end_s() < 2.2 * seconds {
        for packet in node.block() {
            match packet {
                Packet::Message(Message::Indicators(values)) => levels.push(values.rms),
                Packet::Message(Message::Event(event)) => {
                    use meshband::events::EventKind::{SignalBad, Stuck, TachDoubtful, TachStalled};
                    restless += u32::from(matches!(event.kind, SignalBad | Stuck | TachDoubtful | TachStalled));
                }
                _ => {}
            }
        }
    }
    let (low, high) = levels.iter().skip(1).fold((f32::MAX, 0.0f32), |(l, h), &x| (l.min(x), h.max(x)));
    assert!(levels.len() > 30 && high / low < 1.02, "RMS {low} to {high} in {} records", levels.len());
    assert_eq!(restless, 0, "neither the signal nor the tach ever stopped");
}

#[test]
fn theory_the_seam_keeps_edges_even_samples_smooth_and_both_shafts_in_phase() {
    let signal = signal(7.0, 20.0, 0.0);
    let repeated = Loop::new(&signal).expect("loops");
    assert_eq!(repeated.jump_deg(), 0.0, "38 turns of 20 Hz are 1.9 s");
    let count = (0..).take_while(|&n| (repeated.edge_tick(n) as f64) < repeated.seconds() * 25e6).count() as u64;
    for n in count - 3..count + 3 {
        let between = (repeated.edge_tick(n + 1) - repeated.edge_tick(n)) as f64 / 25e6;
        assert!((between * 20.0 - 1.0).abs() < 1e-6, "edge {n}: {between} s");
    }
    let channel = Channel::new(&signal.samples, "test").expect("a signal");
    let seam = (repeated.seconds() * 25e6) as u64;
    let value = |tick: u64| repeated.value(&channel, tick);
    let step = |tick: u64| (value(tick + 100) - value(tick)).abs();
    let usual = (0..20_000).map(|n| step(30_000_000 + 100 * n)).fold(0.0, f64::max);
    let across = (0..20_000).map(|n| step(seam - 1_000_000 + 100 * n)).fold(0.0, f64::max);
    assert!(across < 1.05 * usual, "largest step {across} at the seam, {usual} elsewhere");
    // The gear's own modulation is where it would be without a seam: the same value a whole hunting period later.
    let hunting = (38.0 / 20.0 * 25e6) as u64;
    for tick in (seam - 500_000..seam + 500_000).step_by(10_007) {
        assert!((value(tick) - value(tick - hunting)).abs() < 0.01 * usual.max(1.0), "tick {tick}");
    }
}

#[test]
fn claim_a_signal_shorter_than_the_hunting_period_says_by_how_much_a_shaft_jumps() {
    let signal = signal(1.5, 20.0, 0.0);
    let repeated = Loop::new(&signal).expect("loops");
    assert!(repeated.jump_deg() > 0.0 && repeated.jump_deg() < 20.0, "{}", repeated.jump_deg());
}

fn json(path: &std::path::Path) -> Value {
    serde_json::from_str(&std::fs::read_to_string(path).expect("written")).expect("JSON")
}

#[test]
fn regress_two_viewers_hear_the_same_and_a_third_asks_meanwhile() {
    let folder = folder("served-two");
    let node = Node::start("17-38.toml", &["--duration", "3"]);
    let viewer = |name: &str| {
        Command::new(env!("CARGO_BIN_EXE_meshband"))
            .args(["monitor", &node.port(), "--frames", "60", "--force", "--json", &text(&folder.join(name))])
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .expect("starts")
    };
    let mut viewers = [viewer("a.json"), viewer("b.json")];
    let said = accepted(&["configure", &node.port(), "--volatile"]);
    assert!(said.contains("17 x 38 teeth"), "{said}");
    for viewer in &mut viewers {
        assert!(viewer.wait().expect("ends").success());
        let mut complaint = String::new();
        std::io::Read::read_to_string(&mut viewer.stderr.take().expect("piped"), &mut complaint).expect("text");
        assert!(!complaint.contains("link lost"), "nobody is thrown out: {complaint}");
    }
    let [a, b] = ["a.json", "b.json"].map(|name| json(&folder.join(name)));
    for seen in [&a, &b] {
        assert_eq!(seen["view"]["messages"], 60);
        for counter in ["lost", "refused", "restarts", "reopened"] {
            assert_eq!(seen["losses"][counter], 0, "{counter}: {seen}");
        }
    }
    assert_eq!(a["identity"], b["identity"]);
}

#[test]
fn regress_a_served_machine_measures_by_its_own_law_and_doubts_are_said() {
    let folder = folder("served-doubts");
    let node = Node::start("17-38.toml", &["--duration", "3"]);
    let said = accepted(&["monitor", &node.port(), "--once"]);
    assert!(said.contains("law ") && !said.contains("provisional") && !said.contains("law's domain"), "{said}");
    let settings = folder.join("set.toml");
    let alarm = "[[alarms]]\nwatched = \"Departure\"\nfrom = 5\nto = 60\nraise = 1\nclear = 0.5\npersistence = 3\n";
    std::fs::write(&settings, alarm).expect("written");
    let output = crate::common::meshband(&["configure", &node.port(), "--settings", &text(&settings), "--volatile"]);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && said.contains("can never be raised without expected levels"), "{said}");
}

#[test]
fn theory_a_node_is_told_a_train_and_says_which_gears_it_follows() {
    let folder = folder("served-train");
    let train = folder.join("train.toml");
    let stages = "[[stage]]\nkind = \"pair\"\nteeth = [17, 38]\n[[stage]]\nkind = \"pair\"\nteeth = [11, \
                  77]\n[[stage]]\nkind = \"planetary\"\nsun = 24\nplanet = 30\nring = 84\nplanets = 4\nfixed \
                  = \"ring\"\ninput = \"sun\"\n";
    std::fs::write(&train, stages).expect("written");
    let node = Node::start("17-38.toml", &["--duration", "3"]);
    let configured = |more: &[&str]| {
        let port = node.port();
        let arguments = [&["configure", &port, "--train"], more].concat();
        crate::common::meshband(&arguments)
    };
    let held = folder.join("held.json");
    let output = configured(&[&text(&train), "--volatile", "--json", &text(&held)]);
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success() && said.contains("follows in turns: pinion of stage 1, gear of stage 1"), "{said}");
    let not = String::from_utf8_lossy(&output.stderr);
    assert!(not.contains("not followed: pinion of stage 2 (fewer than 12 teeth"), "{not}");
    let held = json(&held);
    let teeth: Vec<u64> = held["train"].as_array().expect("gears").iter().filter_map(|g| g["teeth"].as_u64()).collect();
    assert_eq!(teeth, [38, 77, 84, 24, 30]);
    // A pair's machine takes the train away again.
    let machine = text(&crate::common::machine("17-38.toml"));
    accepted(&[
        "configure",
        &node.port(),
        "--machine",
        &machine,
        "--volatile",
        "--json",
        &text(&folder.join("b.json")),
    ]);
    assert_eq!(json(&folder.join("b.json"))["train"].as_array().map(Vec::len), Some(0));
    std::fs::write(&train, "[[stage]]\nkind = \"pair\"\nteeth = [11, 11]\n").expect("written");
    let output = configured(&[&text(&train), "--volatile"]);
    assert_eq!(output.status.code(), Some(2), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn regress_an_alarm_that_stands_is_shown_to_whoever_comes_later() {
    let folder = folder("served-alarm");
    let settings = folder.join("set.toml");
    let alarm = "[[alarms]]\nwatched = \"Rms\"\nfrom = 5\nto = 60\nraise = 0.001\nclear = 0.0005\npersistence = \
     3\n\n[holding]\nlatching = true\n";
    std::fs::write(&settings, alarm).expect("written");
    let node = Node::start("17-38.toml", &["--duration", "3"]);
    accepted(&["configure", &node.port(), "--settings", &text(&settings)]);
    let start = Instant::now();
    let mut client = Client::open(&node.port()).expect("connects");
    loop {
        assert!(start.elapsed() < PATIENCE, "the alarm is never raised");
        if let Some(Message::Status(status)) = client.next_message(Duration::from_secs(1)).expect("speaks")
            && status.alarms.raised != 0
        {
            break;
        }
    }
    let (seen, page) = (folder.join("seen.json"), folder.join("seen.html"));
    let said =
        accepted(&["monitor", &node.port(), "--once", "--json", &text(&seen), "--report", &text(&page), "--force"]);
    assert!(said.contains("ALARM 1: RMS") && said.contains("above 0.001 m/s2"), "{said}");
    assert!(!said.contains("no alarm") && !said.contains("raised: 0"), "{said}");
    let seen = json(&seen);
    assert_eq!((&seen["alarms"]["known"], &seen["alarms"]["standing"][0]["number"]), (&true.into(), &1.into()));
    let page = std::fs::read_to_string(page).expect("written");
    let first = page.find("ALARM 1: RMS").expect("in the report");
    assert!(first < page.find("<h2>").expect("sections"), "the alarm comes first");
}

struct Unattended;

impl Operator for Unattended {
    fn tell(&mut self, line: &str) -> meshband_host::Result<()> {
        println!("{line}");
        Ok(())
    }

    fn ask(&mut self, _: &str) -> meshband_host::Result<bool> {
        Ok(false)
    }
}

#[test]
fn regress_a_machine_of_one_speed_is_commissioned_and_its_fault_is_seen() {
    let machine = Machine::read(&crate::common::machine("17-38.toml")).expect("a machine");
    let sound = signal(7.0, 24.75, 0.3);
    let mut config = configuration(&sound, Some(25_600.0)).expect("a configuration");
    config.limits.analogue_stop = meshband::units::Hertz(10_000.0);
    let line = Direct::new(&sound, &config);
    let strength = line.strength.clone();
    let mut client = Client::new(Box::new(line));
    let path = crate::common::machine("17-38.toml");
    let plan = Plan {
        port: "in process".into(),
        sources: Sources::read(Some(&path), None, None).expect("reads"),
        machine,
        installation: Installation { pulses_per_turn: Some(1), ..Installation::default() },
        law_given: false,
        range: run_up::speeds("1485rpm").expect("one speed"),
        values: 10,
        seconds: 600.0,
        allowance_db: 0.5,
        false_alarms_per_year: 1.0,
        yes: true,
    };
    let done = commission(&mut client, &plan, &mut Unattended).expect("goes through");
    assert!(done.refusal().is_none() && done.stored, "{:?}", done.refusal());
    let coverage = done.coverage.as_ref().expect("speeds");
    assert_eq!(coverage.classes.len(), 1);
    assert!(coverage.classes[0].values >= 50, "five times the values of a class: {coverage:?}");
    let levels = done.levels.as_ref().expect("a baseline");
    let [low, high] = [levels.points[0].speed.0, levels.points[1].speed.0];
    assert!(levels.points.len() == 2 && low < 24.1 && high > 25.4, "{low} to {high} Hz");
    let alarms = &done.alarms.as_ref().expect("limits").alarms;
    assert!(alarms.iter().any(|alarm| alarm.watched == Watched::Departure), "{alarms:?}");
    let page = report::of(&done).expect("a page").html();
    assert!(page.contains("It is watched from now on") && page.contains("over time"), "the letter and its drift");
    // The healthy machine stays quiet; twice its vibration does not.
    assert!(!alarm_within(&mut client, 60.0), "a minute without an alarm");
    strength.store(0.8f64.to_bits(), std::sync::atomic::Ordering::Relaxed);
    assert!(alarm_within(&mut client, 30.0), "6 dB more are seen");
}

/// Whether an alarm stands within so many seconds of the node.
fn alarm_within(client: &mut Client, seconds: f64) -> bool {
    let mut first = None;
    loop {
        let message = client.next_message(Duration::from_secs(30)).expect("speaks").expect("goes on");
        if let Message::Status(status) = message {
            let now_s = status.tick as f64 / 25e6;
            if status.alarms.raised != 0 {
                return true;
            }
            if now_s - *first.get_or_insert(now_s) > seconds {
                return false;
            }
        }
    }
}
