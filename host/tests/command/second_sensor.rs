//! A second sensor from the command line: its settings, what boards can have it, and what a live virtual node says of
//! it.

use crate::common::{accepted, folder, machine, refused, text};
use meshband::config::{Configuration, SecondSensor};
use meshband::units::{Acceleration, Hertz};
use meshband_host::link::settings::Settings;
use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};

fn apply(text: &str, config: &mut Configuration) -> Result<(), String> {
    let settings = Settings::from_toml(text, "second.toml").map_err(|error| error.to_string())?;
    settings.apply(config).map_err(|error| error.to_string())
}

#[test]
fn claim_settings_give_a_node_a_second_sensor_change_it_and_take_it_away() {
    let mut config = Configuration::default();
    apply("[second]\nacceleration_per_code = 0.00494\nband = 10000.0\n", &mut config).expect("given");
    let expected =
        SecondSensor { acceleration_per_code: Acceleration(0.00494), band: Hertz(10_000.0), ..SecondSensor::default() };
    assert_eq!(config.second, Some(expected));
    apply("[second]\nzero_code = 31000\n", &mut config).expect("changed");
    assert_eq!(config.second, Some(SecondSensor { zero_code: 31_000, ..expected }), "what is not named stays");
    apply("[sensor]\nzero_code = 32000\n", &mut config).expect("another table");
    assert!(config.second.is_some());
    apply("second = \"None\"\n", &mut config).expect("taken away");
    assert_eq!(config.second, None);
}

#[test]
fn fault_settings_of_a_second_sensor_name_their_key() {
    let mut config = Configuration::default();
    for (text, parts) in [
        ("[second]\nsensitivity = 1.0\n", ["second.toml: [second] sensitivity", "acceleration_per_code"]),
        ("[second]\nband = \"wide\"\n", ["second.toml: [second] band", "a number"]),
        ("second = 3\n", ["second.toml: second", "\"None\""]),
        ("second = \"Off\"\n", ["second.toml: second", "\"None\""]),
    ] {
        let said = apply(text, &mut config).expect_err("wrong");
        assert!(parts.iter().all(|part| said.contains(part)), "{said}");
    }
    assert_eq!(config, Configuration::default());
}

#[test]
fn fault_a_board_with_one_converter_and_a_channel_that_is_none_are_refused() {
    let machine = &text(&machine("19-48.toml"));
    refused(&["node", machine, "--second", "1"], &["--second", "an386 has one converter", "stm32f405"]);
    refused(&["node", machine, "--second", "motor", "--board", "stm32f405"], &["--second", "motor"]);
}

/// A live node that ends with the test.
struct Node(Child);

impl Drop for Node {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn claim_a_live_node_with_a_second_sensor_shows_its_values() {
    let arguments = ["node", "--second", "1", "--duration", "1", "--serve", "tcp:127.0.0.1:0", "--loop"];
    let child = Command::new(env!("CARGO_BIN_EXE_meshband"))
        .args(arguments)
        .arg(machine("19-48.toml"))
        .stdout(Stdio::piped())
        .spawn()
        .expect("the command starts");
    let mut node = Node(child);
    let mut line = String::new();
    BufReader::new(node.0.stdout.take().expect("piped")).read_line(&mut line).expect("a line");
    let port = line.split_whitespace().find(|word| word.starts_with("tcp:")).expect("a port").trim_end_matches(',');
    let report = text(&folder("second-live").join("report.html"));
    let seen = accepted(&["monitor", port, "--frames", "25", "--no-record", "--report", &report]);
    assert!(seen.contains("second sensor RMS"), "{seen}");
    let page = crate::common::without_tooltips(&std::fs::read_to_string(report).expect("written"));
    assert!(page.contains("second sensor: velocity RMS, mm/s"), "in the report");
}
