//! SPI2: master of eight bits with software select, as the front end's amplifier needs it. RM0090 section 28.
//!
//! The bytes are moved by the core. What the pins carry is the chip's to say: it knows their modes and the select pin.

use crate::error::{Access, Refusal, within};
use crate::time::{NO_INSTANT, Time};

const CPHA_CPOL: u32 = 0b11;
const MSTR: u32 = 1 << 2;
const SPE: u32 = 1 << 6;
const SSI: u32 = 1 << 8;
const SSM: u32 = 1 << 9;
const CONTROL: u32 = MSTR | 7 << 3 | SPE | SSI | SSM;

const RXNE: u32 = 1 << 0;
const TXE: u32 = 1 << 1;
const MODF: u32 = 1 << 5;
const OVR: u32 = 1 << 6;
const BSY: u32 = 1 << 7;
/// Bits of a byte.
const BITS: Time = 8;

/// The interface.
#[derive(Clone, Debug)]
pub struct Spi {
    cr1: u32,
    sr: u32,
    received: u8,
    /// A read of the data has begun to clear an overrun; a read of the status ends it.
    overrun_read: bool,
    /// Waits behind the byte on the wire.
    waiting: Option<u8>,
    /// On the wire, and when its last bit ends.
    shifting: Option<(u8, Time)>,
    /// A fault of the chip or the board: nothing is ever shifted.
    pub dead: bool,
}

impl Default for Spi {
    fn default() -> Self {
        Self { cr1: 0, sr: TXE, received: 0, overrun_read: false, waiting: None, shifting: None, dead: false }
    }
}

impl Spi {
    /// After a reset; what is broken stays so.
    pub fn reset(&mut self) {
        *self = Self { dead: self.dead, ..Self::default() };
    }

    fn is_master(&self) -> bool {
        self.cr1 & (SPE | MSTR) == SPE | MSTR
    }

    /// Length of a bit, units.
    pub fn bit_time(&self, apb1: Time) -> Time {
        apb1 << (1 + (self.cr1 >> 3 & 7))
    }

    /// When the byte on the wire ends.
    pub fn due(&self) -> Time {
        self.shifting.map_or(NO_INSTANT, |(_, end)| end)
    }

    fn begin(&mut self, now: Time, apb1: Time) {
        if self.is_master()
            && !self.dead
            && self.shifting.is_none()
            && let Some(byte) = self.waiting.take()
        {
            self.shifting = Some((byte, now + BITS * self.bit_time(apb1)));
            self.sr |= TXE | BSY;
        }
    }

    /// The byte on the wire has ended: gives it and takes the one that came meanwhile.
    pub fn finish(&mut self, now: Time, apb1: Time, received: u8) -> Option<u8> {
        let (byte, _) = self.shifting.take()?;
        if self.sr & RXNE != 0 {
            self.sr |= OVR;
        } else {
            self.received = received;
            self.sr |= RXNE;
        }
        self.begin(now, apb1);
        if self.shifting.is_none() {
            self.sr &= !BSY;
        }
        Some(byte)
    }

    /// Reads a register.
    ///
    /// # Errors
    /// [`Refusal::Register`].
    pub fn read(&mut self, offset: u32) -> Access<u32> {
        Ok(match offset {
            0x00 => self.cr1,
            0x04 => 0,
            0x08 => {
                let status = self.sr;
                if std::mem::take(&mut self.overrun_read) {
                    self.sr &= !OVR;
                }
                status
            }
            0x0c => {
                self.sr &= !RXNE;
                self.overrun_read = self.sr & OVR != 0;
                self.received.into()
            }
            _ => return Err(Refusal::Register),
        })
    }

    /// Writes a register; `now` and the bus's clock say when a byte ends.
    ///
    /// # Errors
    /// A register or bit that is not modelled, or what the manual forbids.
    pub fn write(&mut self, offset: u32, value: u32, now: Time, apb1: Time) -> Access<()> {
        match offset {
            0x00 => self.control(value)?,
            0x04 => drop(within(value, 0)?),
            0x0c if self.sr & TXE == 0 => return Err(Refusal::Forbidden("a byte is overwritten that waits")),
            0x0c => {
                self.waiting = Some(within(value, 0xff)? as u8);
                self.sr &= !TXE;
            }
            _ => return Err(Refusal::Register),
        }
        self.begin(now, apb1);
        Ok(())
    }

    fn control(&mut self, value: u32) -> Access<()> {
        within(value, CONTROL)?;
        let on = self.cr1 & value & SPE != 0;
        if on && (self.cr1 ^ value) & (CPHA_CPOL | 7 << 3 | MSTR) != 0 {
            return Err(Refusal::Forbidden("clock and mode are fixed while it is on"));
        }
        self.cr1 = value;
        if value & (MSTR | SSM | SSI) == MSTR | SSM {
            // Inside, another master selects it.
            self.cr1 &= !(MSTR | SPE);
            self.sr |= MODF;
        }
        if self.cr1 & SPE == 0 {
            (self.waiting, self.shifting) = (None, None);
            self.sr = self.sr & !BSY | TXE;
        }
        Ok(())
    }
}
