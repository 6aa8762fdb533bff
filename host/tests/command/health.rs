//! `meshband health` as a user runs it: against the released image in the emulated chip, and with everything that is
//! no node of this kind.

use crate::common::{accepted, folder, refused, text};
use crate::emulated_line::Line;
use meshband_emulator::board::Board;
use meshband_host::virtual_node::emulated::run::Emulated;
use serde_json::Value;
use std::time::{SystemTime, UNIX_EPOCH};

/// The board behind a port, with a sensor at rest, or `None` after saying why the test is skipped.
fn node(test: &str) -> Option<Line> {
    let Some(emulated) = Emulated::of_board() else {
        println!("skipped {test}: Unicorn or the firmware image is absent (cargo xtask setup, cargo xtask node-build)");
        return None;
    };
    let mut board: Board = emulated.power_up(None).expect("powers up");
    let inputs = &mut board.chip_mut().inputs;
    (inputs.supply_v, inputs.temperature_c) = (3.25, 61.0);
    inputs.analogue = std::sync::Arc::new(|time_s| 0.4 + 0.05 * (3000.0 * time_s).sin());
    Some(Line::open(board, 0))
}

#[test]
fn claim_the_command_shows_the_device_sets_its_clock_and_writes_both_files() {
    let Some(line) = node("health") else { return };
    let folder = folder("health");
    let (json, page) = (text(&folder.join("health.json")), text(&folder.join("health.html")));
    // Values, and with them the bias, take a second.
    let shown = accepted(&["monitor", &line.port, "--frames", "6"]);
    assert!(shown.contains("device 3.2"), "{shown}");
    let shown = accepted(&["health", &line.port, "--set-clock", "--json", &json, "--report", &page]);
    for part in ["supply", "3.25", " V\n", "degrees Celsius", "bias of the sensor", "1.30", "time of day", "not known"]
    {
        assert!(shown.contains(part), "`{part}` in {shown}");
    }
    let written: Value = serde_json::from_str(&std::fs::read_to_string(&json).expect("written")).expect("JSON");
    let said = &written["health"];
    let number = |value: &Value| value.as_f64().unwrap_or_else(|| panic!("a number, not {value}"));
    assert!(
        (number(&said["supply_v"]) - 3.25).abs() < 0.01 && (number(&said["temperature_c"]) - 61.0).abs() < 2.0,
        "{said}"
    );
    assert!((number(&said["bias_v"]) - 0.4 * 3.25).abs() < 0.02, "{said}");
    assert_eq!(said["started"], "Power");
    // The board's clock goes as fast as this machine runs it: the time told a moment before is what can be judged.
    let now_us = SystemTime::now().duration_since(UNIX_EPOCH).expect("after 1970").as_micros() as f64;
    let off_us = (number(&said["wall_time"]["unix_us"]) - now_us).abs();
    assert!(off_us < 30e6, "{off_us} us off: {said}");
    let page = std::fs::read_to_string(&page).expect("written");
    assert!(page.contains("temperature of the chip") && page.contains("stm32f405"));
    let kept = accepted(&["health", &line.port]);
    assert!(kept.contains("told "), "the node carries the time on: {kept}");
}

#[test]
fn fault_ports_without_a_node_and_results_in_the_way_are_refused_in_one_line() {
    refused(&["health", "/dev/no-such-port"], &["/dev/no-such-port"]);
    refused(&["health", "tcp:127.0.0.1:1"], &["tcp:127.0.0.1:1", "refused"]);
    let folder = folder("health-refused");
    let json = text(&folder.join("health.json"));
    std::fs::write(&json, "somebody's").expect("writable");
    refused(&["health", "tcp:127.0.0.1:1", "--json", &json], &["health.json"]);
    assert_eq!(std::fs::read_to_string(&json).expect("there"), "somebody's");
}
