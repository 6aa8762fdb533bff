//! The released image in the emulated chip sends the frames of the host, byte for byte.

use meshband::config::{Configuration, GearPair, TrainGear};
use meshband::events::EventKind;
use meshband::message::Message;
use meshband_host::virtual_node::emulated::reference;
use meshband_host::virtual_node::emulated::run::{Emulated, Feed, Heard};
use meshband_host::virtual_node::frames::Received;
use meshband_host::virtual_node::signal::{Second, Signal, Unit};
use meshband_host::virtual_node::trial;
use std::f64::consts::TAU;
use std::sync::Arc;

const TEETH: u16 = 19;

/// The board, or `None` after saying why the test is skipped.
fn board(test: &str) -> Option<Emulated> {
    let board = Emulated::of_board();
    if board.is_none() {
        println!("skipped {test}: Unicorn or the firmware image is absent (cargo xtask setup, cargo xtask node-build)");
    }
    board
}

fn configuration() -> Configuration {
    Configuration { gears: GearPair { pinion_teeth: TEETH, gear_teeth: 48 }, ..Configuration::default() }
}

/// Five mesh harmonics with a sideband of the shaft, at `turns(t)`.
fn signal(turns: impl Fn(f64) -> f64 + Send + Sync + 'static) -> Arc<dyn Fn(f64) -> f64 + Send + Sync> {
    Arc::new(move |time_s| {
        let turn = turns(time_s);
        let mesh = TAU * turn * f64::from(TEETH);
        let modulation = 1.0 + 0.2 * (TAU * turn).cos();
        let sum: f64 = (1..=5).map(|h| (f64::from(h) * mesh).cos() / f64::from(h)).sum();
        0.5 + 0.15 * modulation * sum
    })
}

/// Instants of whole turns, s; none so late that it would still be in the input's filter at the end.
fn edges(turns: impl Fn(f64) -> f64, duration_s: f64) -> Vec<f64> {
    let (duration_s, step_s) = (duration_s - 0.01, 1e-4);
    let mut found = Vec::new();
    let mut time_s = 0.0;
    while time_s < duration_s {
        let (before, after) = (turns(time_s), turns(time_s + step_s));
        if after.floor() > before.floor() {
            found.push(time_s + step_s * (after.floor() - before) / (after - before));
        }
        time_s += step_s;
    }
    found
}

/// Plays a signal at `turns(t)` with these edges and asserts that every frame is the host's.
fn assert_equal_frames(board: &Emulated, duration_s: f64, turns: fn(f64) -> f64, edges_s: &[f64]) -> Heard {
    assert_equal_frames_of(board, &configuration(), signal(turns), (duration_s, edges_s))
}

/// Plays a signal to a node of a configuration and asserts that every frame is the host's.
fn assert_equal_frames_of(
    board: &Emulated,
    config: &Configuration,
    analogue: Arc<dyn Fn(f64) -> f64 + Send + Sync>,
    (duration_s, edges_s): (f64, &[f64]),
) -> Heard {
    let feed = Feed { analogue, second: None, edges_s, duration_s, config: Some(config) };
    let heard = board.run(&feed).expect("runs to its end");
    let comparison = reference::compare(&heard, config).expect("the host runs it");
    println!(
        "{} of {} frames, {} blocks, {} edges, {:.0} M instructions in {:.1} s",
        comparison.first_difference.unwrap_or(comparison.frames),
        comparison.frames,
        heard.blocks.len(),
        heard.edges.len(),
        heard.instructions as f64 / 1e6,
        heard.wall_time.as_secs_f64()
    );
    assert_eq!((heard.broken, heard.resets, heard.edges.len()), (0, 0, edges_s.len()));
    assert!(comparison.is_equal(), "{comparison:?}");
    heard
}

#[test]
fn golden_released_image_and_host_send_the_same_frames_at_steady_speed() {
    let Some(board) = board("steady speed") else { return };
    let turns = |time_s: f64| 25.0 * time_s + 0.9;
    let heard = assert_equal_frames(&board, 20.0, turns, &edges(turns, 20.0));
    let spectra = Received::decode(&heard.link).spectra().count();
    assert!(spectra >= 5, "{spectra} spectra");
}

#[test]
fn golden_released_image_and_host_send_the_same_frames_in_a_run_up() {
    let Some(board) = board("run-up") else { return };
    let turns = |time_s: f64| time_s + 24.0 * time_s * time_s / 40.0;
    let heard = assert_equal_frames(&board, 20.0, turns, &edges(turns, 20.0));
    let mut periods: Vec<u32> = heard.blocks.iter().map(|block| block.period).collect();
    periods.dedup();
    assert!(periods.len() >= 3, "the rate follows the speed: {periods:?}");
}

#[test]
fn golden_released_image_and_host_send_the_same_frames_when_the_tach_is_lost_and_comes_back() {
    let Some(board) = board("lost tach") else { return };
    let turns = |time_s: f64| 25.0 * time_s + 0.9;
    let mut edges = edges(turns, 20.0);
    edges.retain(|time_s| !(7.0..13.0).contains(time_s));
    let heard = assert_equal_frames(&board, 20.0, turns, &edges);
    let received = Received::decode(&heard.link);
    let events: Vec<EventKind> = received
        .messages()
        .filter_map(|message| if let Message::Event(event) = message { Some(event.kind) } else { None })
        .collect();
    let count = |kind| events.iter().filter(|event| **event == kind).count();
    let noticed = count(EventKind::TachStalled) + count(EventKind::TachDoubtful);
    assert!(noticed >= 1 && count(EventKind::TachLocked) == 2, "{events:?}");
}

/// Four stages, five further gears: 19/48, 21/65, a planetary set of 84 and 24 (by its carrier), 18/54.
fn four_stages() -> (Configuration, Arc<dyn Fn(f64) -> f64 + Send + Sync>) {
    let gear = |stage, [teeth, mate_teeth]: [u16; 2], [turns, pinion_turns]: [u32; 2]| TrainGear {
        stage,
        teeth,
        mate_teeth,
        turns,
        pinion_turns,
    };
    let third = [19 * 21 * 2, 48 * 65 * 9];
    let gears = [
        gear(1, [48, 19], [19, 48]),
        gear(2, [21, 65], [19, 48]),
        gear(2, [65, 21], [19 * 21, 48 * 65]),
        gear(3, [84, 24], third),
        gear(4, [18, 54], third),
    ];
    let mut config = configuration();
    config.train.extend(gears);
    let meshes = gears.map(|gear| f64::from(gear.teeth) * f64::from(gear.turns) / f64::from(gear.pinion_turns));
    let level = move |time_s: f64| {
        let turn = 25.0 * time_s + 0.9;
        let sum: f64 = meshes.iter().map(|order| (TAU * (order * turn).fract()).cos()).sum();
        0.5 + 0.06 * sum
    };
    (config, Arc::new(level))
}

#[test]
fn golden_released_image_and_host_send_the_same_frames_of_a_train_of_four_stages() {
    let Some(board) = board("train") else { return };
    let (config, level) = four_stages();
    let turns = |time_s: f64| 25.0 * time_s + 0.9;
    // A round takes some 50 s, most of it the slow gears': each must have been followed once.
    let seconds = 75.0;
    let heard = assert_equal_frames_of(&board, &config, level, (seconds, &edges(turns, seconds)));
    let received = Received::decode(&heard.link);
    let of_gear = |wanted: u8| {
        received.messages().any(|message| matches!(message, Message::GearSpectrum(of) if of.gear == wanted))
    };
    assert!((1..=5).all(of_gear) && received.spectra().count() > 0);
}

/// A record of tones at the bearings as a user has it, through the same way as `meshband node --board stm32f405`.
#[test]
fn ref_mesh_lines_of_a_record_on_the_emulated_board_are_those_of_the_f64_reference() {
    let Some(board) = board("record") else { return };
    let (rate_hz, seconds, speed_hz) = (51_200.0, 4.0, 20.0);
    let level = signal(move |time_s| speed_hz * time_s);
    let of_second = |time_s: f64| 3.0 * (TAU * 160.0 * time_s).cos() + (TAU * 2_400.0 * time_s).sin();
    let record = Signal {
        title: "tones".into(),
        place: "tones".into(),
        channel: "bearing".into(),
        unit: Unit::Acceleration,
        samples: (0..(seconds * rate_hz) as usize).map(|n| 40.0 * (level(n as f64 / rate_hz) - 0.5)).collect(),
        second: Some(Second {
            channel: "motor".into(),
            samples: (0..(seconds * rate_hz) as usize).map(|n| of_second(n as f64 / rate_hz)).collect(),
        }),
        rate_hz,
        edges_s: (0..(seconds * speed_hz) as usize).map(|n| n as f64 / speed_hz).collect(),
        pulses_per_turn: 1,
        pinion_per_tach: 1.0,
        teeth: [TEETH.into(), 48],
        train: Vec::new(),
        machine_hash: None,
        notes: Vec::new(),
    };
    let config = meshband_host::virtual_node::setup::configuration(&record, None).expect("accepted");
    let trial = trial::run(&record, &config, &board, 1).expect("runs");
    let i = &trial.integrity;
    assert!(i.identical_to_host && i.on_schedule, "{i:?}");
    assert_eq!((i.blocks_lost, i.edges_lost, i.frames_lost), (0, 0, 0), "{i:?}");
    assert!(!trial.spectra.is_empty(), "{} spectra, {} not compared", trial.spectra.len(), trial.uncompared);
    assert!(trial.worst_harmonics.lines >= 5);
    // Twelve bits, and edges on a grid of 1.5 us.
    assert!(trial.worst_harmonics.frequency_error < 5e-4, "{:?}", trial.worst_harmonics);
    assert!(trial.worst_harmonics.amplitude_error_db < 0.2, "{:?}", trial.worst_harmonics);
    // The second sensor over the same turns.
    assert!(trial.second.len() >= 2, "{:?}", trial.second);
    for row in &trial.second {
        assert!(row.rms_error().abs() < 1e-3 && row.turns == 20, "{row:?}");
        assert!((row.kurtosis / row.reference_kurtosis - 1.0).abs() < 1e-2, "{row:?}");
        let velocity = 3.0 / (TAU * 160.0) / 2f64.sqrt();
        assert!((row.velocity_rms / velocity - 1.0).abs() < 5e-3, "{row:?}");
    }
}
