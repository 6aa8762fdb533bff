//! What the node speaks on its line: its own link, or Modbus RTU for a PLC.
//!
//! The first values are those of nodes that knew nothing else ([`crate::schema`]), so zeros mean the link of before.
//! Rate and parity concern Modbus alone; their first values are the defaults of "MODBUS over serial line V1.02",
//! sections 2.3 and 3.3: 19 200 bit/s, even parity. The link itself has one rate for ever
//! ([`crate::link::BITS_PER_SECOND`]): a host that finds a node has no settings to guess.

use crate::link;
use core::ops::RangeInclusive;
use serde::{Deserialize, Serialize};

/// Addresses of Modbus nodes; 0 is for all, those above are reserved.
pub const ADDRESSES: RangeInclusive<u8> = 1..=247;
/// Rates that can be asked for. The divider of an STM32F405's UART ends at 1282 bit/s.
pub const RATES: RangeInclusive<u32> = 2_400..=115_200;
/// Rate that 0 stands for.
pub const STANDARD_RATE: u32 = 19_200;

/// Language of the line.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Personality {
    /// The link of this project.
    #[default]
    Meshband,
    /// Modbus RTU ([`crate::modbus`]); from the next start on, after the time in which the node still listens for its
    /// own link.
    Modbus,
}

/// Parity and stop bits of a character.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Parity {
    /// Even, one stop bit: the standard's default.
    #[default]
    Even,
    /// Odd, one stop bit.
    Odd,
    /// None, two stop bits, as the standard asks for without parity.
    NoneTwoStop,
    /// None, one stop bit, as many masters are set.
    NoneOneStop,
}

impl Parity {
    /// Bits of a character on the line, start and stop included.
    pub const fn bits(self) -> u32 {
        if matches!(self, Self::NoneOneStop) { 10 } else { 11 }
    }
}

/// The line; read at the node's start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct LinkConfig {
    /// What is spoken.
    pub personality: Personality,
    /// Modbus address, 1 to 247; without Modbus 0 will do.
    pub address: u8,
    /// Bits per second of Modbus, 2400 to 115 200; 0 stands for 19 200.
    pub bits_per_second: u32,
    /// Parity and stop bits of Modbus.
    pub parity: Parity,
}

impl LinkConfig {
    /// The rate of Modbus in force.
    pub const fn rate(&self) -> u32 {
        if self.bits_per_second == 0 { STANDARD_RATE } else { self.bits_per_second }
    }

    /// Whether a master can reach what is configured.
    pub fn is_sane(&self) -> bool {
        let addressed =
            ADDRESSES.contains(&self.address) || (self.personality == Personality::Meshband && self.address == 0);
        addressed && RATES.contains(&self.rate())
    }
}

/// How a Modbus node answers beyond the standard.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ModbusOptions {
    /// A master may write the command register ([`crate::modbus::Command`]); otherwise every write is refused.
    pub commands: bool,
    /// Values of two registers have their low word first.
    pub low_word_first: bool,
}

/// How characters are sent on the line, as boards set their UART.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LineFormat {
    /// Bits per second.
    pub bits_per_second: u32,
    /// Parity and stop bits.
    pub parity: Parity,
    /// Others speak on the line, too: its driver is on only while the node sends.
    pub shared: bool,
}

impl LineFormat {
    /// The project's link.
    pub const MESHBAND: Self =
        Self { bits_per_second: link::BITS_PER_SECOND, parity: Parity::NoneOneStop, shared: false };

    /// Modbus as configured.
    pub const fn of_modbus(config: &LinkConfig) -> Self {
        Self { bits_per_second: config.rate(), parity: config.parity, shared: true }
    }
}
