//! Alarms of the released image through what happens to a machine and its node: tach off, converter at its rails,
//! crash, power cut. The alarm output is what counts: high while all is well, low otherwise.

use super::image::image;
use super::outputs::{ALARM, history, watched};
use super::spoken::Node;
use meshband::alarm::AlarmHolding;
use meshband::config::{Configuration, SensorSupply};
use meshband::events::EventKind;
use meshband::frame::Packet;
use meshband::message::{AlarmState, Message, Reply, Request};
use std::f64::consts::TAU;
use std::sync::Arc;

/// Amplitudes, as shares of the converter's range: well, beyond the limit, beyond the rails.
const QUIET_AMPLITUDE: f64 = 0.005;
const LOUD_AMPLITUDE: f64 = 0.4;
const CLIPPED_AMPLITUDE: f64 = 0.9;

fn configuration(latching: bool) -> Configuration {
    let holding = AlarmHolding { latching, persistence_s: 0.0, watch_signal: true };
    Configuration { holding, ..watched(SensorSupply::Off) }
}

/// A sine whose amplitude changes at instants, s.
fn signal(node: &mut Node, course: &'static [(f64, f64)]) {
    node.board.set_analogue(Arc::new(move |time_s| {
        let amplitude = course
            .iter()
            .rev()
            .find(|(from_s, _)| time_s >= *from_s)
            .map_or(QUIET_AMPLITUDE, |(_, amplitude)| *amplitude);
        (0.5 + amplitude * (TAU * 500.0 * time_s).sin()).clamp(0.0, 1.0)
    }));
}

/// A shaft at 25 Hz between two instants, s.
fn turning(node: &mut Node, from_s: f64, to_s: f64) {
    let edges: Vec<f64> = (0..).map(|n| from_s + 0.04 * f64::from(n)).take_while(|&edge| edge < to_s).collect();
    node.board.add_tach_edges(&edges);
}

/// The newest status's alarms.
fn alarms(node: &Node) -> AlarmState {
    let newest = node.heard.iter().rev().find_map(|packet| match packet {
        Packet::Message(Message::Status(status)) => Some(status.alarms),
        _ => None,
    });
    newest.expect("a status every second")
}

fn levels(node: &mut Node) -> Vec<bool> {
    history(node, ALARM).iter().map(|change| change.1).collect()
}

#[test]
fn fault_an_alarm_stands_at_the_output_when_its_tach_is_lost() {
    let Some(image) = image("alarm without a tach") else { return };
    let mut node = Node::new(&image);
    signal(&mut node, &[(2.0, LOUD_AMPLITUDE), (6.0, QUIET_AMPLITUDE)]);
    turning(&mut node, 0.1, 5.0);
    turning(&mut node, 11.0, 16.0);
    node.start();
    node.configure(&configuration(false));
    node.run(10.0);
    assert_eq!((alarms(&node).raised, levels(&mut node)), (1, vec![true, false]), "well again at which speed?");
    node.run(5.5);
    assert_eq!((alarms(&node).standing, levels(&mut node)), (0, vec![true]), "well at 25 Hz");
}

#[test]
fn fault_a_clipped_signal_is_an_alarm_of_its_own_and_raises_what_it_exceeds() {
    let Some(image) = image("clipped signal") else { return };
    let mut node = Node::new(&image);
    signal(&mut node, &[(3.0, CLIPPED_AMPLITUDE), (7.0, QUIET_AMPLITUDE)]);
    turning(&mut node, 0.1, 12.0);
    node.start();
    node.configure(&configuration(false));
    node.run(6.5);
    let state = alarms(&node);
    assert!(state.signal_bad && state.standing == 1, "what is clipped is at least as large: {state:?}");
    assert_eq!(levels(&mut node), [true, false]);
    node.run(5.0);
    assert!(!alarms(&node).signal_bad);
    assert_eq!(levels(&mut node), [true]);
}

#[test]
fn fault_a_latched_alarm_stands_at_the_output_through_a_crash_and_a_power_cut_until_a_person_has_seen_it() {
    let Some(image) = image("latched alarm") else { return };
    let mut node = Node::new(&image);
    signal(&mut node, &[(2.0, LOUD_AMPLITUDE), (5.0, QUIET_AMPLITUDE)]);
    turning(&mut node, 0.1, 30.0);
    node.start();
    node.configure(&configuration(true));
    node.commit();
    node.run(6.0);
    assert_eq!(alarms(&node).standing, 1);
    assert_eq!(levels(&mut node), [true, false]);
    // Set-enable and set-pending registers of an interrupt that nobody handles: the program restarts.
    node.forget();
    for register in [0xe000_e100, 0xe000_e200] {
        node.board.chip_mut().write(register, 4, 1 << 28).expect("served");
    }
    node.run(4.5);
    assert_eq!(node.board.seen().resets.len(), 1);
    assert_eq!((alarms(&node).standing, alarms(&node).unseen), (1, 1));
    node.cycle_power();
    node.run(4.5);
    assert_eq!((alarms(&node).standing, alarms(&node).unseen), (1, 1));
    assert_eq!(levels(&mut node), [] as [bool; 0], "never high in between, although the signal is well");
    assert_eq!(node.ask(&Request::AcknowledgeAlarms), Reply::Done);
    node.wait_for_event(EventKind::ConfigurationStored);
    node.run(2.5);
    assert_eq!((alarms(&node).standing, levels(&mut node)), (0, vec![true]));
    node.cycle_power();
    node.run(4.5);
    assert_eq!(alarms(&node).standing, 0, "and its end is kept as well");
}
