//! Reading a node's link: intact packets, and what was lost or damaged.

use meshband::frame::{Decoder, Packet};
use meshband::message::{Message, Spectrum, Statistics, Status};
use meshband::message::{Peaks, Reply};

/// Everything a node sent in one run.
#[derive(Debug, Clone, Default)]
pub struct Received {
    /// Packets in order.
    pub packets: Vec<Packet>,
    /// Frames refused (checksum, form, version).
    pub refused: u32,
    /// Frames missing by sequence number.
    pub lost: u32,
}

impl Received {
    /// Decodes the bytes of a link.
    pub fn decode(bytes: &[u8]) -> Self {
        let mut decoder = Decoder::new();
        let packets = bytes.iter().filter_map(|&byte| decoder.push(byte)?.ok()).map(|frame| frame.packet).collect();
        Self { packets, refused: decoder.refused(), lost: decoder.lost() }
    }

    /// Streamed messages, in order.
    pub fn messages(&self) -> impl Iterator<Item = &Message> {
        self.packets.iter().filter_map(|packet| match packet {
            Packet::Message(message) => Some(message),
            _ => None,
        })
    }

    /// Mesh-band spectra.
    pub fn spectra(&self) -> impl Iterator<Item = &Spectrum> {
        self.messages().filter_map(|message| if let Message::Spectrum(s) = message { Some(s) } else { None })
    }

    /// Wideband peak lists.
    pub fn peaks(&self) -> impl Iterator<Item = &Peaks> {
        self.messages().filter_map(|message| if let Message::Peaks(p) = message { Some(p) } else { None })
    }

    /// Speed and rate reports.
    pub fn statuses(&self) -> impl Iterator<Item = &Status> {
        self.messages().filter_map(|message| if let Message::Status(s) = message { Some(s) } else { None })
    }

    /// The closing statistics.
    pub fn statistics(&self) -> Option<&Statistics> {
        self.packets.iter().rev().find_map(|packet| match packet {
            Packet::Reply(Reply::Statistics(statistics)) => Some(statistics),
            _ => None,
        })
    }
}
