//! A second sensor at the flashed image: both converters sampled at the same triggers, its values those of its own
//! signal, frames those of the host on the same codes, and room in the block buffers at the highest rate; it comes
//! and goes while the node runs.

use super::compared::load::{SPEEDS_HZ, configured_for, run};
use super::compared::{Node, STARTED_S, configuration, machine, turns};
use super::image::image;
use meshband::alarm::{AlarmBand, Watched};
use meshband::board::Timing;
use meshband::config::{Configuration, ConfigurationError, SecondSensor};
use meshband::events::{EventKind, OF_SECOND};
use meshband::message::{ChannelValues, Indicators, Message, Reply, Request};
use meshband::units::{Acceleration, Hertz};
use meshband_emulator::world::Analogue;
use std::f64::consts::TAU;
use std::sync::Arc;

/// Codes of the converter's range.
const CODES: f64 = 65_536.0;
/// What a code of the second sensor means, m/s^2.
const M_S2_PER_CODE: f32 = 0.001;
/// Turns of the shaft per second.
const SPEED_HZ: f64 = 20.0;

fn two(config: Configuration) -> Configuration {
    let second = SecondSensor {
        acceleration_per_code: Acceleration(M_S2_PER_CODE),
        band: Hertz(10_000.0),
        ..SecondSensor::default()
    };
    let mut config = Configuration { second: Some(second), ..config };
    config.limits.highest_adc = Hertz(config.limits.highest_adc.0.min(highest_of_two().0));
    config
}

fn highest_of_two() -> Hertz {
    Timing::STM32F405.highest_of_two.expect("two converters")
}

/// A tone in the velocity's band and one above it, about a bias beside the middle.
fn tones() -> Analogue {
    Arc::new(|time_s| 0.48 + 0.1 * (TAU * 120.0 * time_s).cos() + 0.05 * (TAU * 3_000.0 * time_s).sin())
}

fn started(test: &str, config: &Configuration, until_s: f64) -> Option<Node> {
    let mut node = Node::new(&image(test)?, config);
    node.board.set_analogue(machine(SPEED_HZ));
    node.board.set_second(tones());
    node.board.add_tach_edges(&turns(SPEED_HZ, STARTED_S, until_s));
    Some(node)
}

fn values(node: &Node) -> Vec<Indicators> {
    let values = |message| if let Message::Indicators(values) = message { Some(values) } else { None };
    node.messages().into_iter().filter_map(values).collect()
}

fn good(node: &Node) -> Vec<ChannelValues> {
    values(node).iter().filter_map(|values| values.second).filter(|second| second.quality.is_good()).collect()
}

#[test]
fn regress_both_channels_are_the_hosts_frame_by_frame_and_the_second_ones_values_its_signals() {
    let Some(mut node) = started("two channels", &two(configuration()), 6.0) else { return };
    node.run_until(6.0);
    assert!(node.blocks.len() > 2_000 && node.broken == 0, "{} blocks, {} broken", node.blocks.len(), node.broken);
    assert!(node.blocks.iter().all(|block| block.second.len() == 256 && block.codes.len() == 256));
    let comparison = node.compare();
    assert!(comparison.is_equal() && comparison.frames > 25, "{comparison:?}");

    let (scale, of_two) = (CODES * f64::from(M_S2_PER_CODE), good(&node));
    assert!(of_two.len() >= 3, "{}", of_two.len());
    let rms = scale * ((0.1f64.powi(2) + 0.05f64.powi(2)) / 2.0).sqrt();
    let velocity = scale * 0.1 / (TAU * 120.0) / 2f64.sqrt();
    for second in &of_two {
        let near = |value: f32, wanted: f64, share: f64| (f64::from(value) / wanted - 1.0).abs() < share;
        assert!(near(second.rms, rms, 0.001), "RMS {} of {rms}", second.rms);
        assert!(near(second.velocity_rms, velocity, 0.002), "velocity {} of {velocity}", second.velocity_rms);
        assert!(near(second.peak, 0.15 * scale, 0.01), "peak {}", second.peak);
        assert!((f64::from(second.mean_code) - 0.48 * CODES).abs() < 20.0, "bias {}", second.mean_code);
        assert_eq!((second.passed_hz, second.quality.turns), (10_000.0, 20));
    }
    let first = values(&node).into_iter().filter(|values| values.quality.is_good()).collect::<Vec<_>>();
    assert!(first.iter().all(|values| values.rms > 100.0), "the first one keeps its own scale");
}

#[test]
fn regress_two_channels_at_the_highest_rate_lose_no_block_and_leave_a_third_of_the_buffers() {
    let Some(image) = image("two channels at the highest rate") else { return };
    let accepted = highest_of_two();
    let mut config = two(configured_for(f64::from(accepted.0)));
    config.limits.highest_adc = accepted;
    for speed_hz in SPEEDS_HZ {
        let outcome = run(&image, &config, 2.0, speed_hz);
        let free = outcome.buffers_free();
        println!(
            "{speed_hz} turns/s, two channels of {:.1} kHz: load {:.0} %, {:.0} % of the buffers free at worst",
            outcome.rate_hz / 1e3,
            100.0 * outcome.load,
            100.0 * free
        );
        assert!((outcome.rate_hz / f64::from(accepted.0) - 1.0).abs() < 0.01, "{} Hz", outcome.rate_hz);
        assert!(outcome.lost == 0 && outcome.spectra >= 3, "{outcome:?}");
        assert!(free >= 0.3, "{speed_hz} turns/s: {} blocks waited", outcome.most_waiting);
    }
}

#[test]
fn regress_a_second_sensor_comes_and_goes_while_the_node_runs() {
    let Some(mut node) = started("a second sensor comes and goes", &configuration(), 14.0) else { return };
    node.run_until(3.0);
    assert!(values(&node).iter().all(|values| values.second.is_none()), "none before");
    node.ask(Request::SetConfiguration(two(configuration())));
    node.run_for(5.0);
    let joined = good(&node);
    assert!(joined.len() >= 3, "{}", joined.len());
    assert!(node.blocks.last().is_some_and(|block| block.second.len() == 256));
    node.ask(Request::SetConfiguration(configuration()));
    node.run_for(4.0);
    assert!(node.blocks.last().is_some_and(|block| block.second.is_empty() && block.codes.len() == 512));
    assert!(values(&node).last().is_some_and(|values| values.second.is_none() && values.quality.is_good()));
    assert_eq!(node.resets(), 0);
}

#[test]
fn fault_a_clipped_second_sensor_raises_what_it_exceeds_and_a_dead_one_clears_nothing() {
    let alarm = AlarmBand {
        watched: Watched::SecondRms,
        from: Hertz(0.0),
        to: Hertz(100.0),
        raise: 8.0,
        clear: 4.0,
        persistence: 1,
    };
    let mut config = two(configuration());
    config.holding.watch_signal = true;
    config.alarms.push(alarm).expect("room");
    let Some(mut node) = started("a bad second sensor", &config, 16.0) else { return };
    node.run_until(4.0);
    assert!(node.details(EventKind::SignalBad).is_empty() && node.details(EventKind::AlarmRaised).is_empty());
    // A square wave from rail to rail, then nothing at all, then a strong tone.
    node.board.set_second(Arc::new(|time_s| if (TAU * 120.0 * time_s).cos() > 0.0 { 1.1 } else { -0.1 }));
    node.run_for(3.0);
    assert!(node.details(EventKind::Saturated).iter().any(|detail| detail & OF_SECOND != 0));
    assert_eq!(node.details(EventKind::SignalBad), [4], "clipped, of the second sensor alone");
    node.board.set_second(Arc::new(|_| 0.5));
    node.run_for(3.0);
    assert!(node.details(EventKind::Stuck).iter().any(|detail| detail & OF_SECOND != 0));
    assert_eq!(node.details(EventKind::AlarmRaised), [0], "what is clipped is at least as large");
    assert!(node.details(EventKind::AlarmCleared).is_empty(), "a dead sensor is no sound machine");
    node.board.set_second(Arc::new(|time_s| 0.5 + 0.3 * (TAU * 120.0 * time_s).cos()));
    node.run_for(4.0);
    assert_eq!(node.details(EventKind::AlarmRaised), [0]);
    assert!(
        values(&node).iter().all(|values| !values.quality.overload && !values.quality.stuck),
        "the first one is well"
    );
}

#[test]
fn fault_a_rate_that_two_channels_cannot_have_is_refused() {
    let Some(mut node) = started("two channels too fast", &configuration(), 3.0) else { return };
    node.run_until(1.0);
    let mut config = two(configuration());
    config.limits.highest_adc = Timing::STM32F405.highest_adc;
    node.ask(Request::SetConfiguration(config));
    node.run_for(0.5);
    let refused =
        |packet| matches!(packet, meshband::frame::Packet::Reply(Reply::Refused(ConfigurationError::HighestOfTwo)));
    assert!(node.packets().into_iter().any(refused));
    assert!(node.board.chip().now > 0 && good(&node).is_empty());
}
