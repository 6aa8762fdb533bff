//! Programmable-gain amplifier of the analogue front end: Microchip MCP6S21, and MCP6S22/26/28 on their first channel.
//!
//! Source: data sheet DS21117B. Section 5.1: SPI mode 0,0 or 1,1, at most 10 MHz, words of 16 bits under one chip
//! select (other counts of clocks abort the command), first byte to the instruction register, second to the register
//! it names. Section 5.2: instruction register (register 5-1), gain register (register 5-2). The amplifier cannot be
//! read back: what was written without a fault of the bus is all that is known, and [`Setting`] says no more than
//! that.

use embedded_hal::spi::SpiDevice;

/// Instruction: write to the gain register (commands 010, address 0).
const WRITE_GAIN: u8 = 0b0100_0000;
/// Instruction: shut down (command 001); the second byte is ignored.
const SHUT_DOWN: u8 = 0b0010_0000;

/// Gains of the amplifier. The discriminant is the code in the gain register.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Gain {
    /// 1, as after power-up.
    X1 = 0,
    /// 2.
    X2 = 1,
    /// 4.
    X4 = 2,
    /// 5.
    X5 = 3,
    /// 8.
    X8 = 4,
    /// 10.
    X10 = 5,
    /// 16.
    X16 = 6,
    /// 32.
    X32 = 7,
}

impl Gain {
    /// All gains, in order of their codes.
    pub const ALL: [Gain; 8] = [Gain::X1, Gain::X2, Gain::X4, Gain::X5, Gain::X8, Gain::X10, Gain::X16, Gain::X32];

    /// The gain itself, V/V: amplitudes at the sensor are those at the converter divided by this.
    pub const fn factor(self) -> u8 {
        match self {
            Gain::X1 => 1,
            Gain::X2 => 2,
            Gain::X4 => 4,
            Gain::X5 => 5,
            Gain::X8 => 8,
            Gain::X10 => 10,
            Gain::X16 => 16,
            Gain::X32 => 32,
        }
    }

    /// Code in the gain register.
    pub const fn code(self) -> u8 {
        self as u8
    }

    /// The gain with a factor; `None` where the amplifier has none such.
    pub fn of_factor(factor: u8) -> Option<Gain> {
        Gain::ALL.into_iter().find(|gain| gain.factor() == factor)
    }
}

/// What is known of the amplifier.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Setting {
    /// Nothing was written yet: 1 if the amplifier was powered up with the node, else what it was.
    Unwritten,
    /// This gain was written last, without a fault.
    Written(Gain),
    /// Shut down: the converter sees no signal.
    ShutDown,
    /// The last write failed and may or may not have arrived. No amplitude can be scaled.
    Doubtful,
}

/// The amplifier.
#[derive(Clone, Debug)]
pub struct ProgrammableGain<S> {
    spi: S,
    setting: Setting,
    last: Option<Gain>,
}

impl<S: SpiDevice> ProgrammableGain<S> {
    /// Takes over the amplifier; nothing is written.
    pub const fn new(spi: S) -> Self {
        Self { spi, setting: Setting::Unwritten, last: None }
    }

    /// Writes a gain, in force as the chip select rises; wakes an amplifier that is shut down.
    ///
    /// # Errors
    /// The bus's own; the setting is then doubtful and the last gain that was written stays remembered.
    pub fn set_gain(&mut self, gain: Gain) -> Result<(), S::Error> {
        self.send([WRITE_GAIN, gain.code()])?;
        self.setting = Setting::Written(gain);
        self.last = Some(gain);
        Ok(())
    }

    /// Shuts the amplifier down; the next [`Self::set_gain`] wakes it.
    ///
    /// # Errors
    /// The bus's own; the setting is then doubtful.
    pub fn shut_down(&mut self) -> Result<(), S::Error> {
        self.send([SHUT_DOWN, 0])?;
        self.setting = Setting::ShutDown;
        Ok(())
    }

    fn send(&mut self, word: [u8; 2]) -> Result<(), S::Error> {
        self.setting = Setting::Doubtful;
        self.spi.write(&word)
    }

    /// What is known of the amplifier.
    pub const fn setting(&self) -> Setting {
        self.setting
    }

    /// The gain that is known to be in use, for scaling amplitudes.
    pub const fn in_use(&self) -> Option<Gain> {
        match self.setting {
            Setting::Written(gain) => Some(gain),
            Setting::Unwritten | Setting::ShutDown | Setting::Doubtful => None,
        }
    }

    /// The last gain that was written without a fault, whatever came after.
    pub const fn last_written(&self) -> Option<Gain> {
        self.last
    }
}
