//! What the released image does at its outputs, seen from outside: light, alarm output, sensor supply, bytes to the
//! amplifier; and who it says it is.

use super::image::image;
use super::spoken::Node;
use meshband::alarm::{AlarmBand, Watched};
use meshband::config::{Configuration, FrontEnd, Gain, SensorSupply};
use meshband::message::{Reply, Request};
use meshband::rate_plan::RatePolicy;
use meshband::units::Hertz;
use std::sync::Arc;

const PORT_C: usize = 2;
pub const ALARM: u32 = 8;
const SENSOR_SUPPLY: u32 = 9;
const GAIN_FAULT: u32 = 8;

/// Words of two bytes that an amplifier has taken, since last asked: command and gain.
fn amplifier(node: &mut Node) -> Vec<[u8; 2]> {
    let bytes: Vec<u8> = std::mem::take(&mut node.board.seen().clocked)
        .into_iter()
        .map(|clocked| {
            assert!(clocked.selected, "a byte to nobody: {clocked:?}");
            clocked.byte.expect("the pins belong to the bus")
        })
        .collect();
    bytes.chunks(2).map(|word| word.try_into().expect("whole words")).collect()
}

/// Levels of a pin of port C since power, with their instants, s.
pub fn history(node: &mut Node, pin: u32) -> Vec<(f64, bool)> {
    let seen = std::mem::take(&mut node.board.seen().pins);
    let own = seen.into_iter().filter(|change| (change.port, change.pin) == (PORT_C, pin));
    own.map(|change| (node.board.chip().seconds_at(change.at), change.level)).collect()
}

/// An alarm on the signal's strength, at a low rate, so that a run is cheap.
pub fn watched(sensor_supply: SensorSupply) -> Configuration {
    let alarm = AlarmBand {
        watched: Watched::Rms,
        from: Hertz(10.0),
        to: Hertz(50.0),
        raise: 200.0,
        clear: 50.0,
        persistence: 1,
    };
    Configuration {
        policy: RatePolicy::Forced { rate: Hertz(20_000.0) },
        alarms: [alarm].into_iter().collect(),
        front_end: FrontEnd { sensor_supply, ..FrontEnd::default() },
        ..Configuration::default()
    }
}

/// A machine that turns at 25 Hz and is loud between two instants, s.
fn loud(node: &mut Node, from_s: f64, to_s: f64) {
    node.board.set_analogue(Arc::new(move |time_s| {
        let amplitude = if (from_s..to_s).contains(&time_s) { 0.4 } else { 0.005 };
        0.5 + amplitude * (std::f64::consts::TAU * 500.0 * time_s).sin()
    }));
    let edges: Vec<f64> = (1..400).map(|n| 0.04 * f64::from(n)).collect();
    node.board.add_tach_edges(&edges);
}

fn with_gain(gain: Gain) -> Configuration {
    Configuration { front_end: FrontEnd { gain, ..FrontEnd::default() }, ..Configuration::default() }
}

#[test]
fn golden_identify_names_commit_board_and_the_chips_own_number() {
    let Some(image) = image("identity") else { return };
    let mut node = Node::new(&image);
    node.board.chip_mut().unique = [0x1122_3344, 0x5566_7788, 0x99aa_bbcc];
    node.start();
    let Reply::Identity(identity) = node.ask(&Request::Identify) else { panic!("no identity") };
    assert_eq!((identity.board.as_str(), identity.ticks_per_second), ("stm32f405", 84_000_000));
    assert_eq!(identity.unique_id, [0x1122_3344, 0x5566_7788, 0x99aa_bbcc]);
    println!("build {:?}, schemas {} and {}", identity.build, identity.wire_schema, identity.configuration_schema);
    let build = identity.build.as_bytes();
    let is_hash = build.len() >= 7 && build.iter().all(u8::is_ascii_hexdigit);
    assert!(is_hash || identity.build == "unknown", "{:?}", identity.build);
}

#[test]
fn theory_gain_bytes_follow_the_configuration_at_start_and_at_a_change() {
    let Some(image) = image("gain") else { return };
    let mut node = Node::new(&image);
    node.start();
    // Instruction "write to the gain register", then the gain's code.
    assert_eq!(amplifier(&mut node), [[0x40, Gain::X1.code()]]);
    node.configure(&with_gain(Gain::X16));
    node.run(0.01);
    assert_eq!(amplifier(&mut node), [[0x40, Gain::X16.code()]]);
    node.commit();
    node.cycle_power();
    node.start();
    assert_eq!(amplifier(&mut node), [[0x40, Gain::X16.code()]], "the stored gain");
    assert_eq!(node.board_events(GAIN_FAULT), []);
}

#[test]
fn fault_amplifiers_bus_that_hangs_is_told_once_and_tried_again() {
    let Some(image) = image("fault of the amplifier's bus") else { return };
    let mut node = Node::new(&image);
    node.start();
    assert_eq!(amplifier(&mut node), [[0x40, Gain::X1.code()]]);
    node.board.chip_mut().spi2.dead = true;
    node.configure(&with_gain(Gain::X8));
    node.run(2.5);
    assert_eq!(node.board_events(GAIN_FAULT), [8], "of the gain wanted, once");
    assert_eq!(amplifier(&mut node), [] as [[u8; 2]; 0]);
    node.board.chip_mut().spi2.dead = false;
    node.run(1.1);
    assert_eq!(amplifier(&mut node), [[0x40, Gain::X8.code()]], "within a second of the bus's recovery");
    assert_eq!(node.board.seen().resets.len(), 0);
}

#[test]
fn theory_alarm_output_drops_with_the_alarm_and_rises_when_it_is_over() {
    let Some(image) = image("alarm output") else { return };
    let mut node = Node::new(&image);
    loud(&mut node, 4.0, 5.0);
    node.start();
    node.configure(&watched(SensorSupply::Off));
    node.run(9.0);
    let alarm = history(&mut node, ALARM);
    println!("alarm output: {alarm:.2?}");
    let levels: Vec<bool> = alarm.iter().map(|change| change.1).collect();
    assert_eq!(levels, [true, false, true], "healthy, alarm, healthy");
    let (dropped, risen) = (alarm[1].0, alarm[2].0);
    assert!((4.0..5.5).contains(&dropped), "{dropped}");
    assert!(risen - dropped >= 2.0, "an alarm is shown for two seconds at least");
}

#[test]
fn theory_alarm_output_says_nothing_until_the_sensor_has_settled_and_drops_with_a_crash() {
    let Some(image) = image("sensor supply") else { return };
    let mut node = Node::new(&image);
    node.start();
    node.configure(&watched(SensorSupply::On));
    node.run(4.0);
    let pins = node.board.seen().pins.clone();
    let supply = history(&mut node, SENSOR_SUPPLY);
    node.board.seen().pins = pins;
    let alarm = history(&mut node, ALARM);
    println!("sensor supply {supply:.2?}, alarm output {alarm:.2?}");
    assert_eq!((supply.len(), supply[0].1), (1, true), "on from the start");
    assert_eq!((alarm.len(), alarm[0].1), (1, true));
    let settling = alarm[0].0 - supply[0].0;
    assert!((3.0..3.1).contains(&settling), "{settling} s");
    // Set-enable and set-pending registers of an interrupt that nobody handles.
    for register in [0xe000_e100, 0xe000_e200] {
        node.board.chip_mut().write(register, 4, 1 << 28).expect("served");
    }
    node.run(0.3);
    assert_eq!(history(&mut node, ALARM).iter().map(|change| change.1).collect::<Vec<_>>(), [false]);
}

#[test]
fn theory_sensor_supply_follows_the_configuration() {
    let Some(image) = image("sensor supply") else { return };
    let mut node = Node::new(&image);
    node.start();
    for sensor_supply in [SensorSupply::Off, SensorSupply::On] {
        node.configure(&watched(sensor_supply));
        node.run(0.02);
    }
    let levels: Vec<bool> = history(&mut node, SENSOR_SUPPLY).iter().map(|change| change.1).collect();
    assert_eq!(levels, [true, false, true]);
}
