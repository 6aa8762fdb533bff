//! A node on an STM32F405's converter and clock, driven by formulas: acceleration and pulses of time, 12-bit codes.

use meshband::board::Timing;
use meshband::config::{Configuration, GearPair};
use meshband::events::EventKind;
use meshband::law::{Law, LawForm};
use meshband::message::{Indicators, Message, Spectrum, Status};
use meshband::node::{Block, Node};
use meshband::units::{Acceleration, Hertz};

pub const BLOCK: usize = 512;
/// m/s^2 per code of 16 bit: full scale is 161 m/s^2.
pub const M_S2_PER_CODE: f64 = 0.00494;

/// A pair of 19 and 48 teeth behind a filter of 12 kHz: few samples per second.
pub fn slow_converter() -> Configuration {
    let form = LawForm::Quadratic { a_per_hz: 4.0, b: 300.0, c_hz: 200.0 };
    let mut config = Configuration {
        gears: GearPair { pinion_teeth: 19, gear_teeth: 48 },
        law: Law { form, lowest: Hertz(1.0), highest: Hertz(25.0), provisional: false, ..Law::PROVISIONAL },
        ..Configuration::default()
    };
    config.limits.analogue_stop = Hertz(12_000.0);
    config.limits.highest_adc = Hertz(40_000.0);
    config.sensor.acceleration_per_code = Acceleration(M_S2_PER_CODE as f32);
    config
}

/// The node, and what it said.
pub struct Rig {
    pub node: Box<Node>,
    ticks: u64,
    sequence: u32,
    clock_hz: f64,
    pub events: Vec<(EventKind, u32)>,
    pub indicators: Vec<Indicators>,
    pub spectra: Vec<Spectrum>,
    pub statuses: Vec<Status>,
}

impl Rig {
    pub fn new(config: Configuration) -> Self {
        let node = Box::new(Node::new(config, Timing::STM32F405).expect("a sound configuration"));
        let clock_hz = f64::from(Timing::STM32F405.clock.0);
        let (events, indicators, spectra, statuses) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        Self { node, ticks: 0, sequence: 0, clock_hz, events, indicators, spectra, statuses }
    }

    /// Seconds since the start.
    pub fn now(&self) -> f64 {
        self.ticks as f64 / self.clock_hz
    }

    /// Runs on until a time: acceleration in m/s^2 at a time, and the time of the n-th pulse, ascending.
    pub fn run(&mut self, until: f64, acceleration: impl Fn(f64) -> f64, pulse: impl Fn(u64) -> f64) -> &mut Self {
        let clock_hz = self.clock_hz;
        let tick_of = |seconds: f64| (seconds * clock_hz).round() as u64;
        let end = tick_of(until);
        let mut next = (0..).find(|&n| tick_of(pulse(n)) >= self.ticks).unwrap_or(0);
        while self.ticks < end {
            let period = self.node.requested_period_ticks();
            let first = self.ticks;
            let code = |n: u64| {
                let t = (first + n * u64::from(period)) as f64 / clock_hz;
                // Twelve bits, left-aligned.
                let code = (acceleration(t) / M_S2_PER_CODE / 16.0).round() + 2048.0;
                (code.clamp(0.0, 4095.0) as u16) << 4
            };
            let codes: Vec<u16> = (0..BLOCK as u64).map(code).collect();
            let behind = self.ticks + BLOCK as u64 * u64::from(period);
            while tick_of(pulse(next)) < behind {
                self.node.on_tach_edge(tick_of(pulse(next)) as u32);
                next += 1;
            }
            let (first_tick, sequence) = (self.ticks as u32, self.sequence);
            let block =
                Block { codes: &codes, second: &[], first_tick, period_ticks: period, sequence, overrun: false };
            self.node.on_block(block);
            (self.ticks, self.sequence) = (behind, self.sequence + 1);
            self.hear();
        }
        self
    }

    fn hear(&mut self) {
        while let Some(message) = self.node.poll(self.ticks as u32) {
            match message {
                Message::Event(event) => self.events.push((event.kind, event.detail)),
                Message::Status(status) => self.statuses.push(status),
                Message::Indicators(indicators) => self.indicators.push(indicators),
                Message::Spectrum(spectrum) => self.spectra.push(spectrum),
                _ => {}
            }
        }
    }

    /// Details of a kind of event, in order.
    pub fn said(&self, kind: EventKind) -> Vec<u32> {
        self.events.iter().filter(|event| event.0 == kind).map(|event| event.1).collect()
    }

    /// The latest values.
    pub fn values(&self) -> &Indicators {
        self.indicators.last().expect("values")
    }

    /// The latest status.
    pub fn status(&self) -> &Status {
        self.statuses.last().expect("a status")
    }

    /// Forgets what was said so far.
    pub fn forget(&mut self) -> &mut Self {
        self.events.clear();
        self.indicators.clear();
        self.spectra.clear();
        self.statuses.clear();
        self
    }
}

/// Pulses of a steady shaft.
pub fn steady(hz: f64) -> impl Fn(u64) -> f64 {
    move |n| (n as f64 + 0.5) / hz
}

/// No pulses.
pub fn none(_: u64) -> f64 {
    1.0e9
}
