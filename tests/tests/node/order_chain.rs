//! Samples and turn marks in, mesh bands and averages out, with and without losses.

use meshband::order_chain::OrderChain;
use meshband::window::Window;
use meshband::zoom::{Averaging, ZoomConfig};
use std::f64::consts::TAU;

const TEETH: u16 = 19;
const SPEED_HZ: f64 = 12.0;
const CLOCK_HZ: f64 = 25e6;
const PERIOD: u32 = 3200;

type Chain = OrderChain<4096, 256, 3, 512>;

fn chain() -> Box<Chain> {
    let averaging = Averaging::Linear { records: 2 };
    Box::new(Chain::new(ZoomConfig { teeth: TEETH, turns: 16, window: Window::Hann, averaging }).unwrap())
}

fn signal(turns: f64) -> f64 {
    2.0 * (TAU * 19.0 * turns).cos() + 0.5 * (TAU * 20.0 * turns + 1.0).cos() + 0.8 * (TAU * 57.0 * turns).sin()
}

/// Feeds blocks of 128 samples; `lost` says which are dropped. Returns turns and records.
fn feed(chain: &mut Chain, blocks: u64, lost: impl Fn(u64) -> bool) -> (u32, u32) {
    let origin = u32::MAX - 40_000_000;
    let (mut mark, mut turns, mut records) = (0u64, 0, 0);
    for block in 0..blocks {
        let first = block * 128 * u64::from(PERIOD);
        if !lost(block) {
            let samples: [f32; 128] = std::array::from_fn(|i| {
                let tick = first + i as u64 * u64::from(PERIOD);
                signal(SPEED_HZ * tick as f64 / CLOCK_HZ) as f32
            });
            chain.push_samples(&samples, origin.wrapping_add(first as u32), PERIOD);
        }
        let end = first + 128 * u64::from(PERIOD);
        loop {
            let tick = (mark as f64 / SPEED_HZ * CLOCK_HZ).round() as u64;
            if tick > end {
                break;
            }
            chain.push_mark(origin.wrapping_add(tick as u32));
            mark += 1;
        }
        let progress = chain.process();
        turns += progress.turns;
        records += progress.records;
    }
    (turns, records)
}

fn assert_bands(chain: &Chain) {
    for (harmonic, offset, amplitude) in [(1, 0.0, 2.0), (1, 1.0, 0.5), (3, 0.0, 0.8)] {
        let line = chain.mesh_bands().line(harmonic, offset).unwrap();
        let level = 20.0 * (f64::from(line.amplitude) / amplitude).log10();
        assert!(level.abs() < 0.1, "harmonic {harmonic} {offset:+}: {level} dB");
    }
}

#[test]
fn theory_chain_gives_bands_and_average() {
    let mut chain = chain();
    let (turns, records) = feed(&mut chain, 200, |_| false);
    assert!(turns >= 34 && records == 2, "{turns} turns, {records} records");
    assert_eq!(chain.interruptions(), 0);
    assert_bands(&chain);
    let mut average = [0.0f32; 512];
    chain.average().average(&mut average).unwrap();
    for (n, &x) in average.iter().enumerate() {
        assert!((f64::from(x) - signal(n as f64 / 512.0)).abs() < 0.02, "sample {n}");
    }
}

#[test]
fn fault_a_lost_block_interrupts_the_record_and_spoils_nothing() {
    let mut chain = chain();
    let (_, records) = feed(&mut chain, 420, |block| block == 60 || block == 250);
    assert_eq!(chain.interruptions(), 2);
    assert!(records >= 2, "{records}");
    assert_bands(&chain);
}

#[test]
fn fault_a_lost_tach_forgets_the_marks_only() {
    let mut chain = chain();
    feed(&mut chain, 50, |_| false);
    chain.lose_tach();
    assert_eq!(chain.interruptions(), 1);
    assert_eq!(chain.process(), Default::default());
}
