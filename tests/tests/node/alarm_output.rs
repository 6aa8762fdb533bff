//! From the signal to the relay: the node's alarm through the output's driver to the level of a pin.

use embedded_hal::digital::{ErrorType, OutputPin};
use meshband::alarm::{AlarmBand, Watched};
use meshband::config::Configuration;
use meshband::events::EventKind;
use meshband::message::Message;
use meshband::node::{Block, Node};
use meshband::units::{Acceleration, Hertz, TicksPerSecond};
use meshband_drivers::alarm_output::{AlarmOutput, Practice, Transition};
use meshband_drivers::switch::Polarity;
use std::cell::RefCell;
use std::convert::Infallible;
use std::f64::consts::TAU;

const BLOCK: usize = 512;
const CLOCK: u32 = 25_000_000;
const M_S2_PER_CODE: f64 = 0.01;
/// Turns of the pinion per second, one tach pulse each.
const SPEED: u32 = 10;

/// Keeps its levels.
struct Relay<'r>(&'r RefCell<Vec<bool>>);

impl ErrorType for Relay<'_> {
    type Error = Infallible;
}

impl OutputPin for Relay<'_> {
    fn set_low(&mut self) -> Result<(), Infallible> {
        self.0.borrow_mut().push(false);
        Ok(())
    }

    fn set_high(&mut self) -> Result<(), Infallible> {
        self.0.borrow_mut().push(true);
        Ok(())
    }
}

fn configuration() -> Configuration {
    let mut config = Configuration::default();
    config.sensor.acceleration_per_code = Acceleration(M_S2_PER_CODE as f32);
    let alarm =
        AlarmBand { watched: Watched::Peak, from: Hertz(5.0), to: Hertz(20.0), raise: 5.0, clear: 3.0, persistence: 2 };
    config.alarms.push(alarm).expect("room for one");
    config
}

#[test]
fn theory_the_relay_falls_while_the_nodes_alarm_stands() {
    let mut node = Box::new(Node::new(configuration(), TicksPerSecond(CLOCK)).expect("a sound configuration"));
    let levels = RefCell::new(Vec::new());
    let minimum = u64::from(CLOCK);
    let mut output = AlarmOutput::new(Relay(&levels), Polarity::ActiveHigh, Practice::EnergisedInHealth, minimum);
    let (mut transitions, mut raised, mut was_raised) = (Vec::new(), false, false);
    // Loud from 4 s to 8 s of 12 s; the tick counter wraps at 6 s.
    let start = (1u64 << 32) - 6 * u64::from(CLOCK);
    let (mut first, mut next_edge, mut sequence) = (start, start, 0);
    while first < start + 12 * u64::from(CLOCK) {
        let period = node.requested_period_ticks();
        let codes: Vec<u16> = (0..BLOCK as u64)
            .map(|n| {
                let seconds = (first - start + n * u64::from(period)) as f64 / f64::from(CLOCK);
                let amplitude = if (4.0..8.0).contains(&seconds) { 10.0 } else { 1.0 };
                let mesh = (TAU * (20.0 * f64::from(SPEED) * seconds).fract()).sin();
                (amplitude * mesh / M_S2_PER_CODE + 32_768.0) as u16
            })
            .collect();
        let end = first + BLOCK as u64 * u64::from(period);
        while next_edge < end {
            node.on_tach_edge(next_edge as u32);
            next_edge += u64::from(CLOCK / SPEED);
        }
        node.on_block(Block {
            codes: &codes,
            second: &[],
            first_tick: first as u32,
            period_ticks: period,
            sequence,
            overrun: false,
        });
        (sequence, first) = (sequence + 1, end);
        while let Some(message) = node.poll(end as u32) {
            match message {
                Message::Event(event) if event.kind == EventKind::AlarmRaised => raised = true,
                Message::Event(event) if event.kind == EventKind::AlarmCleared => raised = false,
                _ => {}
            }
        }
        assert_eq!(node.alarm_stands(), raised, "as its events say");
        was_raised |= raised;
        let Ok(transition) = output.update(node.alarm_stands(), end as u32);
        transitions.extend(transition);
    }
    assert!(was_raised, "the loud signal raises the alarm");
    assert_eq!(transitions, [Transition::Started, Transition::Raised, Transition::Stood, Transition::Cleared]);
    assert_eq!(*levels.borrow(), [true, false, true]);
}
