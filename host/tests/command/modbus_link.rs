//! `meshband configure` and Modbus: what it says of it, and how a node that listens at its start only is called.

use crate::common::{accepted, folder, refused, text};
use meshband::config::{Configuration, LinkConfig, Parity, Personality};
use meshband::identity::Identity;
use meshband::session::Session;
use meshband::units::TicksPerSecond;
use std::io::{Read, Write};
use std::net::TcpListener;
use std::path::Path;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

const CLOCK: TicksPerSecond = TicksPerSecond(84_000_000);

/// A node whose link hears nothing for so long from its caller's first byte on; for one caller, and then what it holds.
fn node(deaf: Duration, config: Configuration) -> (String, JoinHandle<Configuration>) {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let port = format!("tcp:{}", listener.local_addr().expect("an address"));
    let serve = move || {
        let (mut stream, _) = listener.accept().expect("a caller");
        let begin = Instant::now();
        let mut session = Session::new(config, CLOCK, Identity::HOST).expect("sound");
        let mut buffer = [0; 512];
        while let Ok(count @ 1..) = stream.read(&mut buffer) {
            if begin.elapsed() < deaf {
                continue;
            }
            let mut out = Vec::new();
            let mut send = |frame: &[u8]| out.extend_from_slice(frame);
            buffer[..count].iter().for_each(|&byte| session.on_byte(byte, &mut send));
            if session.take_commit() {
                session.on_stored(true);
            }
            session.on_line_empty();
            session.send_messages(0, &mut send);
            if stream.write_all(&out).is_err() {
                break;
            }
        }
        session.node().configuration().clone()
    };
    (port, std::thread::spawn(serve))
}

fn written(folder: &Path, name: &str, content: &str) -> String {
    let path = folder.join(name);
    std::fs::write(&path, content).expect("written");
    text(&path)
}

#[test]
fn claim_a_node_of_modbus_is_called_at_its_start_and_told_to_speak_the_link_again() {
    let folder = folder("modbus-back");
    let link = LinkConfig { personality: Personality::Modbus, address: 9, ..LinkConfig::default() };
    let (port, node) = node(Duration::from_millis(1300), Configuration { link, ..Configuration::default() });
    let back = written(&folder, "back.toml", "[link]\npersonality = \"Meshband\"\n");
    let said = accepted(&["configure", &port, "--at-start", "--settings", &back]);
    assert!(said.contains("switch it off and on") && said.contains("stored"), "{said}");
    assert!(!said.contains("Modbus"), "{said}");
    assert_eq!(node.join().expect("ended").link, LinkConfig { personality: Personality::Meshband, ..link });
}

#[test]
fn claim_settings_make_a_node_of_modbus_and_the_way_back_is_said() {
    let folder = folder("modbus-there");
    let (port, node) = node(Duration::ZERO, Configuration::default());
    let settings = "[link]\npersonality = \"Modbus\"\naddress = 17\nbits_per_second = 9600\nparity = \"NoneTwoStop\"\n";
    let settings = written(&folder, "modbus.toml", settings);
    let said = accepted(&["configure", &port, "--settings", &settings]);
    for part in ["from its next start", "address 17", "9600 bit/s", "NoneTwoStop", "--at-start"] {
        assert!(said.contains(part), "{part}: {said}");
    }
    let parity = Parity::NoneTwoStop;
    let expected = LinkConfig { personality: Personality::Modbus, address: 17, bits_per_second: 9600, parity };
    assert_eq!(node.join().expect("ended").link, expected);
}

#[test]
fn fault_a_line_that_no_master_could_reach_is_refused_with_its_key() {
    let folder = folder("modbus-wrong");
    for (name, content, expected) in [
        ("no-address.toml", "[link]\npersonality = \"Modbus\"\n", ["link.address", "1 to 247"]),
        (
            "rate.toml",
            "[link]\npersonality = \"Modbus\"\naddress = 3\nbits_per_second = 300\n",
            ["link.bits_per_second", "2400"],
        ),
    ] {
        let (port, node) = node(Duration::ZERO, Configuration::default());
        refused(&["configure", &port, "--settings", &written(&folder, name, content)], &expected);
        assert_eq!(node.join().expect("ended").link, LinkConfig::default());
    }
    for (name, content, expected) in [
        ("parity.toml", "[link]\nparity = \"Mark\"\n", ["link", "Mark"]),
        ("large.toml", "[link]\naddress = 300\n", ["link", "300"]),
    ] {
        refused(&["configure", "tcp:127.0.0.1:1", "--settings", &written(&folder, name, content)], &expected);
    }
}
