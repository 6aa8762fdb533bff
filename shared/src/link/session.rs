//! A node with its link: blocks, edges and bytes in, frames out.
//!
//! Boards and the host's simulation of a board run this same code, so that the same record gives the same
//! frames, byte for byte. The session also runs the self-test, and paces what leaves ([`crate::link`]).

use crate::board::Timing;
use crate::buffers::{Arrays, LentArrays, OwnArrays};
use crate::config::LineFormat;
use crate::config::{Configuration, ConfigurationError};
use crate::events::EventKind;
use crate::frame::{self, Decoder, Incoming, MAX_FRAME, PacketRef};
use crate::identity::Identity;
use crate::link::pace::{Pace, Room};
use crate::message::{Message, Reply, Request};
use crate::modbus::Command;
use crate::modbus::station::{Mode, Station};
use crate::node::{Block, Node};
use crate::self_test::SelfTestRun;
use crate::update::{UpdateRequest, UpdateStatus};

/// A node, the receiver of its commands and the counter of its frames.
#[derive(Clone, Debug)]
pub struct Session<A = OwnArrays> {
    node: Node<A>,
    decoder: Decoder<Incoming>,
    test: SelfTestRun,
    pace: Pace,
    station: Station,
    sequence: u16,
    unsent: u32,
    commit: bool,
    /// Commits carried out or failed.
    commits: u32,
}

/// A session whose arrays lie in a static of the board.
pub type BoardSession = Session<LentArrays<'static>>;

impl Session {
    /// A node with its arrays inside that waits for its tach, with a fresh link.
    ///
    /// # Errors
    /// The first field of the configuration that is out of range.
    pub fn new(
        config: Configuration,
        board: impl Into<Timing>,
        identity: Identity,
    ) -> Result<Self, ConfigurationError> {
        Session::with_arrays(config, board, identity, OwnArrays::new())
    }
}

impl<A: Arrays> Session<A> {
    /// A node with its arrays elsewhere, see [`Node::with_arrays`].
    ///
    /// # Errors
    /// The first field of the configuration that is out of range.
    pub fn with_arrays(
        config: Configuration,
        board: impl Into<Timing>,
        identity: Identity,
        arrays: A,
    ) -> Result<Self, ConfigurationError> {
        let board = board.into();
        config.validate(board)?;
        let mut session = Self::of_valid(&config, board, arrays);
        session.begin(identity);
        Ok(session)
    }

    /// As [`Session::with_arrays`], of a configuration that [`Configuration::validate`] accepts for this board;
    /// another one gives a node whose figures mean nothing. Not yet begun: whoever holds the session calls
    /// [`Session::begin`] in its place. What is only put together, and changed nowhere before it lies where it stays,
    /// is built there; anything else is a copy of 13 KB on a board's stack.
    #[inline(never)]
    pub fn of_valid(config: &Configuration, board: Timing, arrays: A) -> Self {
        Self {
            decoder: Decoder::new(),
            test: SelfTestRun::at_start(board.clock, true),
            pace: Pace::new(board.clock),
            station: Station::new(config.link, board.clock),
            sequence: 0,
            unsent: 0,
            commit: false,
            commits: 0,
            node: Node::of_valid(config, board, arrays),
        }
    }

    /// Sets up what lies in the buffers, tests itself and waits for the tach.
    pub fn begin(&mut self, identity: Identity) {
        self.node.begin();
        self.node.set_identity(identity);
        let range = self.node.configuration().range;
        self.test = SelfTestRun::at_start(self.node.clock(), self.node.check_mathematics()).with_range(range);
        self.node.set_self_test(self.test.result());
    }

    /// The node itself.
    pub fn node(&self) -> &Node<A> {
        &self.node
    }

    /// The node itself, for the board's own notes and self-test.
    pub fn node_mut(&mut self) -> &mut Node<A> {
        &mut self.node
    }

    /// A captured tach edge.
    pub fn on_edge(&mut self, tick: u32) {
        self.test.on_edge();
        self.node.on_tach_edge(tick);
    }

    /// A block; then sends what the node has to say about it, as far as the line's pace allows.
    ///
    /// The node's clock is set to the block's end: what it says depends on its inputs only, never on how
    /// long the processor took.
    pub fn on_block(&mut self, block: Block<'_>, send: &mut impl FnMut(&[u8])) {
        let end = self.take_block(block, block.end_tick());
        self.send_messages(end, send);
    }

    /// A block that arrived at a tick, for boards that give it back before anything is sent; returns its end, the
    /// present of
    /// [`Session::send_messages`].
    pub fn take_block(&mut self, block: Block<'_>, arrived: u32) -> u32 {
        if let Some(result) = self.test.on_block(&block, arrived) {
            self.node.report_self_test(result);
        }
        self.node.on_block(block);
        self.commit |= self.node.take_latch_change();
        block.end_tick()
    }

    /// Sends what the node has to say at an instant, as far as the line's pace allows; the rest comes later.
    pub fn send_messages(&mut self, now_tick: u32, send: &mut impl FnMut(&[u8])) {
        self.pace.advance(now_tick);
        if self.station.mode() != Mode::Meshband {
            return self.keep_messages(now_tick);
        }
        while let Some(message) = self.next_message(now_tick) {
            self.send(PacketRef::Message(&message), send);
        }
    }

    /// Where the line is not the link's, results are kept for those who read them as registers.
    fn keep_messages(&mut self, now_tick: u32) {
        while let Some(message) = self.node.poll_results(now_tick) {
            self.station.take(&message, self.node.lifetime().0);
        }
    }

    fn next_message(&mut self, now_tick: u32) -> Option<Message> {
        match self.pace.room() {
            Room::Nothing | Room::Reply => None,
            Room::Result => self.node.poll_results(now_tick),
            Room::Waveform => self.node.poll(now_tick),
        }
    }

    /// Whether a command may be taken: there is room for its reply. Otherwise the bytes wait where they were received.
    pub fn takes_commands(&self) -> bool {
        self.station.mode() != Mode::Meshband || self.pace.room() >= Room::Reply
    }

    /// The board sees that the line has sent everything; for times in which no block tells how late it is.
    pub fn on_line_empty(&mut self) {
        self.pace.clear();
    }

    /// Bytes on their way to the host, at the pace.
    pub fn on_way(&self) -> usize {
        self.pace.on_way()
    }

    /// A byte from the link; a complete command is carried out and answered at once.
    pub fn on_byte(&mut self, byte: u8, send: &mut impl FnMut(&[u8])) {
        self.on_byte_with(byte, &mut |_| UpdateStatus::NOT_SUPPORTED, send);
    }

    /// As [`Session::on_byte`]; `update` carries out a step of an update, for boards with slots.
    pub fn on_byte_with(
        &mut self,
        byte: u8,
        update: &mut impl FnMut(&UpdateRequest) -> UpdateStatus,
        send: &mut impl FnMut(&[u8]),
    ) {
        if self.station.mode() == Mode::Modbus {
            return self.station.push(byte);
        }
        match self.decoder.push(byte) {
            Some(Ok(frame)) => {
                // A node has no use for replies and messages.
                if let Incoming::Request(request) = frame.packet {
                    self.find_link();
                    self.on_request_with(request, update, send);
                }
            }
            // What a PLC says at another rate is no frame of anybody's.
            Some(Err(_)) if self.station.mode() == Mode::Meshband => self.node.note(EventKind::FramesRefused, 1),
            Some(Err(_)) | None => {}
        }
    }

    /// Once per turn of the main loop, after the bytes that were there, with a tick read behind them: the part of
    /// Modbus that goes by the clock.
    pub fn follow_line(&mut self, now_tick: u32, send: &mut impl FnMut(&[u8])) {
        if let Some((answer, command)) = self.station.follow(&self.node, now_tick) {
            send(&answer);
            if let Some(command) = command {
                self.obey(command);
            }
        }
    }

    /// What a Modbus master asked for, as a host asks for it.
    pub fn obey(&mut self, command: Command) {
        let held = self.node.held_waveform().map_or(0, |head| head.facts.number);
        self.node.on_request(match command {
            Command::Acknowledge => Request::AcknowledgeAlarms,
            Command::TakeWaveform => Request::TriggerCapture,
            Command::ReleaseWaveform => Request::ReleaseCapture { number: held },
        });
        self.commit |= self.node.take_latch_change();
    }

    /// How the board's line is to be set at present.
    pub fn line_format(&self) -> LineFormat {
        self.station.format()
    }

    /// The link's own request has come: where the node was still listening, the line is the link's, and what was said
    /// to nobody is said again.
    fn find_link(&mut self) {
        if self.station.mode() != Mode::Meshband {
            self.station.yield_to_link();
            self.node.on_request(Request::Events);
        }
    }

    /// A command, answered at once.
    pub fn on_request(&mut self, request: Request, send: &mut impl FnMut(&[u8])) {
        self.on_request_with(request, &mut |_| UpdateStatus::NOT_SUPPORTED, send);
    }

    /// As [`Session::on_request`]; `update` carries out a step of an update. A refusal is counted.
    #[inline(never)]
    pub fn on_request_with(
        &mut self,
        request: Request,
        update: &mut impl FnMut(&UpdateRequest) -> UpdateStatus,
        send: &mut impl FnMut(&[u8]),
    ) {
        if let Request::Update(step) = &request {
            let status = update(step);
            if let Some(refusal) = status.refusal {
                self.node.note(EventKind::RequestRefused, refusal as u32);
            }
            return self.send(PacketRef::Reply(&Reply::Update(status)), send);
        }
        self.commit |= matches!(request, Request::CommitConfiguration);
        if matches!(request, Request::SelfTest) && !self.test.is_recent(self.node.clock()) {
            let range = self.node.configuration().range;
            self.test = SelfTestRun::again(self.node.check_mathematics()).with_range(range);
            self.node.set_self_test(self.test.result());
        }
        let reply = self.node.on_request(request);
        self.commit |= self.node.take_latch_change();
        self.send(PacketRef::Reply(&reply), send);
    }

    /// Whether a command or a latched alarm asks to store the configuration in force, once each; the board answers with
    /// [`Session::on_stored`].
    pub fn take_commit(&mut self) -> bool {
        core::mem::take(&mut self.commit)
    }

    /// The board has stored the configuration, or failed to. The event's detail counts the attempts: equal events in
    /// a row would be one, and the host would wait for the second.
    pub fn on_stored(&mut self, success: bool) {
        if success {
            self.node.on_stored();
        }
        let kind = if success { EventKind::ConfigurationStored } else { EventKind::ConfigurationNotStored };
        self.commits = self.commits.wrapping_add(1);
        self.node.note(kind, self.commits);
    }

    /// Frames too long to be sent, a defect of the message definitions; always zero in tested versions.
    pub fn unsent(&self) -> u32 {
        self.unsent
    }

    fn send(&mut self, packet: PacketRef<'_>, send: &mut impl FnMut(&[u8])) {
        let mut buffer = [0; MAX_FRAME];
        match frame::encode(packet, self.sequence, &mut buffer) {
            Ok(bytes) => {
                self.pace.take(bytes.len());
                send(bytes);
            }
            Err(_) => self.unsent = self.unsent.saturating_add(1),
        }
        self.sequence = self.sequence.wrapping_add(1);
    }
}
