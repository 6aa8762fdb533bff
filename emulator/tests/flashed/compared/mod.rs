//! The flashed image on the emulated chip, and beside it the node's own code on the codes and edges that the chip's
//! devices made.
//!
//! Everything the host is given was seen at the devices: conversions, captures, bytes received. Taken over from the
//! image's frames are events of the board itself (depth of its stack, crash record), at the instant they carry.
#![allow(dead_code, reason = "every test program uses some of it")]

mod host;
pub mod load;
mod stored;

use meshband::config::{Configuration, GearPair};
use meshband::events::{Event, EventKind};
use meshband::frame::{self, Decoder, Packet, PacketRef};
use meshband::message::{Message, Request};
use meshband::session::Session;
use meshband_emulator::board::Board;
use meshband_emulator::elf::Image;
use meshband_emulator::flash::{DATA_START, START};
use meshband_emulator::world::{Analogue, Border, Sampled};
use std::f64::consts::TAU;
use std::sync::Arc;

pub use host::Comparison;

/// Ticks of the time base in a second.
pub const TICKS_PER_SECOND: f64 = 84.0e6;
/// Units of the emulator's time in a tick.
pub const UNITS_PER_TICK: u64 = 4;
/// Samples of a block.
pub const BLOCK: usize = meshband::config::BLOCK_SAMPLES;
/// Teeth of the pinion.
pub const TEETH: u16 = 19;
/// When a board that was switched on at zero surely measures, s.
pub const STARTED_S: f64 = 0.25;

/// A block as converter and DMA made it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SampledBlock {
    /// Instant of its first sample, ticks.
    pub first_tick: u32,
    /// Sample period, ticks.
    pub period: u32,
    /// The codes.
    pub codes: Vec<u16>,
    /// Those of the second converter; empty where it is not in use.
    pub second: Vec<u16>,
}

impl SampledBlock {
    /// Instant of the last sample.
    pub fn last_tick(&self) -> u32 {
        self.first_tick.wrapping_add(self.period * (self.codes.len() as u32 - 1))
    }
}

/// A board with the released image.
pub struct Node {
    /// The board.
    pub board: Board,
    /// What was stored in it.
    pub config: Configuration,
    /// Every byte it sent.
    pub link: Vec<u8>,
    /// Complete blocks.
    pub blocks: Vec<SampledBlock>,
    /// Blocks that lacked samples.
    pub broken: usize,
    /// Edges as the input gives them, ticks.
    pub edges: Vec<u32>,
    /// Requests sent.
    pub requests: Vec<Request>,
    open: Vec<Sampled>,
    open_second: Vec<Sampled>,
    borders: Vec<Border>,
}

/// The default configuration with the gear pair of [`machine`].
pub fn configuration() -> Configuration {
    Configuration { gears: GearPair { pinion_teeth: TEETH, gear_teeth: 48 }, ..Configuration::default() }
}

/// Five mesh harmonics with a sideband of the shaft, at so many turns per second.
pub fn machine(speed_hz: f64) -> Analogue {
    Arc::new(move |time_s| {
        let turn = TAU * speed_hz * time_s;
        let modulation = 1.0 + 0.2 * turn.cos();
        let sum: f64 = (1..=5).map(|h| (f64::from(h) * f64::from(TEETH) * turn).cos() / f64::from(h)).sum();
        0.5 + 0.15 * modulation * sum
    })
}

/// Instants of whole turns, s.
pub fn turns(speed_hz: f64, from_s: f64, to_s: f64) -> Vec<f64> {
    let first = (from_s * speed_hz).ceil() as u32;
    (first..).map(|n| f64::from(n) / speed_hz).take_while(|&time_s| time_s < to_s).collect()
}

impl Node {
    /// A board with this configuration stored, at its first instruction.
    pub fn new(image: &Image, config: &Configuration) -> Self {
        let mut board = Board::new(image).expect("the image fits");
        let at = (DATA_START - START) as usize;
        stored::save(&mut board.chip_mut().cells[at..at + stored::BYTES], config);
        board.seen().keep_conversions = true;
        let (link, blocks, edges, open, open_second) = (Vec::new(), Vec::new(), Vec::new(), Vec::new(), Vec::new());
        Self {
            board,
            config: config.clone(),
            link,
            blocks,
            broken: 0,
            edges,
            requests: Vec::new(),
            open,
            open_second,
            borders: Vec::new(),
        }
    }

    /// Runs until so many seconds since power came.
    pub fn run_until(&mut self, end_s: f64) {
        while self.board.seconds() < end_s {
            let slice_s = f64::min(self.board.seconds() + 0.05, end_s);
            self.board.run_until(slice_s).expect("the chip serves what the image does");
            self.take_seen();
            if slice_s >= end_s {
                break;
            }
        }
    }

    /// Goes on for so many seconds.
    pub fn run_for(&mut self, seconds: f64) {
        self.run_until(self.board.seconds() + seconds);
    }

    /// Forgets what was seen, for a host that starts with the next blocks.
    pub fn forget(&mut self) {
        self.link.clear();
        self.blocks.clear();
        self.edges.clear();
        self.broken = 0;
    }

    /// Sends a request to the board.
    pub fn ask(&mut self, request: Request) {
        let mut buffer = [0; frame::MAX_FRAME];
        let bytes = frame::encode(PacketRef::Request(&request), self.requests.len() as u16, &mut buffer);
        self.board.send(bytes.expect("fits a frame"));
        self.requests.push(request);
    }

    /// What the frames say so far.
    pub fn packets(&self) -> Vec<Packet> {
        packets(&self.link)
    }

    /// All messages.
    pub fn messages(&self) -> Vec<Message> {
        let message = |packet| if let Packet::Message(message) = packet { Some(message) } else { None };
        self.packets().into_iter().filter_map(message).collect()
    }

    /// All events.
    pub fn events(&self) -> Vec<Event> {
        let event = |message| if let Message::Event(event) = message { Some(event) } else { None };
        self.messages().into_iter().filter_map(event).collect()
    }

    /// Details of the events of a kind.
    pub fn details(&self, kind: EventKind) -> Vec<u32> {
        self.events().iter().filter(|event| event.kind == kind).map(|event| event.detail).collect()
    }

    /// Numbers of the board's own events of a kind (highest byte of the detail).
    pub fn board_events(&self, kind: u32) -> Vec<u32> {
        let details = self.details(EventKind::Board);
        details.iter().filter(|detail| *detail >> 24 == kind).map(|detail| detail & 0x00ff_ffff).collect()
    }

    /// Mesh-band spectra sent.
    pub fn spectra(&self) -> usize {
        self.messages().iter().filter(|message| matches!(message, Message::Spectrum(_))).count()
    }

    /// Resets since the start.
    pub fn resets(&mut self) -> usize {
        self.board.seen().resets.len()
    }

    /// The host on the same blocks and edges, frame by frame, from a start after power came.
    pub fn compare(&self) -> Comparison {
        host::compare(self, 0)
    }

    /// As [`Node::compare`], after a start of another cause.
    pub fn compare_started(&self, cause: u32) -> Comparison {
        host::compare(self, cause)
    }

    /// The host's node after the same blocks and edges.
    pub fn host_node(&self) -> Box<Session> {
        host::node_after(self)
    }

    fn take_seen(&mut self) {
        self.link.extend(self.board.take_sent());
        let seen = self.board.seen();
        self.open.append(&mut seen.conversions);
        self.open_second.append(&mut seen.second);
        let edges = std::mem::take(&mut seen.captured);
        self.edges.extend(edges.iter().map(|edge| edge.tick.wrapping_sub(edge.filter_ticks)));
        self.borders.append(&mut seen.borders);
        // Behind a border the block's last conversion is still under way: it has ended when there is a later one.
        while let Some(border) = self.borders.first().copied()
            && self.open.last().is_some_and(|sample| sample.trigger > border.at)
        {
            self.borders.remove(0);
            let until = |open: &mut Vec<Sampled>| -> Vec<Sampled> {
                let count = open.iter().take_while(|sample| sample.trigger <= border.at).count();
                open.drain(..count).collect()
            };
            let (samples, of_second) = (until(&mut self.open), until(&mut self.open_second));
            // A border before sampling has begun is none.
            if samples.is_empty() {
                continue;
            }
            match block(&samples, &of_second, border.tick) {
                Some(block) => self.blocks.push(block),
                None => self.broken += 1,
            }
        }
    }
}

/// Decoded packets of a line.
pub fn packets(link: &[u8]) -> Vec<Packet> {
    let mut decoder: Decoder = Decoder::new();
    link.iter().filter_map(|&byte| Some(decoder.push(byte)?.ok()?.packet)).collect()
}

/// A block of equally spaced samples whose last one was captured at `last_tick`, with those of the second converter
/// at the same triggers.
fn block(samples: &[Sampled], of_second: &[Sampled], last_tick: u32) -> Option<SampledBlock> {
    let (first, next) = (samples.first()?, samples.get(1)?);
    let spacing = next.trigger - first.trigger;
    let even = samples.windows(2).all(|pair| pair[1].trigger - pair[0].trigger == spacing);
    let expected = if of_second.is_empty() { BLOCK } else { BLOCK / 2 };
    let together = of_second.is_empty() || samples.iter().map(|s| s.trigger).eq(of_second.iter().map(|s| s.trigger));
    if samples.len() != expected || !even || !together {
        return None;
    }
    let period = (spacing / UNITS_PER_TICK) as u32;
    let first_tick = last_tick.wrapping_sub(period * (samples.len() as u32 - 1));
    let codes = |samples: &[Sampled]| samples.iter().map(|sample| sample.code).collect();
    Some(SampledBlock { first_tick, period, codes: codes(samples), second: codes(of_second) })
}
