//! SPI2 after RM0090 section 28, and resets of peripherals after section 7.3.

use super::registers::*;
use meshband_emulator::chip::Chip;
use meshband_emulator::error::Refusal;

const SPI2: u32 = 0x4000_3800;
const GPIOB: u32 = 0x4002_0400;
const SR: u32 = SPI2 + 8;
const DR: u32 = SPI2 + 0xc;
const RXNE: u32 = 1 << 0;
const TXE: u32 = 1 << 1;
const OVR: u32 = 1 << 6;
const BSY: u32 = 1 << 7;
/// Master with software select, by 8, on.
const MASTER_CONTROL: u32 = 1 << 2 | 2 << 3 | 1 << 6 | 1 << 8 | 1 << 9;
/// Units of a byte at 42 MHz / 8.
const BYTE: u64 = 8 * 8 * 8;

fn connected() -> Chip {
    let mut chip = running();
    set(&mut chip, RCC + 0x40, 0x1000_400b);
    set(&mut chip, GPIOB + 0x24, 5 << 20 | 5 << 28);
    set(&mut chip, GPIOB, 0x280 | 1 << 24 | 2 << 26 | 2 << 30);
    set(&mut chip, SPI2, MASTER_CONTROL & !(1 << 6));
    set(&mut chip, SPI2, MASTER_CONTROL);
    chip
}

#[test]
fn a_byte_takes_eight_bits_and_is_seen_with_the_select_pin() {
    let mut chip = connected();
    let start = chip.now;
    set(&mut chip, DR, 0x40);
    assert_eq!(get(&mut chip, SR), TXE | BSY, "in the shift register at once");
    wait(&mut chip, BYTE - 1);
    assert_eq!(get(&mut chip, SR) & RXNE, 0);
    wait(&mut chip, 1);
    assert_eq!(get(&mut chip, SR), TXE | RXNE);
    let seen = chip.seen.clocked.pop().expect("a byte");
    assert_eq!((seen.at - start, seen.byte, seen.selected), (BYTE, Some(0x40), true));
    get(&mut chip, DR);
    set(&mut chip, GPIOB + 0x18, 1 << 12);
    set(&mut chip, DR, 0x41);
    wait(&mut chip, BYTE);
    assert!(!chip.seen.clocked.pop().expect("a byte").selected);
}

#[test]
fn a_byte_that_nobody_reads_is_an_overrun_until_data_and_status_are_read() {
    let mut chip = connected();
    for byte in [1, 2] {
        set(&mut chip, DR, byte);
        wait(&mut chip, BYTE);
    }
    assert_eq!(get(&mut chip, SR) & OVR, OVR);
    assert_eq!(get(&mut chip, SR) & OVR, OVR, "the status alone does not clear it");
    get(&mut chip, DR);
    get(&mut chip, SR);
    assert_eq!(get(&mut chip, SR) & OVR, 0);
}

#[test]
fn a_peripherals_reset_puts_its_registers_back_and_no_others() {
    let mut chip = connected();
    set(&mut chip, TIM2 + 0x2c, 1234);
    set(&mut chip, RCC + 0x20, 1 << 14);
    set(&mut chip, RCC + 0x20, 0);
    assert_eq!((get(&mut chip, SPI2), get(&mut chip, SR)), (0, TXE));
    assert_eq!(get(&mut chip, TIM2 + 0x2c), 1234);
    set(&mut chip, RCC + 0x20, 1);
    set(&mut chip, RCC + 0x10, 1 << 1);
    assert_ne!(get(&mut chip, TIM2 + 0x2c), 1234);
    assert_eq!(get(&mut chip, GPIOB), 0x280);
}

#[test]
fn a_byte_over_one_that_waits_is_refused() {
    let mut chip = connected();
    set(&mut chip, DR, 1);
    set(&mut chip, DR, 2);
    assert!(matches!(refusal(&mut chip, DR, 3), Refusal::Forbidden(_)));
}
