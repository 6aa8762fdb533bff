//! The host's end of the link.
//!
//! A node answers every command with one reply, in order, between its streamed messages. A command or its answer can be
//! lost on the line; every command may be repeated without harm, so the client asks again, up to [`ATTEMPTS`] times.

use super::transport::{BITS_PER_SECOND, Transport};
use crate::{Error, Result};
use meshband::config::Configuration;
use meshband::events::{Event, EventKind};
use meshband::frame::{Decoder, FrameError, MAX_FRAME, Packet, encode};
use meshband::law::Law;
use meshband::message::{Identity, Message, PROTOCOL, Reply, Request, SelfTest, Statistics};
use std::collections::VecDeque;
use std::io::ErrorKind;
use std::time::{Duration, Instant};

/// How often a command is sent before the node counts as absent.
pub const ATTEMPTS: u32 = 3;
/// How long one attempt waits for its answer.
pub const ANSWER_PATIENCE: Duration = Duration::from_secs(2);

/// What did not arrive, or not whole.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Losses {
    /// Frames missing by sequence number.
    pub lost: u32,
    /// Pieces refused: checksum, form, version.
    pub refused: u32,
    /// Times the sequence began anew: the node restarted.
    pub restarts: u32,
}

/// A node at the other end of a transport.
pub struct Client {
    transport: Box<dyn Transport>,
    decoder: Decoder,
    sequence: u16,
    losses: Losses,
    waiting: VecDeque<Packet>,
    ended: bool,
    other_version: Option<u8>,
    /// Bytes and intact frames received.
    bytes: u64,
    frames: u64,
}

impl Client {
    /// Speaks over this transport.
    pub fn new(transport: Box<dyn Transport>) -> Self {
        Self {
            transport,
            decoder: Decoder::new(),
            sequence: 0,
            losses: Losses::default(),
            waiting: VecDeque::new(),
            ended: false,
            other_version: None,
            bytes: 0,
            frames: 0,
        }
    }

    /// Opens a port by name (see [`super::transport`]).
    ///
    /// # Errors
    /// Of the port.
    pub fn open(port: &str) -> Result<Self> {
        Ok(Self::new(super::transport::open(port)?))
    }

    /// What the link lost so far.
    pub fn losses(&self) -> Losses {
        self.losses
    }

    /// Whether the link has ended (file read to its end, connection closed) and every message received was taken.
    pub fn has_ended(&self) -> bool {
        self.ended && !self.waiting.iter().any(|packet| matches!(packet, Packet::Message(_)))
    }

    /// The next streamed message, within `patience`; `None` when none came or the link has ended.
    ///
    /// # Errors
    /// Of the transport.
    pub fn next_message(&mut self, patience: Duration) -> Result<Option<Message>> {
        let deadline = Instant::now() + patience;
        loop {
            let at = self.waiting.iter().position(|packet| matches!(packet, Packet::Message(_)));
            if let Some(Packet::Message(message)) = at.and_then(|at| self.waiting.remove(at)) {
                return Ok(Some(message));
            }
            if self.ended || Instant::now() >= deadline {
                return Ok(None);
            }
            self.receive()?;
        }
    }

    /// Waits for an event of a kind; other messages stay in the stream.
    ///
    /// # Errors
    /// [`Error::Tool`] when it does not come within `patience`.
    pub fn wait_event(&mut self, kinds: &[EventKind], patience: Duration) -> Result<Event> {
        let deadline = Instant::now() + patience;
        let mut seen = 0;
        loop {
            while let Some(packet) = self.waiting.get(seen) {
                match packet {
                    Packet::Message(Message::Event(event)) if kinds.contains(&event.kind) => {
                        let event = *event;
                        self.waiting.remove(seen);
                        return Ok(event);
                    }
                    _ => seen += 1,
                }
            }
            if self.ended || Instant::now() >= deadline {
                return Err(Error::tool("node", format!("did not report any of {kinds:?}")));
            }
            self.receive()?;
        }
    }

    /// Sends a command and waits for its answer.
    ///
    /// # Errors
    /// [`Error::Tool`] when the node does not answer, the link ends, or the node speaks another version.
    pub fn request(&mut self, request: &Request) -> Result<Reply> {
        // Late answers to former attempts would be taken for this one's.
        self.waiting.retain(|packet| !matches!(packet, Packet::Reply(_)));
        for _ in 0..ATTEMPTS {
            self.send(request)?;
            let deadline = Instant::now() + ANSWER_PATIENCE;
            while Instant::now() < deadline && !self.ended {
                if let Some(at) = self.waiting.iter().position(|p| matches!(p, Packet::Reply(r) if answers(request, r)))
                    && let Some(Packet::Reply(reply)) = self.waiting.remove(at)
                {
                    return Ok(reply);
                }
                self.receive()?;
            }
        }
        Err(Error::tool("node", self.silence(request)))
    }

    /// Why a command has no answer, as far as what did come tells.
    fn silence(&self, request: &Request) -> String {
        let patience = ANSWER_PATIENCE.as_secs() * u64::from(ATTEMPTS);
        match (self.other_version, self.bytes, self.frames) {
            (Some(version), ..) => format!("speaks version {version} of the link, this program {PROTOCOL}"),
            _ if self.ended => format!("the link ended before {} was answered", name(request)),
            (_, 0, _) => {
                format!("silent for {patience} s: no power, no node on this port, or its two lines interchanged")
            }
            (_, bytes, 0) => format!(
                "{bytes} bytes in {patience} s and no frame among them: another bit rate than {BITS_PER_SECOND}, or no node"
            ),
            _ => format!("no answer to {} within {patience} s", name(request)),
        }
    }

    /// Who the node is.
    ///
    /// # Errors
    /// As [`Client::request`]; so for all commands below.
    pub fn identify(&mut self) -> Result<Identity> {
        match self.request(&Request::Identify)? {
            Reply::Identity(identity) => Ok(identity),
            other => Err(unexpected(&other)),
        }
    }

    /// The configuration in force.
    pub fn configuration(&mut self) -> Result<Configuration> {
        match self.request(&Request::GetConfiguration)? {
            Reply::Configuration(configuration) => Ok(configuration),
            other => Err(unexpected(&other)),
        }
    }

    /// Replaces the configuration in force.
    pub fn set_configuration(&mut self, configuration: &Configuration) -> Result<()> {
        self.done(&Request::SetConfiguration(configuration.clone()))
    }

    /// Stores the configuration in force and waits until the node has confirmed it.
    pub fn commit(&mut self) -> Result<()> {
        self.done(&Request::CommitConfiguration)?;
        let outcomes = [EventKind::ConfigurationStored, EventKind::ConfigurationNotStored];
        match self.wait_event(&outcomes, Duration::from_secs(10))?.kind {
            EventKind::ConfigurationStored => Ok(()),
            _ => Err(Error::tool("node", "could not store the configuration; the one stored before stays")),
        }
    }

    /// The law in force.
    pub fn law(&mut self) -> Result<Law> {
        match self.request(&Request::GetLaw)? {
            Reply::Law(law) => Ok(law),
            other => Err(unexpected(&other)),
        }
    }

    /// Replaces the law in force.
    pub fn put_law(&mut self, law: &Law) -> Result<()> {
        self.done(&Request::PutLaw(*law))
    }

    /// Measures.
    pub fn start(&mut self) -> Result<()> {
        self.done(&Request::Start)
    }

    /// Stops measuring.
    pub fn stop(&mut self) -> Result<()> {
        self.done(&Request::Stop)
    }

    /// Asks for the next wideband waveform; it comes in the stream.
    pub fn snapshot(&mut self) -> Result<()> {
        self.done(&Request::Snapshot)
    }

    /// Asks for all kept events again; they come in the stream.
    pub fn events(&mut self) -> Result<()> {
        self.done(&Request::Events)
    }

    /// Result of the boot self-test.
    pub fn self_test(&mut self) -> Result<SelfTest> {
        match self.request(&Request::SelfTest)? {
            Reply::SelfTest(result) => Ok(result),
            other => Err(unexpected(&other)),
        }
    }

    /// Counters since the node's start.
    pub fn statistics(&mut self) -> Result<Statistics> {
        match self.request(&Request::Statistics)? {
            Reply::Statistics(statistics) => Ok(statistics),
            other => Err(unexpected(&other)),
        }
    }

    /// The answers received that no command waits for, as the node's closing statistics.
    pub fn take_replies(&mut self) -> Vec<Reply> {
        let (replies, rest) =
            std::mem::take(&mut self.waiting).into_iter().partition(|p| matches!(p, Packet::Reply(_)));
        self.waiting = rest;
        let replies: VecDeque<Packet> = replies;
        replies.into_iter().filter_map(|p| if let Packet::Reply(reply) = p { Some(reply) } else { None }).collect()
    }

    /// Sends raw bytes, as a test of a noisy line does.
    ///
    /// # Errors
    /// Of the transport.
    pub fn send_raw(&mut self, bytes: &[u8]) -> Result<()> {
        self.transport.write(bytes).map_err(|e| Error::tool("link", e))
    }

    fn done(&mut self, request: &Request) -> Result<()> {
        match self.request(request)? {
            Reply::Done | Reply::Committing => Ok(()),
            Reply::Refused(error) => Err(Error::invalid("node refused the configuration", error)),
            other => Err(unexpected(&other)),
        }
    }

    fn send(&mut self, request: &Request) -> Result<()> {
        let mut buffer = [0; MAX_FRAME];
        let frame = encode(request, self.sequence, &mut buffer)
            .map_err(|e| Error::invalid("command", format!("does not fit a frame: {e:?}")))?;
        self.sequence = self.sequence.wrapping_add(1);
        match self.transport.write(frame) {
            // What was answered before the peer went may still be read.
            Err(e) if matches!(e.kind(), ErrorKind::BrokenPipe | ErrorKind::ConnectionReset) => Ok(()),
            other => other.map_err(|e| Error::tool("link", e)),
        }
    }

    /// Takes in what the transport has.
    fn receive(&mut self) -> Result<()> {
        let mut buffer = [0; 4096];
        let Some(count) = self.transport.read(&mut buffer).map_err(|e| Error::tool("link", e))? else {
            self.ended = true;
            return Ok(());
        };
        self.bytes += count as u64;
        for &byte in &buffer[..count] {
            match self.decoder.push(byte) {
                None => {}
                Some(Err(error)) => {
                    self.losses.refused += 1;
                    if let FrameError::Version(version) = error {
                        self.other_version = Some(version);
                    }
                }
                Some(Ok(frame)) => {
                    self.frames += 1;
                    // A restarted node counts from zero; a gap that ends exactly there is no loss of 65 000 frames.
                    if frame.sequence == 0 && frame.lost != 0 {
                        self.losses.restarts += 1;
                    } else {
                        self.losses.lost += u32::from(frame.lost);
                    }
                    self.waiting.push_back(frame.packet);
                }
            }
        }
        Ok(())
    }
}

/// Whether a reply is one that the command can have.
fn answers(request: &Request, reply: &Reply) -> bool {
    match request {
        Request::Identify => matches!(reply, Reply::Identity(_)),
        Request::GetConfiguration => matches!(reply, Reply::Configuration(_)),
        Request::GetLaw => matches!(reply, Reply::Law(_)),
        Request::SelfTest => matches!(reply, Reply::SelfTest(_)),
        Request::Statistics => matches!(reply, Reply::Statistics(_)),
        Request::CommitConfiguration => matches!(reply, Reply::Committing),
        Request::SetConfiguration(_) | Request::PutLaw(_) => matches!(reply, Reply::Done | Reply::Refused(_)),
        Request::Start | Request::Stop | Request::Snapshot | Request::Events => matches!(reply, Reply::Done),
    }
}

fn name(request: &Request) -> String {
    let text = format!("{request:?}");
    text.split(|c: char| !c.is_alphanumeric()).next().unwrap_or_default().to_owned()
}

fn unexpected(reply: &Reply) -> Error {
    Error::tool("node", format!("unexpected answer {reply:?}"))
}
