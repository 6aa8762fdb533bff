//! What is around the chip: the signal, the tach, the host's end of the line; and what the chip was seen to do.

use crate::time::{Time, UNITS_PER_SECOND};
use std::collections::VecDeque;
use std::sync::Arc;

/// Supply and reference of the converters unless told otherwise, V.
pub const SUPPLY_V: f64 = 3.3;
/// Temperature of the chip unless told otherwise, degrees Celsius.
pub const TEMPERATURE_C: f64 = 30.0;

/// Bit rate of the line unless told otherwise.
pub const BITS_PER_SECOND: f64 = 921_600.0;

/// The analogue input: share of the reference voltage (0 to 1) at an instant, s since power first came.
pub type Analogue = Arc<dyn Fn(f64) -> f64 + Send + Sync>;

/// Seconds, told from the chip's units: these are of its oscillator, which may be wrong.
#[derive(Clone, Copy, Debug)]
pub struct TrueTime {
    since: Time,
    since_s: f64,
    /// Share by which the oscillator in force runs fast.
    fast: f64,
}

impl TrueTime {
    /// Starts at zero, on the internal oscillator.
    pub fn new(fast: f64) -> Self {
        Self { since: 0, since_s: 0.0, fast }
    }

    /// Another oscillator from now on.
    pub fn change(&mut self, now: Time, fast: f64) {
        *self = Self { since: now, since_s: self.seconds(now), fast };
    }

    /// Seconds at an instant.
    pub fn seconds(&self, at: Time) -> f64 {
        let units = at as f64 - self.since as f64;
        self.since_s + units / (UNITS_PER_SECOND as f64 * (1.0 + self.fast))
    }

    /// First instant at or behind so many seconds.
    pub fn at(&self, seconds: f64) -> Time {
        let units = (seconds - self.since_s) * UNITS_PER_SECOND as f64 * (1.0 + self.fast);
        // A whole unit that rounding has missed by less than a ten thousandth is meant.
        let units = (units - 1e-4).ceil();
        if units <= 0.0 { self.since } else { self.since.saturating_add(units as Time) }
    }
}

/// A conversion as the converter made it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sampled {
    /// Its trigger.
    pub trigger: Time,
    /// The result as the program gets it.
    pub code: u16,
}

/// An edge that TIM5 captured on channel 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Captured {
    /// When.
    pub at: Time,
    /// The count captured.
    pub tick: u32,
    /// What the input filter delays an edge by at most, in ticks of the counter.
    pub filter_ticks: u32,
}

/// A trigger that TIM5 captured on channel 2: the end of a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Border {
    /// When.
    pub at: Time,
    /// The count captured.
    pub tick: u32,
}

/// A pin of a port has changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PinChange {
    /// When.
    pub at: Time,
    /// Port, 0 for A.
    pub port: usize,
    /// Pin.
    pub pin: u32,
    /// Level.
    pub level: bool,
}

/// A byte that SPI2 has clocked out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Clocked {
    /// When its last bit ended.
    pub at: Time,
    /// The byte; `None` where the pins do not belong to the bus.
    pub byte: Option<u8>,
    /// Whether the amplifier's select pin was driven low meanwhile.
    pub selected: bool,
}

/// What the world does to the chip.
#[derive(Clone)]
pub struct Inputs {
    /// At the first sensor's pin, PA1.
    pub analogue: Analogue,
    /// At the second one's, PA2.
    pub second: Analogue,
    /// Supply and reference of the converters, V; signals stay shares of it.
    pub supply_v: f64,
    /// Temperature of the chip, degrees Celsius.
    pub temperature_c: f64,
    /// Rising edges to come of the pulse per second at PA3, s, in order.
    pub second_pulses: VecDeque<f64>,
    /// Changes of the tach's pin to come, s and level, in order.
    pub tach: VecDeque<(f64, bool)>,
    /// Bytes to come over the line, s at which their stop bit ends, in order.
    pub bytes: VecDeque<(f64, u8)>,
    /// Rate at which they are sent.
    pub bits_per_second: f64,
    /// Bits of each on the line, start, parity and stop included.
    pub bits: Time,
}

impl Default for Inputs {
    fn default() -> Self {
        Self {
            analogue: Arc::new(|_| 0.5),
            second: Arc::new(|_| 0.5),
            supply_v: SUPPLY_V,
            temperature_c: TEMPERATURE_C,
            second_pulses: VecDeque::new(),
            tach: VecDeque::new(),
            bytes: VecDeque::new(),
            bits_per_second: BITS_PER_SECOND,
            bits: 10,
        }
    }
}

/// What the chip was seen to do; whoever looks takes it away.
#[derive(Clone, Debug, Default)]
pub struct Seen {
    /// Bytes that left the chip, with the end of their stop bit.
    pub sent: Vec<(Time, u8)>,
    /// Conversions of the first sensor's signal, if they are wanted.
    pub conversions: Vec<Sampled>,
    /// Conversions of the second sensor's, if they are wanted.
    pub second: Vec<Sampled>,
    /// Whether conversions are wanted.
    pub keep_conversions: bool,
    /// Captured edges.
    pub captured: Vec<Captured>,
    /// Captured ends of blocks.
    pub borders: Vec<Border>,
    /// Changes of output pins.
    pub pins: Vec<PinChange>,
    /// Bytes that SPI2 has clocked out.
    pub clocked: Vec<Clocked>,
    /// Resets with their flags, as in `RCC_CSR`.
    pub resets: Vec<(Time, u32)>,
}
