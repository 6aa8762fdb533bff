//! Oscillators, PLL, gates and resets after RM0090 section 7, the watchdog after section 21.

use super::registers::*;
use meshband_emulator::chip::Chip;
use meshband_emulator::error::Refusal;
use meshband_emulator::rcc::cause;

#[test]
fn the_crystal_takes_two_milliseconds_and_an_absent_one_never_comes() {
    let mut chip = Chip::new();
    set(&mut chip, RCC, 0x83 | 1 << 16);
    wait(&mut chip, seconds(0.0019));
    assert_eq!(get(&mut chip, RCC) >> 17 & 1, 0);
    wait(&mut chip, seconds(0.0002));
    assert_eq!(get(&mut chip, RCC) >> 17 & 1, 1);

    let mut chip = Chip::new();
    chip.rcc.oscillators.crystal = false;
    set(&mut chip, RCC, 0x83 | 1 << 16);
    wait(&mut chip, seconds(1.0));
    assert_eq!(get(&mut chip, RCC) >> 17 & 1, 0);
}

#[test]
fn the_core_runs_at_16_and_then_at_168_megahertz() {
    let mut chip = Chip::new();
    assert_eq!(chip.cycle(), 21);
    full_clock(&mut chip);
    assert_eq!(chip.cycle(), 2);
    assert_eq!(get(&mut chip, RCC + 8) >> 2 & 3, 2, "SWS tells the clock in use");
}

#[test]
fn a_pll_that_does_not_lock_is_never_ready_and_cannot_be_chosen() {
    let mut chip = Chip::new();
    chip.rcc.oscillators.pll = false;
    set(&mut chip, FLASH, 5);
    set(&mut chip, RCC, 0x83 | 1 << 24);
    wait(&mut chip, seconds(1.0));
    assert_eq!(get(&mut chip, RCC) >> 25 & 1, 0);
    assert!(matches!(refusal(&mut chip, RCC + 8, 2), Refusal::Forbidden(_)));
}

#[test]
fn a_fast_core_with_slow_flash_is_refused() {
    let mut chip = Chip::new();
    set(&mut chip, FLASH, 4);
    set(&mut chip, RCC + 4, 8 | 168 << 6 | 7 << 24);
    set(&mut chip, RCC, 0x83 | 1 << 24);
    wait(&mut chip, seconds(0.001));
    set(&mut chip, RCC + 8, 5 << 10 | 4 << 13);
    assert!(matches!(refusal(&mut chip, RCC + 8, 5 << 10 | 4 << 13 | 2), Refusal::Forbidden(_)));
}

#[test]
fn a_guarded_crystal_that_fails_raises_the_non_maskable_interrupt_and_leaves_16_megahertz() {
    let mut chip = running();
    let control = get(&mut chip, RCC);
    set(&mut chip, RCC, control | 1 << 19);
    assert!(!chip.nvic.has_pending());
    chip.lose_crystal();
    assert!(chip.nvic.has_pending());
    assert_eq!(chip.nvic.next(Default::default()), Some(2));
    assert_eq!(chip.cycle(), 21);
    assert_eq!(get(&mut chip, RCC) >> 24 & 3, 0, "the PLL that the crystal fed is off");
    assert_eq!(get(&mut chip, RCC + 0xc) >> 7 & 1, 1, "CSSF");
}

#[test]
fn a_device_without_its_clock_is_refused() {
    let mut chip = Chip::new();
    for address in [TIM2, TIM5, USART1, ADC1, GPIOA, DMA2] {
        assert_eq!(chip.read(address, 4), Err(Refusal::Forbidden("its clock is off")), "{address:#x}");
    }
    assert!(chip.read(RCC, 4).is_ok() && chip.read(FLASH, 4).is_ok());
}

#[test]
fn what_is_not_modelled_is_refused_with_the_bits() {
    let mut chip = running();
    assert_eq!(chip.read(0x4000_0800, 4), Err(Refusal::Forbidden("nothing is there")));
    assert_eq!(chip.read(TIM2 + 0x4c, 4), Err(Refusal::Register));
    assert_eq!(refusal(&mut chip, TIM2, 0x10), Refusal::Bits(0x10));
    assert!(chip.write(RCC + 1, 1, 0).is_err());
}

#[test]
fn the_watchdog_resets_when_it_is_not_fed_and_says_so() {
    let mut chip = running();
    set(&mut chip, RCC + 0x74, 1 << 24);
    for (offset, value) in [(0, 0xcccc), (0, 0x5555), (4, 6), (8, 999), (0, 0xaaaa)] {
        set(&mut chip, IWDG + offset, value);
    }
    wait(&mut chip, seconds(7.9));
    set(&mut chip, IWDG, 0xaaaa);
    wait(&mut chip, seconds(7.99));
    assert!(chip.seen.resets.is_empty());
    wait(&mut chip, seconds(0.02));
    assert_eq!(chip.seen.resets.len(), 1);
    assert_eq!(get(&mut chip, RCC + 0x74) & 0xfe00_0000, cause::WATCHDOG | cause::PIN);
    assert_eq!(chip.cycle(), 21);
}

#[test]
fn the_watchdog_is_locked_without_its_key() {
    let mut chip = running();
    assert_eq!(refusal(&mut chip, IWDG + 8, 999), Refusal::Forbidden("locked"));
    set(&mut chip, IWDG, 0x5555);
    set(&mut chip, IWDG + 8, 999);
    assert_eq!(get(&mut chip, IWDG + 12) & 2, 2, "RVU until five cycles have passed");
    wait(&mut chip, seconds(5.1 / 32_000.0));
    assert_eq!(get(&mut chip, IWDG + 12) & 2, 0);
}

#[test]
fn reset_flags_add_up_until_they_are_cleared() {
    let mut chip = Chip::new();
    assert_eq!(get(&mut chip, RCC + 0x74) & 0xfe00_0000, cause::POWER | cause::BROWN_OUT | cause::PIN);
    chip.reset(cause::SOFTWARE);
    assert_ne!(get(&mut chip, RCC + 0x74) & cause::POWER, 0);
    set(&mut chip, RCC + 0x74, 1 << 24);
    chip.reset(cause::SOFTWARE);
    assert_eq!(get(&mut chip, RCC + 0x74) & 0xfe00_0000, cause::SOFTWARE | cause::PIN);
}

#[test]
fn memory_survives_a_reset_and_not_a_loss_of_power() {
    let mut chip = running();
    assert!(chip.poke(SRAM, 0x1234_5678).is_some());
    chip.reset(cause::SOFTWARE);
    assert_eq!(chip.peek(SRAM), Some(0x1234_5678));
    chip.lose_power();
    assert_ne!(chip.peek(SRAM), Some(0x1234_5678));
}
