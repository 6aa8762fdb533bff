//! A PLC to be tried on a served node: pymodbus reads alarms, values and spectrum over TCP and over a serial line's
//! terminal, told by the csv map alone; without Python the bytes of both lines are looked at here.

use crate::common::{accepted, folder, text};
use serde_json::Value;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

struct Served {
    child: Child,
    link: String,
    tcp: String,
    rtu: String,
}

impl Served {
    fn start() -> Self {
        let mut child = Command::new(env!("CARGO_BIN_EXE_meshband"))
            .args(["node", "--serve", "tcp:0", "--modbus", "tcp:0", "--modbus", "rtu", "--duration", "3", "--loop"])
            .arg(crate::common::machine("17-38.toml"))
            .stdout(Stdio::piped())
            .spawn()
            .expect("starts");
        let mut lines = BufReader::new(child.stdout.take().expect("piped")).lines();
        let mut next = || lines.next().expect("a line").expect("text");
        let after = |line: &str, mark: &str| {
            let rest = line.split_once(mark).unwrap_or_else(|| panic!("{mark} in {line}")).1;
            rest.split([',', ' ']).next().expect("a word").to_owned()
        };
        let link = after(&next(), "at ");
        let tcp = after(&next(), "Modbus TCP at ");
        let rtu = after(&next(), "Modbus RTU at ");
        Self { child, link, tcp, rtu }
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Interpreter with pymodbus: `cargo xtask modbus` makes it.
fn python() -> Option<PathBuf> {
    let own = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../target/modbus-python/bin/python");
    let python = std::env::var_os("MESHBAND_MODBUS_PYTHON").map_or_else(own, PathBuf::from);
    let has = Command::new(&python).args(["-c", "import pymodbus"]).stderr(Stdio::null()).status();
    has.is_ok_and(|status| status.success()).then_some(python)
}

fn alarm(folder: &Path, link: &str, more: &str) {
    let settings = folder.join("set.toml");
    let alarm = "[[alarms]]\nwatched = \"Rms\"\nfrom = 5\nto = 60\nraise = 0.001\nclear = 0.0005\npersistence = 1\n";
    std::fs::write(&settings, format!("{alarm}{more}")).expect("written");
    accepted(&["configure", link, "--settings", &text(&settings)]);
    accepted(&["monitor", link, "--once"]);
}

#[test]
#[cfg(unix)]
fn claim_pymodbus_reads_a_served_node_by_the_csv_map_alone() {
    let Some(python) = python() else {
        println!("skipped: no pymodbus (cargo xtask modbus makes its environment)");
        return;
    };
    let folder = folder("modbus-serve");
    let served = Served::start();
    alarm(&folder, &served.link, "");
    let map = folder.join("map.csv");
    let said = accepted(&["modbus", &served.link, "-o", &text(&map), "--force"]);
    assert!(said.contains("01 04 00 68 00 02"), "the example in bytes: {said}");
    let rows = std::fs::read_to_string(&map).expect("written");
    assert!(rows.contains("alarm 1, RMS above 0.001 m/s2 from 5 to 60 Hz: is raised or latched"), "{rows}");
    let (host, port) = served.tcp.rsplit_once(':').expect("an address");
    let read = |place: &[&str]| read(&python, &map, place);
    // An alarm stands after its persistence, which the served node counts in its own values; a spectrum takes longer.
    let ready = |values: &Value| values["discrete inputs/standing_1"] == true && values["mesh bands/mesh_1"].is_f64();
    let over_tcp = (0..60).map(|_| read(&["tcp", host, port, "1"])).find(ready).expect("an alarm and a spectrum");
    for values in [over_tcp, read(&["rtu", &served.rtu, "1"])] {
        assert_eq!(
            (&values["discrete inputs/standing_1"], &values["discrete inputs/standing_2"]),
            (&true.into(), &false.into())
        );
        let rms = &values["values/rms"];
        assert!(rms.as_f64().is_some_and(|rms| rms > 0.001), "{rms}");
        let lines = values
            .as_object()
            .expect("values")
            .iter()
            .filter(|(name, value)| name.contains("mesh") && value.as_f64().is_some_and(|x| x > 0.0));
        assert!(lines.count() > 2, "mesh bands: {values}");
    }
}

/// What the map's reader prints.
#[cfg(unix)]
fn read(python: &Path, map: &Path, words: &[&str]) -> Value {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/compare/modbus_map.py");
    let output = Command::new(python).arg(&script).arg(map).args(words).output().expect("starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("JSON")
}

#[test]
#[cfg(unix)]
fn claim_pymodbus_acknowledges_and_reads_a_waveform_where_the_settings_permit_it() {
    let Some(python) = python() else {
        println!("skipped: no pymodbus (cargo xtask modbus makes its environment)");
        return;
    };
    let folder = folder("modbus-commands");
    let served = Served::start();
    let map = folder.join("map.csv");
    accepted(&["modbus", "-o", &text(&map), "--force"]);
    let (host, port) = served.tcp.rsplit_once(':').expect("an address");
    let ask = |more: &[&str]| read(&python, &map, &[&["tcp", host, port, "1"], more].concat());
    assert_eq!(ask(&["WRITE=1"])["written"], "exception 1", "without permission");
    alarm(&folder, &served.link, "[modbus]\ncommands = true\n[capture]\nkeep = \"Fixed\"\n");
    let held = |values: &Value| values["samples"][0].is_f64() && values["discrete inputs/unseen_1"] == true;
    let values = (0..60).map(|_| ask(&["SAMPLES=1000"])).find(held).expect("an alarm's waveform");
    assert_eq!((&values["waveform/trigger"], &values["waveform/number"]), (&1.into(), &1.into()));
    let samples: Vec<f64> = values["samples"].as_array().expect("samples").iter().filter_map(Value::as_f64).collect();
    let rms = (samples.iter().map(|x| x * x).sum::<f64>() / 1000.0).sqrt();
    assert!(samples.len() == 1000 && rms > 0.001, "{rms} of {}", samples.len());
    let seen = ask(&["WRITE=1"]);
    assert_eq!((&seen["written"], &seen["discrete inputs/unseen_1"]), (&"yes".into(), &false.into()));
    assert_eq!(seen["discrete inputs/standing_1"], true, "acknowledged, and still beyond its limit");
    assert_eq!(ask(&["WRITE=3"])["written"], "yes");
    assert_ne!(ask(&[])["waveform/phase"], 4, "released");
    assert_eq!(ask(&["WRITE=9"])["written"], "exception 3");
}

#[test]
fn ref_a_request_over_tcp_is_answered_with_its_transaction_and_refused_as_the_standard_says() {
    let served = Served::start();
    accepted(&["monitor", &served.link, "--once"]);
    let mut master = TcpStream::connect(&served.tcp).expect("connects");
    master.set_read_timeout(Some(Duration::from_secs(20))).expect("settable");
    let mut ask = |request: &[u8], length: usize| {
        master.write_all(request).expect("sent");
        let mut answer = vec![0; length];
        master.read_exact(&mut answer).expect("answered");
        answer
    };
    // RMS: two input registers from 104 on, by unit 17; not a number until the node has its first values.
    let start = std::time::Instant::now();
    let rms = loop {
        let answer = ask(&[0, 7, 0, 0, 0, 6, 17, 4, 0, 104, 0, 2], 13);
        assert_eq!(answer[..9], [0, 7, 0, 0, 0, 7, 17, 4, 4]);
        let rms = f32::from_be_bytes(answer[9..13].try_into().expect("four bytes"));
        if rms.is_finite() {
            break rms;
        }
        assert!(start.elapsed() < Duration::from_secs(60), "no values come");
        std::thread::sleep(Duration::from_millis(200));
    };
    assert!(rms > 0.0 && rms < 1e4, "{rms}");
    assert_eq!(ask(&[0, 8, 0, 0, 0, 6, 1, 6, 0, 1, 0, 1], 9), [0, 8, 0, 0, 0, 3, 1, 0x86, 1], "writing is refused");
    assert_eq!(ask(&[0, 9, 0, 0, 0, 6, 1, 4, 0xff, 0xf0, 0, 2], 9), [0, 9, 0, 0, 0, 3, 1, 0x84, 2], "no such address");
}

#[test]
#[cfg(unix)]
fn ref_a_request_over_the_serial_terminal_is_answered_with_its_checksum() {
    let served = Served::start();
    accepted(&["monitor", &served.link, "--once"]);
    let mut line = serialport::new(&served.rtu, 19_200).timeout(Duration::from_secs(20)).open().expect("opens");
    let rows = meshband_host::link::modbus::rows(None);
    let row = rows.iter().find(|row| row.name == "rms").expect("in the map");
    let [request, pattern] = meshband_host::link::modbus::example(1, row, 0.0);
    // A busy host may look too late once: then the master asks again, as masters do.
    let mut answer = vec![0; pattern.len()];
    line.set_timeout(Duration::from_secs(3)).expect("settable");
    let answered = (0..5).any(|_| {
        line.write_all(&request).expect("sent");
        line.read_exact(&mut answer).is_ok()
    });
    assert!(answered && answer[..3] == pattern[..3], "{answer:?}");
    let checksum = meshband::modbus::CRC16.checksum(&answer[..7]);
    assert_eq!(answer[7..], checksum.to_le_bytes());
}
