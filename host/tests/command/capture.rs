//! `meshband capture` as a user runs it: an alarm of the released image in the emulated chip, its waveform over a
//! line that damages bytes, the record, and what `meshband analyse` makes of it.

use crate::common::{accepted, folder, refused, text};
use crate::emulated_line::Line;
use meshband::alarm::{AlarmBand, Watched};
use meshband::config::{CaptureConfig, CaptureRate, Configuration, GearPair};
use meshband::units::Hertz;
use meshband::waveform::CapturePhase;
use meshband_host::link::Client;
use meshband_host::record::Record;
use meshband_host::virtual_node::emulated::run::Emulated;
use std::f64::consts::TAU;
use std::sync::Arc;
use std::time::{Duration, Instant};

const SPEED_HZ: f64 = 25.0;
const TEETH: u16 = 19;
/// Bytes of every million that are damaged, in either direction: one frame in sixteen.
const DAMAGED_PER_MILLION: u32 = 100;
/// Amplitude of the mesh at the converter, volts.
const LEVEL: f64 = 0.15;

/// Waveforms at 10 kHz, and no limit.
fn quiet() -> Configuration {
    Configuration {
        gears: GearPair { pinion_teeth: TEETH, gear_teeth: 48 },
        capture: CaptureConfig { keep: CaptureRate::Fixed, rate: Hertz(0.0) },
        ..Configuration::default()
    }
}

/// The same with a limit that the mesh is beyond.
fn watchful() -> Configuration {
    let (from, to) = (Hertz(5.0), Hertz(60.0));
    let alarm = AlarmBand { watched: Watched::Rms, from, to, raise: 0.01, clear: 0.005, persistence: 1 };
    Configuration { alarms: [alarm].into_iter().collect(), ..quiet() }
}

/// A board with this configuration, whose gears turn from the start, or `None` after saying why the test is skipped.
fn line(test: &str, configuration: &Configuration) -> Option<Line> {
    let Some(emulated) = Emulated::of_board() else {
        println!("skipped {test}: Unicorn or the firmware image is absent (cargo xtask setup, cargo xtask node-build)");
        return None;
    };
    let mut board = emulated.power_up(Some(configuration)).expect("powers up");
    board.set_analogue(Arc::new(|time_s| {
        let turn = TAU * SPEED_HZ * time_s;
        0.5 + LEVEL * (1.0 + 0.2 * turn.cos()) * (f64::from(TEETH) * turn).cos()
    }));
    let edges: Vec<f64> = (10..15_000).map(|turn| f64::from(turn) / SPEED_HZ).collect();
    board.add_tach_edges(&edges);
    Some(Line::open(board, DAMAGED_PER_MILLION))
}

fn phase(port: &str) -> CapturePhase {
    Client::open(port).expect("connects").capture(false).expect("answers").phase
}

#[test]
fn loop_an_alarm_s_waveform_crosses_a_bad_line_and_is_analysed() {
    let Some(line) = line("waveform of an alarm", &watchful()) else { return };
    let folder = folder("capture-of-an-alarm").join("record");
    let deadline = Instant::now() + Duration::from_secs(300);
    while phase(&line.port) != CapturePhase::Held {
        assert!(Instant::now() < deadline, "an alarm leaves a waveform");
        std::thread::sleep(Duration::from_millis(200));
    }
    let kept = accepted(&["capture", &line.port, "-o", &text(&folder), "--keep"]);
    assert!(kept.contains("by alarm 1") && kept.contains("still held"), "{kept}");
    let record = Record::read(&folder).expect("a record");
    let run = &record.runs[0];
    let rate_hz = record.declaration.acquisition.sample_rate_hz;
    let seconds = run.samples() as f64 / rate_hz;
    println!("{kept}{} samples at {rate_hz:.1} Hz", run.samples());
    assert!(rate_hz >= 10_000.0 && seconds >= 1.96, "{seconds} s at {rate_hz} Hz");
    assert!((48..=56).contains(&run.edges_s.len()), "{} turns", run.edges_s.len());
    let released = accepted(&["capture", &line.port, "-o", &text(&folder), "--force"]);
    assert!(released.contains("released"), "{released}");
    let again = Record::read(&folder).expect("a record");
    assert_eq!(again.runs[0].edges_s, run.edges_s, "the same waveform twice");
    assert_eq!(again.runs[0].channel_codes(0), run.channel_codes(0), "sample for sample");
    assert_ne!(phase(&line.port), CapturePhase::Held);
    let said = accepted(&["analyse", &text(&folder)]);
    println!("{said}");
    assert!(said.contains("19"), "the mesh order is among what is shown: {said}");
}

#[test]
fn fault_a_node_that_holds_none_is_asked_by_name_and_one_that_keeps_none_says_which_setting() {
    let Some(line) = line("no waveform", &quiet()) else { return };
    let folder = folder("capture-of-nothing").join("record");
    refused(&["capture", &line.port, "-o", &text(&folder)], &["holds no waveform", "--trigger"]);
    let asked = accepted(&["capture", &line.port, "-o", &text(&folder), "--trigger", "--wait", "300"]);
    assert!(asked.contains("asked for") && asked.contains("released"), "{asked}");
    let mut client = Client::open(&line.port).expect("connects");
    let kept_off = Configuration { capture: CaptureConfig::default(), ..quiet() };
    client.set_configuration(&kept_off).expect("accepted");
    refused(&["capture", &line.port, "-o", &text(&folder), "--force"], &["keeps no waveforms", "[capture] keep"]);
}
