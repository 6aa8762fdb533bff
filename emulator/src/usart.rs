//! USART1: 8 bits with or without parity, one or two stop bits, at the programmed rate; both ways by DMA, and the
//! interrupt at the end of what was sent. RM0090 section 30.

use crate::error::{Access, Refusal, within};
use crate::time::{NO_INSTANT, Time};

const ORE: u32 = 1 << 3;
const RXNE: u32 = 1 << 5;
const TC: u32 = 1 << 6;
const TXE: u32 = 1 << 7;
const RE: u32 = 1 << 2;
const TE: u32 = 1 << 3;
const TCIE: u32 = 1 << 6;
const PS: u32 = 1 << 9;
const PCE: u32 = 1 << 10;
/// Nine bits a word, of which the last is the parity where there is one.
const M: u32 = 1 << 12;
const UE: u32 = 1 << 13;
/// Two stop bits.
const STOP_2: u32 = 2 << 12;
const DMAR: u32 = 1 << 6;
const DMAT: u32 = 1 << 7;
/// Start, eight bits, stop.
const BITS: Time = 10;
/// A rate that is off by more than this share is not understood.
const TOLERANCE: f64 = 0.03;

/// The interface.
#[derive(Clone, Debug)]
pub struct Usart {
    sr: u32,
    brr: u32,
    cr1: u32,
    cr2: u32,
    cr3: u32,
    received: u8,
    /// Waits behind the byte on the wire.
    waiting: Option<u8>,
    /// On the wire, and when its stop bit ends.
    sending: Option<(u8, Time)>,
}

impl Default for Usart {
    fn default() -> Self {
        Self { sr: TXE | TC, brr: 0, cr1: 0, cr2: 0, cr3: 0, received: 0, waiting: None, sending: None }
    }
}

impl Usart {
    /// Length of a byte on the wire, units; `None` before it is programmed.
    pub fn byte_time(&self, apb2: Time) -> Option<Time> {
        (self.brr >= 16).then(|| self.bits() * Time::from(self.brr) * apb2)
    }

    /// Bits of a character on the wire.
    pub fn bits(&self) -> Time {
        BITS + Time::from(self.cr1 & M != 0) + Time::from(self.cr2 & STOP_2 != 0)
    }

    /// Whether a character that takes so many units, of so many bits, is understood.
    pub fn understands(&self, units: f64, bits: Time, apb2: Time) -> bool {
        let own = self.byte_time(apb2).unwrap_or(0) as f64;
        bits == self.bits() && (own / units - 1.0).abs() <= TOLERANCE
    }

    /// Whether the end of what was sent interrupts.
    pub fn interrupt(&self) -> bool {
        self.cr1 & TCIE != 0 && self.sr & TC != 0
    }

    /// Whether bytes are received.
    pub fn listens(&self) -> bool {
        self.cr1 & (UE | RE) == UE | RE
    }

    /// Whether the DMA is asked for a byte to send.
    pub fn asks_for_byte(&self) -> bool {
        self.cr3 & DMAT != 0 && self.cr1 & (UE | TE) == UE | TE && self.sr & TXE != 0
    }

    /// Whether the DMA is asked to take a byte.
    pub fn offers_byte(&self) -> bool {
        self.cr3 & DMAR != 0 && self.sr & RXNE != 0
    }

    /// When the byte on the wire ends.
    pub fn due(&self) -> Time {
        self.sending.map_or(NO_INSTANT, |(_, end)| end)
    }

    /// A byte to send has come.
    pub fn send(&mut self, byte: u8, now: Time, apb2: Time) {
        self.waiting = Some(byte);
        self.sr &= !(TXE | TC);
        self.begin(now, apb2);
    }

    fn begin(&mut self, now: Time, apb2: Time) {
        if self.sending.is_none()
            && let (Some(byte), Some(time)) = (self.waiting, self.byte_time(apb2))
        {
            (self.sending, self.waiting) = (Some((byte, now + time)), None);
            self.sr |= TXE;
        }
    }

    /// The byte on the wire has ended.
    pub fn finish(&mut self, now: Time, apb2: Time) -> Option<u8> {
        let (byte, _) = self.sending.take()?;
        self.begin(now, apb2);
        if self.sending.is_none() {
            self.sr |= TC;
        }
        Some(byte)
    }

    /// A byte has come over the wire; one not taken before is kept, and the new one lost.
    pub fn receive(&mut self, byte: u8) {
        if !self.listens() {
            return;
        }
        if self.sr & RXNE != 0 {
            self.sr |= ORE;
        } else {
            self.received = byte;
            self.sr |= RXNE;
        }
    }

    /// Reads a register.
    ///
    /// # Errors
    /// [`Refusal::Register`].
    pub fn read(&mut self, offset: u32) -> Access<u32> {
        Ok(match offset {
            0x00 => self.sr,
            0x04 => {
                self.sr &= !(RXNE | ORE);
                self.received.into()
            }
            0x08 => self.brr,
            0x0c => self.cr1,
            0x10 => self.cr2,
            0x14 => self.cr3,
            _ => return Err(Refusal::Register),
        })
    }

    /// Writes a register.
    ///
    /// # Errors
    /// A register or bit that is not modelled.
    pub fn write(&mut self, offset: u32, value: u32, now: Time, apb2: Time) -> Access<()> {
        match offset {
            // Only these are cleared by a zero.
            0x00 => self.sr &= value | !(RXNE | TC),
            0x04 => self.send(value as u8, now, apb2),
            0x08 => self.brr = within(value, 0xffff)?,
            0x0c => self.cr1 = within(value, UE | TE | RE | TCIE | M | PCE | PS)?,
            0x10 => self.cr2 = within(value, STOP_2)?,
            0x14 => self.cr3 = within(value, DMAR | DMAT)?,
            _ => return Err(Refusal::Register),
        }
        Ok(())
    }
}
