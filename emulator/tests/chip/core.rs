//! The core: exceptions, faults, sleep, strictness, snapshots, on programs of a few instructions.

use meshband_emulator::board::Board;
use meshband_emulator::elf::{Image, Segment};
use meshband_emulator::error::Error;
use meshband_emulator::unicorn::{self, Register};

const START: u32 = 0x0800_0000;
/// First instruction, behind the vector table.
const CODE: u32 = START + 0x200;
const HANDLER: u32 = START + 0x300;
const STACK: u32 = 0x1000_1000;

/// A board with this program and handler, or `None` after saying why the test is skipped.
fn board(test: &str, code: &[u16], handler: &[u16]) -> Option<Board> {
    if !unicorn::is_installed() {
        println!("skipped {test}: Unicorn is absent (cargo xtask setup)");
        return None;
    }
    let mut bytes = vec![0; 0x400];
    let mut put = |at: u32, halves: &[u16]| {
        for (n, half) in halves.iter().enumerate() {
            bytes[(at - START) as usize + 2 * n..][..2].copy_from_slice(&half.to_le_bytes());
        }
    };
    let word = |value: u32| [value as u16, (value >> 16) as u16];
    put(START, &word(STACK));
    put(START + 4, &word(CODE | 1));
    for vector in 2..0x70 {
        put(START + 4 * vector, &word(HANDLER | 1));
    }
    put(CODE, code);
    put(HANDLER, handler);
    let image = Image { segments: vec![Segment { address: START, bytes }], ..Image::default() };
    Some(Board::new(&image).expect("a board"))
}

/// `b .`
const LOOP: u16 = 0xe7fe;
/// `bx lr`
const RETURN: u16 = 0x4770;

fn register(board: &mut Board, number: u8) -> u32 {
    board.cpu().register(Register::r(number))
}

#[test]
fn an_access_to_a_register_of_a_clockless_device_ends_the_run_with_place_and_instruction() {
    // movs r0, #1; lsls r0, r0, #30; nop; ldr r1, [r0]
    let Some(mut board) = board("clockless device", &[0x2001, 0x0780, 0xbf00, 0x6801, LOOP], &[LOOP]) else {
        return;
    };
    let Err(Error::Violation(violation)) = board.run_until(1e-3) else { panic!("no violation") };
    assert_eq!((violation.address, violation.what.as_str()), (0x4000_0000, "its clock is off"));
    assert!((CODE..CODE + 8).contains(&violation.program_counter), "{violation}");
}

#[test]
fn memory_that_is_not_there_ends_the_run_or_is_a_hard_fault_as_told() {
    // movs r0, #3; lsls r0, r0, #28; str r0, [r0]
    let code = [0x2003, 0x0700, 0x6000, LOOP];
    let Some(mut strict) = board("no memory", &code, &[0x2707, LOOP]) else { return };
    let Err(Error::Violation(violation)) = strict.run_until(1e-3) else { panic!("no violation") };
    assert_eq!(violation.address, 0x3000_0000);

    let Some(mut faulting) = board("no memory", &code, &[0x2707, LOOP]) else { return };
    faulting.cpu().take_faults().expect("follows instructions");
    faulting.run_until(1e-5).expect("goes on in the handler");
    assert_eq!(register(&mut faulting, 7), 7);
    let sp = faulting.cpu().register(Register::SP);
    assert_eq!(sp, STACK - 32);
    // The frame: r0 and the address of the instruction that failed.
    assert_eq!(faulting.chip().peek(sp), Some(0x3000_0000));
    assert_eq!(faulting.chip().peek(sp + 24), Some(CODE + 4));
}

#[test]
fn an_undefined_instruction_is_a_hard_fault_and_one_in_its_handler_locks_up() {
    const UNDEFINED_CODE: u16 = 0xde00;
    let Some(mut once) = board("undefined", &[0xbf00, UNDEFINED_CODE], &[0x2705, LOOP]) else { return };
    once.run_until(1e-3).expect("goes on in the handler");
    assert_eq!(register(&mut once, 7), 5);
    let sp = once.cpu().register(Register::SP);
    assert_eq!(once.chip().peek(sp + 24), Some(CODE + 2));
    let Some(mut twice) = board("undefined", &[0xbf00, UNDEFINED_CODE], &[0xbf00, UNDEFINED_CODE]) else { return };
    assert!(matches!(twice.run_until(1e-3), Err(Error::LockUp { .. })));
}

#[test]
fn the_floating_point_unit_is_closed_until_it_is_opened() {
    // vmov s0, r0
    let code = [0xbf00, 0xee00, 0x0a10, LOOP];
    let Some(mut board) = board("closed unit", &code, &[LOOP]) else { return };
    let Err(Error::Violation(violation)) = board.run_until(1e-3) else { panic!("no violation") };
    assert_eq!(violation.what, "the floating-point unit is not open");
}

/// Starts SysTick every 1000 cycles and then runs `code`.
fn ticking(code: &[u16]) -> Vec<u16> {
    // r0 = 0xe000e010; reload r1 = 999; control = 7.
    let mut program = vec![
        0x200e, 0x0300, // movs r0, #14; lsls r0, r0, #12
        0x210e, 0x0709, // movs r1, #14; lsls r1, r1, #28
        0x1840, // adds r0, r0, r1
        0x3010, // adds r0, #16
        0x21fa, 0x0089, // movs r1, #250; lsls r1, r1, #2
        0x3901, // subs r1, #1
        0x6041, // str r1, [r0, #4]
        0x2107, 0x6001, // movs r1, #7; str r1, [r0]
    ];
    program.extend(code);
    program
}

#[test]
fn sleep_ends_with_an_interrupt_which_returns_behind_it() {
    // Loop: wfi; adds r6, #1; b loop. Handler: adds r7, #1; bx lr.
    let program = ticking(&[0xbf30, 0x3601, 0xe7fc]);
    let Some(mut board) = board("sleep", &program, &[0x3701, RETURN]) else { return };
    board.run_until(1e-3).expect("runs");
    // 16 MHz over 1000 cycles for a millisecond.
    let (woken, ticks) = (register(&mut board, 6), register(&mut board, 7));
    assert!((15..=16).contains(&ticks), "{ticks}");
    assert!(woken.abs_diff(ticks) <= 1, "{woken} and {ticks}");
    assert!(board.cpu().instructions() < 1000, "asleep otherwise");
}

#[test]
fn masked_interrupts_end_the_sleep_and_wait() {
    // cpsid i; loop: wfi; adds r6, #1; b loop
    let program = ticking(&[0xb672, 0xbf30, 0x3601, 0xe7fc]);
    let Some(mut board) = board("masked", &program, &[0x3701, RETURN]) else { return };
    board.run_until(1e-3).expect("runs");
    assert!(register(&mut board, 6) > 0);
    assert_eq!(register(&mut board, 7), 0);
}

#[test]
fn registers_and_flags_are_as_before_behind_an_interrupt() {
    // Loop: adds r5, #1; cmp r5, r4 (never equal: r4 = 0); bne loop; movs r3, #1; b .
    // The handler spoils flags and scratch registers: movs r0, #0; movs r1, #0; movs r2, #0; cmp r0, r0; adds r7, #1;
    // bx lr.
    let program = ticking(&[0x2501, 0x3501, 0x42a5, 0xd1fc, 0x2301, LOOP]);
    let handler = [0x2000, 0x2100, 0x2200, 0x4280, 0x3701, RETURN];
    let Some(mut board) = board("flags", &program, &handler) else { return };
    board.run_until(20e-3).expect("runs");
    assert!(register(&mut board, 7) > 100);
    assert_eq!(register(&mut board, 3), 0, "the loop was left by spoilt flags");
    assert_eq!(register(&mut board, 0), 0xe000_e010);
}

#[test]
fn a_reset_asked_for_by_the_program_starts_it_anew() {
    // AIRCR = 0x05fa0004: r0 = 0xe000ed0c.
    let code = [
        0x200e, 0x0300, 0x210e, 0x0709, 0x1840, // 0xe000e000
        0x21d0, 0x0109, 0x1840, 0x300c, // + 0xd00 + 12
        0x4901, 0x6001, LOOP, // ldr r1, [pc, #4]; str r1, [r0]; b .
        0x0004, 0x05fa,
    ];
    let Some(mut board) = board("reset", &code, &[LOOP]) else { return };
    board.run_until(1e-4).expect("runs");
    assert!(board.chip().seen.resets.len() > 10, "{:?}", board.chip().seen.resets.len());
}

#[test]
fn going_on_from_a_snapshot_is_going_on() {
    let program = ticking(&[0xbf30, 0x3601, 0xe7fc]);
    let Some(mut board) = board("snapshot", &program, &[0x3701, RETURN]) else { return };
    board.run_until(1e-3).expect("runs");
    let snapshot = board.snapshot();
    board.run_until(3e-3).expect("runs");
    let first = (register(&mut board, 6), register(&mut board, 7), board.chip().now, board.cpu().instructions());
    board.restore(&snapshot).expect("restores");
    board.run_until(3e-3).expect("runs");
    let second = (register(&mut board, 6), register(&mut board, 7), board.chip().now, board.cpu().instructions());
    assert_eq!(first, second);
}

#[test]
fn more_cycles_per_instruction_are_fewer_instructions() {
    let count = |pace: f64| {
        let mut board = board("pace", &[0x3501, 0xe7fd], &[LOOP])?;
        board.cpu().set_pace(pace);
        board.run_until(1e-3).expect("runs");
        Some(board.cpu().instructions() as f64)
    };
    let (Some(fast), Some(slow)) = (count(1.0), count(2.5)) else { return };
    assert!((fast - 16_000.0).abs() < 10.0, "{fast}");
    assert!((fast / slow - 2.5).abs() < 0.01, "{fast} and {slow}");
}
