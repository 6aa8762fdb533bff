//! Crashes of the released image: each is recorded, told after the restart, and several in a row lead to a safe start.

use super::image::image;
use super::spoken::Node;
use meshband::config::{Configuration, GearPair};
use meshband::events::EventKind;
use meshband::rate_plan::RatePolicy;
use meshband::units::Hertz;
use meshband_emulator::elf::Image;
use meshband_emulator::rcc::cause;
use meshband_emulator::unicorn::Register;

/// Kinds of the board's own events.
const CRASH: u32 = 1;
const SAFE_START: u32 = 7;
/// Causes that have no address.
const STACK_OVERFLOW: u32 = 4;
const STRAY_INTERRUPT: u32 = 5;
/// Reset causes as the board numbers them.
const SOFTWARE: u32 = 2;
const WATCHDOG: u32 = 3;
/// In the page of the crash record, behind the record: nobody uses it.
const SCRATCH: u32 = 0x2001_fe00;
/// Unused end of the stack.
const UNUSED_STACK: u32 = 0x1000_0200;
/// Set-enable and set-pending registers of the first interrupts, and one that the image leaves masked.
const ISER0: u32 = 0xe000_e100;
const ISPR0: u32 = 0xe000_e200;
const TIM2: u32 = 28;
/// Count of TIM5, and its ticks per second.
const TIM5_COUNT: u32 = 0x4000_0c24;
const TICKS_PER_SECOND: u32 = 84_000_000;

/// At a low rate, so that a run is cheap.
fn stored() -> Configuration {
    Configuration {
        gears: GearPair { pinion_teeth: 19, gear_teeth: 48 },
        policy: RatePolicy::Forced { rate: Hertz(20_000.0) },
        ..Configuration::default()
    }
}

/// A node that measures with its stored configuration.
fn running(image: &Image) -> Node {
    let mut node = Node::new(image);
    let mut bytes = [0; Configuration::MAX_SERIALISED];
    let payload = postcard::to_slice(&stored(), &mut bytes).expect("fits").to_vec();
    super::records::put(node.board.chip_mut(), 0, 0, &payload);
    node.start();
    assert_eq!(node.configuration(), stored());
    node
}

/// Runs on until no exception is being handled, and lets interrupts in.
fn to_main_loop(node: &mut Node) {
    while node.board.chip().nvic.depth() > 0 {
        let until = node.board.chip().now + 336_000;
        node.board.cpu().run_instructions(1, until).expect("runs");
    }
    node.board.cpu().set_register(Register::PRIMASK, 0);
}

/// Makes the main loop go on with these half-words.
fn execute(node: &mut Node, code: [u16; 2]) {
    to_main_loop(node);
    node.board.chip_mut().poke(SCRATCH, u32::from(code[0]) | u32::from(code[1]) << 16).expect("memory");
    node.board.cpu().set_program_counter(SCRATCH);
}

fn stray_interrupt(node: &mut Node) {
    for register in [ISER0, ISPR0] {
        node.board.chip_mut().write(register, 4, 1 << TIM2).expect("served");
    }
}

/// Resets since last asked, by their flags.
fn resets(node: &mut Node) -> Vec<u32> {
    std::mem::take(&mut node.board.seen().resets).into_iter().map(|(_, cause)| cause).collect()
}

/// Lets the crash happen and the node start again; gives the number that its event carries.
fn told(node: &mut Node) -> Vec<u32> {
    while node.board.seen().resets.is_empty() {
        node.run(0.0001);
    }
    node.forget();
    node.run(0.3);
    assert_eq!(resets(node), [cause::SOFTWARE]);
    let started: Vec<u32> = node.events().filter(|e| e.kind == EventKind::Started).map(|e| e.detail).collect();
    assert_eq!(started, [SOFTWARE]);
    node.board_events(CRASH)
}

#[test]
fn fault_instruction_that_reads_where_nothing_is_is_told_with_its_address() {
    let Some(image) = image("hard fault") else { return };
    let mut node = running(&image);
    node.board.cpu().take_faults().expect("followed");
    // ldr r0, [r0]; b .
    execute(&mut node, [0x6800, 0xe7fe]);
    node.board.cpu().set_register(Register::r(0), 0x3000_0000);
    assert_eq!(told(&mut node), [SCRATCH & 0x00ff_ffff]);
    assert_eq!(node.configuration(), stored());
}

#[test]
fn fault_undefined_instruction_is_told_with_its_address() {
    let Some(image) = image("undefined instruction") else { return };
    let mut node = running(&image);
    node.board.cpu().take_faults().expect("followed");
    // nop; udf #0
    execute(&mut node, [0xbf00, 0xde00]);
    assert_eq!(told(&mut node), [(SCRATCH + 2) & 0x00ff_ffff]);
}

#[test]
fn fault_stack_that_outgrows_its_memory_is_told_as_such() {
    let Some(image) = image("stack overflow") else { return };
    let mut node = running(&image);
    node.board.cpu().take_faults().expect("followed");
    // push {r0}; b to the push: a recursion without an end.
    execute(&mut node, [0xb401, 0xe7fd]);
    assert_eq!(told(&mut node), [STACK_OVERFLOW]);
    assert_eq!(node.configuration(), stored());
}

#[test]
fn fault_panic_is_told_with_its_source_line() {
    let Some(image) = image("panic") else { return };
    let bounds = image.symbols.iter().find(|(name, _)| name.contains("panic_bounds_check"));
    let Some((_, &panic)) = bounds else { panic!("the image has no check of bounds that could fail") };
    let mut node = running(&image);
    to_main_loop(&mut node);
    let chip = node.board.chip_mut();
    // A source place as the compiler lays it out: name, its length, line, column.
    for (n, word) in [UNUSED_STACK + 16, 8, 1234, 5, 0x2e6e_6961, 0x0000_7372].into_iter().enumerate() {
        chip.poke(UNUSED_STACK + 4 * n as u32, word).expect("memory");
    }
    // Index 5 of 3.
    for (register, value) in [(0, 5), (1, 3), (2, UNUSED_STACK)] {
        node.board.cpu().set_register(Register::r(register), value);
    }
    node.board.cpu().set_program_counter(panic);
    assert_eq!(told(&mut node), [1234]);
    assert_eq!(node.configuration(), stored());
}

#[test]
fn fault_interrupt_that_nobody_unmasked_is_told_as_such() {
    let Some(image) = image("stray interrupt") else { return };
    let mut node = running(&image);
    stray_interrupt(&mut node);
    assert_eq!(told(&mut node), [STRAY_INTERRUPT]);
}

#[test]
fn fault_main_loop_that_hangs_is_restarted_by_the_watchdog_which_is_told() {
    let Some(image) = image("hang") else { return };
    let mut node = running(&image);
    let begin = node.board.seconds();
    // wfi; b to the wfi
    execute(&mut node, [0xbf30, 0xe7fd]);
    while node.board.seen().resets.is_empty() {
        assert!(node.board.seconds() < begin + 10.0, "no watchdog");
        node.run(0.1);
    }
    let passed = node.board.seconds() - begin;
    println!("restarted after {passed:.1} s");
    assert!((7.5..8.5).contains(&passed), "8 s at 32 kHz: {passed}");
    node.forget();
    node.run(0.3);
    assert_eq!(resets(&mut node), [cause::WATCHDOG]);
    let started: Vec<u32> = node.events().filter(|e| e.kind == EventKind::Started).map(|e| e.detail).collect();
    assert_eq!(started, [WATCHDOG]);
    assert_eq!(node.board_events(CRASH), [], "nothing is known of where");
    assert_eq!(node.configuration(), stored());
}

/// Crashes so often in a row.
fn crash(node: &mut Node, times: u32) {
    for _ in 0..times {
        stray_interrupt(node);
        node.run(0.001);
        node.forget();
        node.start();
    }
}

#[test]
fn fault_fourth_crash_in_a_row_starts_with_the_default_and_keeps_what_is_stored() {
    let Some(image) = image("safe start") else { return };
    let mut node = running(&image);
    crash(&mut node, 3);
    assert_eq!(node.configuration(), stored());
    assert_eq!(node.board_events(SAFE_START), []);
    crash(&mut node, 1);
    assert_eq!(node.configuration(), Configuration::default());
    node.run(0.1);
    assert_eq!(node.board_events(SAFE_START), [4]);
    // New power: somebody wants to try again.
    node.cycle_power();
    node.start();
    assert_eq!(node.configuration(), stored());
}

#[test]
fn fault_another_configuration_stored_ends_the_count_of_crashes() {
    let Some(image) = image("end of safe start") else { return };
    let mut node = running(&image);
    crash(&mut node, 4);
    let other = Configuration { gears: GearPair { pinion_teeth: 23, gear_teeth: 61 }, ..stored() };
    node.configure(&other);
    node.commit();
    crash(&mut node, 3);
    assert_eq!(node.configuration(), other);
    crash(&mut node, 1);
    assert_eq!(node.configuration(), Configuration::default(), "counted anew");
}

/// Lets the time base jump ahead: an hour in a few seconds of the chip.
fn pass_seconds(node: &mut Node, seconds: u32) {
    const JUMP_S: u32 = 20;
    for _ in 0..seconds / JUMP_S {
        let chip = node.board.chip_mut();
        let count = chip.read(TIM5_COUNT, 4).expect("served");
        chip.write(TIM5_COUNT, 4, count.wrapping_add(JUMP_S * TICKS_PER_SECOND)).expect("served");
        node.run(0.06);
    }
}

#[test]
fn fault_an_hour_of_good_running_ends_the_count_of_crashes_and_less_does_not() {
    let Some(image) = image("good running") else { return };
    let mut node = running(&image);
    crash(&mut node, 3);
    pass_seconds(&mut node, 3540);
    let before = node.snapshot();
    crash(&mut node, 1);
    assert_eq!(node.configuration(), Configuration::default(), "less than an hour");
    node.restore(&before);
    pass_seconds(&mut node, 120);
    crash(&mut node, 1);
    assert_eq!(node.configuration(), stored(), "an hour");
}
