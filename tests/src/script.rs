//! Records for the node in QEMU with faults at known times: a gear pair's signal, its tach, and what befalls either.

use crate::gear_signal::{FIRST_HARMONIC_M_S2, acceleration};
use crate::plant::{CLOCK_HZ, PER_CODE_M_S2, TEETH};
use meshband::config::Configuration;
use meshband::events::{Event, EventKind};
use meshband::frame::Packet;
use meshband::message::{Message, Spectrum, Statistics, Status};
use meshband::node::State;
use meshband::replay::{Header, MAX_CONFIGURATION, START_TICK, image_bytes, write};
use meshband::tach::Validity;
use meshband_host::virtual_node::frames::Received;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Rate of the signal: the fifth mesh harmonic at 15 Hz has 35 samples per period.
const RATE_HZ: u32 = 50_000;
const TICKS_PER_SAMPLE: u32 = CLOCK_HZ / RATE_HZ;

/// What goes wrong in a part of the record.
#[derive(Clone, Copy)]
pub enum Disturbance {
    /// Nothing.
    None,
    /// So many extra tach pulses per second, at random instants.
    Pulses(f64),
    /// The tach wire is off.
    NoPulses,
    /// The converter's codes become these.
    Codes(fn(f64, &mut ChaCha8Rng) -> f64),
}

/// A record under construction.
pub struct Script {
    samples: Vec<i16>,
    edges: Vec<u32>,
    turns: f64,
    random: ChaCha8Rng,
}

impl Script {
    /// Nothing yet, the shaft at rest.
    pub fn new(seed: u64) -> Self {
        Self { samples: Vec::new(), edges: Vec::new(), turns: 0.0, random: ChaCha8Rng::seed_from_u64(seed) }
    }

    /// Length so far, s.
    pub fn seconds(&self) -> f64 {
        self.samples.len() as f64 / f64::from(RATE_HZ)
    }

    /// Appends `seconds` with the shaft at `speed_hz(t)`, t from the start of this part; the sign is the direction.
    /// Gives the part's start and end, s.
    pub fn run(&mut self, seconds: f64, speed_hz: impl Fn(f64) -> f64, disturbance: Disturbance) -> (f64, f64) {
        let start_s = self.seconds();
        let first = self.samples.len() as u32 * TICKS_PER_SAMPLE;
        let count = (seconds * f64::from(RATE_HZ)) as u32;
        let mut edges = Vec::new();
        for n in 0..count {
            let moved = speed_hz(f64::from(n) / f64::from(RATE_HZ)) / f64::from(RATE_HZ);
            let before = self.turns;
            self.turns += moved;
            let border = before.max(self.turns).floor();
            if border > before.min(self.turns) {
                let share = (border - before) / moved;
                edges.push(first + n * TICKS_PER_SAMPLE + (share * f64::from(TICKS_PER_SAMPLE)) as u32);
            }
            let noise = self.random.random_range(-2.0..2.0);
            let mut code = acceleration(before, TEETH) / f64::from(PER_CODE_M_S2) + noise;
            if let Disturbance::Codes(fault) = disturbance {
                code = fault(code, &mut self.random);
            }
            self.samples.push(code.round().clamp(-32_768.0, 32_767.0) as i16);
        }
        match disturbance {
            Disturbance::NoPulses => edges.clear(),
            Disturbance::Pulses(rate) => {
                let last = first + count * TICKS_PER_SAMPLE;
                edges.extend((0..(rate * seconds) as u32).map(|_| self.random.random_range(first..last)));
                edges.sort_unstable();
                edges.dedup();
            }
            Disturbance::None | Disturbance::Codes(_) => {}
        }
        self.edges.extend(edges);
        (start_s, self.seconds())
    }

    /// The image for the board.
    ///
    /// # Panics
    /// For a record beyond the board's memory.
    pub fn image(&self, config: Option<&Configuration>, adjust: impl FnOnce(Header) -> Header) -> Vec<u8> {
        let mut buffer = [0; MAX_CONFIGURATION];
        let config: &[u8] = match config {
            Some(config) => postcard::to_slice(config, &mut buffer).expect("fits"),
            None => &[],
        };
        let header = adjust(Header::new(CLOCK_HZ, TICKS_PER_SAMPLE, PER_CODE_M_S2 * 32_767.0));
        let mut bytes = vec![0; image_bytes(config.len(), self.edges.len(), self.samples.len())];
        write(&header, config, &self.edges, &self.samples, &mut bytes).expect("a sound record");
        bytes
    }
}

/// What a node said, by the record's time.
pub struct Account {
    /// Everything received.
    pub received: Received,
}

/// Seconds from the record's start.
pub fn seconds(tick: u64) -> f64 {
    (tick as f64 - f64::from(START_TICK)) / f64::from(CLOCK_HZ)
}

impl Account {
    /// Of the bytes of a link.
    pub fn of(link: &[u8]) -> Self {
        Self { received: Received::decode(link) }
    }

    /// Statuses of a stretch, s.
    pub fn statuses(&self, from_s: f64, to_s: f64) -> Vec<&Status> {
        self.received.statuses().filter(|s| (from_s..to_s).contains(&seconds(s.tick))).collect()
    }

    /// Spectra whose record begins in a stretch, s.
    pub fn spectra(&self, from_s: f64, to_s: f64) -> Vec<&Spectrum> {
        self.received.spectra().filter(|s| (from_s..to_s).contains(&seconds(s.tag.first_tick))).collect()
    }

    /// Events first seen in a stretch, s.
    pub fn events(&self, from_s: f64, to_s: f64) -> Vec<&Event> {
        let events = self.received.messages().filter_map(|m| if let Message::Event(e) = m { Some(e) } else { None });
        events.filter(|e| (from_s..to_s).contains(&seconds(e.first_tick))).collect()
    }

    /// The closing statistics.
    ///
    /// # Panics
    /// Where the node sent none.
    pub fn statistics(&self) -> &Statistics {
        self.received.statistics().expect("closing statistics")
    }

    /// Answers, the closing statistics among them.
    pub fn replies(&self) -> usize {
        self.received.packets.iter().filter(|packet| matches!(packet, Packet::Reply(_))).count()
    }

    /// How often an event occurred, by the closing statistics.
    pub fn counted(&self, kind: EventKind) -> u32 {
        self.statistics().count(kind)
    }

    /// Asserts that in the last part of a stretch the node measures and its spectra are right.
    ///
    /// # Panics
    /// Where they are not.
    pub fn assert_measures(&self, (from_s, to_s): (f64, f64), speed_hz: f64) {
        // Records that reach into the next part are none of this one's.
        let ends_s = |s: &Spectrum| seconds(s.tag.first_tick) + f64::from(s.turns) / f64::from(s.tag.speed_hz);
        let mut spectra = self.spectra(from_s + 0.5, to_s);
        spectra.retain(|s| ends_s(s) < to_s);
        assert!(!spectra.is_empty(), "no spectrum from {from_s} s to {to_s} s");
        for spectrum in spectra {
            let what = (spectrum.bands[0].line, spectrum.tag.speed_hz);
            assert!(is_right(spectrum, speed_hz), "{what:?} between {from_s} s and {to_s} s");
        }
        let statuses = self.statuses(from_s, to_s);
        let last = statuses.last().expect("statuses come each second");
        assert_eq!(
            (last.state, last.validity, last.safe_rate),
            (State::Measuring, Validity::Locked, false),
            "{to_s} s"
        );
    }
}

/// Whether a spectrum has the first mesh harmonic of the gear pair at a speed.
pub fn is_right(spectrum: &Spectrum, speed_hz: f64) -> bool {
    let line = spectrum.bands[0].line;
    let frequency = f64::from(line.frequency_hz) / (speed_hz * f64::from(TEETH)) - 1.0;
    let amplitude = f64::from(line.amplitude) / FIRST_HARMONIC_M_S2 - 1.0;
    frequency.abs() < 5e-4 && amplitude.abs() < 0.06
}
