//! Frames: sequence number, postcard body and CRC-32 under COBS, between two zero bytes.
//!
//! COBS keeps zeros out of the frame, so a receiver resynchronises at the next zero whatever was lost or damaged. The
//! leading zero costs a byte and keeps a frame whose end was lost from swallowing the next one.
//! Layout before COBS: sender's schema (1 byte), oldest schema whose readers can take the frame (1 byte), sequence (2
//! bytes, little-endian), postcard of [`Packet`], CRC-32 (ISO-HDLC) of all that (4 bytes, little-endian). Sequence
//! gaps count whole lost frames exactly up to 65535 in a row.
//!
//! Readers of another schema take what they know of a frame ([`crate::schema`]); a kind of message that is not known is
//! skipped and counted ([`FrameError::Unknown`]), and a sender that cannot be read at all is named
//! ([`FrameError::Version`]).

use crate::link::compact;
use crate::message::{Message, OLDEST_READABLE, OLDEST_READER, Reply, Request, WIRE_SCHEMA};
use crate::schema;
use core::cmp::Ordering;
use core::marker::PhantomData;
use crc::{CRC_32_ISO_HDLC, Crc};
use serde::{Deserialize, Serialize};

/// Longest frame on the wire, delimiters included, bytes.
pub const MAX_FRAME: usize = 1360;

const HEADER: usize = 4;
const CHECKSUM: usize = 4;
/// Longest content before COBS: one byte per 254 and the delimiters are overhead.
const MAX_CONTENT: usize = MAX_FRAME - MAX_FRAME / 254 - 3;

/// CRC-32 of frames and digests.
pub const CRC32: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);

/// What a frame carries.
// No heap to box the large variants in; few values exist at a time.
#[allow(clippy::large_enum_variant)]
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub enum Packet {
    /// Host to node.
    Request(Request),
    /// Node to host, answering.
    Reply(Reply),
    /// Node to host, streamed.
    Message(Message),
}

/// [`Packet`] by reference, for sending; the same bytes.
#[derive(Clone, Copy, Debug, Serialize)]
pub enum PacketRef<'a> {
    /// Host to node.
    Request(&'a Request),
    /// Node to host, answering.
    Reply(&'a Reply),
    /// Node to host, streamed.
    Message(&'a Message),
}

/// What a receiver makes of a frame's content.
pub trait Content: Sized {
    /// Reads postcard of a [`Packet`]; `writer` is the sender's schema compared with ours. `None` where the content
    /// is not understood.
    fn read(bytes: &[u8], writer: Ordering) -> Option<Self>;
}

impl Content for Packet {
    fn read(bytes: &[u8], writer: Ordering) -> Option<Self> {
        schema::read(bytes, writer)
    }
}

/// What a node takes from the link. Replies and messages are nothing to it, and the code that reads them is not in
/// its image.
// No heap to box the large variant in; few values exist at a time.
#[allow(clippy::large_enum_variant)]
#[derive(Clone, Debug, PartialEq)]
pub enum Incoming {
    /// A command.
    Request(Request),
    /// What a node sends: an echo, or another node on the line.
    Foreign,
}

impl Content for Incoming {
    fn read(bytes: &[u8], writer: Ordering) -> Option<Self> {
        // The variant of [`Packet`].
        match bytes.split_first()? {
            (0, request) => schema::read(request, writer).map(Self::Request),
            (1 | 2, _) => Some(Self::Foreign),
            _ => None,
        }
    }
}

impl<'a> From<&'a Request> for PacketRef<'a> {
    fn from(request: &'a Request) -> Self {
        Self::Request(request)
    }
}
impl<'a> From<&'a Reply> for PacketRef<'a> {
    fn from(reply: &'a Reply) -> Self {
        Self::Reply(reply)
    }
}
impl<'a> From<&'a Message> for PacketRef<'a> {
    fn from(message: &'a Message) -> Self {
        Self::Message(message)
    }
}
impl<'a> From<&'a Packet> for PacketRef<'a> {
    fn from(packet: &'a Packet) -> Self {
        match packet {
            Packet::Request(request) => Self::Request(request),
            Packet::Reply(reply) => Self::Reply(reply),
            Packet::Message(message) => Self::Message(message),
        }
    }
}

/// A received frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame<P = Packet> {
    /// Sender's sequence number.
    pub sequence: u16,
    /// Frames missing before this one.
    pub lost: u16,
    /// Content.
    pub packet: P,
}

/// Why a frame was refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum FrameError {
    /// Longer than [`MAX_FRAME`].
    TooLong,
    /// Not COBS, or shorter than header and checksum.
    Malformed,
    /// Checksum differs.
    Checksum,
    /// Intact, but its sender's schema, this one, cannot be read here.
    Version(u8),
    /// Intact, of our schema or an older one, but the content is not understood.
    Content,
    /// Intact, of a newer schema, this one, and of a kind that is not known here.
    Unknown(u8),
    /// The destination buffer is too small (encoding only).
    NoRoom,
}

/// Writes one frame, delimiters included, into `buffer` (at least [`MAX_FRAME`] bytes hold any frame).
pub fn encode<'b, 'p>(
    packet: impl Into<PacketRef<'p>>,
    sequence: u16,
    buffer: &'b mut [u8],
) -> Result<&'b [u8], FrameError> {
    let mut content = [0u8; MAX_CONTENT];
    content[0] = WIRE_SCHEMA;
    content[1] = OLDEST_READER;
    content[2..HEADER].copy_from_slice(&sequence.to_le_bytes());
    let body = &mut content[HEADER..MAX_CONTENT - CHECKSUM];
    let length = compact::write(&packet.into(), body).ok_or(FrameError::NoRoom)?;
    let end = HEADER + length;
    let checksum = CRC32.checksum(content.get(..end).ok_or(FrameError::NoRoom)?);
    let place = content.get_mut(end..end + CHECKSUM).ok_or(FrameError::NoRoom)?;
    place.copy_from_slice(&checksum.to_le_bytes());
    let content = content.get(..end + CHECKSUM).ok_or(FrameError::NoRoom)?;
    let (leading, place) = buffer.split_first_mut().ok_or(FrameError::NoRoom)?;
    *leading = 0;
    let coded = cobs::try_encode(content, place).map_err(|_| FrameError::NoRoom)?;
    *place.get_mut(coded).ok_or(FrameError::NoRoom)? = 0;
    Ok(&buffer[..coded + 2])
}

/// Receiver; feed it bytes in any portions.
#[derive(Clone, Debug)]
pub struct Decoder<P = Packet> {
    bytes: [u8; MAX_FRAME],
    length: usize,
    overflow: bool,
    expected: Option<u16>,
    refused: u32,
    lost: u32,
    content: PhantomData<fn() -> P>,
}

impl<P: Content> Default for Decoder<P> {
    fn default() -> Self {
        Self::new()
    }
}

impl<P: Content> Decoder<P> {
    /// A receiver that waits for its first delimiter or frame.
    pub const fn new() -> Self {
        Self {
            bytes: [0; MAX_FRAME],
            length: 0,
            overflow: false,
            expected: None,
            refused: 0,
            lost: 0,
            content: PhantomData,
        }
    }

    /// Takes one byte; a result comes with each delimiter that ends a non-empty frame.
    pub fn push(&mut self, byte: u8) -> Option<Result<Frame<P>, FrameError>> {
        if byte != 0 {
            match self.bytes.get_mut(self.length) {
                Some(place) => {
                    *place = byte;
                    self.length += 1;
                }
                None => self.overflow = true,
            }
            return None;
        }
        let (length, overflow) = (self.length, self.overflow);
        (self.length, self.overflow) = (0, false);
        if length == 0 {
            return None;
        }
        let result = if overflow { Err(FrameError::TooLong) } else { self.open(length) };
        if result.is_err() {
            self.refused = self.refused.saturating_add(1);
        }
        Some(result)
    }

    fn open(&mut self, length: usize) -> Result<Frame<P>, FrameError> {
        let bytes = self.bytes.get_mut(..length).ok_or(FrameError::Malformed)?;
        let decoded = cobs::decode_in_place(bytes).map_err(|_| FrameError::Malformed)?;
        let content = bytes.get(..decoded).ok_or(FrameError::Malformed)?;
        let (signed, checksum) = content.split_last_chunk::<CHECKSUM>().ok_or(FrameError::Malformed)?;
        if signed.len() < HEADER {
            return Err(FrameError::Malformed);
        }
        if CRC32.checksum(signed) != u32::from_le_bytes(*checksum) {
            return Err(FrameError::Checksum);
        }
        let (writer, oldest_reader) = (signed[0], signed[1]);
        // Before there were schemas the second byte was another.
        if writer < OLDEST_READABLE || (writer > WIRE_SCHEMA && oldest_reader > WIRE_SCHEMA) {
            return Err(FrameError::Version(writer));
        }
        let sequence = u16::from_le_bytes([signed[2], signed[3]]);
        let lost = self.expected.map_or(0, |expected| sequence.wrapping_sub(expected));
        self.expected = Some(sequence.wrapping_add(1));
        self.lost = self.lost.saturating_add(u32::from(lost));
        match P::read(&signed[HEADER..], writer.cmp(&WIRE_SCHEMA)) {
            Some(packet) => Ok(Frame { sequence, lost, packet }),
            None if writer > WIRE_SCHEMA => Err(FrameError::Unknown(writer)),
            None => Err(FrameError::Content),
        }
    }

    /// Frames refused since start.
    pub fn refused(&self) -> u32 {
        self.refused
    }

    /// Frames missing by sequence number since start.
    pub fn lost(&self) -> u32 {
        self.lost
    }
}
