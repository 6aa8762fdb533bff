//! An update as it goes when nothing fails.

use super::super::image::{self, SLOTS, image};
use super::{Update, activate, chunk, confirm, erase, running, send_until, started, step, transfer};
use crate::spoken::Node;
use crate::update::begin;
use meshband::config::{Configuration, GearPair};
use meshband::events::EventKind;
use meshband::message::{Reply, Request};
use meshband::rate_plan::RatePolicy;
use meshband::units::Hertz;
use meshband::update::receiver::Step;
use meshband::update::{ImageStanding, Slot, Stage, StartCause, UpdateRefused, UpdateRequest};
use meshband_emulator::flash::START;

/// At a low rate, so that a run is cheap.
fn configuration() -> Configuration {
    Configuration {
        gears: GearPair { pinion_teeth: 19, gear_teeth: 61 },
        policy: RatePolicy::Forced { rate: Hertz(20_000.0) },
        ..Configuration::default()
    }
}

#[test]
fn claim_what_is_flashed_is_the_board_of_these_tests_and_starts_whatever_lay_in_the_upper_slot() {
    let Some(image) = image("what is flashed") else { return };
    let flashed = image::flashed();
    let mut expected = vec![0xff; flashed.len()];
    for segment in &image.segments {
        let at = (segment.address - START) as usize;
        expected[at..at + segment.bytes.len()].copy_from_slice(&segment.bytes);
    }
    let upper = (SLOTS[1] - START) as usize;
    assert_eq!(flashed[..upper], expected[..upper]);
    // A newer image in the upper slot, then a probe.
    let mut node = started(&image);
    transfer(&mut node, &Update::built(1));
    activate(&mut node);
    confirm(&mut node);
    assert_eq!(running(&mut node).slot, Slot::B);
    node.board.chip_mut().cells[..flashed.len()].copy_from_slice(&flashed);
    node.cycle_power();
    node.start();
    let image = running(&mut node);
    assert_eq!((image.slot, image.standing, image.given_up), (Slot::A, ImageStanding::Confirmed, None));
}

#[test]
fn loop_an_update_is_received_started_confirmed_and_stays_and_the_next_one_goes_into_the_other_slot() {
    let Some(image) = image("update") else { return };
    let mut node = started(&image);
    node.configure(&configuration());
    node.commit();
    let first = running(&mut node);
    assert_eq!((first.slot, first.standing, first.started), (Slot::A, ImageStanding::Confirmed, StartCause::Power));
    let update = Update::built(1);
    transfer(&mut node, &update);
    activate(&mut node);
    let second = running(&mut node);
    assert_eq!((second.slot, second.standing, second.started), (Slot::B, ImageStanding::OnTrial, StartCause::Software));
    assert_eq!(node.configuration(), configuration(), "the stored one is kept");
    // Not well before it has sampled for five seconds.
    let status = step(&mut node, UpdateRequest::Confirm);
    assert_eq!((status.refusal, status.missing & 4), (Some(UpdateRefused::Unwell), 4));
    confirm(&mut node);
    node.cycle_power();
    node.start();
    let third = running(&mut node);
    assert_eq!((third.slot, third.standing, third.started), (Slot::B, ImageStanding::Confirmed, StartCause::Power));
    transfer(&mut node, &Update::built(0));
    activate(&mut node);
    confirm(&mut node);
    let fourth = running(&mut node);
    assert_eq!((fourth.slot, fourth.standing, fourth.given_up), (Slot::A, ImageStanding::Confirmed, None));
    assert_eq!(node.configuration(), configuration());
}

#[test]
fn theory_the_loader_takes_less_than_an_eighth_of_a_second() {
    let Some(image) = image("loader's time") else { return };
    let mut node = Node::new(&image);
    while node.board.cpu().program_counter() < SLOTS[0] {
        node.run(0.001);
    }
    println!("the image begins {:.0} ms after power", 1e3 * node.board.seconds());
    assert!(node.board.seconds() < 0.125);
}

#[test]
fn theory_erasing_stops_measuring_for_two_seconds_which_is_announced_and_counted_and_the_transfer_does_not() {
    let Some(image) = image("measuring") else { return };
    let mut node = started(&image);
    node.configure(&configuration());
    let update = Update::built(1);
    let before = node.board.seconds();
    erase(&mut node, &update);
    let stall = node.board.seconds() - before;
    node.run(0.3);
    assert!((2.0..2.6).contains(&stall), "two sectors of a second each: {stall} s");
    assert_eq!(node.board.seen().resets.len(), 0, "the watchdog waits");
    let begun = Step::Begun.detail(update.version());
    assert_eq!(node.events().filter(|event| event.kind == EventKind::Update && event.detail == begun).count(), 1);
    assert!(node.events().any(|event| event.kind == EventKind::BlocksLost));
    let Reply::Statistics(then) = node.ask(&Request::Statistics) else { panic!("no statistics") };
    let (sent, from) = (64 * 512, node.board.seconds());
    send_until(&mut node, &update, sent);
    let seconds = node.board.seconds() - from;
    let Reply::Statistics(now) = node.ask(&Request::Statistics) else { panic!("no statistics") };
    println!("erasing {stall:.2} s; {:.1} KB/s", f64::from(sent) / 1e3 / seconds);
    assert!(now.blocks > then.blocks && now.blocks_lost == then.blocks_lost, "{then:?} {now:?}");
}

#[test]
fn theory_steps_may_be_repeated_and_a_part_out_of_turn_changes_nothing() {
    let Some(image) = image("repeated steps") else { return };
    let mut node = started(&image);
    let update = Update::built(1);
    erase(&mut node, &update);
    send_until(&mut node, &update, 4 * 512);
    assert_eq!(chunk(&mut node, &update, 512).next, 4 * 512, "had already");
    assert_eq!(chunk(&mut node, &update, 8 * 512).next, 4 * 512, "too early");
    let again = begin(&mut node, &update.header);
    assert_eq!((again.stage, again.next, again.refusal), (Stage::Receiving, 4 * 512, None), "goes on");
    send_until(&mut node, &update, update.bytes.len() as u32);
    // The answer may be lost, too.
    for _ in 0..2 {
        let status = step(&mut node, UpdateRequest::Activate);
        assert_eq!((status.stage, status.refusal), (Stage::Restarting, None));
    }
    super::wait_for_reset(&mut node);
    node.start();
    confirm(&mut node);
    assert_eq!(step(&mut node, UpdateRequest::Confirm).refusal, None);
}
