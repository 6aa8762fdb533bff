//! The core's reads and writes of registers: which device, is it clocked, does the model serve it.
//!
//! Strict: what the model does not serve is an error. Devices are accessed by aligned words; those whose registers
//! are narrow by half-words as well, flash's data by any size.

use crate::adc::Converters;
use crate::chip::{Chip, interrupt};
use crate::error::{Access, Refusal};
use crate::flash;
use crate::rcc::Gate;
use crate::time::Source;

/// First address of what is beside the core.
pub const SYSTEM: u32 = 0xe000_e000;
const UNIQUE_ID: u32 = 0x1fff_7a10;
const FLASH_SIZE: u32 = 0x1fff_7a22;
/// What the factory measured of reference and temperature sensor.
const FACTORY: u32 = 0x1fff_7a2a;
const IDENTITY_END: u32 = 0x1fff_7a30;

/// A device by address.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Device {
    Timer(u32),
    Watchdog,
    Power,
    Spi,
    Usart,
    Adc,
    Gpio(usize),
    Rcc,
    Flash,
    Dma(usize),
    System,
}

/// The device at an address with its first address and its gate.
fn device(address: u32) -> Option<(Device, u32, Option<Gate>)> {
    let page = address & !0x3ff;
    Some(match page {
        0x4000_0000 => (Device::Timer(2), page, Some(Gate::Apb1(0))),
        0x4000_0400 => (Device::Timer(3), page, Some(Gate::Apb1(1))),
        0x4000_0c00 => (Device::Timer(5), page, Some(Gate::Apb1(3))),
        0x4000_3000 => (Device::Watchdog, page, None),
        0x4000_3800 => (Device::Spi, page, Some(Gate::Apb1(14))),
        0x4000_7000 => (Device::Power, page, Some(Gate::Apb1(28))),
        0x4001_1000 => (Device::Usart, page, Some(Gate::Apb2(4))),
        // What they have in common takes the first one's clock.
        0x4001_2000 => (Device::Adc, page, Some(Gate::Apb2(8 + Converters::owner(address - page).unwrap_or(0) as u8))),
        0x4002_0000..0x4002_2400 => {
            let port = (page - 0x4002_0000) / 0x400;
            (Device::Gpio(port as usize), page, Some(Gate::Ahb1(port as u8)))
        }
        0x4002_3800 => (Device::Rcc, page, None),
        0x4002_3c00 => (Device::Flash, page, None),
        0x4002_6000 => (Device::Dma(0), page, Some(Gate::Ahb1(21))),
        0x4002_6400 => (Device::Dma(1), page, Some(Gate::Ahb1(22))),
        SYSTEM..0xe000_f000 => (Device::System, SYSTEM, None),
        _ => return None,
    })
}

impl Device {
    fn is_narrow(self) -> bool {
        matches!(self, Device::Timer(_) | Device::Watchdog | Device::Spi | Device::Usart)
    }
}

impl Chip {
    fn locate(&self, address: u32, size: u32) -> Access<(Device, u32)> {
        let (device, base, gate) = device(address).ok_or(Refusal::Forbidden("nothing is there"))?;
        if gate.is_some_and(|gate| !self.rcc.is_clocked(gate)) {
            return Err(Refusal::Forbidden("its clock is off"));
        }
        // Data registers are wider than what DMA takes from them.
        let allowed = size == 4 || size == 2 && device.is_narrow() || self.is_data(address);
        if !address.is_multiple_of(4) || !allowed {
            return Err(Refusal::Forbidden("an access of this size or alignment is not modelled"));
        }
        Ok((device, address - base))
    }

    fn is_data(&self, address: u32) -> bool {
        matches!(address, 0x4001_204c | 0x4001_214c | 0x4001_224c | 0x4001_1004)
    }

    /// Reads registers, or flash as data.
    ///
    /// # Errors
    /// What the model does not serve.
    pub fn read(&mut self, address: u32, size: u32) -> Access<u32> {
        match address {
            flash::START..0x0810_0000 => return Ok(self.flash.read_data(address - flash::START, size, &self.cells)),
            UNIQUE_ID..IDENTITY_END => return self.read_identity(address, size),
            _ => {}
        }
        let (device, offset) = self.locate(address, size)?;
        let (now, core) = (self.now, self.clocks.core);
        match device {
            Device::Timer(number) => {
                let value = self.timer(number).read(offset, now)?;
                self.follow_timer_line(number);
                Ok(value)
            }
            Device::Watchdog => self.watchdog.read(offset, now),
            Device::Power => Err(Refusal::Register),
            Device::Spi => self.spi2.read(offset),
            Device::Usart => self.usart.read(offset),
            Device::Adc => {
                let value = self.adc.read(offset)?;
                self.nvic.set_line(interrupt::ADC, self.adc.interrupt());
                Ok(value)
            }
            Device::Gpio(port) => self.ports[port].read(offset),
            Device::Rcc => self.rcc.read(offset),
            Device::Flash => self.flash.read(offset),
            Device::Dma(number) => self.dma[number].read(offset),
            Device::System => self.nvic.read(offset, now, core),
        }
    }

    fn read_identity(&self, address: u32, size: u32) -> Access<u32> {
        match address {
            UNIQUE_ID | 0x1fff_7a14 | 0x1fff_7a18 if size == 4 => Ok(self.unique[((address - UNIQUE_ID) / 4) as usize]),
            FLASH_SIZE if size == 2 => Ok(flash::BYTES / 1024),
            FACTORY..IDENTITY_END if size == 2 && address.is_multiple_of(2) => {
                Ok(self.factory[((address - FACTORY) / 2) as usize].into())
            }
            _ => Err(Refusal::Register),
        }
    }

    /// Writes registers, or programs flash.
    ///
    /// # Errors
    /// What the model does not serve.
    pub fn write(&mut self, address: u32, size: u32, value: u32) -> Access<()> {
        let (now, core, apb2) = (self.now, self.clocks.core, self.clocks.apb2);
        if (flash::START..0x0810_0000).contains(&address) {
            self.flash.write_data(address - flash::START, size, value, now)?;
            self.schedule.set(Source::Flash, self.flash.due());
            return Ok(());
        }
        if size == 1 && (SYSTEM..0xe000_f000).contains(&address) {
            return self.nvic.write_byte(address - SYSTEM, value as u8);
        }
        let (device, offset) = self.locate(address, size)?;
        match device {
            Device::Timer(number) => self.write_timer(number, offset, value)?,
            Device::Watchdog => {
                self.watchdog.write(offset, value, now)?;
                self.schedule.set(Source::Watchdog, self.watchdog.due());
            }
            Device::Power => return Err(Refusal::Register),
            Device::Spi => {
                let apb1 = self.clocks.apb1;
                self.spi2.write(offset, value, now, apb1)?;
                self.schedule.set(Source::Spi, self.spi2.due());
            }
            Device::Usart => {
                self.usart.write(offset, value, now, apb2)?;
                self.schedule.set(Source::Sent, self.usart.due());
                self.nvic.set_line(interrupt::USART1, self.usart.interrupt());
                self.ask_dma();
            }
            Device::Adc => {
                self.adc.write(offset, value, now, apb2)?;
                self.schedule.set(Source::Converter, self.adc.due());
                self.nvic.set_line(interrupt::ADC, self.adc.interrupt());
            }
            Device::Gpio(port) => {
                let before = self.outputs();
                self.ports[port].write(offset, value)?;
                self.see_outputs(before);
            }
            Device::Rcc => {
                self.rcc.write(offset, value, now, self.flash.wait_states())?;
                let before = self.outputs();
                self.reset_peripherals(self.rcc.held());
                self.see_outputs(before);
                self.follow_clocks();
            }
            Device::Flash => {
                self.flash.write(offset, value, now)?;
                self.schedule.set(Source::Flash, self.flash.due());
            }
            Device::Dma(number) => self.write_dma(number, offset, value)?,
            Device::System => {
                self.nvic.write(offset, value, now, core)?;
                self.schedule.set(Source::SysTick, self.nvic.tick_due(core));
            }
        }
        Ok(())
    }

    fn timer(&mut self, number: u32) -> &mut crate::timer::Timer {
        match number {
            2 => &mut self.tim2,
            3 => &mut self.tim3,
            _ => &mut self.tim5,
        }
    }

    fn follow_timer_line(&mut self, number: u32) {
        let (line, level) = match number {
            2 => (interrupt::TIM2, self.tim2.interrupt()),
            3 => (interrupt::TIM3, self.tim3.interrupt()),
            _ => (interrupt::TIM5, self.tim5.interrupt()),
        };
        self.nvic.set_line(line, level);
    }

    fn write_timer(&mut self, number: u32, offset: u32, value: u32) -> Access<()> {
        let now = self.now;
        if offset == 0x08 && value != 0 && (number == 2 || value >> 4 & 7 != 1) {
            return Err(Refusal::Forbidden("of the triggers between timers ITR1 of TIM3 and TIM5 are modelled"));
        }
        let update = self.timer(number).write(offset, value, now)?;
        self.follow_timers();
        self.follow_timer_line(number);
        if update.trigger {
            self.on_update(number, update, now);
        }
        Ok(())
    }

    fn write_dma(&mut self, number: usize, offset: u32, value: u32) -> Access<()> {
        let enabled = self.dma[number].write(offset, value)?;
        if let Some(stream) = enabled {
            if !self.is_wired(number, stream) {
                return Err(Refusal::Forbidden("this stream's channel leads to no device of the model"));
            }
            if self.dma[number].streams[stream].direction() == crate::dma::Direction::ToDevice {
                self.read_ahead(number, stream);
            }
            self.ask_dma();
        }
        for stream in 0..8 {
            let line = [interrupt::DMA1, interrupt::DMA2][number][stream];
            self.nvic.set_line(line, self.dma[number].interrupt(stream));
        }
        let due = self.dma[0].due().min(self.dma[1].due());
        self.schedule.set(Source::Dma, due);
        Ok(())
    }
}
