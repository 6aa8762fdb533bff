//! Ports: modes, pulls, alternate functions, levels. RM0090 section 8.

use crate::error::{Access, Refusal};

/// A port.
#[derive(Clone, Debug, Default)]
pub struct Port {
    moder: u32,
    otyper: u32,
    ospeedr: u32,
    pupdr: u32,
    odr: u32,
    afr: [u32; 2],
    /// Levels that the world drives.
    driven: u32,
}

/// What a pin is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// Input.
    Input,
    /// Output.
    Output,
    /// Alternate function of this number.
    Alternate(u32),
    /// Analogue.
    Analogue,
}

impl Port {
    /// Port A, B or another (0, 1, 2 ...) after reset: the debug pins of the first two are in use.
    pub fn new(number: usize) -> Self {
        let (moder, ospeedr, pupdr) = match number {
            0 => (0xa800_0000, 0x0c00_0000, 0x6400_0000),
            1 => (0x0000_0280, 0x0000_00c0, 0x0000_0100),
            _ => (0, 0, 0),
        };
        Self { moder, ospeedr, pupdr, ..Self::default() }
    }

    /// Mode of a pin.
    pub fn mode(&self, pin: u32) -> Mode {
        match self.moder >> (2 * pin) & 3 {
            0 => Mode::Input,
            1 => Mode::Output,
            2 => Mode::Alternate(self.afr[(pin / 8) as usize] >> (4 * (pin % 8)) & 0xf),
            _ => Mode::Analogue,
        }
    }

    /// Levels that the port drives: outputs that are high.
    pub fn outputs(&self) -> u32 {
        (0..16).filter(|&pin| self.mode(pin) == Mode::Output).fold(0, |levels, pin| levels | self.odr & 1 << pin)
    }

    /// The world drives a pin.
    pub fn drive(&mut self, pin: u32, level: bool) {
        self.driven = self.driven & !(1 << pin) | u32::from(level) << pin;
    }

    /// Reads a register.
    ///
    /// # Errors
    /// [`Refusal::Register`].
    pub fn read(&self, offset: u32) -> Access<u32> {
        Ok(match offset {
            0x00 => self.moder,
            0x04 => self.otyper,
            0x08 => self.ospeedr,
            0x0c => self.pupdr,
            0x10 => {
                let outputs = (0..16).filter(|&pin| self.mode(pin) == Mode::Output).fold(0, |m, pin| m | 1 << pin);
                self.driven & !outputs | self.odr & outputs
            }
            0x14 => self.odr,
            0x18 => 0,
            0x20 | 0x24 => self.afr[(offset - 0x20) as usize / 4],
            _ => return Err(Refusal::Register),
        })
    }

    /// Writes a register.
    ///
    /// # Errors
    /// [`Refusal::Register`].
    pub fn write(&mut self, offset: u32, value: u32) -> Access<()> {
        match offset {
            0x00 => self.moder = value,
            0x04 => self.otyper = value & 0xffff,
            0x08 => self.ospeedr = value,
            0x0c => self.pupdr = value,
            0x14 => self.odr = value & 0xffff,
            // A pin that is both set and cleared is set.
            0x18 => self.odr = self.odr & !(value >> 16) | value & 0xffff,
            0x20 | 0x24 => self.afr[(offset - 0x20) as usize / 4] = value,
            _ => return Err(Refusal::Register),
        }
        Ok(())
    }
}
