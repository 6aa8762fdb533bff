//! The flashed image and its line: requests answered, waveforms whole, rates changed.

use super::compared::{Node, STARTED_S, configuration, machine, turns};
use super::image::image;
use meshband::events::EventKind;
use meshband::frame::Packet;
use meshband::message::{Message, Reply, Request, Snapshot};

/// A node at 25 Hz that measures.
fn measuring(test: &str, seconds: f64) -> Option<Node> {
    let image = image(test)?;
    let mut node = Node::new(&image, &configuration());
    node.board.set_analogue(machine(25.0));
    node.board.add_tach_edges(&turns(25.0, STARTED_S, seconds));
    node.run_until(1.0);
    Some(node)
}

fn snapshots(node: &Node) -> Vec<Snapshot> {
    let snapshot = |message| if let Message::Snapshot(snapshot) = message { Some(snapshot) } else { None };
    node.messages().into_iter().filter_map(snapshot).collect()
}

#[test]
fn theory_five_requests_are_answered_in_their_order() {
    let Some(mut node) = measuring("requests", 2.0) else { return };
    let requests =
        [Request::Identify, Request::GetConfiguration, Request::GetLaw, Request::Statistics, Request::SelfTest];
    for request in requests {
        node.ask(request);
    }
    node.run_until(1.5);
    let reply = |packet| if let Packet::Reply(reply) = packet { Some(reply) } else { None };
    let replies: Vec<Reply> = node.packets().into_iter().filter_map(reply).collect();
    let [
        Reply::Identity(identity),
        Reply::Configuration(configuration),
        Reply::Law(law),
        Reply::Statistics(statistics),
        Reply::SelfTest(test),
    ] = &replies[..]
    else {
        panic!("{replies:?}")
    };
    assert_eq!((identity.board.as_str(), identity.unique_id), ("stm32f405", node.board.chip().unique));
    assert_eq!((identity.ticks_per_second, test.failed), (84_000_000, 0));
    assert_eq!((configuration, law), (&node.config, &node.config.law));
    assert!(statistics.blocks > 100 && statistics.blocks_lost == 0, "{statistics:?}");
}

#[test]
fn regress_a_burst_of_self_tests_loses_no_block_and_fails_nothing() {
    let Some(mut node) = measuring("self-tests", 4.0) else { return };
    for _ in 0..3 {
        for _ in 0..12 {
            node.ask(Request::SelfTest);
        }
        node.run_for(0.7);
    }
    let tested = node.packets().iter().filter(|packet| matches!(packet, Packet::Reply(Reply::SelfTest(_)))).count();
    assert_eq!(tested, 36);
    let events = [EventKind::SelfTestFailed, EventKind::BlocksLost, EventKind::Overrun].map(|kind| node.details(kind));
    assert!(events.iter().all(Vec::is_empty), "{events:?}");
}

/// 32 parts of 128 samples: 11 KB at 92 KB/s beside spectra, statuses and averages.
#[test]
fn regress_a_waveform_of_4096_samples_arrives_whole_20_of_20_times_while_everything_else_is_sent() {
    let Some(mut node) = measuring("waveforms", 16.0) else { return };
    let mut whole = 0;
    for n in 0..20 {
        let before = snapshots(&node).len();
        node.ask(Request::Snapshot);
        node.run_for(0.5);
        let parts = &snapshots(&node)[before..];
        let offsets: Vec<u16> = parts.iter().map(|part| part.offset).collect();
        let expected: Vec<u16> = (0..32).map(|part| part * 128).collect();
        let same_record = parts.windows(2).all(|pair| pair[0].tag.first_tick == pair[1].tag.first_tick);
        assert_eq!(offsets, expected, "waveform {n}");
        assert!(same_record && parts.iter().all(|part| part.total == 4096), "waveform {n}");
        whole += 1;
    }
    let spectra = node.spectra();
    println!("{whole} of 20 whole, beside {spectra} spectra");
    assert!(node.details(EventKind::MessagesDropped).is_empty() && node.details(EventKind::BlocksLost).is_empty());
    assert!(spectra >= 3);
}

/// The converter's rate follows the speed; no block has two spacings of its samples.
#[test]
fn theory_rates_change_at_block_borders_only() {
    let Some(image) = image("rate changes") else { return };
    let mut node = Node::new(&image, &configuration());
    node.board.set_analogue(machine(5.0));
    // From 2 Hz to 40 Hz in 6 s.
    let mut edges = vec![STARTED_S];
    while edges[edges.len() - 1] < 6.0 {
        let last = edges[edges.len() - 1];
        edges.push(last + 1.0 / (2.0 + 38.0 * last / 6.0));
    }
    node.board.add_tach_edges(&edges);
    node.run_until(6.3);
    let mut periods: Vec<u32> = node.blocks.iter().map(|block| block.period).collect();
    periods.dedup();
    let comparison = node.compare();
    println!("{} blocks, {} rates in a row, {comparison:?}", node.blocks.len(), periods.len());
    assert_eq!((node.broken, node.resets()), (0, 0), "a block with two spacings would be broken");
    assert!(periods.len() >= 4, "{periods:?}");
    assert!(node.details(EventKind::UnexpectedPeriod).is_empty());
    assert!(comparison.is_equal(), "{comparison:?}");
}
