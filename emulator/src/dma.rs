//! DMA1 and DMA2: streams in direct mode, circles, double buffers, and the word that is read ahead. RM0090 section 10.
//!
//! The chip moves the items ([`crate::chip`]); here is what a stream knows. In direct mode a stream that goes from
//! memory to a device fetches its first item when it is enabled and the next one right behind each transfer (section
//! 10.3.13).

use crate::error::{Access, Refusal, within};
use crate::time::{NO_INSTANT, Time};

const EN: u32 = 1 << 0;
const TEIE: u32 = 1 << 2;
const HTIE: u32 = 1 << 3;
const TCIE: u32 = 1 << 4;
const CIRC: u32 = 1 << 8;
const PINC: u32 = 1 << 9;
const MINC: u32 = 1 << 10;
const DBM: u32 = 1 << 18;
const CT: u32 = 1 << 19;
/// Read-only field of `FCR`.
const FIFO_STATE: u32 = 7 << 3;

/// Flags of a stream, as they lie in `LISR` and `HISR` from its first bit on.
pub mod flag {
    /// FIFO error.
    pub const FIFO: u32 = 1 << 0;
    /// Direct mode error.
    pub const DIRECT_MODE: u32 = 1 << 2;
    /// Transfer error.
    pub const ERROR: u32 = 1 << 3;
    /// Half of the items.
    pub const HALF: u32 = 1 << 4;
    /// All of the items.
    pub const COMPLETION: u32 = 1 << 5;
}

/// Which way a stream goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// From a device to memory.
    ToMemory,
    /// From memory to a device.
    ToDevice,
}

/// A stream.
#[derive(Clone, Debug)]
pub struct Stream {
    cr: u32,
    ndtr: u32,
    reload: u32,
    par: u32,
    m0ar: u32,
    m1ar: u32,
    fcr: u32,
    flags: u32,
    /// Items moved in this round.
    moved: u32,
    /// Item read ahead.
    pub ahead: Option<u32>,
    /// When the item that was asked for is moved.
    pub due: Time,
}

impl Default for Stream {
    fn default() -> Self {
        Self {
            cr: 0,
            ndtr: 0,
            reload: 0,
            par: 0,
            m0ar: 0,
            m1ar: 0,
            fcr: 0x21,
            flags: 0,
            moved: 0,
            ahead: None,
            due: NO_INSTANT,
        }
    }
}

impl Stream {
    /// Whether it is enabled.
    pub fn is_enabled(&self) -> bool {
        self.cr & EN != 0
    }

    /// Request channel.
    pub fn channel(&self) -> u32 {
        self.cr >> 25 & 7
    }

    /// Which way it goes.
    pub fn direction(&self) -> Direction {
        if self.cr >> 6 & 3 == 1 { Direction::ToDevice } else { Direction::ToMemory }
    }

    /// Bytes of an item.
    pub fn item_bytes(&self) -> u32 {
        1 << (self.cr >> 13 & 3)
    }

    /// Address of the device.
    pub fn device(&self) -> u32 {
        self.par
    }

    /// Address of the next item in memory.
    pub fn memory(&self) -> u32 {
        let base = if self.cr & (DBM | CT) == DBM | CT { self.m1ar } else { self.m0ar };
        if self.cr & MINC != 0 { base.wrapping_add(self.moved * self.item_bytes()) } else { base }
    }

    /// Transfers that are left.
    pub fn left(&self) -> u32 {
        self.ndtr
    }

    /// An item has been moved.
    pub fn advance(&mut self) {
        self.ndtr -= 1;
        self.moved += 1;
        if self.moved == self.reload.div_ceil(2) {
            self.flags |= flag::HALF;
        }
        if self.ndtr > 0 {
            return;
        }
        self.flags |= flag::COMPLETION;
        self.moved = 0;
        if self.cr & DBM != 0 {
            self.cr ^= CT;
        }
        if self.cr & (CIRC | DBM) != 0 {
            self.ndtr = self.reload;
        } else {
            self.cr &= !EN;
            // What the device asked for meanwhile is another stream's.
            (self.due, self.ahead) = (NO_INSTANT, None);
        }
    }

    /// The bus has refused a transfer.
    pub fn fail(&mut self) {
        self.flags |= flag::ERROR;
        self.cr &= !EN;
        (self.due, self.ahead) = (NO_INSTANT, None);
    }

    fn interrupt(&self) -> bool {
        [(TCIE, flag::COMPLETION), (HTIE, flag::HALF), (TEIE, flag::ERROR)]
            .iter()
            .any(|(enable, flag)| self.cr & enable != 0 && self.flags & flag != 0)
    }

    fn read(&self, offset: u32) -> Access<u32> {
        Ok(match offset {
            0x00 => self.cr,
            0x04 => self.ndtr,
            0x08 => self.par,
            0x0c => self.m0ar,
            0x10 => self.m1ar,
            // An empty FIFO.
            0x14 => self.fcr & !FIFO_STATE | 4 << 3,
            _ => return Err(Refusal::Register),
        })
    }

    /// True where the write enabled the stream.
    fn write(&mut self, offset: u32, value: u32) -> Access<bool> {
        let (enabled, double) = (self.is_enabled(), self.cr & DBM != 0);
        let fixed = Refusal::Forbidden("fixed while the stream is enabled");
        match offset {
            0x00 => return self.control(value),
            0x04 | 0x08 | 0x14 if enabled => return Err(fixed),
            0x0c if enabled && !(double && self.cr & CT != 0) => return Err(fixed),
            0x10 if enabled && !(double && self.cr & CT == 0) => return Err(fixed),
            0x04 => (self.ndtr, self.reload) = (within(value, 0xffff)?, value),
            0x08 => self.par = value,
            0x0c => self.m0ar = value,
            0x10 => self.m1ar = value,
            // Direct mode; the threshold means nothing in it.
            0x14 => self.fcr = within(value & !FIFO_STATE, 3)?,
            _ => return Err(Refusal::Register),
        }
        Ok(false)
    }

    fn control(&mut self, value: u32) -> Access<bool> {
        // No flow control by the device, no bursts, no direct mode error interrupt.
        within(value, EN | TEIE | HTIE | TCIE | 0xc0 | CIRC | PINC | MINC | 0x7800 | 0x30000 | DBM | CT | 7 << 25)?;
        if self.is_enabled() {
            if (value ^ self.cr) & !(EN | TEIE | HTIE | TCIE) != 0 {
                return Err(Refusal::Forbidden("fixed while the stream is enabled"));
            }
            self.cr = value;
            if value & EN == 0 {
                // The end of a stream stopped by the program is told as a complete transfer (section 10.3.14).
                self.flags |= flag::COMPLETION;
                (self.due, self.ahead) = (NO_INSTANT, None);
            }
            return Ok(false);
        }
        self.cr = value;
        if value & EN == 0 {
            return Ok(false);
        }
        self.check()?;
        self.moved = 0;
        self.reload = self.ndtr;
        Ok(true)
    }

    fn check(&self) -> Access<()> {
        let forbidden = |what| Err(Refusal::Forbidden(what));
        if self.flags != 0 {
            return forbidden("a stream is enabled with flags of its last transfers");
        }
        if self.ndtr == 0 {
            return forbidden("a stream is enabled without transfers");
        }
        if self.cr >> 6 & 3 > 1 {
            return forbidden("memory to memory is not modelled");
        }
        if self.cr >> 11 & 3 != self.cr >> 13 & 3 || self.cr >> 13 & 3 == 3 {
            return forbidden("sizes differ at the two ends: not in direct mode");
        }
        if self.cr & PINC != 0 {
            return forbidden("a device's address that increments is not modelled");
        }
        if self.fcr & 4 != 0 {
            return forbidden("the FIFO is not modelled");
        }
        let size = self.item_bytes();
        if [self.par, self.m0ar].iter().any(|address| address % size != 0) {
            return forbidden("an address is not aligned to the item");
        }
        Ok(())
    }
}

/// A controller.
#[derive(Clone, Debug, Default)]
pub struct Dma {
    /// Its streams.
    pub streams: [Stream; 8],
}

/// First bit of a stream's flags in its status register.
const fn shift(stream: usize) -> u32 {
    [0, 6, 16, 22][stream & 3]
}

impl Dma {
    /// Whether a stream's interrupt is asked for.
    pub fn interrupt(&self, stream: usize) -> bool {
        self.streams[stream].interrupt()
    }

    /// When the first item is moved.
    pub fn due(&self) -> Time {
        self.streams.iter().map(|stream| stream.due).min().unwrap_or(NO_INSTANT)
    }

    /// Reads a register.
    ///
    /// # Errors
    /// [`Refusal::Register`].
    pub fn read(&self, offset: u32) -> Access<u32> {
        let status = |from: usize| (from..from + 4).map(|n| self.streams[n].flags << shift(n)).sum();
        match offset {
            0x00 => Ok(status(0)),
            0x04 => Ok(status(4)),
            0x08 | 0x0c => Ok(0),
            _ => self.streams.get(stream_of(offset)?).ok_or(Refusal::Register)?.read((offset - 0x10) % 0x18),
        }
    }

    /// Writes a register; gives the stream that it enabled.
    ///
    /// # Errors
    /// A register or bit that is not modelled, or what the manual forbids.
    pub fn write(&mut self, offset: u32, value: u32) -> Access<Option<usize>> {
        match offset {
            0x08 | 0x0c => {
                let from = if offset == 0x08 { 0 } else { 4 };
                within(value, 0x0f7d_0f7d)?;
                for n in from..from + 4 {
                    self.streams[n].flags &= !(value >> shift(n));
                }
                Ok(None)
            }
            _ => {
                let number = stream_of(offset)?;
                let stream = self.streams.get_mut(number).ok_or(Refusal::Register)?;
                Ok(stream.write((offset - 0x10) % 0x18, value)?.then_some(number))
            }
        }
    }
}

fn stream_of(offset: u32) -> Access<usize> {
    offset.checked_sub(0x10).map(|inside| inside as usize / 0x18).ok_or(Refusal::Register)
}
