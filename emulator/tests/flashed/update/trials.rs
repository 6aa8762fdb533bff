//! New images that do not prove themselves: after three starts the image before them runs again, as it was.

use super::super::image::{SLOTS, image};
use super::{Update, activate, identity, running, started, step, transfer, wait_for_reset};
use crate::spoken::Node;
use meshband::events::EventKind;
use meshband::update::receiver::Step;
use meshband::update::slots::TRIALS;
use meshband::update::{ImageStanding, Slot, StartCause, UpdateRefused, UpdateRequest};
use meshband_emulator::rcc::cause;

/// Count of TIM5, and its ticks per second.
const TIM5_COUNT: u32 = 0x4000_0c24;
const TICKS_PER_SECOND: u32 = 84_000_000;
/// Half-words that jump to themselves, and that no core knows.
const HANG: [u8; 2] = [0xfe, 0xe7];
const UNDEFINED_CODE: [u8; 2] = [0x00, 0xde];

/// The lower slot's image, past its head.
fn lower(node: &Node) -> Vec<u8> {
    let from = (SLOTS[0] - 0x0800_0000) as usize;
    node.board.chip().cells[from..from + 0x4_0000].to_vec()
}

/// An image whose first instruction is another.
fn beginning_with(code: [u8; 2]) -> Update {
    let entry = Update::built(1).entry();
    Update::changed(|bytes| bytes[entry..entry + 2].copy_from_slice(&code))
}

/// Asks for the activation, and sees that the image fails in each of its starts by a reset of this cause.
fn fails_by(node: &mut Node, expected: u32) {
    assert_eq!(step(node, UpdateRequest::Activate).refusal, None);
    wait_for_reset(node);
    for _ in 0..TRIALS {
        wait_for_reset(node);
        let (_, cause) = node.board.seen().resets[0];
        assert_eq!(cause & expected, expected);
    }
    node.start();
}

fn assert_given_up(node: &mut Node, update: &Update, started: StartCause) {
    let image = running(node);
    assert_eq!((image.slot, image.standing, image.started), (Slot::A, ImageStanding::Confirmed, started));
    assert_eq!(image.given_up, Some(update.version()));
    let event = node.wait_for_event(EventKind::Update);
    assert_eq!(event.detail, Step::GivenUp.detail(update.version()));
}

#[test]
fn fault_an_image_that_hangs_at_its_first_instruction_is_given_up_after_three_starts() {
    let Some(image) = image("hanging image") else { return };
    let mut node = started(&image);
    let (update, before) = (beginning_with(HANG), lower(&node));
    transfer(&mut node, &update);
    fails_by(&mut node, cause::WATCHDOG);
    assert_given_up(&mut node, &update, StartCause::Watchdog);
    assert_eq!(lower(&node), before, "the image before was not touched");
    // It stays given up, and another one is taken in its place.
    node.cycle_power();
    node.start();
    assert_eq!(running(&mut node).given_up, Some(update.version()));
    transfer(&mut node, &Update::built(1));
    activate(&mut node);
    let image = running(&mut node);
    assert_eq!((image.slot, image.standing, image.given_up), (Slot::B, ImageStanding::OnTrial, None));
}

#[test]
fn fault_an_image_that_crashes_at_its_first_instruction_is_given_up_after_three_starts() {
    let Some(image) = image("crashing image") else { return };
    let mut node = started(&image);
    let update = beginning_with(UNDEFINED_CODE);
    transfer(&mut node, &update);
    let before = node.configuration();
    fails_by(&mut node, cause::SOFTWARE);
    assert_given_up(&mut node, &update, StartCause::Software);
    assert_eq!(node.configuration(), before, "no safe start for what another image did");
}

#[test]
fn fault_an_image_that_nobody_confirms_is_given_up_after_three_times_two_minutes() {
    let Some(image) = image("unconfirmed image") else { return };
    let mut node = started(&image);
    let update = Update::built(1);
    transfer(&mut node, &update);
    activate(&mut node);
    for trial in 1..=TRIALS {
        let image = running(&mut node);
        assert_eq!((image.slot, image.standing), (Slot::B, ImageStanding::OnTrial), "start {trial}");
        pass_seconds(&mut node, 100);
        assert_eq!(node.board.seen().resets.len(), 0, "start {trial} lasts");
        pass_seconds(&mut node, 20);
        if node.board.seen().resets.is_empty() {
            wait_for_reset(&mut node);
        }
        node.forget();
        node.start();
    }
    assert_given_up(&mut node, &update, StartCause::Software);
}

/// Lets the time base jump ahead.
fn pass_seconds(node: &mut Node, seconds: u32) {
    const JUMP_S: u32 = 20;
    node.board.seen().resets.clear();
    for _ in 0..seconds / JUMP_S {
        let chip = node.board.chip_mut();
        let count = chip.read(TIM5_COUNT, 4).expect("served");
        chip.write(TIM5_COUNT, 4, count.wrapping_add(JUMP_S * TICKS_PER_SECOND)).expect("served");
        node.run(0.06);
    }
}

#[test]
fn fault_power_lost_in_every_start_of_a_trial_goes_back_and_the_image_can_be_sent_again() {
    let Some(image) = image("power lost in trials") else { return };
    let mut node = started(&image);
    let update = Update::built(1);
    transfer(&mut node, &update);
    activate(&mut node);
    for _ in 1..TRIALS {
        assert_eq!(running(&mut node).standing, ImageStanding::OnTrial);
        assert_eq!(step(&mut node, UpdateRequest::Confirm).refusal, Some(UpdateRefused::Unwell));
        node.cycle_power();
        node.start();
    }
    node.cycle_power();
    node.start();
    assert_given_up(&mut node, &update, StartCause::Power);
}

#[test]
fn fault_a_confirmed_image_that_is_damaged_later_gives_way_to_the_one_before() {
    let Some(image) = image("damaged later") else { return };
    let mut node = started(&image);
    transfer(&mut node, &Update::built(1));
    activate(&mut node);
    super::confirm(&mut node);
    let build = identity(&mut node).build;
    let at = (SLOTS[1] - 0x0800_0000) as usize + 100_000;
    node.board.chip_mut().cells[at] ^= 0x04;
    node.cycle_power();
    // Two checksums.
    node.run(0.1);
    node.start();
    let image = identity(&mut node);
    assert_eq!((image.image.slot, image.image.standing, image.build), (Slot::A, ImageStanding::Confirmed, build));
}
