//! Timers after RM0090 section 18: counting, preload, triggers, captures with their filter and flags.

use super::registers::*;
use meshband_emulator::chip::Chip;

const CR1: u32 = 0x00;
const CR2: u32 = 0x04;
const SMCR: u32 = 0x08;
const DIER: u32 = 0x0c;
const SR: u32 = 0x10;
const EGR: u32 = 0x14;
const CCMR1: u32 = 0x18;
const CCER: u32 = 0x20;
const CNT: u32 = 0x24;
const PSC: u32 = 0x28;
const ARR: u32 = 0x2c;
const CCR1: u32 = 0x34;
const CCR2: u32 = 0x38;
const CC1IF: u32 = 1 << 1;
const CC2IF: u32 = 1 << 2;
const CC1OF: u32 = 1 << 9;

#[test]
fn the_count_follows_the_prescaler_and_wraps_behind_the_reload() {
    let mut chip = running();
    set(&mut chip, TIM2 + PSC, 1);
    set(&mut chip, TIM2 + ARR, 9);
    set(&mut chip, TIM2 + EGR, 1);
    set(&mut chip, TIM2 + SR, 0);
    set(&mut chip, TIM2 + CR1, 1);
    // The counter starts one clock after it is enabled.
    wait(&mut chip, TICK + 2 * TICK * 7);
    assert_eq!(get(&mut chip, TIM2 + CNT), 7);
    assert_eq!(get(&mut chip, TIM2 + SR), 0);
    wait(&mut chip, 2 * TICK * 3);
    assert_eq!(get(&mut chip, TIM2 + CNT), 0);
    assert_eq!(get(&mut chip, TIM2 + SR), 1);
}

#[test]
fn a_preloaded_reload_governs_from_the_next_update_on() {
    let mut chip = running();
    set(&mut chip, TIM2 + ARR, 99);
    set(&mut chip, TIM2 + CR1, 1 << 7 | 1 << 2);
    set(&mut chip, TIM2 + EGR, 1);
    set(&mut chip, TIM2 + CR1, 1 << 7 | 1 << 2 | 1);
    wait(&mut chip, TICK + 50 * TICK);
    set(&mut chip, TIM2 + ARR, 199);
    assert_eq!(get(&mut chip, TIM2 + ARR), 199, "the register shows the preload");
    wait(&mut chip, 50 * TICK);
    assert_eq!(get(&mut chip, TIM2 + CNT), 0, "the old period ended the round");
    wait(&mut chip, 150 * TICK);
    assert_eq!(get(&mut chip, TIM2 + CNT), 150);
}

#[test]
fn with_urs_a_software_update_raises_no_flag() {
    let mut chip = running();
    for (control, flag) in [(0, 1), (1 << 2, 0)] {
        set(&mut chip, TIM2 + CR1, control);
        set(&mut chip, TIM2 + EGR, 1);
        assert_eq!(get(&mut chip, TIM2 + SR), flag);
        set(&mut chip, TIM2 + SR, 0);
    }
}

#[test]
fn writing_the_control_register_does_not_disturb_a_running_count() {
    let mut chip = running();
    set(&mut chip, TIM5 + CR1, 1);
    for _ in 0..100 {
        wait(&mut chip, 3);
        set(&mut chip, TIM5 + CR1, 1 | 2 << 8);
        set(&mut chip, TIM5 + CR1, 1);
    }
    // 300 units, one clock until it starts.
    assert_eq!(get(&mut chip, TIM5 + CNT), 300 / TICK as u32 - 1);
}

/// TIM2 as master, TIM3 counting its updates, TIM5 capturing TIM3's.
fn chained() -> Chip {
    let mut chip = running();
    set(&mut chip, TIM5 + SMCR, 1 << 4);
    set(&mut chip, TIM5 + CCMR1, 3 << 8 | 1);
    set(&mut chip, TIM5 + CCER, 1 << 4 | 1);
    set(&mut chip, TIM5 + DIER, 2);
    set(&mut chip, TIM5 + CR1, 1);
    set(&mut chip, TIM2 + CR2, 2 << 4);
    set(&mut chip, TIM2 + ARR, 99);
    set(&mut chip, TIM3 + CR2, 2 << 4);
    set(&mut chip, TIM3 + ARR, 3);
    set(&mut chip, TIM3 + SMCR, 7 | 1 << 4);
    set(&mut chip, TIM3 + CR1, 1);
    set(&mut chip, TIM2 + CR1, 1);
    chip
}

#[test]
fn a_slave_counts_its_masters_updates_and_a_capture_takes_its_own() {
    let mut chip = chained();
    let start = get(&mut chip, TIM5 + CNT);
    wait(&mut chip, TICK + 3 * 100 * TICK + 2 * TICK);
    assert_eq!(get(&mut chip, TIM3 + CNT), 3);
    assert_eq!(get(&mut chip, TIM5 + SR) & CC2IF, 0);
    wait(&mut chip, 100 * TICK);
    assert_eq!(get(&mut chip, TIM3 + CNT), 0);
    assert_eq!(get(&mut chip, TIM5 + SR) & CC2IF, CC2IF);
    let captured = get(&mut chip, TIM5 + CCR2) - start;
    // Four periods, one clock until the master starts, two from trigger to trigger.
    assert!((400..=404).contains(&captured), "{captured}");
    assert_eq!(get(&mut chip, TIM5 + SR) & CC2IF, 0, "reading the count clears its flag");
}

#[test]
fn a_second_capture_before_the_first_is_read_sets_the_overcapture_flag() {
    let mut chip = chained();
    wait(&mut chip, 900 * TICK);
    assert_eq!(get(&mut chip, TIM5 + SR) & (CC2IF | 1 << 10), CC2IF | 1 << 10);
    get(&mut chip, TIM5 + CCR2);
    assert_eq!(get(&mut chip, TIM5 + SR) & 1 << 10, 1 << 10, "only a written zero clears it");
    set(&mut chip, TIM5 + SR, !(1 << 10));
    assert_eq!(get(&mut chip, TIM5 + SR) & 1 << 10, 0);
}

/// TIM5 captures rising edges of PA0 behind a filter.
fn capturing(ckd: u32, filter: u32) -> Chip {
    let mut chip = running();
    set(&mut chip, GPIOA + 0x20, 2);
    set(&mut chip, GPIOA, 0xa800_0002);
    set(&mut chip, TIM5 + CCMR1, 1 | filter << 4);
    set(&mut chip, TIM5 + CCER, 1);
    set(&mut chip, TIM5 + DIER, 2);
    set(&mut chip, TIM5 + CR1, 1 | ckd << 8);
    chip
}

fn drive(chip: &mut Chip, after: &[(f64, bool)]) {
    let now = chip.seconds();
    chip.inputs.tach.extend(after.iter().map(|(s, level)| (now + s, *level)));
    chip.follow_inputs();
}

#[test]
fn the_filter_delays_value_and_flag_alike() {
    // Divider 4 and code 15: eight samples every 128 ticks, 1024 ticks.
    let mut chip = capturing(2, 15);
    let start = chip.now;
    drive(&mut chip, &[(10e-6, true)]);
    wait(&mut chip, seconds(10e-6) + 890 * TICK);
    assert_eq!(get(&mut chip, TIM5 + SR) & CC1IF, 0, "seven samples at most");
    assert!(!chip.nvic.has_pending());
    wait(&mut chip, 140 * TICK);
    assert_eq!(get(&mut chip, TIM5 + SR) & CC1IF, CC1IF);
    let (captured, at) = (get(&mut chip, TIM5 + CCR1), chip.seen.captured[0].at);
    let edge = start + seconds(10e-6);
    let delay = (at - edge) / TICK;
    assert!((896..=1024).contains(&delay), "{delay}");
    assert_eq!(u64::from(captured), (at - start) / TICK - 1, "the count at the instant of the flag");
    assert_eq!(get(&mut chip, TIM5 + SR) & CC1IF, 0);
}

#[test]
fn a_pulse_shorter_than_the_filter_is_not_captured_and_a_longer_one_is() {
    for (ticks, captures) in [(800, 0), (1100, 1)] {
        let mut chip = capturing(2, 15);
        drive(&mut chip, &[(1e-5, true), (1e-5 + f64::from(ticks) / 84e6, false)]);
        wait(&mut chip, seconds(1e-3));
        assert_eq!(chip.seen.captured.len(), captures, "{ticks} ticks");
    }
}

#[test]
fn without_a_filter_every_edge_of_the_chosen_direction_counts() {
    let mut chip = capturing(0, 0);
    set(&mut chip, TIM5 + CCER, 1 | 2);
    drive(&mut chip, &[(1e-6, true), (2e-6, false), (3e-6, true), (4e-6, false)]);
    wait(&mut chip, seconds(1e-5));
    assert_eq!(chip.seen.captured.len(), 2);
    assert_eq!(get(&mut chip, TIM5 + SR) & (CC1IF | CC1OF), CC1IF | CC1OF);
    assert_eq!((chip.seen.captured[1].at - chip.seen.captured[0].at) / TICK, 168);
}

#[test]
fn a_pin_that_is_not_the_timers_captures_nothing() {
    let mut chip = capturing(0, 3);
    set(&mut chip, GPIOA, 0xa800_0000);
    drive(&mut chip, &[(1e-6, true)]);
    wait(&mut chip, seconds(1e-4));
    assert!(chip.seen.captured.is_empty());
}

#[test]
fn the_time_base_wraps_after_two_to_the_32_ticks() {
    let mut chip = running();
    set(&mut chip, TIM5 + CNT, u32::MAX - 9);
    set(&mut chip, TIM5 + CR1, 1);
    wait(&mut chip, TICK + 20 * TICK);
    assert_eq!(get(&mut chip, TIM5 + CNT), 10);
    assert_eq!(get(&mut chip, TIM5 + SR) & 1, 1);
}
