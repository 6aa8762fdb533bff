//! The heaviest ordinary work of the flashed image, and whether it keeps up: mesh records, synchronous averages,
//! edges timed, and waveforms asked for without end.

use super::{Node, STARTED_S, TICKS_PER_SECOND, configuration, machine, turns};
use meshband::config::Configuration;
use meshband::frame::Packet;
use meshband::message::{Reply, Request, Statistics};
use meshband::rate_plan::RatePolicy;
use meshband::units::Hertz;
use meshband_emulator::elf::Image;

/// Turns per second: a usual speed, from which on the default law is the same; a higher one; the default wheel's
/// highest, less what its tach needs as room.
pub const SPEEDS_HZ: [f64; 3] = [25.0, 60.0, 95.0];
/// What a run may last, s: several mesh records and averages.
const RUN_S: f64 = 4.0;
/// Block buffers of the board, and how many the double buffer holds.
const BUFFERS: f64 = 27.0;
const FILLING_BUFFERS: u32 = 2;
/// Least multiple of the bandwidth that a configuration may ask for.
const LEAST_MULTIPLE: f32 = 2.0;

/// What a run gave.
#[derive(Clone, Copy, Debug)]
pub struct Outcome {
    /// Turns per second.
    pub speed_hz: f64,
    /// Blocks lost, by the node's own count.
    pub lost: u32,
    /// Mesh-band spectra sent.
    pub spectra: usize,
    /// Highest rate at which blocks were sampled, Hz.
    pub rate_hz: f64,
    /// Share of the processor that was used after the first second.
    pub load: f64,
    /// Most blocks that ever waited, by the board's own count.
    pub most_waiting: u32,
}

impl Outcome {
    /// Share of the block buffers that stayed free at worst; two of them are being filled at any time.
    pub fn buffers_free(&self) -> f64 {
        1.0 - f64::from(self.most_waiting + FILLING_BUFFERS) / BUFFERS
    }
}

/// A configuration whose law asks for this ADC rate, a half-band above the wideband path's where its policy can say so.
pub fn configured_for(rate_hz: f64) -> Configuration {
    let mut config = configuration();
    let rate_hz = rate_hz as f32;
    let whole = rate_hz / config.law.bandwidth(Hertz(SPEEDS_HZ[0] as f32)).bandwidth.0;
    let multiple = if whole >= 2.0 * LEAST_MULTIPLE { whole / 2.0 } else { whole };
    config.policy = RatePolicy::Waveform { multiple };
    config.limits.analogue_stop = Hertz(rate_hz / 2.1);
    config.limits.highest_adc = Hertz(rate_hz * 1.001);
    config
}

/// Runs the image at so many cycles per instruction and turns per second.
pub fn run(image: &Image, config: &Configuration, cycles: f64, speed_hz: f64) -> Outcome {
    run_for(image, config, cycles, (speed_hz, RUN_S))
}

/// [`run`] for so many seconds.
pub fn run_for(image: &Image, config: &Configuration, cycles: f64, (speed_hz, run_s): (f64, f64)) -> Outcome {
    let mut node = Node::new(image, config);
    node.board.cpu().set_pace(cycles);
    node.board.set_analogue(machine(speed_hz));
    node.board.add_tach_edges(&turns(speed_hz, STARTED_S, run_s));
    node.run_until(1.0);
    let before = node.board.cpu().instructions();
    while node.board.seconds() < run_s {
        node.ask(Request::Snapshot);
        node.run_for(0.25);
    }
    let load = (node.board.cpu().instructions() - before) as f64 * cycles / 168.0e6 / (run_s - 1.0);
    let rate_hz = node.blocks.iter().map(|block| TICKS_PER_SECOND / f64::from(block.period)).fold(0.0, f64::max);
    assert_eq!((node.broken, node.resets()), (0, 0));
    let spectra = node.spectra();
    let Statistics { blocks_lost: lost, most_waiting, .. } = statistics(&mut node);
    Outcome { speed_hz, lost, spectra, rate_hz, load, most_waiting }
}

/// The node's own counters since the start.
fn statistics(node: &mut Node) -> Statistics {
    node.ask(Request::Statistics);
    node.run_for(0.2);
    let counted = node.packets().into_iter().rev().find_map(|packet| match packet {
        Packet::Reply(Reply::Statistics(statistics)) => Some(statistics),
        _ => None,
    });
    counted.expect("an answer")
}
