//! ADC1 to ADC3: one regular channel each, started by a timer or by software, read by DMA or by the core; independent
//! mode. RM0090 section 13.
//!
//! A trigger takes effect at the converter's next clock: with a period that is no multiple of it the aperture
//! jitters, as on the chip. A trigger during a conversion is lost. An overrun ends requests and conversions until it
//! is cleared.

use crate::error::{Access, Refusal, within};
use crate::time::{NO_INSTANT, Time};

const EOC: u32 = 1 << 1;
const STRT: u32 = 1 << 4;
const OVR: u32 = 1 << 5;
const EOCIE: u32 = 1 << 5;
const OVRIE: u32 = 1 << 26;
const ADON: u32 = 1 << 0;
const DMA: u32 = 1 << 8;
const DDS: u32 = 1 << 9;
const EOCS: u32 = 1 << 10;
const ALIGN: u32 = 1 << 11;
const SWSTART: u32 = 1 << 30;
/// Reference and temperature sensor on, in the common register.
const TSVREFE: u32 = 1 << 23;
/// External trigger TIM2's TRGO, rising edge.
const FROM_TIM2: u32 = 0b0110 << 24 | 1 << 28;

/// Sampling times, converter clocks, by the code in `SMPRx`.
const SAMPLING: [Time; 8] = [3, 15, 28, 56, 84, 112, 144, 480];
/// Clocks of a conversion of 12 bits behind the sampling.
const CONVERSION: Time = 12;

/// A conversion under way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Conversion {
    /// The trigger that started it.
    pub trigger: Time,
    /// When the input is held.
    pub held: Time,
    /// When the result is there.
    pub end: Time,
    /// Channel.
    pub channel: u32,
    /// How long the input is taken in.
    pub sampling: Time,
}

/// All converters and what they share.
#[derive(Clone, Debug, Default)]
pub struct Converters {
    /// ADC1 to ADC3.
    pub each: [Adc; 3],
    ccr: u32,
}

/// A register's converter and its place there.
enum Place {
    Own(usize, u32),
    Common,
}

fn place(offset: u32) -> Access<Place> {
    match offset {
        0x000..0x100 => Ok(Place::Own(0, offset)),
        0x100..0x200 => Ok(Place::Own(1, offset - 0x100)),
        0x200..0x300 => Ok(Place::Own(2, offset - 0x200)),
        0x304 => Ok(Place::Common),
        _ => Err(Refusal::Register),
    }
}

impl Converters {
    /// TIM2's trigger output; `apb2` is the period of the bus's clock.
    pub fn trigger(&mut self, at: Time, apb2: Time) {
        let clock = self.clock(apb2);
        self.each.iter_mut().filter(|adc| adc.listens_to_tim2()).for_each(|adc| adc.trigger(at, clock));
    }

    /// Period of the converters' clock.
    fn clock(&self, apb2: Time) -> Time {
        apb2 * 2 * (1 + Time::from(self.ccr >> 16 & 3))
    }

    /// Whether the internal reference and the temperature sensor are on.
    pub fn has_reference(&self) -> bool {
        self.ccr & TSVREFE != 0
    }

    /// When the next conversion under way ends.
    pub fn due(&self) -> Time {
        self.each.iter().map(Adc::due).min().unwrap_or(NO_INSTANT)
    }

    /// Whether the interrupt, which they share, is asked for.
    pub fn interrupt(&self) -> bool {
        self.each.iter().any(Adc::interrupt)
    }

    /// Which converter's registers lie at an offset; `None` for those in common.
    pub fn owner(offset: u32) -> Option<usize> {
        if let Ok(Place::Own(number, _)) = place(offset) { Some(number) } else { None }
    }

    /// Reads a register.
    ///
    /// # Errors
    /// [`Refusal::Register`].
    pub fn read(&mut self, offset: u32) -> Access<u32> {
        match place(offset)? {
            Place::Own(number, offset) => self.each[number].read(offset),
            Place::Common => Ok(self.ccr),
        }
    }

    /// Writes a register.
    ///
    /// # Errors
    /// A register or bit that is not modelled, or what the manual forbids.
    pub fn write(&mut self, offset: u32, value: u32, now: Time, apb2: Time) -> Access<()> {
        let clock = self.clock(apb2);
        match place(offset)? {
            Place::Own(number, 0x08) => {
                let adc = &mut self.each[number];
                adc.control(value & !SWSTART)?;
                if value & SWSTART != 0 {
                    adc.trigger(now, clock);
                }
                Ok(())
            }
            Place::Own(number, offset) => self.each[number].write(offset, value),
            Place::Common => {
                self.ccr = within(value, TSVREFE | 3 << 16)?;
                Ok(())
            }
        }
    }
}

/// A converter.
#[derive(Clone, Debug, Default)]
pub struct Adc {
    sr: u32,
    cr1: u32,
    cr2: u32,
    smpr1: u32,
    smpr2: u32,
    sqr1: u32,
    sqr3: u32,
    dr: u32,
    running: Option<Conversion>,
    /// A result waits for the DMA.
    pub request: bool,
}

impl Adc {
    /// Whether TIM2's trigger output starts conversions.
    pub fn listens_to_tim2(&self) -> bool {
        self.cr2 & ADON != 0 && self.cr2 & 0x3f00_0000 == FROM_TIM2
    }

    /// A trigger; `clock` is the period of the converters' clock.
    pub fn trigger(&mut self, at: Time, clock: Time) {
        let blocked = self.cr2 & ADON == 0 || self.running.is_some() || self.sr & OVR != 0;
        if blocked {
            return;
        }
        let channel = self.sqr3 & 0x1f;
        let code = if channel < 10 { self.smpr2 >> (3 * channel) } else { self.smpr1 >> (3 * (channel - 10)) } & 7;
        let start = at.div_ceil(clock) * clock;
        let sampling = SAMPLING[code as usize] * clock;
        let held = start + sampling;
        self.running = Some(Conversion { trigger: at, held, end: held + CONVERSION * clock, channel, sampling });
        self.sr |= STRT;
    }

    /// When the conversion under way ends.
    pub fn due(&self) -> Time {
        self.running.map_or(NO_INSTANT, |conversion| conversion.end)
    }

    /// The conversion that has ended.
    pub fn finish(&mut self) -> Option<Conversion> {
        self.running.take()
    }

    /// The result of 12 bits.
    pub fn deliver(&mut self, code: u16) {
        let watched = self.cr2 & (DMA | EOCS) != 0;
        if watched && self.sr & EOC != 0 {
            // The result is lost; what was there stays.
            self.sr |= OVR;
            return;
        }
        self.dr = if self.cr2 & ALIGN != 0 { u32::from(code) << 4 } else { code.into() };
        self.sr |= EOC;
        self.request = self.cr2 & DMA != 0;
    }

    /// The result as left-aligned or right-aligned by the program.
    pub fn result(&self) -> u16 {
        self.dr as u16
    }

    /// Whether the interrupt is asked for.
    pub fn interrupt(&self) -> bool {
        self.sr & EOC != 0 && self.cr1 & EOCIE != 0 || self.sr & OVR != 0 && self.cr1 & OVRIE != 0
    }

    /// Reads a register.
    ///
    /// # Errors
    /// [`Refusal::Register`].
    pub fn read(&mut self, offset: u32) -> Access<u32> {
        Ok(match offset {
            0x00 => self.sr,
            0x04 => self.cr1,
            0x08 => self.cr2,
            0x0c => self.smpr1,
            0x10 => self.smpr2,
            0x2c => self.sqr1,
            0x34 => self.sqr3,
            0x4c => {
                self.sr &= !EOC;
                self.request = false;
                self.dr
            }
            _ => return Err(Refusal::Register),
        })
    }

    /// Writes a register.
    ///
    /// # Errors
    /// A register or bit that is not modelled, or what the manual forbids.
    pub fn write(&mut self, offset: u32, value: u32) -> Access<()> {
        match offset {
            // Zeros clear, ones leave.
            0x00 => self.sr &= value,
            0x04 => self.cr1 = within(value, EOCIE | OVRIE)?,
            0x0c => self.smpr1 = within(value, 0x07ff_ffff)?,
            0x10 => self.smpr2 = within(value, 0x3fff_ffff)?,
            // One conversion.
            0x2c => self.sqr1 = within(value, 0)?,
            0x34 => self.sqr3 = within(value, 0x1f)?,
            _ => return Err(Refusal::Register),
        }
        Ok(())
    }

    fn control(&mut self, value: u32) -> Access<()> {
        within(value, ADON | DMA | DDS | EOCS | ALIGN | 0x3f00_0000)?;
        if value & DMA != 0 && value & DDS == 0 {
            return Err(Refusal::Forbidden("without DDS the requests end with the stream's first round"));
        }
        let trigger = value & 0x3f00_0000;
        if trigger >> 28 != 0 && trigger != FROM_TIM2 {
            return Err(Refusal::Bits(trigger));
        }
        self.cr2 = value;
        if value & ADON == 0 {
            self.running = None;
        }
        if value & DMA == 0 {
            self.request = false;
        }
        Ok(())
    }
}
