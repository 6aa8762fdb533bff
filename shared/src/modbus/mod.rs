//! Modbus RTU: the node's results as registers and bits, for a PLC.
//!
//! The second personality of the line ([`crate::config::LinkConfig`]); everything else of the node is the same.
//! Results are kept as they would have left as messages ([`bank`]), so that a register holds what the link would have
//! said, bit for bit. [`map`] is the one definition of the registers: requests are answered from it, and
//! the csv of `meshband modbus` is made from it. [`mod@line`] finds the requests among the bytes, [`server`]
//! answers one, [`station`] puts them together and holds the way back to the link.
//!
//! A plant's master reads a node. Where the configuration permits it, it may also write one register ([`Command`]):
//! acknowledge, take a waveform, release it. Configuration stays with the link.
//!
//! Written here and not taken from the crate `rmodbus` (0.13): that answers an unknown function before it has looked
//! at the checksum, so noise makes it drive a shared line; the figures are in `book/src/adr/0008-modbus.md`. Sources:
//! "MODBUS over serial line specification V1.02" (silence, address, broadcast) and "MODBUS application protocol
//! V1.1b3" (functions 2, 3, 4, 6, 16, exceptions).
//!
//! Cost: 1.1 KB of memory; an answer of 125 registers some 20 000 instructions, half of them the checksum.

pub mod bank;
pub mod line;
pub mod map;
pub mod server;
pub mod station;

use crc::{CRC_16_MODBUS, Crc, NoTable};

/// Longest frame, address and checksum included.
pub const MAX_FRAME: usize = 256;
/// Version of [`map`]: raised whenever a register is added; none is ever moved or given another meaning.
pub const MAP_VERSION: u16 = 6;

/// What a master may ask for, by the value that it writes to [`map::COMMAND`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command {
    /// 1: all alarms are acknowledged.
    Acknowledge,
    /// 2: a waveform is taken.
    TakeWaveform,
    /// 3: the waveform held is released.
    ReleaseWaveform,
}

impl Command {
    /// Of a value written.
    pub fn of(value: u16) -> Option<Self> {
        match value {
            1 => Some(Self::Acknowledge),
            2 => Some(Self::TakeWaveform),
            3 => Some(Self::ReleaseWaveform),
            _ => None,
        }
    }
}

/// Checksum of a frame, sent low byte first. Without its table: 512 bytes of flash against 2000 instructions per
/// longest frame.
pub const CRC16: Crc<u16, NoTable> = Crc::<u16, NoTable>::new(&CRC_16_MODBUS);
