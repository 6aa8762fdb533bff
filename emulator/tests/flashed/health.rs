//! The flashed image as a device: supply, temperature and bias as the chip's inputs are, its clock against pulses per
//! second, the time of day.

use super::compared::{STARTED_S, configuration, machine, turns};
use super::image::image;
use super::spoken::Node;
use meshband::board::Timing;
use meshband::config::SecondSensor;
use meshband::health::Health;
use meshband::message::{Reply, Request};
use meshband::node::wall_time::ToldTime;
use std::sync::Arc;

/// Kinds of the board's own events.
const SUPPLY: u32 = 9;
const TEMPERATURE: u32 = 10;

fn health(node: &mut Node) -> Health {
    match node.ask(&Request::GetHealth) {
        Reply::Health(health) => health,
        other => panic!("{other:?}"),
    }
}

#[test]
fn claim_supply_temperature_and_bias_are_those_of_the_chips_inputs() {
    let Some(image) = image("health") else { return };
    let mut node = Node::new(&image);
    node.board.set_analogue(Arc::new(|time_s| 0.5 + 0.1 * (2000.0 * time_s).sin()));
    node.board.set_second(Arc::new(|time_s| 0.31 + 0.1 * (900.0 * time_s).sin()));
    node.start();
    let mut config = configuration();
    config.second = Some(SecondSensor::default());
    config.limits.highest_adc = Timing::STM32F405.highest_of_two.expect("two converters");
    node.configure(&config);
    for (supply_v, temperature_c) in [(3.3, 30.0), (3.25, 71.0), (3.36, -18.0)] {
        let inputs = &mut node.board.chip_mut().inputs;
        (inputs.supply_v, inputs.temperature_c) = (supply_v, temperature_c);
        node.run(4.0);
        let said = health(&mut node);
        println!("{supply_v} V, {temperature_c} degrees: {said:?}");
        let near =
            |value: Option<f32>, wanted: f64, within: f64| (f64::from(value.expect("known")) - wanted).abs() < within;
        assert!(near(said.supply_v, supply_v, 0.002 * supply_v), "{said:?}");
        assert!(near(said.temperature_c, temperature_c, 1.0), "{said:?}");
        assert!(near(said.bias_v, 0.5 * supply_v, 0.003 * supply_v), "{said:?}");
        assert!(near(said.second_bias_v, 0.31 * supply_v, 0.003 * supply_v), "{said:?}");
        assert_eq!((said.second_pulse, said.wall_time), (None, None));
    }
    assert!(node.board_events(SUPPLY).is_empty(), "within 3 %");
}

#[test]
fn fault_a_low_supply_and_a_hot_chip_are_events_of_the_board() {
    let Some(image) = image("health events") else { return };
    let mut node = Node::new(&image);
    node.start();
    node.run(2.0);
    let inputs = &mut node.board.chip_mut().inputs;
    (inputs.supply_v, inputs.temperature_c) = (3.0, 97.0);
    node.run(3.0);
    let supply = node.board_events(SUPPLY);
    assert!(supply.len() == 1 && (2_950..3_210).contains(&supply[0]), "{supply:?}");
    let kelvins = node.board_events(TEMPERATURE);
    assert!(kelvins.len() == 1 && (358..=371).contains(&kelvins[0]), "{kelvins:?}");
}

#[test]
fn claim_pulses_per_second_tell_the_clocks_error_and_steer_the_time_of_day() {
    const FAST_PPM: f64 = 25.0;
    let Some(image) = image("pulses per second") else { return };
    let mut node = Node::new(&image);
    node.board.set_analogue(machine(20.0));
    node.board.add_tach_edges(&turns(20.0, STARTED_S, 12.0));
    // A crystal that is fast sees each true second last longer.
    let pulses: Vec<f64> = (1..12).map(|n| 0.123 + f64::from(n) * (1.0 + FAST_PPM * 1e-6)).collect();
    node.board.add_second_pulses(&pulses);
    node.start();
    let told = ToldTime { unix_us: 1_800_000_000_000_000, uncertainty_us: 1_000 };
    let told_s = node.board.seconds();
    assert!(matches!(node.ask(&Request::SetWallTime(told)), Reply::Health(_)));
    node.run(10.0);
    let asked_s = node.board.seconds();
    let said = health(&mut node);
    let answered_s = node.board.seconds();
    let pulse = said.second_pulse.expect("pulses");
    println!("{pulse:?} {:?}", said.wall_time);
    assert!((f64::from(pulse.fast_ppm) - FAST_PPM).abs() < 0.1, "{pulse:?}");
    assert!(pulse.pulses >= 9 && pulse.refused == 0 && pulse.uncertainty_ppm < 0.1, "{pulse:?}");
    let wall = said.wall_time.expect("told");
    let since_us = (wall.unix_us - told.unix_us) as f64;
    let slack_us = wall.uncertainty_us as f64;
    assert!(slack_us < 30_000.0, "{wall:?}");
    let (least, most) = ((asked_s - told_s) * 1e6 - slack_us, (answered_s - told_s) * 1e6 + slack_us);
    assert!((least..most).contains(&since_us), "{since_us} us within {least} and {most}");
}
