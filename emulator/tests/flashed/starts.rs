//! How the flashed image starts, and what it does when what it relies on fails: crystal, PLL, triggers, converter.

use super::compared::{Node, STARTED_S, configuration, machine, turns};
use super::image::image;
use super::registers::{DMA2, TIM2, stream};
use meshband::message::{Message, Status};
use meshband_emulator::elf::Image;
use meshband_emulator::rcc::Oscillators;

/// Numbers of the board's own events.
mod board_event {
    pub const CRASH: u32 = 1;
    pub const INTERNAL_OSCILLATOR: u32 = 2;
    pub const SAMPLING_RESTARTED: u32 = 4;
}

/// Causes of a restart, as the crash record and the event of the start name them.
mod cause {
    pub const PLL: u32 = 1;
    pub const CRYSTAL: u32 = 2;
    pub const STARTED_BY_SOFTWARE: u32 = 2;
    pub const STARTED_BY_WATCHDOG: u32 = 3;
}

/// A node at 25 Hz, not yet switched on.
fn node(image: &Image, seconds: f64) -> Node {
    let mut node = Node::new(image, &configuration());
    node.board.set_analogue(machine(25.0));
    node.board.add_tach_edges(&turns(25.0, STARTED_S, seconds));
    node
}

fn last_status(node: &Node) -> Status {
    let status = |message| if let Message::Status(status) = message { Some(status) } else { None };
    node.messages().into_iter().rev().find_map(status).expect("a status")
}

/// Starts of the node since the last [`Node::forget`], by cause.
fn starts(node: &Node) -> Vec<u32> {
    node.details(meshband::events::EventKind::Started)
}

/// Times the light went on within some seconds of its cycle of 2.4 s.
fn flashes(node: &mut Node, seconds: f64) -> usize {
    node.board.seen().pins.clear();
    node.run_for(seconds);
    node.board.seen().pins.iter().filter(|change| (change.port, change.pin, change.level) == (2, 12, false)).count()
}

#[test]
fn fault_without_a_crystal_the_node_runs_and_says_so_and_its_frequencies_carry_the_oscillators_error() {
    let Some(image) = image("no crystal") else { return };
    let mut node = node(&image, 9.0);
    node.board.chip_mut().rcc.oscillators = Oscillators { crystal: false, pll: true };
    node.board.chip_mut().internal_fast = 0.008;
    node.run_until(3.0);
    assert_eq!(node.board_events(board_event::INTERNAL_OSCILLATOR).len(), 1);
    // Its second is shorter, so that a turn takes longer by its clock.
    let speed_hz = f64::from(last_status(&node).speed_hz);
    assert!((speed_hz * 1.008 / 25.0 - 1.0).abs() < 2e-4, "{speed_hz}");
    // Four flashes in a cycle of 2.4 s.
    let flashes = flashes(&mut node, 4.8);
    println!("{speed_hz} Hz, {flashes} flashes in two cycles");
    assert!((7..=9).contains(&flashes), "{flashes}");
    assert_eq!(node.resets(), 0);
}

#[test]
fn fault_a_pll_that_does_not_lock_restarts_the_node_until_it_does() {
    let Some(image) = image("PLL") else { return };
    let mut node = node(&image, 4.0);
    node.board.chip_mut().rcc.oscillators = Oscillators { crystal: true, pll: false };
    node.run_until(1.0);
    let failed = node.resets();
    assert!(failed >= 2, "{failed} restarts");
    assert!(node.link.is_empty(), "nothing is sent at the wrong rate");
    node.board.chip_mut().rcc.oscillators.pll = true;
    node.run_until(4.0);
    assert_eq!(node.board_events(board_event::CRASH), [cause::PLL]);
    assert_eq!(starts(&node), [cause::STARTED_BY_SOFTWARE]);
    assert!(node.blocks.len() > 100);
    println!("{failed} restarts, then {} blocks", node.blocks.len());
}

#[test]
fn fault_a_crystal_lost_while_running_is_recorded_and_the_node_goes_on_without() {
    let Some(image) = image("crystal lost") else { return };
    let mut node = node(&image, 4.0);
    node.run_until(1.5);
    assert!(node.compare().is_equal());
    node.forget();
    node.board.chip_mut().lose_crystal();
    node.run_until(4.0);
    assert_eq!(node.resets(), 1);
    assert_eq!(node.board_events(board_event::CRASH), [cause::CRYSTAL]);
    assert_eq!(starts(&node), [cause::STARTED_BY_SOFTWARE]);
    assert_eq!(node.board_events(board_event::INTERNAL_OSCILLATOR).len(), 1);
    assert!((last_status(&node).speed_hz - 25.0).abs() < 0.05);
}

#[test]
fn fault_triggers_that_stop_end_in_a_restart_by_the_watchdog() {
    let Some(image) = image("triggers stop") else { return };
    let mut node = node(&image, 13.0);
    node.run_until(1.5);
    node.forget();
    let stopped_s = node.board.seconds();
    node.board.chip_mut().write(TIM2, 4, 0).expect("the counter stops");
    while node.resets() == 0 && node.board.seconds() < 12.0 {
        node.run_for(0.1);
    }
    let restarted_s = node.board.seconds();
    node.run_for(1.5);
    assert_eq!(starts(&node), [cause::STARTED_BY_WATCHDOG]);
    assert!(node.board_events(board_event::CRASH).is_empty());
    // One second of patience and 8 s of the watchdog.
    let after_s = restarted_s - stopped_s;
    println!("restarted {after_s:.1} s after the last trigger");
    assert!((7.5..10.0).contains(&after_s), "{after_s}");
    assert!(node.blocks.len() > 100, "samples again");
}

#[test]
fn fault_an_overrun_of_the_converter_restarts_sampling_and_later_frames_are_right() {
    let Some(image) = image("overrun") else { return };
    let mut node = node(&image, 6.0);
    node.run_until(1.5);
    let broken_before = node.broken;
    // The stream is held up for some conversions.
    let control = node.board.chip_mut().read(stream(DMA2, 0), 4).expect("a register");
    node.board.chip_mut().write(stream(DMA2, 0), 4, control & !1).expect("the stream stops");
    node.run_until(6.0);
    assert_eq!(node.board_events(board_event::SAMPLING_RESTARTED), [1]);
    assert_eq!((node.resets(), broken_before), (0, 0));
    assert_eq!(node.broken, 1, "one block lacks samples");
    let status = last_status(&node);
    assert!((status.speed_hz - 25.0).abs() < 0.01, "{status:?}");
    let spectrum = |message| if let Message::Spectrum(spectrum) = message { Some(spectrum) } else { None };
    let spectra: Vec<_> = node.messages().into_iter().filter_map(spectrum).collect();
    let first = spectra.last().and_then(|spectrum| spectrum.bands.first()).expect("a mesh line");
    // The signal's first mesh line: 0.15 of 65536 codes at 0.03 m/s2 per code.
    let (amplitude, expected) = (f64::from(first.line.amplitude), 0.15 * 65_536.0 * 0.03);
    println!("{} Hz, {amplitude:.2} m/s2 of {expected:.2}", first.line.frequency_hz);
    assert!((f64::from(first.line.frequency_hz) / (25.0 * 19.0) - 1.0).abs() < 1e-4);
    assert!((amplitude / expected - 1.0).abs() < 0.02);
}
