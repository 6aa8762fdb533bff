//! Bus to the front end's amplifier: SPI2 as master, mode 0,0, 8 bits, 5.25 MHz, as embedded-hal's bus and device.
//!
//! Words are few (two bytes at start and at each change of gain), so the processor moves them itself. Every wait is
//! bounded: a bus that does not answer gives [`Fault::Stuck`] after some tens of microseconds, and the peripheral is
//! switched off and on so that the next transfer starts empty. RM0090 section 28.3 (functional description), 28.5
//! (registers).

use crate::design_parameters::TIMER_HZ;
use crate::pac::spi1::RegisterBlock;
use core::convert::Infallible;
use embedded_hal::digital::OutputPin;
use embedded_hal::spi::{self, Error, ErrorKind, Operation, SpiBus, SpiDevice};

/// Clock of the peripheral, Hz: APB1, half its timers' clock.
const PERIPHERAL_HZ: u32 = TIMER_HZ / 2;
/// The amplifier's highest clock, Hz (DS21117B, section 5.1).
pub const HIGHEST_HZ: u32 = 10_000_000;
/// Clock of the bus, Hz: the fastest the divider gives below the highest.
pub const BUS_HZ: u32 = PERIPHERAL_HZ / 8;
/// Polls of a flag before the bus counts as stuck: over 60 us at 168 MHz, where a byte takes 1.5 us.
pub const PATIENCE: u32 = 1_000;
/// A read of a register of APB1 takes at least one of its clocks of 42 MHz, ns rounded down.
const READ_NS: u32 = 23;

const _: () = assert!(BUS_HZ <= HIGHEST_HZ && BUS_HZ * 2 > HIGHEST_HZ);

/// What can go wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// A flag did not come within the patience.
    Stuck,
    /// A byte was received before the last one was read.
    Overrun,
    /// The peripheral fell back to slave (MODF).
    Mode,
}

impl Error for Fault {
    fn kind(&self) -> ErrorKind {
        match self {
            Fault::Stuck => ErrorKind::Other,
            Fault::Overrun => ErrorKind::Overrun,
            Fault::Mode => ErrorKind::ModeFault,
        }
    }
}

/// The bus.
#[derive(Clone, Copy)]
pub struct Bus<'r>(&'r RegisterBlock);

impl<'r> Bus<'r> {
    /// Sets the peripheral up; its pins belong to [`crate::pins`].
    pub fn start(spi: &'r RegisterBlock) -> Self {
        let bus = Self(spi);
        bus.restart();
        bus
    }

    /// From any state to an empty, working one.
    fn restart(&self) {
        self.0.cr1().reset();
        // An overrun ends with a read of the data, then of the status (RM0090 section 28.3.10).
        let _ = self.0.dr().read();
        let _ = self.0.sr().read();
        // The select pin is an output of its own; inside, the peripheral sees itself not selected by another master.
        self.0.cr1().write(|w| w.mstr().master().br().div8().ssm().enabled().ssi().slave_not_selected());
        self.0.cr1().modify(|_, w| w.spe().enabled());
    }

    /// Sends one byte and takes the one that comes meanwhile.
    fn exchange(&self, byte: u8) -> Result<u8, Fault> {
        self.wait_for(|status| status.txe().bit_is_set())?;
        self.0.dr().write(|w| w.dr().set(byte.into()));
        self.wait_for(|status| status.rxne().bit_is_set())?;
        Ok(self.0.dr().read().dr().bits() as u8)
    }

    fn wait_for(&self, ready: impl Fn(&crate::pac::spi1::sr::R) -> bool) -> Result<(), Fault> {
        for _ in 0..PATIENCE {
            let status = self.0.sr().read();
            if status.modf().bit_is_set() {
                return Err(Fault::Mode);
            }
            if status.ovr().bit_is_set() {
                return Err(Fault::Overrun);
            }
            if ready(&status) {
                return Ok(());
            }
        }
        Err(Fault::Stuck)
    }

    /// Waits at least so long, by reads that take a known time.
    fn pause(&self, nanoseconds: u32) {
        for _ in 0..=nanoseconds / READ_NS {
            let _ = self.0.sr().read();
        }
    }
}

impl spi::ErrorType for Bus<'_> {
    type Error = Fault;
}

impl SpiBus for Bus<'_> {
    fn read(&mut self, words: &mut [u8]) -> Result<(), Fault> {
        words.iter_mut().try_for_each(|word| self.exchange(0).map(|received| *word = received))
    }

    fn write(&mut self, words: &[u8]) -> Result<(), Fault> {
        words.iter().try_for_each(|word| self.exchange(*word).map(|_| ()))
    }

    fn transfer(&mut self, read: &mut [u8], write: &[u8]) -> Result<(), Fault> {
        let common = read.len().min(write.len());
        let (read, read_only) = read.split_at_mut(common);
        let (write, write_only) = write.split_at(common);
        for (received, sent) in read.iter_mut().zip(write) {
            *received = self.exchange(*sent)?;
        }
        self.read(read_only)?;
        self.write(write_only)
    }

    fn transfer_in_place(&mut self, words: &mut [u8]) -> Result<(), Fault> {
        words.iter_mut().try_for_each(|word| self.exchange(*word).map(|received| *word = received))
    }

    fn flush(&mut self) -> Result<(), Fault> {
        self.wait_for(|status| status.bsy().bit_is_clear())
    }
}

/// The one device on the bus, selected by a pin that is low meanwhile.
pub struct Device<'r, S> {
    bus: Bus<'r>,
    select: S,
}

impl<'r, S: OutputPin<Error = Infallible>> Device<'r, S> {
    /// Takes over bus and select pin, and deselects the device.
    pub fn new(bus: Bus<'r>, mut select: S) -> Self {
        let Ok(()) = select.set_high();
        Self { bus, select }
    }

    fn carry_out(&mut self, operation: &mut Operation<'_, u8>) -> Result<(), Fault> {
        match operation {
            Operation::Read(words) => self.bus.read(words),
            Operation::Write(words) => self.bus.write(words),
            Operation::Transfer(read, write) => self.bus.transfer(read, write),
            Operation::TransferInPlace(words) => self.bus.transfer_in_place(words),
            Operation::DelayNs(nanoseconds) => {
                self.bus.flush()?;
                self.bus.pause(*nanoseconds);
                Ok(())
            }
        }
    }
}

impl<S> spi::ErrorType for Device<'_, S> {
    type Error = Fault;
}

impl<S: OutputPin<Error = Infallible>> SpiDevice for Device<'_, S> {
    /// Deselects the device whatever happened.
    fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), Fault> {
        let Ok(()) = self.select.set_low();
        let outcome = operations.iter_mut().try_for_each(|operation| self.carry_out(operation));
        let outcome = outcome.and_then(|()| self.bus.flush());
        if outcome.is_err() {
            self.bus.restart();
        }
        let Ok(()) = self.select.set_high();
        outcome
    }
}
