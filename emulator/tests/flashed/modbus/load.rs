//! A master that asks again at once, beside the measurement at its usual rates.

use super::{ADDRESS, DRIVER, LISTENED_S, listen, register, stored};
use crate::compared;
use meshband::config::{Configuration, LinkConfig, Personality};
use meshband::modbus::CRC16;

fn read(first: u16, count: u16) -> Vec<u8> {
    let mut frame = [&[ADDRESS, 4][..], &first.to_be_bytes(), &count.to_be_bytes()].concat();
    frame.extend(CRC16.checksum(&frame).to_le_bytes());
    frame
}

#[test]
fn claim_a_master_that_polls_without_a_pause_costs_no_block_and_is_always_answered() {
    const RATE: u32 = 115_200;
    const FIRST_S: f64 = 8.0;
    let link = LinkConfig {
        personality: Personality::Modbus,
        address: ADDRESS,
        bits_per_second: RATE,
        ..LinkConfig::default()
    };
    let Some(mut node) = stored("polling", &Configuration { link, ..compared::configuration() }) else { return };
    node.board.set_analogue(compared::machine(25.0));
    node.board.set_line(RATE.into(), 11);
    listen(&mut node, LISTENED_S.max(FIRST_S));
    let character = 11.0 / f64::from(RATE);
    let (mut answers, mut delays) = (0, Vec::new());
    let end = node.board.seconds() + 6.0;
    while node.board.seconds() < end {
        let group = register("mesh bands", "age").address;
        let asked = node.board.seconds() + 8.0 * character;
        node.board.send(&read(group, 66));
        let mut bytes = Vec::new();
        let give_up = node.board.seconds() + 0.5;
        while bytes.len() < 3 + 2 * 66 + 2 {
            assert!(node.board.seconds() < give_up, "{} bytes behind {answers} answers", bytes.len());
            let until = node.board.seconds() + 0.0005;
            node.board.run_until(until).expect("the board runs");
            bytes.append(&mut node.board.seen().sent);
        }
        answers += 1;
        delays.push(node.board.chip().seconds_at(bytes[0].0) - character - asked);
        // The silence that a master leaves.
        listen(&mut node, 0.002);
    }
    delays.sort_by(f64::total_cmp);
    let lost = register("counters", "blocks_lost").address;
    node.board.send(&read(lost, 2));
    let answer = listen(&mut node, 0.2);
    println!(
        "{answers} answers in 6 s; delay {:.1} ms at the median, {:.1} ms at most",
        1e3 * delays[delays.len() / 2],
        1e3 * delays[delays.len() - 1]
    );
    assert_eq!(answer[3..7], [0; 4], "blocks lost");
    let driven = node.board.seen().pins.iter().filter(|change| (change.port, change.pin) == DRIVER).count();
    assert_eq!(driven, 2 * (answers + 1));
    assert_eq!(node.board.seen().resets.len(), 0);
}
