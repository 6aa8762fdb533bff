//! Output pins and SPI of the STM32F405 under the drivers that use them, on register blocks of plain memory.
//!
//! Expected values are positions and numbers of the reference manual RM0090 and the data sheet DS8626, as in
//! `stm32_registers.rs`.

use embedded_hal::digital::{ErrorType, OutputPin};
use embedded_hal::spi::{ErrorKind, Operation, SpiBus, SpiDevice};
use meshband_drivers::programmable_gain::{Gain, ProgrammableGain, Setting};
use meshband_drivers::status_light::StatusLight;
use meshband_drivers::switch::Polarity;
use meshband_stm32::design_parameters::TIMER_HZ;
use meshband_stm32::output::Output;
use meshband_stm32::spi::{self, Bus, Device, Fault};
use meshband_stm32::{pac, pins};
use meshband_tests::registers::*;
use std::cell::RefCell;
use std::convert::Infallible;

const MODER: usize = 0x00;
const OSPEEDR: usize = 0x08;
const BSRR: usize = 0x18;
const AFRH: usize = 0x24;
const SPI_CR1: usize = 0x00;
const SPI_SR: usize = 0x08;
const SPI_DR: usize = 0x0c;
const RXNE: u32 = 1 << 0;
const TXE: u32 = 1 << 1;
const MODF: u32 = 1 << 5;
const OVR: u32 = 1 << 6;
const BSY: u32 = 1 << 7;
/// SPE, MSTR, BR = 010 (by 8), SSM with SSI; mode 0,0, 8 bits, most significant first, both directions.
const SPI_WORKING: u32 = (1 << 6) | (1 << 2) | (0b010 << 3) | (1 << 9) | (1 << 8);

/// A peripheral that takes and gives bytes at once: what it receives is what was sent.
fn ready_spi() -> Box<pac::spi1::RegisterBlock> {
    let spi = block::<pac::spi1::RegisterBlock>();
    set(&*spi, SPI_SR, TXE | RXNE);
    spi
}

/// A select pin that keeps its levels, and what the data register held at each.
struct Select<'r> {
    spi: &'r pac::spi1::RegisterBlock,
    log: &'r RefCell<Vec<(bool, u32)>>,
}

impl ErrorType for Select<'_> {
    type Error = Infallible;
}

impl OutputPin for Select<'_> {
    fn set_low(&mut self) -> Result<(), Infallible> {
        self.log.borrow_mut().push((false, word(self.spi, SPI_DR)));
        Ok(())
    }

    fn set_high(&mut self) -> Result<(), Infallible> {
        self.log.borrow_mut().push((true, word(self.spi, SPI_DR)));
        Ok(())
    }
}

#[test]
fn theory_output_pins_write_the_set_reset_register_and_nothing_else() {
    for number in 0..16u8 {
        let port = block::<pac::gpioi::RegisterBlock>();
        let mut pin = Output::new(&*port, number);
        pin.set_high().unwrap();
        assert_eq!(word(&*port, BSRR), 1 << number);
        pin.set_low().unwrap();
        assert_eq!(word(&*port, BSRR), 1 << (number + 16));
        set(&*port, BSRR, 0);
        for offset in (0..size_of::<pac::gpioi::RegisterBlock>()).step_by(4) {
            assert_eq!(word(&*port, offset), 0, "register at {offset:#x}");
        }
    }
}

#[test]
fn theory_light_is_low_when_lit() {
    let port = block::<pac::gpioi::RegisterBlock>();
    let mut light = StatusLight::new(Output::new(&*port, pins::LIGHT), Polarity::ActiveLow);
    light.set(true).unwrap();
    assert_eq!(word(&*port, BSRR), 1 << 28);
    light.set(false).unwrap();
    assert_eq!(word(&*port, BSRR), 1 << 12);
}

#[test]
fn theory_outputs_begin_in_their_safe_state() {
    let (port_a, port_b, port_c) = (
        block::<pac::gpioa::RegisterBlock>(),
        block::<pac::gpiob::RegisterBlock>(),
        block::<pac::gpioi::RegisterBlock>(),
    );
    // As reset leaves port B: its debug pins in alternate function.
    set(&*port_b, MODER, 0x0000_0280);
    set(&*port_b, OSPEEDR, 0x0000_00c0);
    pins::configure(&port_a, &port_b, &port_c);
    assert_eq!(word(&*port_c, BSRR), (1 << 12) | (1 << 22) | (1 << 24) | (1 << 25), "dark, not energised, off");
    assert_eq!(word(&*port_c, MODER), (0b01 << 24) | (0b01 << 18) | (0b01 << 16) | (0b01 << 12));
    assert_eq!(word(&*port_b, BSRR), 1 << 12, "not selected");
    assert_eq!(word(&*port_b, MODER), 0x0000_0280 | (0b01 << 24) | (0b10 << 26) | (0b10 << 30));
    assert_eq!(word(&*port_b, AFRH), (5 << 20) | (5 << 28), "PB13, PB15: SPI2");
    assert_eq!(word(&*port_b, OSPEEDR), 0x0000_00c0 | (0b01 << 26) | (0b01 << 30));
}

#[test]
fn theory_bus_is_a_master_of_mode_0_below_10_mhz() {
    let spi = block::<pac::spi1::RegisterBlock>();
    // As another program may have left it.
    set(&*spi, SPI_CR1, 0xffff);
    let _bus = Bus::start(&spi);
    assert_eq!(word(&*spi, SPI_CR1), SPI_WORKING);
    let divider = 2 << (SPI_WORKING >> 3 & 7);
    assert_eq!(TIMER_HZ / 2 / divider, spi::BUS_HZ);
    const { assert!(spi::BUS_HZ <= 10_000_000) };
}

#[test]
fn theory_every_gain_goes_through_the_registers_under_one_select() {
    for gain in Gain::ALL {
        let spi = ready_spi();
        set(&*spi, SPI_DR, 0x55);
        let log = RefCell::new(Vec::new());
        let device = Device::new(Bus::start(&spi), Select { spi: &spi, log: &log });
        let mut amplifier = ProgrammableGain::new(device);
        amplifier.set_gain(gain).unwrap();
        assert_eq!(amplifier.in_use(), Some(gain));
        // Deselected at start, selected before the first byte, deselected after the last.
        assert_eq!(*log.borrow(), [(true, 0x55), (false, 0x55), (true, gain.code().into())]);
    }
}

#[test]
fn theory_every_gain_of_the_configuration_is_one_of_the_amplifier() {
    assert_eq!(meshband::config::Gain::ALL.len(), Gain::ALL.len());
    for configured in meshband::config::Gain::ALL {
        let gain = Gain::of_factor(configured.factor());
        assert_eq!(gain.map(Gain::code), Some(configured.code()), "{configured:?}");
    }
}

#[test]
fn theory_bytes_come_in_as_they_go_out() {
    let spi = ready_spi();
    let mut bus = Bus::start(&spi);
    let mut received = [0; 4];
    bus.transfer(&mut received, &[1, 2]).unwrap();
    assert_eq!(received, [1, 2, 0, 0], "zeros are sent when there is nothing left to send");
    let mut received = [9];
    bus.transfer(&mut received, &[0x12, 0xa5, 0xff]).unwrap();
    assert_eq!((received, word(&*spi, SPI_DR)), ([0x12], 0xff), "the rest is sent and not kept");
    let mut words = [7, 8, 9];
    bus.transfer_in_place(&mut words).unwrap();
    assert_eq!(words, [7, 8, 9]);
    bus.read(&mut words).unwrap();
    assert_eq!(words, [0; 3]);
    bus.flush().unwrap();
}

#[test]
fn fault_bus_that_does_not_answer_gives_an_error_and_is_left_deselected() {
    for (status, fault, kind) in [
        (0, Fault::Stuck, ErrorKind::Other),
        (TXE, Fault::Stuck, ErrorKind::Other),
        (TXE | RXNE | BSY, Fault::Stuck, ErrorKind::Other),
        (TXE | RXNE | OVR, Fault::Overrun, ErrorKind::Overrun),
        (TXE | RXNE | MODF, Fault::Mode, ErrorKind::ModeFault),
    ] {
        let spi = block::<pac::spi1::RegisterBlock>();
        let log = RefCell::new(Vec::new());
        let device = Device::new(Bus::start(&spi), Select { spi: &spi, log: &log });
        let mut amplifier = ProgrammableGain::new(device);
        set(&*spi, SPI_SR, status);
        // A peripheral that fell back to slave.
        set(&*spi, SPI_CR1, 0);
        assert_eq!(amplifier.set_gain(Gain::X16), Err(fault), "status {status:#x}");
        assert_eq!(embedded_hal::spi::Error::kind(&fault), kind);
        assert_eq!((amplifier.setting(), amplifier.in_use()), (Setting::Doubtful, None));
        assert_eq!(log.borrow().last().map(|(high, _)| *high), Some(true), "deselected");
        assert_eq!(word(&*spi, SPI_CR1), SPI_WORKING, "set up anew for the next transfer");
        // And the next one goes through.
        set(&*spi, SPI_SR, TXE | RXNE);
        amplifier.set_gain(Gain::X16).unwrap();
        assert_eq!(amplifier.in_use(), Some(Gain::X16));
    }
}

#[test]
fn theory_a_transaction_carries_out_all_its_operations() {
    let spi = ready_spi();
    let log = RefCell::new(Vec::new());
    let mut device = Device::new(Bus::start(&spi), Select { spi: &spi, log: &log });
    let (mut read, mut both, mut place) = ([9; 2], [9; 2], [3, 4]);
    device
        .transaction(&mut [
            Operation::Write(&[1]),
            Operation::DelayNs(1000),
            Operation::Read(&mut read),
            Operation::Transfer(&mut both, &[5, 6]),
            Operation::TransferInPlace(&mut place),
        ])
        .unwrap();
    assert_eq!((read, both, place), ([0; 2], [5, 6], [3, 4]));
    assert_eq!(log.borrow().iter().map(|(high, _)| *high).collect::<Vec<_>>(), [true, false, true]);
}
