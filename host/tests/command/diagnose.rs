//! `meshband diagnose` (alias `loop`) from the command line, at the level that a record allows.

#[path = "../../signal_based/tests/signal_based/generator.rs"]
#[allow(dead_code, reason = "the generator serves the tests of the signal-based diagnosis, too")]
mod generator;

use crate::common;
use generator::{BENCH, Bench, Line};

/// A record that takes a fraction of a second.
const SMALL_BENCH: Bench = Bench { seconds: 6.0, rate_hz: 4096.0, speed_hz: 16.0, channels: 1, ..BENCH };

#[test]
fn theory_the_command_runs_at_the_level_that_the_record_allows_and_writes_its_results() {
    let folder = common::folder("kinematic");
    let path = common::text(&folder.join("record"));
    SMALL_BENCH
        .record(&[Line { order: 37.0, hz: 0.0, amplitude: 0.2, phase: 1.0 }], &[])
        .write(&folder.join("record"))
        .expect("written");
    let [json, page] = ["out.json", "out.html"].map(|name| common::text(&folder.join(name)));
    let text = common::accepted(&["loop", &path, "--json", &json, "--report", &page]);
    assert!(text.starts_with("signal-based inference: named: pinion-ghost-order"), "{text}");
    let value: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(&json).expect("read")).expect("JSON");
    for key in ["declared", "calibrated", "corrected", "noise_floor"] {
        assert!(value["held_out"][key].as_f64().is_some(), "{key}");
    }
    assert_eq!((value["level"].as_str(), value["record"].as_str()), (Some("signal-based"), Some("record")));
    assert!(value["limits"].as_array().is_some_and(|l| l.len() > 4) && value["split"]["kind"].is_string());
    assert!(std::fs::read_to_string(&page).expect("read").contains("Error in three stages"));
    common::refused(&["loop", &path, "--level", "dynamic"], &["model-based inference", "torque of run 0", "stiffness"]);
    let mut bare = SMALL_BENCH.record(&[], &[]);
    bare.declaration.rest.remove("pair");
    bare.declaration.tach = None;
    bare.declaration.runs[0].tach = None;
    bare.runs[0].declaration.tach = None;
    bare.runs[0].edges_s.clear();
    bare.write(&folder.join("bare")).expect("written");
    common::refused(&["loop", &common::text(&folder.join("bare"))], &["tooth counts", "speed reference"]);
}
