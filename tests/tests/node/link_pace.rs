//! The line to the host: paced by the node's own clock, so that the queue behind it never overflows and nothing is
//! lost.

use meshband::config::Configuration;
use meshband::events::EventKind;
use meshband::frame::{MAX_FRAME, Packet, encode};
use meshband::identity::Identity;
use meshband::link::pace::{Pace, Room};
use meshband::link::receive_circle::ReceiveCircle;
use meshband::link::send_ring::SendRing;
use meshband::link::{BITS_PER_SECOND, PACE, QUEUE, WINDOW};
use meshband::message::{Message, Request, SNAPSHOT_CHUNK, Snapshot};
use meshband::session::Session;
use meshband::units::TicksPerSecond;
use meshband_tests::plant::{CLOCK_HZ, Fault, Plant, configuration};
use proptest::prelude::*;

const SPEED_HZ: f64 = 20.0;

fn snapshots(plant: &Plant, from: usize) -> Vec<&Snapshot> {
    let messages = plant.frames[from..].iter();
    messages
        .filter_map(|f| if let Packet::Message(Message::Snapshot(s)) = &f.packet { Some(s) } else { None })
        .collect()
}

#[test]
fn regress_twenty_snapshots_arrive_whole_while_everything_else_is_sent() {
    // A waveform of full scale: every sample takes the three bytes of a large number.
    let mut config = configuration();
    config.alarms = [0.1f32, 0.2, 0.3]
        .map(|raise| meshband::alarm::AlarmBand {
            watched: meshband::alarm::Watched::Rms,
            from: meshband::units::Hertz(1.0),
            to: meshband::units::Hertz(25.0),
            raise,
            clear: 0.0,
            persistence: 1,
        })
        .into_iter()
        .collect();
    let mut plant = Plant::new(config, 3);
    plant.run(3.0, |_| SPEED_HZ, Fault::None);
    let (mut complete, mut kinds) = (0, [0; 5]);
    for _ in 0..20 {
        let from = plant.frames.len();
        plant.request(&Request::Snapshot);
        for _ in 0..15 {
            plant.request(&Request::GetConfiguration);
            plant.request(&Request::Events);
            plant.run(0.1, |_| SPEED_HZ, Fault::None);
        }
        let parts = snapshots(&plant, from);
        let offsets: Vec<u16> = parts.iter().map(|part| part.offset).collect();
        let expected: Vec<u16> = (0..4096).step_by(SNAPSHOT_CHUNK).map(|offset| offset as u16).collect();
        complete += u32::from(offsets == expected);
        for frame in &plant.frames[from..] {
            match &frame.packet {
                Packet::Message(Message::Status(_)) => kinds[0] += 1,
                Packet::Message(Message::Spectrum(_)) => kinds[1] += 1,
                Packet::Message(Message::Peaks(_)) => kinds[2] += 1,
                Packet::Message(Message::Event(_)) => kinds[3] += 1,
                Packet::Reply(_) => kinds[4] += 1,
                _ => {}
            }
        }
    }
    assert_eq!(complete, 20);
    assert_eq!(plant.ring.dropped(), 0);
    assert_eq!((plant.decoder.lost(), plant.decoder.refused()), (0, 0));
    assert_eq!(plant.session.node().statistics().messages_dropped, 0);
    assert_eq!(plant.count(EventKind::MessagesDropped), 0);
    assert!(kinds[0] >= 29 && kinds[1] >= 20 && kinds[2] >= 19 && kinds[3] > 300, "{kinds:?}");
    assert_eq!(kinds[4], 20 * 31, "every command was answered");
}

#[test]
fn theory_what_is_sent_when_does_not_depend_on_the_line() {
    // The same node at a fast and at a dead line sends the same frames.
    let run = |line: f64| {
        let mut plant = Plant::new(configuration(), 5);
        plant.line = line;
        plant.request(&Request::Snapshot);
        plant.run(4.0, |_| SPEED_HZ, Fault::None);
        plant.drain();
        plant.frames
    };
    let (fast, usual) = (run(1.0e7), run(f64::from(BITS_PER_SECOND) / 10.0));
    assert!(fast.len() > 40);
    // As text: values that are not made yet are NaN.
    assert_eq!(format!("{fast:?}"), format!("{usual:?}"));
}

#[test]
fn theory_the_pace_is_bytes_per_second_of_the_nodes_clock() {
    let mut pace = Pace::new(TicksPerSecond(CLOCK_HZ));
    // Across the counter's wrap, in steps that divide nothing.
    let (mut now, mut sent) = (u32::MAX - CLOCK_HZ / 3, 0usize);
    pace.advance(now);
    let (start, mut passed) = (now, 0u64);
    while passed < 10 * u64::from(CLOCK_HZ) {
        while pace.room() == Room::Waveform {
            pace.take(401);
            sent += 401;
        }
        assert!(pace.on_way() <= WINDOW);
        now = now.wrapping_add(100_003);
        passed += 100_003;
        pace.advance(now);
    }
    assert_ne!(start, now);
    let expected = 10.0 * f64::from(PACE);
    assert!((sent as f64 - expected - WINDOW as f64 / 2.0).abs() < WINDOW as f64 / 2.0, "{sent} bytes in 10 s");
}

#[test]
fn theory_each_rank_leaves_room_for_the_ranks_above_it() {
    let room_at = |on_way: usize| {
        let mut pace = Pace::new(TicksPerSecond(CLOCK_HZ));
        pace.take(on_way);
        pace.room()
    };
    let limit = |rank: Room| (0..2 * WINDOW).filter(|&on_way| room_at(on_way) >= rank).max().expect("some");
    assert_eq!(limit(Room::Reply) + MAX_FRAME, WINDOW);
    assert_eq!(limit(Room::Result) + MAX_FRAME, limit(Room::Reply));
    // The longest part of a waveform does not stop a result.
    let samples = (0..SNAPSHOT_CHUNK).map(|_| i16::MIN).collect();
    let tag = meshband::message::Tag { first_tick: u64::MAX, period_ticks: u32::MAX, ..Default::default() };
    let part = Message::Snapshot(Snapshot { tag, offset: u16::MAX, total: u16::MAX, scale: 1.0, samples });
    let mut buffer = [0; MAX_FRAME];
    let longest = encode(&part, u16::MAX, &mut buffer).expect("fits").len();
    assert!(limit(Room::Waveform) + longest <= limit(Room::Result), "{longest} bytes");
    assert_eq!(room_at(usize::MAX), Room::Nothing);
}

#[test]
fn fault_a_flood_of_commands_waits_for_room_and_loses_no_answer() {
    let mut session = Session::new(Configuration::default(), TicksPerSecond(CLOCK_HZ), Identity::HOST).expect("valid");
    let mut ring = SendRing::<QUEUE>::new();
    let mut buffer = [0; MAX_FRAME];
    let command = encode(&Request::GetConfiguration, 0, &mut buffer).expect("fits").to_vec();
    // The host sends as fast as the line allows for two seconds; a turn of the main loop every 5 ms.
    let mut waiting: std::collections::VecDeque<u8> = std::collections::VecDeque::new();
    let (mut answers, mut commands) = (0, 0);
    for turn in 0..400u32 {
        for _ in 0..460 / command.len() {
            waiting.extend(&command);
            commands += 1;
        }
        session.send_messages(turn * (CLOCK_HZ / 200), &mut |frame| assert!(ring.push(frame)));
        while session.takes_commands()
            && let Some(byte) = waiting.pop_front()
        {
            session.on_byte(byte, &mut |frame| {
                answers += 1;
                assert!(ring.push(frame), "a reply found no room");
            });
        }
        // A line that stands still now and then for 40 ms.
        if turn % 20 >= 8 {
            let mut credit = 460 * 20 / 12;
            ring.drain(|_| {
                credit -= 1;
                credit >= 0
            });
        }
    }
    assert_eq!(ring.dropped(), 0);
    assert!(answers < commands && answers > 200, "{answers} of {commands}: the rest waits, nothing is lost");
}

#[test]
fn theory_the_longest_turn_of_a_main_loop_does_not_fill_the_queue() {
    // What stands between the window and the queue, at the line's pace: longer than any turn of the main loop (13 ms).
    let standstill_s = (QUEUE - WINDOW) as f64 / f64::from(PACE);
    assert!(standstill_s > 0.04, "{standstill_s} s");
}

proptest! {
    /// Whatever is pushed comes out in order, by runs as by bytes; what does not fit is refused whole and counted.
    #[test]
    fn theory_the_ring_gives_whole_frames_back_in_order(
        steps in proptest::collection::vec((1usize..40, any::<bool>(), 0usize..50), 1..300),
        by_runs in any::<bool>(),
    ) {
        let mut ring = SendRing::<100>::new();
        let (mut expected, mut got) = (Vec::<u8>::new(), Vec::<u8>::new());
        let (mut next, mut dropped) = (0u8, 0);
        for (length, send, take) in steps {
            let frame: Vec<u8> = (0..length).map(|n| next.wrapping_add(n as u8)).collect();
            let waiting = ring.len();
            if ring.push(&frame) {
                prop_assert!(waiting + length <= 100);
                expected.extend(&frame);
                next = next.wrapping_add(length as u8);
            } else {
                prop_assert!(waiting + length > 100);
                dropped += 1;
            }
            if !send {
                continue;
            }
            if by_runs {
                // A run lent stays waiting until the next is asked for.
                let held = ring.next_run().map_or(0, |run| {
                    got.extend_from_slice(run);
                    run.len()
                });
                prop_assert_eq!(ring.len(), expected.len() - got.len() + held);
            } else {
                let mut left = take;
                ring.drain(|byte| {
                    let accepts = left > 0;
                    if accepts {
                        left -= 1;
                        got.push(byte);
                    }
                    accepts
                });
            }
        }
        prop_assert_eq!(&got[..], &expected[..got.len()]);
        prop_assert_eq!(ring.dropped(), dropped);
        while by_runs && let Some(run) = ring.next_run() {
            got.extend_from_slice(run);
        }
        ring.drain(|byte| { got.push(byte); true });
        prop_assert_eq!(got, expected);
        prop_assert_eq!(ring.take_unreported().unwrap_or(0), dropped);
        prop_assert_eq!(ring.take_unreported(), None);
    }

    #[test]
    fn theory_the_circle_reads_each_byte_once(portions in proptest::collection::vec(0usize..16, 1..200)) {
        // As DMA does: memory and a position; what it counts down shows the end for a moment before it wraps.
        let (mut memory, mut written, mut circle) = ([0u8; 16], 0usize, ReceiveCircle::<16>::new());
        let mut got = Vec::new();
        for portion in portions {
            for _ in 0..portion {
                memory[written % 16] = written as u8;
                written += 1;
            }
            let position = if written > 0 && written % 16 == 0 { 16 } else { written % 16 };
            while let Some(place) = circle.next(position) {
                got.push(memory[place]);
            }
        }
        let expected: Vec<u8> = (0..written).map(|n| n as u8).collect();
        prop_assert_eq!(got, expected);
    }
}
