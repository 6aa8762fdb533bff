//! A live virtual node: the node's own code on a looped signal, in real time, behind a TCP port and, where wanted, as
//! a Modbus station.
//!
//! For anyone to try `monitor`, `configure`, gateways and a PLC without hardware. Blocks are computed when their time
//! has come; a host that is too busy makes the node late, never wrong, because the node's clock is that of its
//! samples. [`super::looped`] says what is looped,
//! [`super::peers`] who hears it, [`super::stations`] how Modbus reads it.

use super::image::TICKS_PER_SECOND;
use super::looped::{Channel, Loop, ZERO_CODE};
use super::peers::{Peers, packets};
use super::signal::Signal;
use super::stations::Stations;
use crate::link::view::FIRST_TICK;
use crate::{Error, Result};
use meshband::config::Configuration;
use meshband::frame::Packet;
use meshband::identity::Identity;
use meshband::modbus::Command;
use meshband::modbus::bank::Bank;
use meshband::node::Block;
use meshband::pipeline::Channels;
use meshband::replay::{BLOCK_SAMPLES, LONGEST_PERIOD};
use meshband::session::Session;
use meshband::units::TicksPerSecond;
use std::time::{Duration, Instant};

/// Lateness after which time is taken as new instead of being caught up, s.
const MAX_LATENESS: Duration = Duration::from_secs(1);
/// Longest pause between two looks at the peers.
const LOOK_EVERY: Duration = Duration::from_millis(2);

/// A node on a looped signal.
pub struct Looped<'a> {
    repeated: Loop,
    first: Channel<'a>,
    /// What a second sensor hears.
    second: Option<Channel<'a>>,
    session: Session,
    /// Results as registers are read from.
    bank: Bank,
    next_edge: u64,
    now: u64,
    sequence: u32,
    strength: f64,
    /// Periods wished after the blocks before: the wish governs the block after the next, as on a board.
    periods: [u32; 2],
}

impl<'a> Looped<'a> {
    /// A node with this configuration, but the sensors' scales, which are the signal's.
    ///
    /// # Errors
    /// What [`Loop::new`] refuses, and a configuration that the node does.
    pub fn new(signal: &'a Signal, config: &Configuration) -> Result<Self> {
        let repeated = Loop::new(signal)?;
        let first = Channel::new(&signal.samples, &signal.place)?;
        let second = signal.second.as_ref().map(|second| Channel::new(&second.samples, &signal.place)).transpose()?;
        let mut config = config.clone();
        config.sensor.acceleration_per_code = first.acceleration_per_code();
        config.sensor.zero_code = ZERO_CODE;
        if let (Some(channel), Some(sensor)) = (&second, &mut config.second) {
            sensor.acceleration_per_code = channel.acceleration_per_code();
            sensor.zero_code = ZERO_CODE;
        }
        let refuse = |what| Error::invalid("virtual node", format!("configuration: {what}"));
        let session = Session::new(config, TicksPerSecond(TICKS_PER_SECOND), Identity::HOST).map_err(refuse)?;
        let wish = session.node().requested_period_ticks().clamp(1, LONGEST_PERIOD);
        let (bank, next_edge, now, sequence) = (Bank::default(), 0, 0, 0);
        let strength = 1.0;
        Ok(Self { repeated, first, second, session, bank, next_edge, now, sequence, strength, periods: [wish; 2] })
    }

    /// What is repeated.
    pub fn repeated(&self) -> &Loop {
        &self.repeated
    }

    /// From here on the machine vibrates so many times as strongly as its signal.
    pub fn set_strength(&mut self, factor: f64) {
        self.strength = factor;
    }

    /// The node with its registers.
    pub fn session(&self) -> (&Session, &Bank) {
        (&self.session, &self.bank)
    }

    /// What a Modbus master asked for.
    pub fn obey(&mut self, command: Command) {
        self.session.obey(command);
    }

    /// End of the next block, s since the start.
    pub fn block_end_s(&self) -> f64 {
        self.block_end() as f64 / f64::from(TICKS_PER_SECOND)
    }

    /// As a board shares a block among its channels.
    fn instants(&self) -> usize {
        if self.second.is_some() { Channels::Two.instants() } else { Channels::One.instants() }
    }

    fn block_end(&self) -> u64 {
        self.now + u64::from(self.periods[0]) * self.instants() as u64
    }

    /// The next block, and what the node says of it.
    pub fn block(&mut self) -> Vec<Packet> {
        let period = self.periods[0];
        let end = self.block_end();
        while self.repeated.edge_tick(self.next_edge) < end {
            self.session.on_edge(self.repeated.edge_tick(self.next_edge) as u32);
            self.next_edge += 1;
        }
        let mut codes = [0; BLOCK_SAMPLES];
        let (codes, rest) = codes.split_at_mut(self.instants());
        self.sample(&self.first, period, codes);
        let second = match &self.second {
            Some(channel) => {
                self.sample(channel, period, rest);
                &*rest
            }
            None => &[],
        };
        let (first_tick, sequence) = (self.now as u32, self.sequence);
        let block = Block { codes, second, first_tick, period_ticks: period, sequence, overrun: false };
        let mut sent = Vec::new();
        self.session.on_block(block, &mut |frame| sent.extend_from_slice(frame));
        self.store();
        self.now = end;
        self.sequence = self.sequence.wrapping_add(1);
        let wish = self.session.node().requested_period_ticks().clamp(1, LONGEST_PERIOD);
        self.periods = [self.periods[1], wish];
        let said = packets(&sent);
        for packet in &said {
            if let Packet::Message(message) = packet {
                // The node counts from the first tick of its extended timer.
                self.bank.take(message, FIRST_TICK + self.now);
            }
        }
        said
    }

    /// Bytes of a peer, and what the node answers.
    pub fn receive(&mut self, bytes: &[u8]) -> Vec<Packet> {
        let mut sent = Vec::new();
        bytes.iter().for_each(|&byte| self.session.on_byte(byte, &mut |frame| sent.extend_from_slice(frame)));
        packets(&sent)
    }

    /// There is no flash to fail: what is in force stays until the program ends.
    fn store(&mut self) {
        if self.session.take_commit() {
            self.session.on_stored(true);
        }
    }

    fn sample(&self, channel: &Channel<'_>, period: u32, codes: &mut [u16]) {
        for (n, code) in (0u64..).zip(codes) {
            *code = self.repeated.code(channel, self.now + n * u64::from(period), self.strength);
        }
    }
}

/// What is served, for whoever starts it.
pub struct Ready<'a> {
    /// Address of the link.
    pub address: &'a str,
    /// Modbus stations, each as one names it: an address, or the path of a pseudo-terminal.
    pub stations: &'a [String],
    /// What is repeated.
    pub repeated: &'a Loop,
}

/// Serves `signal` until `ended` says so; `ready` is told where.
///
/// # Errors
/// A port that cannot be had, and what [`Looped::new`] refuses.
pub fn serve(
    signal: &Signal,
    config: &Configuration,
    address: &str,
    mut stations: Stations,
    ready: impl FnOnce(Ready<'_>) -> Result<()>,
    ended: impl Fn() -> bool,
) -> Result<()> {
    let refuse = |error: std::io::Error| Error::invalid(format!("tcp:{address}"), error);
    let mut node = Looped::new(signal, config)?;
    let mut peers = Peers::at(address).map_err(refuse)?;
    let told = peers.address().map_err(refuse)?;
    ready(Ready { address: &told, stations: &stations.names(), repeated: node.repeated() })?;
    let mut origin = Instant::now();
    while !ended() {
        peers.admit();
        peers.serve(|piece| node.receive(piece));
        let (session, bank) = node.session();
        let commands = stations.serve(session.node(), bank);
        commands.into_iter().for_each(|command| node.obey(command));
        let due = origin + Duration::from_secs_f64(node.block_end_s());
        let now = Instant::now();
        if now >= due {
            if now - due > MAX_LATENESS {
                origin += now - due;
            }
            peers.tell(&node.block());
        } else {
            std::thread::sleep((due - now).min(LOOK_EVERY));
        }
    }
    Ok(())
}
