//! Bytes of a link into packets and counters: the one place that says what was lost, what was refused, and that a node
//! restarted.
//!
//! A live view, a capture that is replayed and a command all count here, so equal bytes give equal figures. Where a
//! link was lost and opened again [`REOPEN_MARK`] stands between the bytes; what went by meanwhile was nobody's loss. A
//! node that begins anew is known by its sequence (zero, or going back) or, where both runs of numbers happen to fit,
//! by the ticks of its statuses, which go back. Limit: frames lost around a restart cannot be told from frames that
//! were never sent; only those of the new run are counted.

use meshband::frame::{Decoder, FrameError, Packet};
use meshband::message::Message;

/// Stands in a capture where the link was opened again: no frame of a node reads so.
pub const REOPEN_MARK: &[u8] = b"\0meshband: link opened again\0";
/// A gap of more frames than this is a sequence that went back: half of what the number counts.
const MIN_BACKWARD_GAP: u16 = 1 << 15;

/// What did not arrive, or not whole.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Losses {
    /// Frames missing by sequence number.
    pub lost: u32,
    /// Pieces refused: checksum, form, version.
    pub refused: u32,
    /// Times the node began anew.
    pub restarts: u32,
    /// Times the link was lost and opened again.
    pub reopened: u32,
    /// Messages dropped here because nobody read them in time.
    pub unread: u32,
    /// Intact messages of kinds that only newer programs know.
    pub unknown: u32,
}

/// A link's bytes as they come.
#[derive(Debug)]
pub struct Stream {
    decoder: Decoder,
    /// Bytes of [`REOPEN_MARK`] seen in a row.
    mark: usize,
    losses: Losses,
    /// Tick of the newest status of this run of the node.
    tick: Option<u64>,
    other_schema: Option<u8>,
    bytes: u64,
    frames: u64,
}

impl Default for Stream {
    fn default() -> Self {
        let losses = Losses::default();
        Self { decoder: Decoder::new(), mark: 0, losses, tick: None, other_schema: None, bytes: 0, frames: 0 }
    }
}

impl Stream {
    /// What was lost so far.
    pub fn losses(&self) -> Losses {
        self.losses
    }

    /// Counts messages that were dropped behind this place.
    pub fn drop_unread(&mut self, count: u32) {
        self.losses.unread += count;
    }

    /// Schema of a sender that cannot be read here.
    pub fn other_schema(&self) -> Option<u8> {
        self.other_schema
    }

    /// Bytes and intact frames so far.
    pub fn received(&self) -> (u64, u64) {
        (self.bytes, self.frames)
    }

    /// Takes a byte; a packet comes with the end of its frame.
    pub fn push(&mut self, byte: u8) -> Option<Packet> {
        self.bytes += 1;
        self.mark = match REOPEN_MARK.get(self.mark) {
            Some(&next) if next == byte => self.mark + 1,
            _ => usize::from(byte == 0),
        };
        if self.mark == REOPEN_MARK.len() {
            (self.decoder, self.mark) = (Decoder::new(), 0);
            self.losses.reopened += 1;
            return None;
        }
        match self.decoder.push(byte)? {
            Err(FrameError::Unknown(_)) => {
                self.frames += 1;
                self.losses.unknown += 1;
                None
            }
            Err(error) => {
                self.losses.refused += 1;
                if let FrameError::Version(schema) = error {
                    self.other_schema = Some(schema);
                }
                None
            }
            Ok(frame) => {
                self.frames += 1;
                self.count_gap(frame.sequence, frame.lost);
                self.follow_time(&frame.packet);
                Some(frame.packet)
            }
        }
    }

    fn count_gap(&mut self, sequence: u16, lost: u16) {
        if lost >= MIN_BACKWARD_GAP || (sequence == 0 && lost != 0) {
            self.restarts();
            self.losses.lost += u32::from(sequence);
        } else {
            self.losses.lost += u32::from(lost);
        }
    }

    fn follow_time(&mut self, packet: &Packet) {
        let Packet::Message(Message::Status(status)) = packet else { return };
        if self.tick.is_some_and(|tick| status.tick < tick) {
            self.restarts();
        }
        self.tick = Some(status.tick);
    }

    fn restarts(&mut self) {
        self.losses.restarts += 1;
        self.tick = None;
    }
}
