//! A node with its link: blocks, edges and bytes in, frames out.
//!
//! Boards and the host's simulation of a board run this same code, so that the same record gives the same
//! frames, byte for byte.

use crate::buffers::Buffers;
use crate::config::{Configuration, ConfigurationError};
use crate::events::EventKind;
use crate::frame::{self, Decoder, MAX_FRAME, Packet, PacketRef};
use crate::message::Request;
use crate::node::{Block, Node};
use crate::units::TicksPerSecond;
use core::borrow::BorrowMut;

/// A node, the receiver of its commands and the counter of its frames.
#[derive(Clone, Debug)]
pub struct Session<B = Buffers> {
    node: Node<B>,
    decoder: Decoder,
    sequence: u16,
    unsent: u32,
    commit: bool,
    /// Commits carried out or failed.
    commits: u32,
}

/// A session whose arrays lie in a static of the board.
pub type BoardSession = Session<&'static mut Buffers>;

impl Session {
    /// A node with its arrays inside that waits for its tach, with a fresh link.
    ///
    /// # Errors
    /// The first field of the configuration that is out of range.
    pub fn new(config: Configuration, clock: TicksPerSecond) -> Result<Self, ConfigurationError> {
        Session::with_buffers(config, clock, Buffers::ZERO)
    }
}

impl<B: BorrowMut<Buffers>> Session<B> {
    /// A node with its arrays elsewhere, see [`Node::with_buffers`].
    ///
    /// # Errors
    /// The first field of the configuration that is out of range.
    pub fn with_buffers(config: Configuration, clock: TicksPerSecond, buffers: B) -> Result<Self, ConfigurationError> {
        let node = Node::with_buffers(config, clock, buffers)?;
        Ok(Self { node, decoder: Decoder::new(), sequence: 0, unsent: 0, commit: false, commits: 0 })
    }

    /// The node itself.
    pub fn node(&self) -> &Node<B> {
        &self.node
    }

    /// The node itself, for the board's own notes and self-test.
    pub fn node_mut(&mut self) -> &mut Node<B> {
        &mut self.node
    }

    /// A captured tach edge.
    pub fn on_edge(&mut self, tick: u32) {
        self.node.on_tach_edge(tick);
    }

    /// A block; then sends everything the node has to say about it.
    ///
    /// The node's clock is set to the block's end: what it says depends on its inputs only, never on how
    /// long the processor took.
    pub fn on_block(&mut self, block: Block<'_>, send: &mut impl FnMut(&[u8])) {
        let end = block.first_tick.wrapping_add(block.period_ticks.wrapping_mul(block.codes.len() as u32));
        self.node.on_block(block);
        self.send_messages(end, send);
    }

    /// Sends what the node has to say at an instant; for boards, while no blocks come.
    pub fn send_messages(&mut self, now_tick: u32, send: &mut impl FnMut(&[u8])) {
        while let Some(message) = self.node.poll(now_tick) {
            self.send(PacketRef::Message(&message), send);
        }
    }

    /// A byte from the link; a complete command is carried out and answered at once.
    pub fn on_byte(&mut self, byte: u8, send: &mut impl FnMut(&[u8])) {
        match self.decoder.push(byte) {
            Some(Ok(frame)) => {
                // A node has no use for replies and messages.
                if let Packet::Request(request) = frame.packet {
                    self.on_request(request, send);
                }
            }
            Some(Err(_)) => self.node.note(EventKind::FramesRefused, 1),
            None => {}
        }
    }

    /// A command, answered at once.
    pub fn on_request(&mut self, request: Request, send: &mut impl FnMut(&[u8])) {
        self.commit |= request == Request::CommitConfiguration;
        let reply = self.node.on_request(request);
        self.send(PacketRef::Reply(&reply), send);
    }

    /// Whether a command asked to store the configuration in force, once per command; the board answers with
    /// [`Session::on_stored`].
    pub fn take_commit(&mut self) -> bool {
        core::mem::take(&mut self.commit)
    }

    /// The board has stored the configuration, or failed to. The event's detail counts the attempts: equal events in a row
    /// would be one, and the host would wait for the second.
    pub fn on_stored(&mut self, success: bool) {
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
            Ok(bytes) => send(bytes),
            Err(_) => self.unsent = self.unsent.saturating_add(1),
        }
        self.sequence = self.sequence.wrapping_add(1);
    }
}
