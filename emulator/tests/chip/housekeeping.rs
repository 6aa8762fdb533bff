//! Conversions by software, the internal reference and the temperature sensor (RM0090 sections 13.10 and 13.11), a
//! third converter, and a pulse per second at TIM5's channel 4.

use super::registers::*;
use meshband_emulator::chip::Chip;
use std::sync::Arc;

const ADC3: u32 = ADC1 + 0x200;
const ADON: u32 = 1;
const SWSTART: u32 = 1 << 30;
const EOC: u32 = 1 << 1;
const TSVREFE: u32 = 1 << 23;
const FACTORY: u32 = 0x1fff_7a2a;

/// ADC1 on, right-aligned, channels 16 and 17 with a sampling code.
fn internal(common: u32, sampling: u32) -> Chip {
    let mut chip = running();
    set(&mut chip, RCC + 0x44, 0x0000_0710);
    set(&mut chip, ADC_COMMON + 4, common | 1 << 16);
    set(&mut chip, ADC1 + 0x0c, sampling << 21 | sampling << 18);
    set(&mut chip, ADC1 + 8, ADON);
    chip
}

fn converted(chip: &mut Chip, channel: u32) -> u32 {
    set(chip, ADC1 + 0x34, channel);
    set(chip, ADC1 + 8, ADON | SWSTART);
    assert_eq!(get(chip, ADC1 + 8), ADON, "the start bit is taken");
    wait(chip, seconds(24e-6));
    assert_eq!(get(chip, ADC1) & EOC, EOC);
    let code = get(chip, ADC1 + 0x4c);
    assert_eq!(get(chip, ADC1) & EOC, 0, "reading the result clears its flag");
    code
}

#[test]
fn the_reference_tells_the_supply_and_the_sensor_the_temperature() {
    let mut chip = internal(TSVREFE, 7);
    let factory: Vec<u32> = (0..3).map(|n| chip.read(FACTORY + 2 * n, 2).expect("there")).collect();
    assert_eq!(factory, [1502, 959, 1207]);
    assert_eq!([converted(&mut chip, 17), converted(&mut chip, 16)], [1502, 959], "as the factory saw them");
    (chip.inputs.supply_v, chip.inputs.temperature_c) = (3.0, 70.0);
    // 1.21 V and 0.76 V + 45 K * 2.5 mV/K of 3.0 V.
    assert_eq!([converted(&mut chip, 17), converted(&mut chip, 16)], [1652, 1191]);
}

#[test]
fn without_their_switch_or_with_too_short_a_sampling_they_tell_nothing_right() {
    assert_eq!(converted(&mut internal(0, 7), 17), 2048, "an input that floats");
    assert_eq!(converted(&mut internal(TSVREFE, 4), 17), 751, "84 clocks are 4 us");
}

#[test]
fn a_third_converter_takes_the_same_trigger_and_another_channel_of_the_stream() {
    let mut chip = running();
    set(&mut chip, RCC + 0x44, 0x0000_0710);
    set(&mut chip, GPIOA, 0xa800_000c);
    chip.seen.keep_conversions = true;
    chip.inputs.analogue = Arc::new(|_| 0.25);
    set(&mut chip, ADC_COMMON + 4, 1 << 16);
    set(&mut chip, ADC3 + 0x34, 1);
    set(&mut chip, ADC3 + 8, ADON | 1 << 8 | 1 << 9 | 1 << 11 | 6 << 24 | 1 << 28);
    let place = stream(DMA2, 0);
    for (offset, value) in [(0x08, ADC3 + 0x4c), (0x0c, SRAM), (0x04, 4), (0x14, 0x21)] {
        set(&mut chip, place + offset, value);
    }
    set(&mut chip, place, 2 << 25 | 1 << 10 | 1 << 11 | 1 << 13 | 1);
    set(&mut chip, TIM2 + 4, 2 << 4);
    set(&mut chip, TIM2 + 0x2c, 999);
    set(&mut chip, TIM2, 1);
    wait(&mut chip, 4500 * TICK);
    assert_eq!(chip.peek(SRAM), Some(0x4000_4000));
    assert_eq!(chip.seen.conversions.len(), 4);
    assert!(chip.seen.second.is_empty());
}

#[test]
fn channel_4_captures_pulses_per_second_behind_its_own_filter() {
    let mut chip = running();
    set(&mut chip, GPIOA, 0xa800_0080);
    set(&mut chip, GPIOA + 0x20, 2 << 12);
    let tim5 = TIM5;
    set(&mut chip, tim5 + 0x1c, 3 << 12 | 1 << 8);
    set(&mut chip, tim5 + 0x20, 1 << 12);
    set(&mut chip, tim5, 1);
    let began_s = chip.seconds();
    chip.inputs.second_pulses.extend([began_s + 1e-3, began_s + 2e-3, began_s + 3e-3]);
    chip.follow_inputs();
    wait(&mut chip, seconds(1.5e-3));
    assert_eq!(get(&mut chip, tim5 + 0x10) & (1 << 12 | 1 << 4), 1 << 4);
    // Eight samples of 84 MHz, the first at the edge; the counter began a clock late.
    let first = get(&mut chip, tim5 + 0x40);
    assert!((84_000 + 5..=84_000 + 8).contains(&first), "{first}");
    assert_eq!(get(&mut chip, tim5 + 0x10) & 1 << 4, 0, "reading the count clears its flag");
    wait(&mut chip, seconds(2e-3));
    assert_eq!(get(&mut chip, tim5 + 0x10) & (1 << 12 | 1 << 4), 1 << 12 | 1 << 4, "one was overwritten");
    assert_eq!(get(&mut chip, tim5 + 0x40), first + 168_000);
}
