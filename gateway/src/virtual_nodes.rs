//! Nodes to try the gateway with: the node's own session on a made-up gear's signal, in real time, behind a TCP port
//! each.
//!
//! What runs is what runs on a board (`meshband::session`): tach tracker, law, rate plan, mesh bands, indicators,
//! commands. Made up are the codes: three mesh harmonics with a sideband pair, and noise from a seeded generator. The
//! filter's stop edge is 2 kHz, so that fifty nodes fit on a core or two. A port serves one reader at a time, as a
//! serial line does; while there is none, frames wait, as in a line server's buffer, and with `--repeat` the last
//! ones are sent again to the next reader.

use crate::NodesArgs;
use crate::error::{Error, Result, at};
use crate::intake::state::fingerprint;
use crate::stop::Stop;
use meshband::config::{BLOCK_SAMPLES, Configuration};
use meshband::frame::{Decoder, Packet};
use meshband::identity::Identity;
use meshband::node::Block;
use meshband::session::Session;
use meshband::units::{Acceleration, Hertz, TicksPerSecond};
use std::collections::VecDeque;
use std::io::{ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::time::{Duration, Instant};

/// Time base, Hz.
const CLOCK: u32 = 1_000_000;
/// Pulses of the tach per turn.
const PULSES: u16 = 8;
/// Frames that wait for a reader at most: an hour's.
const WAITING: usize = 65_536;
/// Readers idle for so long at the end get no more.
const FAREWELL: Duration = Duration::from_secs(30);

/// Serves nodes until asked to stop, or to the end of their time.
///
/// # Errors
/// Where a port is not to be had, or the ledger cannot be written.
pub fn run(args: &NodesArgs, stop: &Stop) -> Result {
    let mut threads = Vec::new();
    for index in 0..args.count {
        let port =
            args.port.checked_add(index).ok_or_else(|| Error::new("--port", "beyond 65535 with so many nodes"))?;
        let listener =
            TcpListener::bind(("127.0.0.1", port)).map_err(|reason| Error::new(format!("port {port}"), reason))?;
        listener.set_nonblocking(true).map_err(|reason| Error::new(format!("port {port}"), reason))?;
        let (stop, repeat, seconds, unit) = (stop.clone(), args.repeat, args.seconds, args.unit + u32::from(index));
        threads.push(std::thread::spawn(move || {
            Served::new(listener, repeat, u32::from(index), unit).serve(&stop, seconds)
        }));
    }
    eprintln!("{} nodes on 127.0.0.1:{} and up", args.count, args.port);
    let mut ledger = String::new();
    for (index, thread) in threads.into_iter().enumerate() {
        let sent = thread.join().map_err(|_| Error::new(format!("node {index}"), "panicked"))?;
        for (sequence, fingerprint, delivered) in sent {
            ledger += &format!("{index},{sequence},{fingerprint:016x},{}\n", u8::from(delivered));
        }
    }
    match &args.ledger {
        Some(path) => at(path, std::fs::write(path, format!("node,sequence,fingerprint,delivered\n{ledger}"))),
        None => Ok(()),
    }
}

/// One node and its port.
struct Served {
    listener: TcpListener,
    reader: Option<TcpStream>,
    repeat: usize,
    session: Session,
    gear: Gear,
    blocks: u32,
    /// Frames made, oldest first: the first `sent` were written to a reader.
    frames: VecDeque<Vec<u8>>,
    sent: usize,
    ledger: Vec<(u16, u64, bool)>,
}

impl Served {
    fn new(listener: TcpListener, repeat: usize, index: u32, unit: u32) -> Self {
        let mut config = Configuration::default();
        config.tach.pulses_per_turn = PULSES;
        config.limits.analogue_stop = Hertz(2_000.0);
        config.limits.highest_adc = Hertz(8_000.0);
        config.sensor.acceleration_per_code = Acceleration(0.001);
        let identity = Identity {
            board: "virtual",
            build: "gateway",
            unique_id: [unit, 0x6d65_7368, 0x6261_6e64],
            ..Identity::HOST
        };
        let session = Session::new(config, TicksPerSecond(CLOCK), identity)
            .unwrap_or_else(|e| unreachable!("own configuration: {e}"));
        let gear = Gear::new(index);
        Self {
            listener,
            reader: None,
            repeat,
            session,
            gear,
            blocks: 0,
            frames: VecDeque::new(),
            sent: 0,
            ledger: Vec::new(),
        }
    }

    /// Until asked to stop or the time is over and all is sent; gives every frame's sequence, fingerprint, and
    /// whether it was written.
    fn serve(mut self, stop: &Stop, seconds: Option<u64>) -> Vec<(u16, u64, bool)> {
        let start = Instant::now();
        let end = seconds.map(|seconds| start + Duration::from_secs(seconds));
        let mut tick = 0u64;
        while !stop.asked() && end.is_none_or(|end| Instant::now() < end + FAREWELL) {
            let measuring = end.is_none_or(|end| Instant::now() < end);
            if measuring {
                let period = self.session.node().requested_period_ticks().clamp(125, 1000);
                self.block(tick, period);
                tick += u64::from(period) * BLOCK_SAMPLES as u64;
            } else if self.sent == self.frames.len() && self.reader_is_gone() {
                break;
            }
            let due = start + Duration::from_micros(tick);
            loop {
                self.talk();
                if stop.asked() || !measuring || Instant::now() >= due {
                    break;
                }
                std::thread::sleep(Duration::from_millis(20).min(due.saturating_duration_since(Instant::now())));
            }
            if !measuring {
                std::thread::sleep(Duration::from_millis(20));
            }
        }
        let delivered = self.ledger.len() - (self.frames.len() - self.sent);
        self.ledger.iter_mut().take(delivered).for_each(|frame| frame.2 = true);
        self.ledger
    }

    fn reader_is_gone(&self) -> bool {
        self.reader.is_none()
    }

    /// Measures one block.
    fn block(&mut self, first: u64, period: u32) {
        let mut codes = [0; BLOCK_SAMPLES];
        let end = first + u64::from(period) * BLOCK_SAMPLES as u64;
        while let Some(edge) = self.gear.edge_before(end) {
            self.session.on_edge(edge as u32);
        }
        for (place, code) in (0u64..).zip(&mut codes) {
            *code = self.gear.code(first + place * u64::from(period));
        }
        let block = Block {
            codes: &codes,
            second: &[],
            first_tick: first as u32,
            period_ticks: period,
            sequence: self.blocks,
            overrun: false,
        };
        self.blocks = self.blocks.wrapping_add(1);
        let mut out = Vec::new();
        self.session.on_block(block, &mut |frame| out.push(frame.to_vec()));
        out.into_iter().for_each(|frame| self.made(frame));
    }

    fn made(&mut self, frame: Vec<u8>) {
        let piece = &frame[1..frame.len() - 1];
        let mut decoder: Decoder<Packet> = Decoder::new();
        let decoded = frame.iter().find_map(|&byte| decoder.push(byte)).and_then(std::result::Result::ok);
        let sequence = decoded.map_or(0, |frame| frame.sequence);
        self.ledger.push((sequence, fingerprint(piece), false));
        self.frames.push_back(frame);
        while self.frames.len() > WAITING.max(self.repeat)
            || (self.sent > self.repeat && self.frames.len() > self.repeat)
        {
            self.frames.pop_front();
            self.sent = self.sent.saturating_sub(1);
        }
    }

    /// Accepts a reader, hears its commands, and sends it what waits.
    fn talk(&mut self) {
        while let Ok((stream, _)) = self.listener.accept() {
            // The line has one end: a second reader is turned away.
            if self.reader.is_none() && stream.set_nonblocking(true).is_ok() {
                self.sent = self.sent.saturating_sub(self.repeat);
                self.reader = Some(stream);
            }
        }
        self.hear();
        while let Some(stream) = &mut self.reader {
            let Some(frame) = self.frames.get(self.sent) else { return };
            let whole = stream
                .set_nonblocking(false)
                .and_then(|()| stream.write_all(frame))
                .and_then(|()| stream.set_nonblocking(true));
            match whole {
                Ok(()) => self.sent += 1,
                Err(_) => self.reader = None,
            }
        }
    }

    fn hear(&mut self) {
        let mut buffer = [0; 2048];
        let Some(stream) = &mut self.reader else { return };
        match stream.read(&mut buffer) {
            Ok(0) => self.reader = None,
            Ok(count) => {
                let mut out = Vec::new();
                for &byte in &buffer[..count] {
                    self.session.on_byte(byte, &mut |frame| out.push(frame.to_vec()));
                }
                if self.session.take_commit() {
                    self.session.on_stored(true);
                }
                out.into_iter().for_each(|frame| self.made(frame));
            }
            Err(e) if e.kind() == ErrorKind::WouldBlock => {}
            Err(_) => self.reader = None,
        }
    }
}

/// A made-up gear: position from a steady speed, codes and edges from the position.
struct Gear {
    speed_hz: f64,
    noise: u32,
    edges: u64,
}

impl Gear {
    fn new(index: u32) -> Self {
        Self { speed_hz: 4.0 + 0.1 * f64::from(index % 20), noise: 0x9e37_79b9 ^ (index + 1), edges: 0 }
    }

    fn code(&mut self, tick: u64) -> u16 {
        let turns = tick as f64 / f64::from(CLOCK) * self.speed_hz;
        let angle = std::f64::consts::TAU * turns;
        let tones = [(20.0, 2.0), (40.0, 1.0), (60.0, 0.5), (19.0, 0.2), (21.0, 0.3)];
        let tone: f64 = tones.iter().map(|(order, amplitude)| amplitude * (order * angle).sin()).sum();
        // Xorshift: seeded by the node's index, the same on every run.
        self.noise ^= self.noise << 13;
        self.noise ^= self.noise >> 17;
        self.noise ^= self.noise << 5;
        let noise = f64::from(self.noise) / f64::from(u32::MAX) - 0.5;
        (32_768.0 + 1000.0 * (tone + noise)).clamp(0.0, 65_535.0) as u16
    }

    /// The next edge, if it is before a tick.
    fn edge_before(&mut self, tick: u64) -> Option<u64> {
        let edge = (self.edges as f64 * f64::from(CLOCK) / (self.speed_hz * f64::from(PULSES))) as u64;
        (edge < tick).then(|| {
            self.edges += 1;
            edge
        })
    }
}
