//! A machine, a board and a line around a node, on the host, with faults at will.

use crate::gear_signal::acceleration;
use meshband::config::{Configuration, GearPair};
use meshband::events::EventKind;
use meshband::frame::{Decoder, Frame, MAX_FRAME, Packet, encode};
use meshband::identity::Identity;
use meshband::law::{Law, LawForm};
use meshband::link::send_ring::SendRing;
use meshband::link::{BITS_PER_SECOND, QUEUE};
use meshband::message::{Message, Request, Spectrum, Status};
use meshband::node::Block;
use meshband::session::Session;
use meshband::units::{Acceleration, Hertz, TicksPerSecond};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Time base of the imitated board, Hz.
pub const CLOCK_HZ: u32 = 25_000_000;
/// Teeth of the pinion.
pub const TEETH: u16 = 19;
const BLOCK: usize = 512;
/// The node's counter wraps within the first second.
const START_TICK: u64 = u32::MAX as u64 - CLOCK_HZ as u64 / 2;
/// Sensitivity, m/s2 per code.
pub const PER_CODE_M_S2: f32 = 0.002;

/// What goes wrong while [`Plant::run`] runs.
#[derive(Clone, Copy)]
pub enum Fault {
    /// Nothing.
    None,
    /// So many extra tach pulses per second, at random instants.
    Pulses(f64),
    /// The tach wire is off.
    NoPulses,
    /// The converter's codes become these.
    Codes(fn(u16, &mut ChaCha8Rng) -> u16),
    /// The converter lost samples in every tenth block.
    Overrun,
    /// Every tenth block does not arrive.
    LostBlocks,
    /// The line takes no byte from the node.
    Stall,
    /// So many random bytes per second arrive on the line.
    RandomBytes(f64),
}

/// The whole set-up.
pub struct Plant {
    /// Node and link.
    pub session: Session,
    /// Bytes on their way to the host.
    pub ring: SendRing<QUEUE>,
    /// Bytes per second that the line takes.
    pub line: f64,
    /// Vibration over speed, as a factor on the signal.
    pub strength: fn(f64) -> f64,
    /// Bytes that the line has had the time for.
    credit: f64,
    /// Everything that reached the host.
    pub frames: Vec<Frame>,
    /// The host's receiver.
    pub decoder: Decoder,
    random: ChaCha8Rng,
    time: u64,
    turns: f64,
    sequence: u32,
    made: u64,
    period: u32,
    request_sequence: u16,
}

/// A configuration that keeps the rates low: 500 Hz of bandwidth per hertz, an analogue filter that stops at 12 kHz.
pub fn configuration() -> Configuration {
    let mut config = Configuration { gears: GearPair { pinion_teeth: TEETH, gear_teeth: 48 }, ..Default::default() };
    let form = LawForm::Quadratic { a_per_hz: 0.0, b: 400.0, c_hz: 0.0 };
    config.law = Law { form, lowest: Hertz(1.0), highest: Hertz(25.0), provisional: false, ..Law::PROVISIONAL };
    config.limits.analogue_stop = Hertz(12_000.0);
    config.limits.highest_adc = Hertz(60_000.0);
    config.sensor.acceleration_per_code = Acceleration(PER_CODE_M_S2);
    config
}

impl Plant {
    /// A plant at rest.
    ///
    /// # Panics
    /// For a configuration that a node refuses.
    pub fn new(config: Configuration, seed: u64) -> Self {
        let session = Session::new(config, TicksPerSecond(CLOCK_HZ), Identity::HOST).expect("a valid configuration");
        let period = session.node().requested_period_ticks();
        Self {
            session,
            ring: SendRing::new(),
            line: f64::from(BITS_PER_SECOND) / 10.0,
            strength: |_| 1.0,
            credit: 0.0,
            frames: Vec::new(),
            decoder: Decoder::new(),
            random: ChaCha8Rng::seed_from_u64(seed),
            time: START_TICK,
            made: 0,
            turns: 0.0,
            sequence: 0,
            period,
            request_sequence: 0,
        }
    }

    /// Runs for `seconds` with the shaft at `speed_hz(t)`, t from the start of this call; the sign is the direction.
    pub fn run(&mut self, seconds: f64, speed_hz: impl Fn(f64) -> f64, fault: Fault) {
        let clock = f64::from(CLOCK_HZ);
        let start = self.time;
        let end = start + (seconds * clock) as u64;
        let mut codes = [0; BLOCK];
        while self.time < end {
            let first = self.time;
            let step = f64::from(self.period) / clock;
            let mut edges = Vec::new();
            for (n, code) in codes.iter_mut().enumerate() {
                let tick = first + n as u64 * u64::from(self.period);
                let speed = speed_hz((tick - start) as f64 / clock);
                let moved = speed * step;
                let before = self.turns;
                self.turns += moved;
                let border = before.max(self.turns).floor();
                if border > before.min(self.turns) {
                    let share = (border - before) / moved;
                    edges.push(tick + (share * f64::from(self.period)) as u64);
                }
                let noise = self.random.random_range(-2.0..2.0);
                let value = (self.strength)(speed) * acceleration(before, TEETH) / f64::from(PER_CODE_M_S2) + noise;
                *code = (value + 32_768.0).round().clamp(0.0, 65_535.0) as u16;
                if let Fault::Codes(fault) = fault {
                    *code = fault(*code, &mut self.random);
                }
            }
            self.time += BLOCK as u64 * u64::from(self.period);
            let length_s = BLOCK as f64 * step;
            match fault {
                Fault::NoPulses => edges.clear(),
                Fault::Pulses(rate) => {
                    let whole = (rate * length_s).floor();
                    let count = whole as usize + usize::from(self.random.random_bool(rate * length_s - whole));
                    edges.extend((0..count).map(|_| self.random.random_range(first..self.time)));
                    edges.sort_unstable();
                }
                Fault::RandomBytes(rate) => {
                    for _ in 0..(rate * length_s) as usize {
                        let byte = self.random.random();
                        self.receive(byte);
                    }
                }
                _ => {}
            }
            edges.into_iter().for_each(|edge| self.session.on_edge(edge as u32));
            let tenth = self.sequence % 10 == 9;
            if !(tenth && matches!(fault, Fault::LostBlocks)) {
                let block = Block {
                    codes: &codes,
                    second: &[],
                    first_tick: first as u32,
                    period_ticks: self.period,
                    sequence: self.sequence,
                    overrun: tenth && matches!(fault, Fault::Overrun),
                };
                let ring = &mut self.ring;
                self.session.on_block(block, &mut |frame| {
                    ring.push(frame);
                });
            }
            self.sequence = self.sequence.wrapping_add(1);
            self.made += 1;
            self.period = self.session.node().requested_period_ticks();
            if let Some(frames) = self.ring.take_unreported() {
                self.session.node_mut().note(EventKind::MessagesDropped, frames);
            }
            if !matches!(fault, Fault::Stall) {
                self.credit += self.line * length_s;
                self.transmit();
            }
        }
    }

    /// A command over the line.
    ///
    /// # Panics
    /// For a command that does not fit a frame.
    pub fn request(&mut self, request: &Request) {
        let mut buffer = [0; MAX_FRAME];
        let frame = encode(request, self.request_sequence, &mut buffer).expect("fits").to_vec();
        self.request_sequence = self.request_sequence.wrapping_add(1);
        frame.into_iter().for_each(|byte| self.receive(byte));
    }

    /// A byte from the line.
    pub fn receive(&mut self, byte: u8) {
        let ring = &mut self.ring;
        self.session.on_byte(byte, &mut |frame| {
            ring.push(frame);
        });
    }

    /// The line takes everything that waits.
    pub fn drain(&mut self) {
        self.credit = f64::INFINITY;
        self.transmit();
    }

    /// The line takes what it had the time for; an idle one saves nothing up.
    fn transmit(&mut self) {
        let Self { ring, credit, decoder, frames, .. } = self;
        ring.drain(|byte| {
            if *credit < 1.0 {
                return false;
            }
            *credit -= 1.0;
            frames.extend(decoder.push(byte).and_then(Result::ok));
            true
        });
        if ring.is_empty() {
            *credit = 0.0;
        }
    }

    /// Virtual time since the start, s.
    pub fn seconds(&self) -> f64 {
        (self.time - START_TICK) as f64 / f64::from(CLOCK_HZ)
    }

    /// Virtual time of the board's counter, s.
    pub fn clock_s(&self) -> f64 {
        self.time as f64 / f64::from(CLOCK_HZ)
    }

    /// Blocks made since the start, lost ones included.
    pub fn blocks(&self) -> u64 {
        self.made
    }

    /// How often an event has occurred.
    pub fn count(&self, kind: EventKind) -> u32 {
        self.session.node().statistics().count(kind)
    }

    /// The newest mesh-band spectrum among the frames from number `from` on.
    pub fn spectrum_since(&self, from: usize) -> Option<&Spectrum> {
        self.frames[from..].iter().rev().find_map(|frame| match &frame.packet {
            Packet::Message(Message::Spectrum(spectrum)) => Some(spectrum),
            _ => None,
        })
    }

    /// The newest status.
    pub fn status(&self) -> Option<&Status> {
        self.frames.iter().rev().find_map(|frame| match &frame.packet {
            Packet::Message(Message::Status(status)) => Some(status),
            _ => None,
        })
    }
}
