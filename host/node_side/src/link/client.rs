//! The host's end of the link.
//!
//! A node answers every command with one reply, in order, between its streamed messages. A command or its answer can be
//! lost on the line; every command may be repeated without harm, so the client asks again, up to [`ATTEMPTS`] times.

use super::stream::{Losses, REOPEN_MARK, Stream};
use super::transport::{BITS_PER_SECOND, Transport};
use crate::{Error, Result};
use meshband::config::{Configuration, SCHEMA};
use meshband::events::{Event, EventKind};
use meshband::frame::{MAX_FRAME, Packet, encode};
use meshband::health::Health;
use meshband::law::Law;
use meshband::message::{Identification, Message, Reply, Request, SelfTest, Statistics, WIRE_SCHEMA};
use meshband::node::wall_time::ToldTime;
use meshband::update::{UpdateRequest, UpdateStatus};
use meshband::waveform::{CapturePart, CaptureReport};
use std::collections::VecDeque;
use std::io::ErrorKind;
use std::time::{Duration, Instant};

/// How often a command is sent before the node counts as absent.
pub const ATTEMPTS: u32 = 3;
/// How long one attempt waits for its answer.
pub const ANSWER_PATIENCE: Duration = Duration::from_secs(2);

/// How often a node is called that may only just be starting.
const CALL_EVERY: Duration = Duration::from_millis(250);

/// Most answers kept that no command has taken yet.
pub const REPLIES: usize = 64;
/// Most streamed messages kept that nobody has read yet: half a minute of a busy node.
pub const MESSAGES: usize = 4096;

/// Where a transport was: it has ended.
struct Gone;

impl Transport for Gone {
    fn read(&mut self, _: &mut [u8]) -> std::io::Result<Option<usize>> {
        Ok(None)
    }

    fn write(&mut self, _: &[u8]) -> std::io::Result<()> {
        Err(ErrorKind::BrokenPipe.into())
    }
}

/// A node at the other end of a transport.
pub struct Client {
    transport: Box<dyn Transport>,
    stream: Stream,
    sequence: u16,
    messages: VecDeque<Message>,
    replies: VecDeque<Reply>,
    ended: bool,
}

impl Client {
    /// Speaks over this transport.
    pub fn new(transport: Box<dyn Transport>) -> Self {
        let (messages, replies) = (VecDeque::new(), VecDeque::new());
        Self { transport, stream: Stream::default(), sequence: 0, messages, replies, ended: false }
    }

    /// Lets the transport go: a port that is to be opened again must not be held. What was received stays.
    pub fn hang_up(&mut self) {
        (self.transport, self.ended) = (Box::new(Gone), true);
    }

    /// Goes on over another transport: counters stay, and what went by meanwhile is no loss.
    pub fn reopen(&mut self, transport: Box<dyn Transport>) {
        (self.transport, self.ended) = (transport, false);
        self.take_in(REOPEN_MARK);
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
        self.stream.losses()
    }

    /// Why nothing the node says can be read here, if so.
    pub fn unreadable(&self) -> Option<String> {
        self.stream.other_schema().map(|schema| differs("link", schema.into(), WIRE_SCHEMA.into()))
    }

    /// Whether the link has ended (file read to its end, connection closed) and every message received was taken.
    pub fn has_ended(&self) -> bool {
        self.ended && self.messages.is_empty()
    }

    /// The next streamed message, within `patience`; `None` when none came or the link has ended.
    ///
    /// # Errors
    /// Of the transport.
    pub fn next_message(&mut self, patience: Duration) -> Result<Option<Message>> {
        let deadline = Instant::now() + patience;
        loop {
            if let Some(message) = self.messages.pop_front() {
                return Ok(Some(message));
            }
            if self.ended || Instant::now() >= deadline {
                return Ok(None);
            }
            self.receive()?;
        }
    }

    /// A message that has come already.
    pub fn waiting_message(&mut self) -> Option<Message> {
        self.messages.pop_front()
    }

    /// Takes in what comes until an instant; it stays in the stream.
    ///
    /// # Errors
    /// Of the transport.
    pub fn listen(&mut self, until: Instant) -> Result<()> {
        while !self.ended && Instant::now() < until {
            self.receive()?;
        }
        Ok(())
    }

    /// Waits for an event of a kind; other messages stay in the stream.
    ///
    /// # Errors
    /// [`Error::Tool`] when it does not come within `patience`.
    pub fn wait_event(&mut self, kinds: &[EventKind], patience: Duration) -> Result<Event> {
        let deadline = Instant::now() + patience;
        let wanted = |message: &Message| matches!(message, Message::Event(event) if kinds.contains(&event.kind));
        let (mut seen, mut dropped) = (0, self.losses().unread);
        loop {
            // What was dropped at the front has moved the rest.
            seen -= (self.losses().unread - dropped).min(seen as u32) as usize;
            dropped = self.losses().unread;
            if let Some(at) = (seen..self.messages.len()).find(|&i| wanted(&self.messages[i]))
                && let Some(Message::Event(event)) = self.messages.remove(at)
            {
                return Ok(event);
            }
            seen = self.messages.len();
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
        self.replies.clear();
        for _ in 0..ATTEMPTS {
            self.send(request)?;
            let deadline = Instant::now() + ANSWER_PATIENCE;
            while Instant::now() < deadline && !self.ended {
                if let Some(at) = self.replies.iter().position(|reply| answers(request, reply))
                    && let Some(reply) = self.replies.remove(at)
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
        let (bytes, frames) = self.stream.received();
        match (self.unreadable(), bytes, frames) {
            (Some(why), ..) => why,
            _ if self.ended => format!("the link ended before {} was answered", name(request)),
            (_, 0, _) => {
                format!(
                    "silent for {patience} s: no power, no node on this port, its two lines interchanged, or a node \
                     that speaks Modbus (`configure --at-start`)"
                )
            }
            (_, bytes, 0) => format!(
                "{bytes} bytes in {patience} s and no frame among them: another bit rate than {BITS_PER_SECOND}, or \
                 no node"
            ),
            _ => format!("no answer to {} within {patience} s", name(request)),
        }
    }

    /// Who the node is.
    ///
    /// # Errors
    /// As [`Client::request`]; so for all commands below.
    pub fn identify(&mut self) -> Result<Identification> {
        match self.request(&Request::Identify)? {
            Reply::Identity(identity) => Ok(identity),
            other => Err(unexpected(&other)),
        }
    }

    /// Calls a node until it answers: one that speaks Modbus listens for its link in the first seconds of a start only.
    ///
    /// # Errors
    /// As [`Client::request`], when `patience` is over or the link ends.
    pub fn call(&mut self, patience: Duration) -> Result<Identification> {
        let deadline = Instant::now() + patience;
        self.replies.clear();
        while Instant::now() < deadline && !self.ended {
            self.send(&Request::Identify)?;
            let again = Instant::now() + CALL_EVERY;
            while Instant::now() < again && !self.ended {
                self.receive()?;
                if let Some(Reply::Identity(identity)) =
                    self.replies.iter().find(|reply| answers(&Request::Identify, reply)).cloned()
                {
                    return Ok(identity);
                }
            }
        }
        let seconds = patience.as_secs();
        Err(Error::tool(
            "node",
            format!("no start of a node within {seconds} s: it has to be switched off and on meanwhile"),
        ))
    }

    /// The configuration in force.
    ///
    /// # Errors
    /// As [`Client::request`], and for a node whose configuration has another schema: sent back, it would lack what
    /// is not known here.
    pub fn configuration(&mut self) -> Result<Configuration> {
        match self.request(&Request::GetConfiguration)? {
            Reply::Configuration(held) if held.schema != SCHEMA => {
                Err(Error::tool("node", differs("configuration", held.schema, SCHEMA)))
            }
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

    /// Acknowledges all alarms that stand.
    pub fn acknowledge_alarms(&mut self) -> Result<()> {
        self.done(&Request::AcknowledgeAlarms)
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

    /// Runs the self-test again and gives what is known of it at once; its result comes in the stream.
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

    /// A step of an update, and how far it then is.
    pub fn update(&mut self, step: &UpdateRequest) -> Result<UpdateStatus> {
        match self.request(&Request::Update(step.clone()))? {
            Reply::Update(status) => Ok(status),
            other => Err(unexpected(&other)),
        }
    }

    /// What the node does about waveforms, after one was begun where `trigger` says so.
    pub fn capture(&mut self, trigger: bool) -> Result<CaptureReport> {
        self.capture_report(if trigger { &Request::TriggerCapture } else { &Request::GetCapture })
    }

    /// Part of the bytes of the waveform held, from `offset` on.
    pub fn capture_part(&mut self, number: u32, offset: u32) -> Result<CapturePart> {
        match self.request(&Request::ReadCapture { number, offset })? {
            Reply::CapturePart(part) => Ok(part),
            other => Err(unexpected(&other)),
        }
    }

    /// Lets the node use the memory of this waveform again.
    pub fn release_capture(&mut self, number: u32) -> Result<CaptureReport> {
        self.capture_report(&Request::ReleaseCapture { number })
    }

    fn capture_report(&mut self, request: &Request) -> Result<CaptureReport> {
        match self.request(request)? {
            Reply::Capture(report) => Ok(report),
            other => Err(unexpected(&other)),
        }
    }

    /// The node as a device.
    pub fn health(&mut self) -> Result<Health> {
        self.health_report(&Request::GetHealth)
    }

    /// Tells the node the time of day; gives what it then says of itself.
    pub fn set_wall_time(&mut self, told: ToldTime) -> Result<Health> {
        self.health_report(&Request::SetWallTime(told))
    }

    fn health_report(&mut self, request: &Request) -> Result<Health> {
        match self.request(request)? {
            Reply::Health(health) => Ok(health),
            other => Err(unexpected(&other)),
        }
    }

    /// The newest answers received that no command waits for, as the node's closing statistics; at most [`REPLIES`].
    pub fn take_replies(&mut self) -> Vec<Reply> {
        self.replies.drain(..).collect()
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

    /// Sends a command without waiting for its answer.
    ///
    /// # Errors
    /// Of the transport.
    pub fn send(&mut self, request: &Request) -> Result<()> {
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

    /// Puts a packet where it is waited for; what nobody takes does not grow without end.
    fn keep(&mut self, packet: Packet) {
        match packet {
            Packet::Message(message) => {
                let dropped = push(&mut self.messages, message, MESSAGES);
                self.stream.drop_unread(dropped);
            }
            // Answers that nobody asked for are no loss.
            Packet::Reply(reply) => {
                push(&mut self.replies, reply, REPLIES);
            }
            Packet::Request(_) => {}
        }
    }

    /// Takes in what the transport has.
    fn receive(&mut self) -> Result<()> {
        let mut buffer = [0; 4096];
        let Some(count) = self.transport.read(&mut buffer).map_err(|e| Error::tool("link", e))? else {
            self.ended = true;
            return Ok(());
        };
        self.take_in(&buffer[..count]);
        Ok(())
    }

    fn take_in(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            if let Some(packet) = self.stream.push(byte) {
                self.keep(packet);
            }
        }
    }
}

/// Adds to the end; gives how many fell out at the front.
fn push<T>(queue: &mut VecDeque<T>, item: T, most: usize) -> u32 {
    queue.push_back(item);
    if queue.len() <= most {
        return 0;
    }
    queue.pop_front();
    1
}

/// Two programs that cannot understand each other, in words.
fn differs(what: &str, node: u16, here: u16) -> String {
    format!("the node speaks schema {node} of the {what}, this program knows {here}")
}

/// Whether a reply is one that the command can have.
fn answers(request: &Request, reply: &Reply) -> bool {
    match request {
        Request::Identify => matches!(reply, Reply::Identity(_)),
        Request::GetConfiguration => matches!(reply, Reply::Configuration(_)),
        Request::GetLaw => matches!(reply, Reply::Law(_)),
        Request::SelfTest => matches!(reply, Reply::SelfTest(_)),
        Request::Statistics => matches!(reply, Reply::Statistics(_)),
        Request::GetHealth | Request::SetWallTime(_) => matches!(reply, Reply::Health(_)),
        Request::CommitConfiguration => matches!(reply, Reply::Committing),
        Request::Update(_) => matches!(reply, Reply::Update(_)),
        Request::SetConfiguration(_) | Request::PutLaw(_) => matches!(reply, Reply::Done | Reply::Refused(_)),
        Request::Start | Request::Stop | Request::Snapshot | Request::Events | Request::AcknowledgeAlarms => {
            matches!(reply, Reply::Done)
        }
        Request::TriggerCapture | Request::GetCapture | Request::ReleaseCapture { .. } => {
            matches!(reply, Reply::Capture(_))
        }
        Request::ReadCapture { number, offset } => {
            matches!(reply, Reply::CapturePart(part) if (part.number, part.offset) == (*number, *offset))
        }
    }
}

fn name(request: &Request) -> String {
    let text = format!("{request:?}");
    text.split(|c: char| !c.is_alphanumeric()).next().unwrap_or_default().to_owned()
}

fn unexpected(reply: &Reply) -> Error {
    Error::tool("node", format!("unexpected answer {reply:?}"))
}
