//! Converter, DMA and UART after RM0090 sections 13, 10 and 30.

use super::registers::*;
use meshband_emulator::chip::Chip;
use meshband_emulator::error::Refusal;
use std::sync::Arc;

const ADON: u32 = 1 << 0;
/// DMA with DDS, left-aligned, triggered by TIM2.
const DMA_CONTROL: u32 = ADON | 1 << 8 | 1 << 9 | 1 << 11 | 6 << 24 | 1 << 28;
const EOC: u32 = 1 << 1;
const OVR: u32 = 1 << 5;
const EN: u32 = 1;
const CR: u32 = 0x00;
const NDTR: u32 = 0x04;
const PAR: u32 = 0x08;
const M0AR: u32 = 0x0c;
const M1AR: u32 = 0x10;
const FCR: u32 = 0x14;

/// The converter set up as the node does, TIM2 triggering every `period` ticks once it is started.
fn sampling(period: u32, control: u32) -> Chip {
    let mut chip = running();
    chip.seen.keep_conversions = true;
    set(&mut chip, GPIOA, 0xa800_000c);
    set(&mut chip, ADC_COMMON + 4, 1 << 16);
    set(&mut chip, ADC1 + 4, 1 << 26);
    set(&mut chip, ADC1 + 0x10, 1 << 3);
    set(&mut chip, ADC1 + 0x34, 1);
    set(&mut chip, ADC1 + 8, control);
    set(&mut chip, TIM2 + 4, 2 << 4);
    set(&mut chip, TIM2 + 0x2c, period - 1);
    chip
}

fn start(chip: &mut Chip) {
    set(chip, TIM2, 1);
}

fn prepare(chip: &mut Chip, stream: u32, device: u32, memory: [u32; 2], count: u32, control: u32) {
    for (offset, value) in
        [(PAR, device), (M0AR, memory[0]), (M1AR, memory[1]), (NDTR, count), (FCR, 0x21), (CR, control)]
    {
        set(chip, stream + offset, value);
    }
}

/// Half-words to memory, memory increments, complete and error interrupts.
const HALF_WORDS_IN: u32 = 1 << 10 | 1 << 11 | 1 << 13 | 1 << 4 | 1 << 2;

#[test]
fn a_conversion_takes_27_clocks_of_21_megahertz_and_holds_after_15() {
    let mut chip = sampling(1000, ADON | 1 << 11 | 6 << 24 | 1 << 28);
    chip.inputs.analogue = Arc::new(|_| 0.25);
    start(&mut chip);
    // One clock until the timer starts; the trigger comes on a clock of the converter or waits for it.
    wait(&mut chip, 1001 * TICK + 26 * 16);
    assert_eq!(get(&mut chip, ADC1) & EOC, 0);
    wait(&mut chip, 3 * 16);
    assert_eq!(get(&mut chip, ADC1) & EOC, EOC);
    assert_eq!(get(&mut chip, ADC1 + 0x4c), 1024 << 4);
    assert_eq!(get(&mut chip, ADC1) & EOC, 0, "reading the result clears its flag");
}

#[test]
fn a_period_that_is_no_multiple_of_the_converters_clock_makes_the_aperture_jitter() {
    for (period, jitters) in [(1000, false), (1001, true)] {
        let mut chip = sampling(period, ADON | 6 << 24 | 1 << 28);
        // A ramp tells the instants at which the input was held: 4096 codes in 8.192 us, 24 in a clock of the
        // converter.
        chip.inputs.analogue = Arc::new(|t| (t * 122_070.3).rem_euclid(1.0));
        start(&mut chip);
        let mut steps = Vec::new();
        for _ in 0..9 {
            wait(&mut chip, u64::from(period) * TICK);
            get(&mut chip, ADC1 + 0x4c);
        }
        wait(&mut chip, 2000);
        for pair in chip.seen.conversions.windows(2) {
            steps.push(pair[1].code.wrapping_sub(pair[0].code) % 4096);
        }
        let spread = steps.iter().max().expect("some") - steps.iter().min().expect("some");
        assert_eq!(spread > 8, jitters, "{period}: {steps:?}");
    }
}

#[test]
fn a_result_that_nobody_takes_is_an_overrun_that_stops_everything_until_cleared() {
    let mut chip = sampling(1000, DMA_CONTROL);
    set(&mut chip, SYSTEM + 0x100, 1 << 18);
    start(&mut chip);
    wait(&mut chip, 3 * 1000 * TICK);
    assert_eq!(get(&mut chip, ADC1) & OVR, OVR);
    assert_eq!(chip.nvic.next(Default::default()), Some(16 + 18));
    let before = chip.seen.conversions.len();
    wait(&mut chip, 10_000 * TICK);
    assert_eq!(chip.seen.conversions.len(), before, "no conversion while the flag stands");
    set(&mut chip, ADC1, !OVR);
    wait(&mut chip, 2_000 * TICK);
    assert!(chip.seen.conversions.len() > before);
}

#[test]
fn a_trigger_during_a_conversion_is_lost() {
    // 1.286 us are 108 ticks.
    for (period, per_trigger) in [(120, 1.0), (80, 0.5)] {
        let mut chip = sampling(period, ADON | 6 << 24 | 1 << 28);
        start(&mut chip);
        wait(&mut chip, u64::from(period) * TICK * 1000);
        let share = chip.seen.conversions.len() as f64 / 1000.0;
        assert!((share - per_trigger).abs() < 0.01, "{period}: {share}");
    }
}

#[test]
fn a_double_buffer_fills_one_target_while_the_other_is_exchanged() {
    let mut chip = sampling(200, DMA_CONTROL);
    let stream = stream(DMA2, 0);
    let control = HALF_WORDS_IN | 1 << 18 | 1 << 8;
    prepare(&mut chip, stream, ADC1 + 0x4c, [SRAM, SRAM + 0x100], 4, control);
    set(&mut chip, stream, control | EN);
    chip.inputs.analogue = Arc::new(|_| 0.5);
    start(&mut chip);
    let block = 4 * 200 * TICK;
    wait(&mut chip, block + 130 * TICK);
    assert_eq!(get(&mut chip, stream) >> 19 & 1, 1, "CT: the second is filling");
    assert_eq!(get(&mut chip, DMA2) & 0x30, 0x30, "half and complete");
    assert_eq!(chip.peek(SRAM), Some(0x8000_8000));
    assert_eq!(refusal(&mut chip, stream + M1AR, SRAM), Refusal::Forbidden("fixed while the stream is enabled"));
    set(&mut chip, stream + M0AR, SRAM + 0x200);
    wait(&mut chip, 2 * block);
    assert_eq!(chip.peek(SRAM + 0x200), Some(0x8000_8000), "the new address is filled");
    assert_eq!(get(&mut chip, stream + NDTR), 4);
}

#[test]
fn core_coupled_memory_is_a_transfer_error_that_stops_the_stream() {
    let mut chip = sampling(200, DMA_CONTROL);
    let stream = stream(DMA2, 0);
    prepare(&mut chip, stream, ADC1 + 0x4c, [CCM, CCM], 4, HALF_WORDS_IN);
    set(&mut chip, stream, HALF_WORDS_IN | EN);
    set(&mut chip, SYSTEM + 0x104, 1 << 24);
    start(&mut chip);
    wait(&mut chip, 400 * TICK);
    assert_eq!(get(&mut chip, DMA2) & 1 << 3, 1 << 3, "TEIF");
    assert_eq!(get(&mut chip, stream) & EN, 0);
    assert_eq!(chip.nvic.next(Default::default()), Some(16 + 56));
}

#[test]
fn towards_a_device_one_word_is_read_ahead() {
    // RM0090 section 10.3.13: the first word when the stream is enabled, the next one behind each transfer.
    let mut chip = running();
    for (timer, reload) in [(TIM2, 99), (TIM3, 1)] {
        set(&mut chip, timer + 4, 2 << 4);
        set(&mut chip, timer + 0x2c, reload);
    }
    set(&mut chip, TIM3 + 8, 7 | 1 << 4);
    set(&mut chip, TIM3 + 0xc, 1 << 8);
    let stream = stream(DMA1, 2);
    let control = 5 << 25 | 2 << 13 | 2 << 11 | 1 << 8 | 1 << 6;
    assert!(chip.poke(SRAM, 199).is_some());
    prepare(&mut chip, stream, TIM2 + 0x2c, [SRAM, 0], 1, control);
    set(&mut chip, stream, control | EN);
    assert!(chip.poke(SRAM, 299).is_some());
    set(&mut chip, TIM3, 1);
    set(&mut chip, TIM2, 1 | 1 << 7);
    wait(&mut chip, 210 * TICK);
    assert_eq!(get(&mut chip, TIM2 + 0x2c), 199, "what was there when the stream was enabled");
    assert!(chip.poke(SRAM, 399).is_some());
    wait(&mut chip, 300 * TICK);
    assert_eq!(get(&mut chip, TIM2 + 0x2c), 299, "what was there at the transfer before");
}

#[test]
fn a_stream_is_not_enabled_over_old_flags_or_towards_nothing() {
    let mut chip = sampling(200, DMA_CONTROL);
    let first = stream(DMA2, 0);
    prepare(&mut chip, first, ADC1 + 0x4c, [SRAM, 0], 1, HALF_WORDS_IN);
    set(&mut chip, first, HALF_WORDS_IN | EN);
    start(&mut chip);
    wait(&mut chip, 400 * TICK);
    assert_eq!(get(&mut chip, first) & EN, 0, "one round and no circle");
    set(&mut chip, first + NDTR, 1);
    assert!(matches!(refusal(&mut chip, first, HALF_WORDS_IN | EN), Refusal::Forbidden(_)));
    let other = stream(DMA2, 1);
    prepare(&mut chip, other, ADC1 + 0x4c, [SRAM, 0], 1, HALF_WORDS_IN);
    assert!(matches!(refusal(&mut chip, other, HALF_WORDS_IN | EN), Refusal::Forbidden(_)));
}

/// USART1 at 921 600 bit/s on its pins.
fn connected() -> Chip {
    let mut chip = running();
    set(&mut chip, GPIOA + 0x24, 7 << 4 | 7 << 8);
    set(&mut chip, GPIOA, 0xa828_0000);
    set(&mut chip, USART1 + 8, 91);
    set(&mut chip, USART1 + 0x14, 1 << 6 | 1 << 7);
    set(&mut chip, USART1 + 0xc, 1 << 13 | 1 << 3 | 1 << 2);
    chip
}

/// Ten bits of 91 clocks of 84 MHz.
const BYTE: u64 = 10 * 91 * 4;

#[test]
fn bytes_leave_one_behind_the_other_at_the_programmed_rate() {
    let mut chip = connected();
    let stream = stream(DMA2, 7);
    chip.sram[..4].copy_from_slice(b"gear");
    let control = 4 << 25 | 1 << 10 | 1 << 6;
    prepare(&mut chip, stream, USART1 + 4, [SRAM, 0], 4, control);
    set(&mut chip, stream, control | EN);
    let start = chip.now;
    wait(&mut chip, 4 * BYTE + 200);
    let sent: Vec<u8> = chip.seen.sent.iter().map(|(_, byte)| *byte).collect();
    assert_eq!(sent, b"gear");
    for (n, (at, _)) in (1..).zip(&chip.seen.sent) {
        assert!((at - start).abs_diff(n * BYTE) < 64, "byte {n} after {} units", at - start);
    }
    assert_eq!(get(&mut chip, stream) & EN, 0);
    assert_eq!(get(&mut chip, DMA2 + 4) & 1 << 27, 1 << 27, "TCIF7");
}

#[test]
fn received_bytes_go_round_the_circle() {
    let mut chip = connected();
    let stream = stream(DMA2, 5);
    let control = 4 << 25 | 1 << 10 | 1 << 8;
    prepare(&mut chip, stream, USART1 + 4, [SRAM, 0], 4, control);
    set(&mut chip, stream, control | EN);
    let now = chip.seconds();
    chip.inputs.bytes.extend((1..=6).map(|n| (now + f64::from(n) * 1e-5, b'0' + n as u8)));
    chip.follow_inputs();
    wait(&mut chip, seconds(1e-3));
    assert_eq!(&chip.sram[..4], b"5634");
    assert_eq!(get(&mut chip, stream + NDTR), 2);
}

#[test]
fn a_byte_that_nobody_takes_is_an_overrun() {
    let mut chip = connected();
    let now = chip.seconds();
    chip.inputs.bytes.extend([(now + 1e-5, b'a'), (now + 2e-5, b'b')]);
    chip.follow_inputs();
    wait(&mut chip, seconds(1e-4));
    assert_eq!(get(&mut chip, USART1) & 0x28, 0x28, "RXNE and ORE");
    assert_eq!(get(&mut chip, USART1 + 4), u32::from(b'a'));
}

#[test]
fn one_byte_over_an_idle_line_ends_its_stream() {
    let mut chip = connected();
    chip.poke(SRAM, 0x5a).expect("memory");
    let (stream, control) = (stream(DMA2, 7), 4 << 25 | 1 << 10 | 1 << 6);
    prepare(&mut chip, stream, USART1 + 4, [SRAM, 0], 1, control);
    set(&mut chip, stream, control | EN);
    wait(&mut chip, 4 * BYTE);
    assert_eq!(chip.seen.sent.iter().map(|sent| sent.1).collect::<Vec<_>>(), [0x5a]);
    assert_eq!(get(&mut chip, stream) & EN, 0);
}

#[test]
fn parity_and_a_second_stop_bit_lengthen_a_character_and_its_end_interrupts() {
    let (on, m, pce, tcie) = (1 << 13 | 1 << 3 | 1 << 2, 1 << 12, 1 << 10, 1 << 6);
    for (control, stop, bits) in [(m | pce, 0, 11), (0, 2 << 12, 11), (0, 0, 10)] {
        let mut chip = connected();
        set(&mut chip, USART1 + 8, 4375);
        set(&mut chip, USART1 + 0x10, stop);
        set(&mut chip, USART1 + 0xc, on | control);
        let pending = |chip: &mut Chip| get(chip, SYSTEM + 0x204) & 1 << (37 - 32);
        // The end of what was sent before is there from the reset on.
        set(&mut chip, USART1, !(1 << 6));
        let start = chip.now;
        set(&mut chip, USART1 + 4, 0x55);
        set(&mut chip, USART1 + 0xc, on | control | tcie);
        wait(&mut chip, bits * 4375 * 4 - 1);
        assert_eq!((pending(&mut chip), chip.seen.sent.len()), (0, 0));
        wait(&mut chip, 1);
        assert_ne!(pending(&mut chip), 0);
        assert_eq!(chip.seen.sent, [(start + bits * 4375 * 4, 0x55)]);
    }
    assert!(matches!(refusal(&mut connected(), USART1 + 0xc, on | 1 << 8), Refusal::Bits(_)), "not modelled");
}

#[test]
fn a_byte_of_another_rate_or_length_is_another_byte() {
    for (rate, bits, understood) in
        [(921_600.0, 10, true), (935_000.0, 10, true), (460_800.0, 10, false), (921_600.0, 11, false)]
    {
        let mut chip = connected();
        (chip.inputs.bits_per_second, chip.inputs.bits) = (rate, bits);
        let now = chip.seconds();
        chip.inputs.bytes.push_back((now + 1e-5, b'a'));
        chip.follow_inputs();
        wait(&mut chip, seconds(1e-4));
        assert_eq!(get(&mut chip, USART1 + 4) == u32::from(b'a'), understood, "{rate} {bits}");
    }
}
