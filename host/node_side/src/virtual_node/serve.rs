//! A live virtual node: the node's own code on a looped signal, in real time, behind a TCP port.
//!
//! For anyone to try `monitor`, `configure` and gateways without hardware. The signal is cut to whole hunting periods where it holds one, else
//! to whole turns of the tach's shaft, and begins anew at its end: the tach goes on evenly, the mesh keeps its phase, and only what
//! belongs to the gear's turn may jump at the seam. Blocks are computed when their time has come; a host that is too busy makes the node
//! late, never wrong, because the node's clock is that of its samples. One peer at a time; without one what is sent goes nowhere, as on a wire.

use super::image::TICKS_PER_SECOND;
use super::signal::Signal;
use crate::{Error, Result};
use meshband::config::Configuration;
use meshband::identity::Identity;
use meshband::node::Block;
use meshband::pipeline::Channels;
use meshband::replay::{BLOCK_SAMPLES, LONGEST_PERIOD, Replay};
use meshband::session::Session;
use meshband::units::TicksPerSecond;
use std::io::{ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::time::{Duration, Instant};

/// Lateness after which time is taken as new instead of being caught up, s.
const MOST_LATE: Duration = Duration::from_secs(1);

/// A node on a looped replay image.
pub struct Looped<'a> {
    replay: Replay<'a>,
    /// What a second sensor hears.
    second: Option<Replay<'a>>,
    session: Session,
    /// First and last tick of the loop.
    from: u32,
    length: u64,
    /// Edges of one loop, ticks from its start.
    edges: Vec<u32>,
    next_edge: u64,
    now: u64,
    sequence: u32,
    /// Periods wished after the blocks before: the wish governs the block after the next, as on a board.
    periods: [u32; 2],
}

impl<'a> Looped<'a> {
    /// A node on `image` and, for a second sensor, another without edges; `turns` are the tach turns that a loop should be a multiple of, where the signal holds them.
    ///
    /// # Errors
    /// An image that the firmware would refuse, and a signal without a whole turn.
    pub fn new(image: &'a [u8], second: Option<&'a [u8]>, pulses_per_turn: u32, turns: u32) -> Result<Self> {
        let refuse = |what: String| Error::invalid("virtual node", what);
        let parse = |image| Replay::parse(image).map_err(|e| refuse(format!("its image cannot be read: {e:?}")));
        let (replay, second) = (parse(image)?, second.map(parse).transpose()?);
        let config: Configuration =
            postcard::from_bytes(replay.configuration()).map_err(|e| refuse(format!("configuration: {e}")))?;
        let all: Vec<u32> = (0..).map_while(|i| replay.edge(i)).collect();
        let whole = (all.len().saturating_sub(1)) / pulses_per_turn as usize;
        let multiple = (turns as usize).max(1);
        let used = if whole >= multiple { whole / multiple * multiple } else { whole };
        if used == 0 {
            return Err(refuse(format!("{} tach edges are no whole turn: lengthen the signal", all.len())));
        }
        let (from, end) = (all[0], all[used * pulses_per_turn as usize]);
        let edges = all.iter().filter(|&&edge| edge < end).map(|edge| edge - from).collect();
        let clock = TicksPerSecond(TICKS_PER_SECOND);
        let session = Session::new(config, clock, Identity::HOST).map_err(|e| refuse(format!("configuration: {e}")))?;
        let first = session.node().requested_period_ticks().clamp(1, LONGEST_PERIOD);
        let length = u64::from(end - from);
        let (next_edge, now, sequence) = (0, 0, 0);
        Ok(Self { replay, second, session, from, length, edges, next_edge, now, sequence, periods: [first; 2] })
    }

    /// Length of the loop, s.
    pub fn loop_s(&self) -> f64 {
        self.length as f64 / f64::from(TICKS_PER_SECOND)
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

    /// The next block; what the node says goes to `send`.
    pub fn block(&mut self, send: &mut impl FnMut(&[u8])) {
        let period = self.periods[0];
        let end = self.block_end();
        while self.edge_tick(self.next_edge) < end {
            self.session.on_edge(self.edge_tick(self.next_edge) as u32);
            self.next_edge += 1;
        }
        let mut codes = [0; BLOCK_SAMPLES];
        let (codes, rest) = codes.split_at_mut(self.instants());
        self.sample(&self.replay, period, codes);
        let second = match &self.second {
            Some(replay) => {
                self.sample(replay, period, rest);
                &*rest
            }
            None => &[],
        };
        let (first_tick, sequence) = (self.now as u32, self.sequence);
        let block = Block { codes, second, first_tick, period_ticks: period, sequence, overrun: false };
        self.session.on_block(block, send);
        if self.session.take_commit() {
            // There is no flash to fail: what is in force stays until the program ends.
            self.session.on_stored(true);
        }
        self.now = end;
        self.sequence = self.sequence.wrapping_add(1);
        let wish = self.session.node().requested_period_ticks().clamp(1, LONGEST_PERIOD);
        self.periods = [self.periods[1], wish];
    }

    /// Bytes from the peer.
    pub fn receive(&mut self, bytes: &[u8], send: &mut impl FnMut(&[u8])) {
        bytes.iter().for_each(|&byte| self.session.on_byte(byte, send));
    }

    /// Tick of the edge `index`, loops counted on.
    fn edge_tick(&self, index: u64) -> u64 {
        let count = self.edges.len() as u64;
        index / count * self.length + u64::from(self.edges[(index % count) as usize])
    }

    /// Samples of the block that begins now, across the loop's seam.
    fn sample(&self, replay: &Replay<'_>, period: u32, codes: &mut [u16]) {
        let mut done = 0;
        while done < codes.len() {
            let within = (self.now + done as u64 * u64::from(period)) % self.length;
            let count = ((self.length - within).div_ceil(u64::from(period)) as usize).min(codes.len() - done);
            replay.sample(self.from + within as u32, period, &mut codes[done..done + count]);
            done += count;
        }
    }
}

/// The address that `tcp:PORT` or `tcp:HOST:PORT` means; without a host only this machine can connect.
///
/// # Errors
/// Any other text.
pub fn address(text: &str) -> Result<String> {
    let rest =
        text.strip_prefix("tcp:").ok_or_else(|| Error::invalid("--serve", format!("'{text}' is not tcp:PORT")))?;
    Ok(if rest.contains(':') { rest.to_owned() } else { format!("127.0.0.1:{rest}") })
}

/// Serves `signal` until `ended` says so; `ready` is told the address.
///
/// # Errors
/// A port that cannot be had, and what [`Looped::new`] refuses.
pub fn serve(
    signal: &Signal,
    config: &Configuration,
    address: &str,
    ready: impl FnOnce(&str, f64) -> Result<()>,
    ended: impl Fn() -> bool,
) -> Result<()> {
    let refuse = |error: std::io::Error| Error::invalid(format!("tcp:{address}"), error);
    let (config, second) = signal.second_image(config)?;
    let image = signal.image(&config)?;
    let hunting = crate::machine::Hunting::of(signal.teeth).turns;
    let turns = (f64::from(hunting) / signal.pinion_per_tach).round().max(1.0) as u32;
    let mut node =
        Looped::new(&image.bytes, second.as_ref().map(|image| &image.bytes[..]), signal.pulses_per_turn, turns)?;
    let listener = TcpListener::bind(address).map_err(refuse)?;
    listener.set_nonblocking(true).map_err(refuse)?;
    ready(&listener.local_addr().map_err(refuse)?.to_string(), node.loop_s())?;
    let mut peer: Option<TcpStream> = None;
    let mut origin = Instant::now();
    while !ended() {
        if let Ok((stream, _)) = listener.accept()
            && stream.set_nonblocking(true).is_ok()
            && stream.set_nodelay(true).is_ok()
        {
            peer = Some(stream);
        }
        let mut out = Vec::new();
        if let Some(bytes) = peer.as_mut().map(received) {
            match bytes {
                Some(bytes) => node.receive(&bytes, &mut |frame| out.extend_from_slice(frame)),
                None => peer = None,
            }
        }
        let due = origin + Duration::from_secs_f64(node.block_end_s());
        let now = Instant::now();
        if now >= due {
            if now - due > MOST_LATE {
                origin += now - due;
            }
            node.block(&mut |frame| out.extend_from_slice(frame));
        } else {
            std::thread::sleep((due - now).min(Duration::from_millis(10)));
        }
        if peer.as_mut().is_some_and(|stream| !sent(stream, &out)) {
            peer = None;
        }
    }
    Ok(())
}

/// What the peer has sent; `None` where it has gone.
fn received(stream: &mut TcpStream) -> Option<Vec<u8>> {
    let mut buffer = [0; 4096];
    match stream.read(&mut buffer) {
        Ok(0) => None,
        Ok(count) => Some(buffer[..count].to_vec()),
        Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => Some(Vec::new()),
        Err(_) => None,
    }
}

/// Whether the peer is still there after these bytes; what it does not take is lost, as on a wire.
fn sent(stream: &mut TcpStream, bytes: &[u8]) -> bool {
    match stream.write_all(bytes) {
        Ok(()) => true,
        Err(error) => error.kind() == ErrorKind::WouldBlock,
    }
}
