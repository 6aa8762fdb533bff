//! What a node does not take: each refusal is named, counted as an event, and leaves the running image as it was.

use super::super::image::{SLOTS, image};
use super::{Update, activate, begin, confirm, running, started, step, transfer};
use crate::spoken::Node;
use meshband::config::{Configuration, SCHEMA};
use meshband::events::EventKind;
use meshband::message::{Reply, Request};
use meshband::update::header::{HEADER_BYTES, describe, seal};
use meshband::update::{ImageStanding, Slot, Stage, UpdateRefused, UpdateRequest};

/// Refusals counted since the start.
fn counted(node: &mut Node) -> u32 {
    match node.ask(&Request::Statistics) {
        Reply::Statistics(statistics) => statistics.count(EventKind::RequestRefused),
        other => panic!("{other:?}"),
    }
}

fn header(board: &str, base: u32, image: &[u8]) -> [u8; HEADER_BYTES] {
    seal(&describe(board, "abcdef"), base, image)
}

#[test]
fn fault_headers_that_do_not_fit_are_refused_before_anything_is_erased() {
    let Some(image) = image("refused headers") else { return };
    let mut node = started(&image);
    let bytes = vec![0; 4096];
    let good = header("stm32f405", SLOTS[1], &bytes);
    let (mut damaged, mut older) = (good, describe("stm32f405", "abcdef"));
    damaged[30] ^= 4;
    older[6..8].copy_from_slice(&(SCHEMA - 1).to_le_bytes());
    let cases = [
        (damaged, UpdateRefused::Header),
        (header("stm32f407", SLOTS[1], &bytes), UpdateRefused::Board),
        (header("stm32f405", SLOTS[0], &bytes), UpdateRefused::Place),
        (header("stm32f405", SLOTS[1], &vec![0; 0x4_0000]), UpdateRefused::Length),
        (header("stm32f405", SLOTS[1], &bytes[..4092]), UpdateRefused::Length),
        (header("stm32f405", SLOTS[1], &bytes[..64]), UpdateRefused::Length),
        (seal(&older, SLOTS[1], &bytes), UpdateRefused::OlderSchema),
    ];
    let upper = (SLOTS[1] - 0x0800_0000) as usize;
    node.board.chip_mut().cells[upper] = 0x5a;
    for (n, (header, refusal)) in (1..).zip(cases) {
        let status = begin(&mut node, &header);
        assert_eq!((status.stage, status.refusal), (Stage::Idle, Some(refusal)));
        assert_eq!(counted(&mut node), n, "{refusal:?}");
    }
    let event = node.wait_for_event(EventKind::RequestRefused);
    assert_eq!(event.detail, UpdateRefused::Header as u32);
    assert_eq!(begin(&mut node, &good[..63]).refusal, Some(UpdateRefused::Header));
    assert_eq!(step(&mut node, UpdateRequest::Activate).refusal, Some(UpdateRefused::NotReady));
    assert_eq!((node.board.chip().flash.erased, node.board.chip().cells[upper]), (0, 0x5a));
    assert_eq!(step(&mut node, UpdateRequest::Confirm).refusal, None, "confirmed it was before");
}

#[test]
fn fault_an_image_that_is_not_what_its_header_says_is_never_started() {
    let Some(image) = image("damaged image") else { return };
    let mut node = started(&image);
    let mut update = Update::built(1);
    update.bytes[70_000] ^= 0x10;
    transfer(&mut node, &update);
    let status = step(&mut node, UpdateRequest::Activate);
    assert_eq!((status.stage, status.refusal), (Stage::Idle, Some(UpdateRefused::Damaged)));
    assert_eq!(counted(&mut node), 1);
    let update = Update::changed(|bytes| bytes[4] &= !1);
    transfer(&mut node, &update);
    assert_eq!(step(&mut node, UpdateRequest::Activate).refusal, Some(UpdateRefused::Vectors));
    node.cycle_power();
    node.start();
    let image = running(&mut node);
    assert_eq!((image.slot, image.standing, image.given_up), (Slot::A, ImageStanding::Confirmed, None));
}

#[test]
fn fault_parts_that_are_missing_or_behind_the_end_are_refused() {
    let Some(image) = image("parts") else { return };
    let mut node = started(&image);
    let update = Update::built(1);
    super::erase(&mut node, &update);
    assert_eq!(step(&mut node, UpdateRequest::Activate).refusal, Some(UpdateRefused::Incomplete));
    let part = |offset: u32, count: usize| UpdateRequest::Chunk {
        offset,
        bytes: vec![0; count][..].try_into().expect("fits"),
    };
    let end = update.bytes.len() as u32;
    for (offset, count) in [(end - 4, 8), (end, 4), (u32::MAX - 3, 8), (0, 6)] {
        let status = step(&mut node, part(offset, count));
        assert_eq!((status.next, status.refusal), (0, Some(UpdateRefused::Range)), "{count} at {offset}");
    }
    super::send_until(&mut node, &update, 1024);
    assert_eq!(step(&mut node, UpdateRequest::Activate).refusal, Some(UpdateRefused::Incomplete));
}

#[test]
fn fault_no_update_is_taken_while_the_running_image_is_on_trial() {
    let Some(image) = image("on trial") else { return };
    let mut node = started(&image);
    transfer(&mut node, &Update::built(1));
    activate(&mut node);
    let lower = Update::built(0);
    assert_eq!(begin(&mut node, &lower.header).refusal, Some(UpdateRefused::OnTrial));
    confirm(&mut node);
    assert_eq!(begin(&mut node, &lower.header).refusal, None);
}

#[test]
fn fault_an_image_that_could_not_take_the_stored_configuration_is_not_confirmed() {
    let Some(image) = image("refused configuration") else { return };
    let mut node = started(&image);
    transfer(&mut node, &Update::built(1));
    // As if a still newer image had stored one meanwhile.
    let mut bytes = [0; Configuration::MAX_SERIALISED];
    let newer = Configuration { schema: SCHEMA + 1, ..Configuration::default() };
    let newer = postcard::to_slice(&newer, &mut bytes).expect("fits");
    crate::records::put(node.board.chip_mut(), 0, 0, newer);
    activate(&mut node);
    node.run(5.5);
    let status = step(&mut node, UpdateRequest::Confirm);
    assert_eq!(
        (status.standing, status.missing, status.refusal),
        (ImageStanding::OnTrial, 1, Some(UpdateRefused::Unwell))
    );
}
