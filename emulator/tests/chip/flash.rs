//! Flash after RM0090 section 3: keys, programming, erasure, cache, power cuts.

use super::registers::*;
use meshband_emulator::chip::Chip;
use meshband_emulator::error::Refusal;

/// First address of sector 10, and its place in the cells.
const SECTOR: u32 = 0x080c_0000;
const PLACE: usize = 0xc_0000;
const SR: u32 = FLASH + 0x0c;
const CR: u32 = FLASH + 0x10;
const BSY: u32 = 1 << 16;

fn unlocked() -> Chip {
    let mut chip = running();
    set(&mut chip, FLASH + 4, 0x4567_0123);
    set(&mut chip, FLASH + 4, 0xcdef_89ab);
    chip
}

fn program(chip: &mut Chip, address: u32, value: u32) {
    set(chip, CR, 0x201);
    set(chip, address, value);
    wait(chip, seconds(20e-6));
}

#[test]
fn only_both_keys_in_order_unlock_and_a_wrong_one_bars_until_reset() {
    let mut chip = running();
    assert_eq!(refusal(&mut chip, CR, 1), Refusal::Forbidden("locked"));
    let mut chip = unlocked();
    assert_eq!(get(&mut chip, CR) >> 31, 0);
    let mut chip = running();
    for key in [1, 0x4567_0123, 0xcdef_89ab] {
        set(&mut chip, FLASH + 4, key);
    }
    assert_eq!(get(&mut chip, CR) >> 31, 1);
}

#[test]
fn a_word_takes_16_microseconds_and_only_clears_bits() {
    let mut chip = unlocked();
    set(&mut chip, CR, 0x201);
    set(&mut chip, SECTOR, 0xffff_0f0f);
    assert_eq!(get(&mut chip, SR) & BSY, BSY);
    wait(&mut chip, seconds(15e-6));
    assert_eq!(get(&mut chip, SR) & BSY, BSY);
    wait(&mut chip, seconds(2e-6));
    assert_eq!(get(&mut chip, SR) & BSY, 0);
    assert_eq!(chip.peek(SECTOR), Some(0xffff_0f0f));
    program(&mut chip, SECTOR, 0x0f0f_ffff);
    assert_eq!(chip.peek(SECTOR), Some(0x0f0f_0f0f));
}

#[test]
fn a_write_without_pg_is_an_error_flag_and_changes_nothing() {
    let mut chip = unlocked();
    set(&mut chip, CR, 0x200);
    set(&mut chip, SECTOR, 0);
    assert_eq!(get(&mut chip, SR) & 0x80, 0x80, "PGSERR");
    assert_eq!(chip.peek(SECTOR), Some(u32::MAX));
    set(&mut chip, SR, 0x80);
    assert_eq!(get(&mut chip, SR), 0);
}

#[test]
fn an_erasure_takes_a_second_and_its_sector_alone() {
    let mut chip = unlocked();
    chip.cells[PLACE - 4..PLACE + 0x2_0004].fill(0);
    set(&mut chip, CR, 0x202 | 10 << 3);
    set(&mut chip, CR, 0x202 | 10 << 3 | 1 << 16);
    wait(&mut chip, seconds(0.99));
    assert_eq!(get(&mut chip, SR) & BSY, BSY);
    wait(&mut chip, seconds(0.02));
    assert!(chip.cells[PLACE..PLACE + 0x2_0000].iter().all(|byte| *byte == 0xff));
    assert_eq!((chip.cells[PLACE - 1], chip.cells[PLACE + 0x2_0000]), (0, 0));
    assert_eq!(get(&mut chip, CR) >> 16 & 1, 0, "STRT falls with BSY");
}

#[test]
fn the_data_cache_keeps_what_an_erasure_has_removed_until_it_is_reset() {
    let mut chip = unlocked();
    program(&mut chip, SECTOR, 0x1234_5678);
    assert_eq!(chip.read(SECTOR, 4), Ok(0x1234_5678));
    set(&mut chip, CR, 0x202 | 10 << 3 | 1 << 16);
    wait(&mut chip, seconds(1.1));
    assert_eq!(chip.peek(SECTOR), Some(u32::MAX));
    assert_eq!(chip.read(SECTOR, 4), Ok(0x1234_5678), "stale");
    assert!(matches!(refusal(&mut chip, FLASH, 0x1705), Refusal::Forbidden(_)), "reset only while it is off");
    for value in [0x305, 0x1305, 0x305, 0x705] {
        set(&mut chip, FLASH, value);
    }
    assert_eq!(chip.read(SECTOR, 4), Ok(u32::MAX));
}

#[test]
fn eight_lines_are_kept_and_the_one_used_longest_ago_goes() {
    let mut chip = unlocked();
    assert_eq!(chip.read(SECTOR, 4), Ok(u32::MAX));
    chip.cells[PLACE] = 0;
    for line in 1..8 {
        chip.read(SECTOR + 16 * line, 4).expect("reads");
    }
    assert_eq!(chip.read(SECTOR, 1), Ok(0xff), "still there, and the newest now");
    for line in 8..16 {
        chip.read(SECTOR + 16 * line, 4).expect("reads");
    }
    assert_eq!(chip.read(SECTOR, 1), Ok(0));
}

#[test]
fn a_word_cut_short_lies_between_the_old_and_the_new() {
    for share in [0.1, 0.5, 0.9] {
        let mut chip = unlocked();
        set(&mut chip, CR, 0x201);
        set(&mut chip, SECTOR, 0x0000_ffff);
        wait(&mut chip, seconds(16e-6 * share));
        chip.lose_power();
        let word = chip.peek(SECTOR).expect("there");
        assert_eq!(word & 0xffff, 0xffff);
        let cleared = (!word).count_ones();
        let expected = (16.0 * share) as u32;
        assert!(cleared.abs_diff(expected) <= 6, "{cleared} bits at {share}");
    }
}

#[test]
fn a_sector_cut_short_is_neither_what_it_was_nor_blank() {
    let mut chip = unlocked();
    chip.cells[PLACE..PLACE + 0x2_0000].fill(0);
    set(&mut chip, CR, 0x202 | 10 << 3 | 1 << 16);
    wait(&mut chip, seconds(0.5));
    chip.lose_power();
    let set_bits: u32 = chip.cells[PLACE..PLACE + 0x2_0000].iter().map(|byte| byte.count_ones()).sum();
    let share = f64::from(set_bits) / f64::from(0x2_0000 * 8);
    assert!((share - 0.5).abs() < 0.01, "{share}");
}

#[test]
fn the_program_can_not_change_itself() {
    let running_in = |address| {
        let mut chip = unlocked();
        chip.flash.fetching = Some(address);
        chip
    };
    let mut chip = running_in(0x0806_0200);
    set(&mut chip, CR, 0x201);
    assert!(matches!(refusal(&mut chip, 0x0806_4000, 1), Refusal::Forbidden(_)));
    program(&mut chip, 0x0808_0000, 0);
    assert_eq!(chip.peek(0x0808_0000), Some(0), "another sector is not its own");
    let mut chip = running_in(0x0806_0200);
    assert!(matches!(refusal(&mut chip, CR, 0x202 | 7 << 3 | 1 << 16), Refusal::Forbidden(_)));
}
