//! What the journal holds: one frame as the node sent it, or one note of the gateway.
//!
//! The frame is kept as received, checksum and schema included: history and broker read it with the node's own
//! decoder, and a journal outlives an update of the gateway as a node outlives it.

use meshband::frame::{Decoder, Frame};
use serde::{Deserialize, Serialize};

/// One entry.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Entry {
    /// Node; empty for the gateway itself.
    pub node: String,
    /// Machine; `_gateway` for the gateway itself.
    pub machine: String,
    /// The chip's number.
    pub unit: [u32; 3],
    /// Starts of this node that the gateway has seen.
    pub boot: u32,
    /// Wall clock at reception, microseconds since 1970.
    pub received_us: i64,
    /// Wall clock of the content by the node's own time base, microseconds since 1970.
    pub time_us: i64,
    /// Content.
    pub body: Body,
}

/// Content of an entry.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Body {
    /// A frame's bytes between its delimiters.
    Frame(Vec<u8>),
    /// Something the gateway saw.
    Note {
        /// What.
        kind: Note,
        /// Kind-specific number.
        detail: i64,
        /// For people.
        text: String,
    },
}

/// What a gateway notes. Only append.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Note {
    /// A node answered; text is its firmware.
    Connected,
    /// A node is gone; text is why.
    Disconnected,
    /// Another chip answers under the name; text is the former one's number.
    Replaced,
    /// The node started anew; detail is its new count of starts.
    Restarted,
    /// Frames missing by sequence number; detail is how many.
    FramesLost,
    /// The wall clock jumped against the steady one; detail is by how many milliseconds.
    ClockJump,
    /// The journal could not be written; detail is how many entries are missing.
    EntriesLost,
    /// A person acknowledged the node's alarms. Read, not written: nodes say so themselves, as an event.
    Acknowledged,
    /// A command from the broker was carried out or refused; text is which.
    Command,
}

impl Entry {
    /// The frame, read by the node's decoder; `None` for notes, and for frames of which nothing is known here.
    pub fn frame(&self) -> Option<Frame> {
        let Body::Frame(bytes) = &self.body else { return None };
        decode(bytes)
    }
}

/// Reads the bytes between two delimiters.
pub fn decode(bytes: &[u8]) -> Option<Frame> {
    let mut decoder: Decoder = Decoder::new();
    for &byte in bytes {
        decoder.push(byte);
    }
    decoder.push(0)?.ok()
}
