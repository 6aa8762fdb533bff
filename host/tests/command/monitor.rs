//! The live view: its picture at both sizes, and the whole of it in a real terminal with a virtual node that freezes,
//! dies and comes back.

use meshband::health::Health;
use meshband::levels::{Departure, Departures};
use meshband::message::{GearIndicators, Indicators, MeshBand, Message, SpectralLine, Spectrum, Status};
use meshband::node::State;
use meshband::tach::Validity;
use meshband_host::link::Losses;
use meshband_host::monitor::link::Standing;
use meshband_host::monitor::panel::Panel;
use meshband_host::monitor::screen::{Scene, draw};
use ratatui::Terminal;
use ratatui::backend::TestBackend;

pub fn status() -> Status {
    Status {
        state: State::Measuring,
        validity: Validity::Locked,
        tick: 0,
        speed_hz: 40.0,
        speed_uncertainty: 1e-5,
        age_s: 0.01,
        bandwidth_hz: 20_000.0,
        available_hz: 20_000.0,
        bound: meshband::message::Bound::Law,
        alarms: meshband::message::AlarmState::default(),
        law_clamped: false,
        law_provisional: false,
        requested_hz: 51_200.0,
        granted_hz: 51_300.0,
        adc_hz: 205_200.0,
        period_ticks: 100,
        stages: 2,
        residual_ppm: 0.0,
        limited: false,
        safe_rate: false,
        block: 0,
        capture: meshband::waveform::CapturePhase::Watching,
        alerts: 0,
        sensor: Default::default(),
    }
}

fn spectrum() -> Spectrum {
    let mut spectrum = Spectrum::default();
    spectrum.tag.speed_hz = 40.0;
    for harmonic in 1..=6_u8 {
        let line = SpectralLine { frequency_hz: 680.0 * f32::from(harmonic), amplitude: 3.0 / f32::from(harmonic) };
        let mut band = MeshBand { harmonic, line, ..MeshBand::default() };
        let side = SpectralLine { frequency_hz: line.frequency_hz + 40.0, amplitude: 0.1 * line.amplitude };
        band.sidebands.push(side).expect("room");
        spectrum.bands.push(band).expect("room");
    }
    spectrum
}

fn indicators(gear: bool) -> Indicators {
    let gear = gear.then(|| GearIndicators { fm0: 2.5, fm4: 3.25, na4: 1.125, ..GearIndicators::default() });
    let departure = |departure_db, uncertainty_db| Some(Departure { departure_db, uncertainty_db });
    // The mesh is the one that stands out most of what scatters.
    let departures =
        Departures { rms: departure(7.5, 3.0), mesh_amplitude: departure(6.25, 1.0), ..Departures::default() };
    Indicators { rms: 1.25, peak: 4.0, crest: 3.2, kurtosis: 2.9, gear, departures, ..Indicators::default() }
}

/// A panel that has heard everything by 1 s.
fn panel() -> Panel {
    let mut panel = Panel::default();
    panel.take(Message::Indicators(indicators(true)), 0.5);
    panel.take(Message::Spectrum(spectrum()), 0.6);
    panel.take(Message::Status(status()), 0.8);
    panel.take(Message::Indicators(indicators(false)), 1.0);
    panel
}

pub fn picture(panel: &Panel, standing: &Standing, now_s: f64, size: (u16, u16)) -> Vec<String> {
    let mut terminal = Terminal::new(TestBackend::new(size.0, size.1)).expect("a terminal");
    let scene =
        Scene { panel, standing, losses: Losses::default(), capture: None, now_s, events_open: false, help: false };
    terminal.draw(|frame| draw(frame, &scene)).expect("drawn");
    let cells = terminal.backend().buffer().content();
    cells.chunks(usize::from(size.0)).map(|row| row.iter().map(|cell| cell.symbol()).collect()).collect()
}

#[test]
fn claim_everything_that_matters_is_seen_at_80x24_and_200x60() {
    for size in [(80, 24), (200, 60)] {
        let rows = picture(&panel(), &Standing::Open, 1.2, size);
        let all = rows.join("\n");
        assert!(rows[0].contains("MEASURING") && rows[0].contains("no reservation"), "{all}");
        assert!(rows[1].contains("40.0000 Hz") && rows[2].contains("granted 51300 Hz"), "{all}");
        for part in [
            "no alarm (which are configured is not known)",
            "1x",
            "6x",
            "4080.00",
            "RMS, m/s2",
            "1.2500",
            "FM0",
            "2.500",
            "NA4",
            "departure, dB          6.2",
            "no events",
            "q quit",
        ] {
            assert!(all.contains(part), "{part} at {size:?}:\n{all}");
        }
    }
    let wide = picture(&panel(), &Standing::Open, 1.2, (200, 60));
    let used = wide.iter().filter(|row| row.trim().len() > 2).count();
    assert!(used >= 50, "a large terminal is used: {used} of 60 rows\n{}", wide.join("\n"));
}

#[test]
fn claim_supply_temperature_and_bias_stand_beside_the_values() {
    let mut panel = panel();
    let health = Health { supply_v: Some(3.28), temperature_c: Some(47.6), bias_v: Some(1.64), ..Health::default() };
    panel.view.health = Some(health);
    for size in [(80, 24), (200, 60)] {
        let all = picture(&panel, &Standing::Open, 1.2, size).join("\n");
        assert!(all.contains("values (3.28 V, 48 deg C, bias 1.64 V)"), "{size:?}:\n{all}");
    }
    assert!(panel.view.text(Losses::default()).contains("device 3.28 V, 48 deg C, bias 1.64 V\n"));
}

#[test]
fn fault_a_silent_node_does_not_look_alive() {
    let rows = picture(&panel(), &Standing::Open, 5.0, (80, 24));
    assert!(rows[0].contains("SILENT") && rows[0].contains("silent for 4 s"), "{}", rows[0]);
    assert!(!rows[0].contains("MEASURING"));
    assert!(rows[1].contains("4.2 s old"), "{}", rows[1]);
    let lost = Standing::Lost { reason: "the other end closed the connection".into(), attempts: 2, next_s: 1.6 };
    let rows = picture(&panel(), &lost, 5.0, (80, 24));
    assert!(rows[0].contains("LINK LOST") && rows[0].contains("again in 2 s, 2 failed"), "{}", rows[0]);
}

#[test]
fn regress_values_that_come_seldom_stay_with_their_own_age() {
    let panel = panel();
    assert_eq!(
        panel.view.indicators.and_then(|i| i.gear).map(|gear| gear.fm4),
        Some(3.25),
        "the next message has none"
    );
    let all = picture(&panel, &Standing::Open, 2.0, (80, 24)).join("\n");
    let row = all.lines().find(|row| row.contains("FM4")).expect("shown");
    assert!(row.contains("3.250") && row.contains("1.5 s"), "{row}");
}

#[cfg(unix)]
mod in_a_terminal {
    use std::io::{BufRead, BufReader, Read, Write};
    use std::net::{TcpListener, TcpStream};
    use std::path::{Path, PathBuf};
    use std::process::{Child, Command, Stdio};
    use std::time::{Duration, Instant};

    /// How long any state may take to be seen; machines are busy.
    const PATIENCE: Duration = Duration::from_secs(90);

    struct Node(Child);

    impl Node {
        /// A virtual node; gives its port.
        fn start(port: u16) -> (Self, u16) {
            let machine = Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/17-38.toml");
            let mut child = Command::new(env!("CARGO_BIN_EXE_meshband"))
                .args(["node", "--serve", &format!("tcp:127.0.0.1:{port}"), "--duration", "3", "--loop"])
                .arg(machine)
                .stdout(Stdio::piped())
                .spawn()
                .expect("the command starts");
            let mut line = String::new();
            BufReader::new(child.stdout.take().expect("piped")).read_line(&mut line).expect("a line");
            let port = line.split("tcp:127.0.0.1:").nth(1).and_then(|rest| rest.split(',').next()?.parse().ok());
            (Self(child), port.unwrap_or_else(|| panic!("no port in '{line}'")))
        }

        fn signal(&self, name: &str) {
            Command::new("kill").args([name, &self.0.id().to_string()]).status().expect("kill");
        }
    }

    impl Drop for Node {
        fn drop(&mut self) {
            let _ = self.0.kill();
            let _ = self.0.wait();
        }
    }

    /// A terminal of tmux with its own server.
    struct Tmux {
        socket: String,
        folder: PathBuf,
    }

    impl Tmux {
        fn run(&self, words: &[&str]) -> String {
            let output = Command::new("tmux").args(["-L", &self.socket]).args(words).output().expect("tmux");
            String::from_utf8_lossy(&output.stdout).into_owned()
        }

        fn start(socket: &str, folder: &Path, size: (u16, u16), command: &str) -> Self {
            let tmux = Self { socket: format!("{socket}-{}", std::process::id()), folder: folder.to_owned() };
            let (x, y) = (size.0.to_string(), size.1.to_string());
            let folder = folder.display().to_string();
            tmux.run(&["new-session", "-d", "-x", &x, "-y", &y, "-c", &folder, command]);
            tmux
        }

        fn screen(&self) -> String {
            self.run(&["capture-pane", "-p"])
        }

        /// Waits until the screen shows all of `parts`.
        fn until(&self, parts: &[&str]) -> String {
            let start = Instant::now();
            loop {
                let screen = self.screen();
                if parts.iter().all(|part| screen.contains(part)) {
                    return screen;
                }
                assert!(start.elapsed() < PATIENCE, "{parts:?} not seen in {}:\n{screen}", self.folder.display());
                std::thread::sleep(Duration::from_millis(100));
            }
        }
    }

    impl Drop for Tmux {
        fn drop(&mut self) {
            self.run(&["kill-server"]);
        }
    }

    fn folder(name: &str) -> PathBuf {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
        let _ = std::fs::remove_dir_all(&folder);
        std::fs::create_dir_all(&folder).expect("a folder");
        folder
    }

    fn has_tmux() -> bool {
        let found = Command::new("tmux").arg("-V").output().is_ok_and(|output| output.status.success());
        if !found {
            println!("skipped: no tmux, the monitor is not driven through a terminal");
        }
        found
    }

    #[test]
    fn fault_frozen_killed_and_replugged_in_a_real_terminal() {
        if !has_tmux() {
            return;
        }
        let folder = folder("monitor-terminal");
        let (node, port) = Node::start(0);
        let monitor = format!(
            "{} monitor tcp:127.0.0.1:{port} --record run.link --json run.json --report run.html",
            env!("CARGO_BIN_EXE_meshband")
        );
        let tmux = Tmux::start("meshband-monitor", &folder, (80, 24), &monitor);
        let screen = tmux.until(&["MEASURING", "1x", "RMS, m/s2", "KB in run.link"]);
        assert!(screen.lines().count() <= 24 && screen.lines().all(|line| line.chars().count() <= 80), "{screen}");
        std::fs::write(folder.join("80x24.txt"), &screen).expect("written");
        tmux.run(&["resize-window", "-x", "200", "-y", "60"]);
        let screen = tmux.until(&["orders of the pinion", "MEASURING"]);
        std::fs::write(folder.join("200x60.txt"), &screen).expect("written");
        tmux.run(&["send-keys", "h"]);
        tmux.until(&["end; --json and --report are written then"]);
        tmux.run(&["send-keys", "h"]);

        node.signal("-STOP");
        tmux.until(&["SILENT", "silent for"]);
        node.signal("-CONT");
        tmux.until(&["MEASURING"]);
        drop(node);
        tmux.until(&["LINK LOST", "again in"]);
        let (node, again) = Node::start(port);
        assert_eq!(again, port);
        tmux.until(&["MEASURING", "1 reconnects"]);
        tmux.run(&["send-keys", "C-c"]);
        let start = Instant::now();
        while !folder.join("run.html").exists() && start.elapsed() < PATIENCE {
            std::thread::sleep(Duration::from_millis(50));
        }
        drop(node);
        let text = std::fs::read_to_string(folder.join("run.json")).expect("JSON is written at the end");
        let json: serde_json::Value = serde_json::from_str(&text).expect("JSON");
        for shown in ["status", "spectrum", "indicators"] {
            assert!(json["view"][shown].is_object(), "{shown} was on the screen: {text}");
        }
        let replay = Command::new(env!("CARGO_BIN_EXE_meshband"))
            .args(["monitor", "--json", "-", "--replay"])
            .arg(folder.join("run.link"))
            .output()
            .expect("the command starts");
        let replayed: serde_json::Value = serde_json::from_slice(&replay.stdout).expect("JSON");
        let messages = |of: &serde_json::Value| of["view"]["messages"].as_u64().expect("a count");
        assert!(messages(&replayed) >= messages(&json), "the capture holds all that was heard: {replayed} {text}");
        assert_eq!(replayed["losses"], json["losses"], "live and replayed count alike");
        // Where the first node had run shorter than the second when it was heard, its ticks do not tell of the restart.
        assert!(json["losses"]["restarts"].as_u64().is_some_and(|restarts| restarts <= 1), "{text}");
        assert_eq!(json["losses"]["reopened"], 1, "the link was opened again: {text}");
        assert_eq!(json["losses"]["lost"], 0, "nobody lost a frame: {text}");
        let said = String::from_utf8_lossy(&replay.stderr);
        assert!(said.contains("mesh bands"), "{said}");
    }

    /// With SIGHUP ignored nothing else ends the view: it used to read the end of the closed terminal for ever.
    #[test]
    fn fault_a_closed_terminal_ends_the_view_and_its_results_are_written() {
        use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
        use rustix::termios::{Winsize, tcsetwinsize};
        let folder = folder("monitor-closed");
        let (_node, port) = Node::start(0);
        // Not handed down to the command, which would keep its own terminal open.
        let screen = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).expect("a pseudo-terminal");
        grantpt(&screen).and_then(|()| unlockpt(&screen)).expect("usable");
        let size = Winsize { ws_row: 24, ws_col: 80, ws_xpixel: 0, ws_ypixel: 0 };
        tcsetwinsize(&screen, size).expect("a terminal has a size");
        let name = ptsname(&screen, Vec::new()).expect("a path").into_string().expect("text");
        let mut screen = std::fs::File::from(screen);
        let terminal = || std::fs::File::options().read(true).write(true).open(&name).expect("the terminal opens");
        let mut monitor = Command::new(env!("CARGO_BIN_EXE_meshband"))
            .args(["monitor", &format!("tcp:127.0.0.1:{port}"), "--record", "run.link", "--json", "run.json"])
            .current_dir(&folder)
            .stdin(terminal())
            .stdout(terminal())
            .stderr(terminal())
            .spawn()
            .expect("the command starts");
        let (start, mut seen, mut buffer) = (Instant::now(), Vec::new(), [0; 4096]);
        while !String::from_utf8_lossy(&seen).contains("MEASURING") {
            assert!(start.elapsed() < PATIENCE, "the view opens: {}", String::from_utf8_lossy(&seen));
            let count = screen.read(&mut buffer).expect("the terminal is read");
            seen.extend_from_slice(&buffer[..count]);
        }
        drop(screen);
        let start = Instant::now();
        while monitor.try_wait().expect("asked").is_none() {
            if start.elapsed() > PATIENCE {
                monitor.kill().expect("killed");
                panic!("the view goes on without its terminal");
            }
            std::thread::sleep(Duration::from_millis(50));
        }
        let text = std::fs::read_to_string(folder.join("run.json")).expect("JSON is written at the end");
        let json: serde_json::Value = serde_json::from_str(&text).expect("JSON");
        assert!(json["view"].is_object() && json["identity"].is_object(), "{text}");
    }

    /// Passes bytes on and puts garbage between them.
    fn dirty(node: u16) -> u16 {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        let port = listener.local_addr().expect("bound").port();
        std::thread::spawn(move || {
            let (mut peer, _) = listener.accept().expect("a caller");
            let mut line = TcpStream::connect(("127.0.0.1", node)).expect("the node");
            let (mut from_peer, mut to_node) = (peer.try_clone().expect("clone"), line.try_clone().expect("clone"));
            std::thread::spawn(move || std::io::copy(&mut from_peer, &mut to_node));
            let mut buffer = [0; 700];
            while let Ok(count) = line.read(&mut buffer) {
                let sent =
                    peer.write_all(&buffer[..count]).and_then(|()| peer.write_all(&[0x55, 0xaa, 0x00, 0x13, 0x00]));
                if count == 0 || sent.is_err() {
                    return;
                }
            }
        });
        port
    }

    #[test]
    fn fault_garbage_on_the_link_is_counted_and_the_rest_is_read() {
        let folder = folder("monitor-garbage");
        let (_node, port) = Node::start(0);
        let json = folder.join("seen.json");
        let output = Command::new(env!("CARGO_BIN_EXE_meshband"))
            .args(["monitor", &format!("tcp:127.0.0.1:{}", dirty(port)), "--frames", "30", "--json"])
            .arg(&json)
            .output()
            .expect("the command starts");
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let text = std::fs::read_to_string(&json).expect("written");
        let seen: serde_json::Value = serde_json::from_str(&text).expect("JSON");
        assert_eq!(seen["view"]["messages"], 30);
        assert!(seen["losses"]["refused"].as_u64().is_some_and(|count| count > 0), "{text}");
    }

    #[test]
    fn regress_an_alarm_that_stands_is_on_the_screens_of_both_viewers() {
        if !has_tmux() {
            return;
        }
        let folder = folder("monitor-alarm");
        let (_node, port) = Node::start(0);
        let settings = folder.join("set.toml");
        let alarm =
            "[[alarms]]\nwatched = \"Rms\"\nfrom = 5\nto = 60\nraise = 0.001\nclear = 0.0005\npersistence = 1\n";
        std::fs::write(&settings, alarm).expect("written");
        let address = format!("tcp:127.0.0.1:{port}");
        let configured = Command::new(env!("CARGO_BIN_EXE_meshband"))
            .args(["configure", &address, "--settings"])
            .arg(&settings)
            .output()
            .expect("starts");
        assert!(configured.status.success(), "{}", String::from_utf8_lossy(&configured.stderr));
        let start = Instant::now();
        loop {
            assert!(start.elapsed() < PATIENCE, "the alarm is never raised");
            let once = Command::new(env!("CARGO_BIN_EXE_meshband")).args(["monitor", &address, "--once"]).output();
            if String::from_utf8_lossy(&once.expect("starts").stdout).contains("ALARM 1: RMS") {
                break;
            }
        }
        let monitor = format!("{} monitor {address} --no-record", env!("CARGO_BIN_EXE_meshband"));
        let viewers =
            ["meshband-alarm-a", "meshband-alarm-b"].map(|name| Tmux::start(name, &folder, (80, 24), &monitor));
        for viewer in &viewers {
            let screen = viewer.until(&["MEASURING", "ALARM 1: RMS", "above 0.001 m/s2"]);
            assert!(!screen.contains("no alarm") && !screen.contains("LINK LOST"), "{screen}");
        }
        viewers[0].run(&["send-keys", "a"]);
        for viewer in &viewers {
            viewer.until(&["ALARM 1: RMS", "acknowledged"]);
        }
    }

    #[test]
    fn regress_the_wizard_asks_again_and_takes_units() {
        if !has_tmux() {
            return;
        }
        let folder = folder("wizard-terminal");
        let wizard = format!("{} machine new -o plant.toml --quick; sleep 60", env!("CARGO_BIN_EXE_meshband"));
        let tmux = Tmux::start("meshband-wizard", &folder, (160, 24), &wizard);
        let answer = |question: &str, text: &str| {
            tmux.until(&[question]);
            tmux.run(&["send-keys", text, "Enter"]);
        };
        answer("one pair of spur gears", "21");
        answer("'21' are not two tooth counts", "21, 83");
        answer("module, mm", "3");
        answer("face width, mm", "thirty");
        answer("'thirty' is no positive number", "30");
        answer("speed of the pinion", "1485");
        answer("write 1485rpm", "1485rpm");
        answer("power, kW", "25");
        tmux.until(&["written: plant.toml"]);
        let text = std::fs::read_to_string(folder.join("plant.toml")).expect("written");
        assert!(text.contains("24.75"), "1485 rpm are 24.75 Hz: {text}");
    }
}
