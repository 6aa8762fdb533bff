//! A chip at full clock with its devices' gates open, and register addresses by the manual's names.
#![allow(dead_code, reason = "every test program uses some of it")]

use meshband_emulator::chip::Chip;
use meshband_emulator::error::Refusal;
use meshband_emulator::time::{Time, UNITS_PER_SECOND};

pub const TIM2: u32 = 0x4000_0000;
pub const TIM3: u32 = 0x4000_0400;
pub const TIM5: u32 = 0x4000_0c00;
pub const IWDG: u32 = 0x4000_3000;
pub const USART1: u32 = 0x4001_1000;
pub const ADC1: u32 = 0x4001_2000;
pub const ADC_COMMON: u32 = 0x4001_2300;
pub const GPIOA: u32 = 0x4002_0000;
pub const GPIOC: u32 = 0x4002_0800;
pub const RCC: u32 = 0x4002_3800;
pub const FLASH: u32 = 0x4002_3c00;
pub const DMA1: u32 = 0x4002_6000;
pub const DMA2: u32 = 0x4002_6400;
pub const SYSTEM: u32 = 0xe000_e000;
pub const SRAM: u32 = 0x2000_0000;
pub const CCM: u32 = 0x1000_0000;

/// Units of a tick of the timers of APB1 at full clock.
pub const TICK: Time = 4;

/// Registers of a stream.
pub fn stream(dma: u32, number: u32) -> u32 {
    dma + 0x10 + 0x18 * number
}

/// Writes a word that must be accepted.
pub fn set(chip: &mut Chip, address: u32, value: u32) {
    chip.write(address, 4, value).unwrap_or_else(|refusal| panic!("{address:#x} = {value:#x}: {refusal:?}"));
}

/// Reads a word that must be there.
pub fn get(chip: &mut Chip, address: u32) -> u32 {
    chip.read(address, 4).unwrap_or_else(|refusal| panic!("{address:#x}: {refusal:?}"))
}

/// Why a write is refused.
pub fn refusal(chip: &mut Chip, address: u32, value: u32) -> Refusal {
    chip.write(address, 4, value).expect_err("refused")
}

/// Lets time pass.
pub fn wait(chip: &mut Chip, units: Time) {
    chip.advance(chip.now + units);
}

/// Seconds as units.
pub fn seconds(seconds: f64) -> Time {
    (seconds * UNITS_PER_SECOND as f64).round() as Time
}

/// A chip at 168 MHz from its crystal, all gates open.
pub fn running() -> Chip {
    let mut chip = Chip::new();
    full_clock(&mut chip);
    set(&mut chip, RCC + 0x30, 0x0070_01ff);
    set(&mut chip, RCC + 0x40, 0x1000_000b);
    set(&mut chip, RCC + 0x44, 0x0000_0110);
    chip
}

/// The clock tree of the node: 8 MHz / 4 x 168 / 2, APB1 by 4, APB2 by 2.
pub fn full_clock(chip: &mut Chip) {
    set(chip, RCC, 0x83 | 1 << 16);
    wait(chip, seconds(0.003));
    set(chip, FLASH, 0x705);
    set(chip, RCC + 4, 1 << 22 | 4 | 168 << 6 | 7 << 24);
    set(chip, RCC, 0x83 | 1 << 16 | 1 << 24);
    wait(chip, seconds(0.001));
    set(chip, RCC + 8, 5 << 10 | 4 << 13);
    set(chip, RCC + 8, 5 << 10 | 4 << 13 | 2);
}
