//! The flashed image with tach edges where they are hardest: around the ends of blocks, at the wraps of the counter,
//! in storms.

use super::compared::{Node, STARTED_S, TICKS_PER_SECOND, configuration, machine, turns};
use super::image::image;
use super::registers::TIM5;
use meshband::config::{Configuration, TachWheel};
use meshband::events::EventKind;
use meshband::rate_plan::RatePolicy;
use meshband::units::Hertz;

/// Offsets of edges to a block's end: from -SPAN to SPAN ticks in steps.
const SPAN: i32 = 1500;
const STEP: i32 = 50;
/// Times through all offsets: mesh-band spectra need some seconds of turns.
const PASSES: usize = 4;

/// A rate that never changes, for which block borders are known in advance.
fn at_rate(rate_hz: f32) -> Configuration {
    Configuration { policy: RatePolicy::Forced { rate: Hertz(rate_hz) }, ..configuration() }
}

/// Runs a node whose edges lie one by one at every offset to a block's end, as the converter sees them through its
/// filter.
fn edges_around_borders(node: &mut Node, speed_hz: f64) -> usize {
    node.board.set_analogue(machine(speed_hz));
    node.run_until(STARTED_S);
    let last = node.blocks.last().expect("samples").clone();
    let end_s = node.board.seconds();
    let border_s = border_seconds(node, last.last_tick());
    let block_s = f64::from(last.period) * super::compared::BLOCK as f64 / TICKS_PER_SECOND;
    let offsets: Vec<i32> = (0..PASSES).flat_map(|_| (0..=2 * SPAN / STEP).map(|n| n * STEP - SPAN)).collect();
    let blocks_per_turn = (1.0 / speed_hz / block_s).round();
    let first = ((end_s - border_s) / block_s).ceil() + 1.0;
    let edge_s = |(n, &offset): (usize, &i32)| {
        border_s + (first + blocks_per_turn * n as f64) * block_s + f64::from(offset) / TICKS_PER_SECOND
    };
    let edges: Vec<f64> = offsets.iter().enumerate().map(edge_s).collect();
    node.board.add_tach_edges(&edges);
    node.run_until(edges[edges.len() - 1] + 0.6);
    edges.len()
}

/// When a tick of the running counter was.
fn border_seconds(node: &mut Node, tick: u32) -> f64 {
    let now = node.board.chip_mut().read(TIM5 + 0x24, 4).expect("the counter can be read");
    node.board.seconds() - f64::from(now.wrapping_sub(tick)) / TICKS_PER_SECOND
}

/// Found in the emulated chip: an edge is known up to 1024 ticks after it happened, its block already 107 ticks after
/// its end.
#[test]
fn regress_edges_at_every_offset_to_a_block_border_give_the_frames_of_the_host() {
    let Some(image) = image("edges at borders") else { return };
    let (mut tried, mut frames) = (0, 0);
    for (rate_hz, pace) in [(400_000.0, 2.0), (200_000.0, 1.0), (100_000.0, 2.5)] {
        let mut node = Node::new(&image, &at_rate(rate_hz));
        node.board.cpu().set_pace(pace);
        let edges = edges_around_borders(&mut node, 60.0);
        tried += edges;
        let comparison = node.compare();
        println!("{rate_hz} Hz, {pace}: {comparison:?}, {} spectra", node.spectra());
        assert_eq!((node.broken, node.resets()), (0, 0));
        assert!(comparison.is_equal(), "{rate_hz} Hz, {pace} cycles per instruction: {comparison:?}");
        assert!(node.spectra() >= 2, "{} spectra", node.spectra());
        assert_eq!(node.edges.len(), edges);
        frames += comparison.frames;
    }
    println!("tried {tried} edges, all at their block; {frames} frames equal, 0 different");
}

/// Two times 51 s at a low rate, so that the processor has little to do.
#[test]
fn theory_both_wraps_of_the_counter_change_no_frame() {
    let Some(image) = image("wraps") else { return };
    let tach = TachWheel { highest: Hertz(20.0), ..configuration().tach };
    let mut node = Node::new(&image, &Configuration { tach, ..at_rate(2_048.0) });
    node.board.set_analogue(machine(3.0));
    node.board.add_tach_edges(&turns(3.0, STARTED_S, 106.0));
    node.run_until(106.0);
    let wraps = node.blocks.windows(2).filter(|pair| pair[1].first_tick < pair[0].first_tick).count();
    let comparison = node.compare();
    println!("{wraps} wraps, {} blocks, {} frames, {comparison:?}", node.blocks.len(), comparison.frames);
    assert_eq!((wraps, node.broken, node.resets()), (2, 0, 0));
    assert!(comparison.is_equal(), "{comparison:?}");
    assert!(node.details(EventKind::TimeJump).is_empty());
}

/// The counter is set ahead as soon as it runs, before sampling starts, so that it wraps in the middle of a run at
/// full rate.
#[test]
fn theory_a_wrap_at_full_rate_changes_no_frame() {
    let Some(image) = image("wrap at full rate") else { return };
    let mut node = Node::new(&image, &at_rate(420_000.0));
    node.board.set_analogue(machine(25.0));
    node.board.add_tach_edges(&turns(25.0, 0.05, 2.4));
    let begin = u32::MAX - (1.2 * TICKS_PER_SECOND) as u32;
    // In steps of 1 us; the image needs 2 ms from power to here.
    let mut at_s = 0.0;
    while node.board.chip_mut().read(TIM5, 4).unwrap_or(0) & 1 == 0 {
        at_s += 1e-6;
        assert!(at_s < 0.2, "the counter starts");
        node.board.run_until(at_s).expect("runs");
    }
    node.board.chip_mut().write(TIM5 + 0x24, 4, begin).expect("the counter can be set");
    node.run_until(2.5);
    let wraps = node.blocks.windows(2).filter(|pair| pair[1].first_tick < pair[0].first_tick).count();
    assert_eq!((wraps, node.broken, node.resets()), (1, 0, 0));
    let comparison = node.compare();
    assert!(comparison.is_equal(), "{comparison:?}");
    assert!(node.spectra() >= 1 || comparison.frames > 20, "{comparison:?}");
}

/// What one storm did to a node that measured at 25 Hz before and behind it.
fn storm(name: &str, levels: &[(f64, bool)]) -> (Node, usize) {
    let image = image(name).expect("looked for before");
    let mut node = Node::new(&image, &configuration());
    node.board.set_analogue(machine(25.0));
    let edges = turns(25.0, STARTED_S, 4.5);
    let mut all: Vec<(f64, bool)> = edges.iter().flat_map(|&edge| [(edge, true), (edge + 0.005, false)]).collect();
    let (from, to) = (levels[0].0, levels[levels.len() - 1].0);
    all.retain(|level| level.0 < from || level.0 > to);
    all.extend(levels);
    all.sort_by(|a, b| a.0.total_cmp(&b.0));
    node.board.add_tach_levels(&all);
    node.run_until(4.5);
    (node, edges.len())
}

#[test]
fn fault_a_storm_of_100_khz_at_the_tach_does_not_get_through_the_filter_and_the_node_locks_again() {
    if image("edge storm").is_none() {
        return;
    }
    // Half a second, between two turns.
    let levels: Vec<(f64, bool)> = (0..100_000).map(|n| (1.51 + 5e-6 * f64::from(n), n % 2 == 0)).collect();
    let (mut node, _) = storm("edge storm", &levels);
    let locks: Vec<f64> = locks(&node);
    println!("{} edges captured, lost {:?}, locked at {locks:?}", node.edges.len(), node.board_events(3));
    assert_eq!(node.resets(), 0, "no hang, no crash");
    assert_eq!(node.broken, 0);
    let last_s = node.blocks.last().map_or(0.0, |block| f64::from(block.first_tick) / TICKS_PER_SECOND);
    assert!(last_s > 4.0, "samples to the end");
    assert!(locks.last().is_some_and(|&at| at > 2.0), "locks again behind the storm: {locks:?}");
}

/// Instants at which the tach locked, s of the node's clock.
fn locks(node: &Node) -> Vec<f64> {
    let locked = node.events().into_iter().filter(|event| event.kind == EventKind::TachLocked);
    locked.map(|event| (event.first_tick - (1 << 32)) as f64 / TICKS_PER_SECOND).collect()
}

/// The filter for 100 Hz and one pulse per turn takes 1024 ticks: 12.2 us.
#[test]
fn fault_bounces_and_glitches_shorter_than_the_filter_are_no_edges() {
    let Some(image) = image("glitches") else { return };
    let mut node = Node::new(&image, &configuration());
    node.board.set_analogue(machine(25.0));
    let edges = turns(25.0, STARTED_S, 3.0);
    let mut levels = Vec::new();
    for (n, &edge) in edges.iter().enumerate() {
        // The contact bounces for 30 us before it rests; then, between two pulses, glitches of 0.5 us to 10 us.
        levels.extend((0..6).map(|bounce| (edge - 3e-5 + 5e-6 * f64::from(bounce), bounce % 2 == 0)));
        levels.extend([(edge, true), (edge + 0.005, false)]);
        let glitch_s = 0.5e-6 * (1 + n % 20) as f64;
        levels.extend([(edge + 0.02, true), (edge + 0.02 + glitch_s, false)]);
    }
    node.board.add_tach_levels(&levels);
    node.run_until(3.2);
    let comparison = node.compare();
    println!("{} pulses with 3 bounces and a glitch each, {} captured, {comparison:?}", edges.len(), node.edges.len());
    assert_eq!((node.edges.len(), node.resets(), node.broken), (edges.len(), 0, 0));
    assert!(comparison.is_equal(), "{comparison:?}");
    assert!(node.board_events(3).is_empty(), "nothing lost");
}
