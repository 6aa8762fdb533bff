//! Which sampling rates the flashed image keeps up with, against cycles per instruction, and with waveforms kept: the
//! tables of `cargo xtask pace`.
//!
//! Every run is the image's heaviest ordinary work ([`compared::load`]): the wideband path at the law's rate, mesh
//! records, synchronous averages, edges timed for the law's check, waveforms asked for without end, at three speeds
//! up to the highest. A rate is kept up with where no block is lost at any of them. From the converter's own limit
//! downwards the first rate is printed that holds together with the two below it: a single one may hold by luck.
//! Waveforms ([`WAVEFORMS`]) cost a filter more; at two cycles every loss is printed.
//!
//! The image must accept such rates (feature `rate-sweep`): `cargo xtask pace` builds it and runs this. Cost: some
//! minutes of one core.

#[path = "../tests/flashed/compared/mod.rs"]
mod compared;
#[path = "../tests/flashed/image.rs"]
mod image;

use compared::TICKS_PER_SECOND;
use compared::load::{Outcome, SPEEDS_HZ, configured_for, run};
use meshband::config::{CaptureConfig, CaptureRate, Configuration, SecondSensor};
use meshband::units::Hertz;
use meshband_emulator::elf::Image;
use std::process::ExitCode;

/// Cycles per instruction.
const CYCLES: [f64; 7] = [1.0, 1.25, 1.5, 1.75, 2.0, 2.25, 2.5];
/// Sample periods tried, ticks of 84 MHz: multiples of the converter's four, from the shortest that it follows.
const PERIODS: [u32; 18] = [112, 124, 136, 148, 160, 172, 184, 192, 200, 208, 216, 224, 240, 260, 284, 312, 344, 380];
/// Waveforms tried.
const WAVEFORMS: [(&str, CaptureConfig); 3] = [
    ("10 kHz", CaptureConfig { keep: CaptureRate::Fixed, rate: Hertz(0.0) }),
    ("20 kHz", CaptureConfig { keep: CaptureRate::Fixed, rate: Hertz(20_000.0) }),
    ("at the law's rate", CaptureConfig { keep: CaptureRate::Law, rate: Hertz(0.0) }),
];
/// Converter rates that they are tried with, and cycles per instruction.
const WITH_WAVEFORMS_HZ: [f64; 3] = [210_000.0, 300_000.0, 420_000.0];
const WITH_WAVEFORMS_CYCLES: f64 = 2.0;
/// Converter rates tried with two sensors.
const TWO_SENSOR_RATES_HZ: [f64; 3] = [150_000.0, 180_000.0, 209_000.0];
/// Rates that must hold in a row.
const MIN_HELD_RATES: usize = 3;

fn main() -> ExitCode {
    let Some(image) = std::env::args_os().nth(1).and_then(|path| image::with_loader(path.as_ref()).ok()) else {
        eprintln!("usage: pace IMAGE, the ELF file of the STM32F405 with the feature rate-sweep, its loader beside it");
        return ExitCode::from(2);
    };
    let [a, b, c] = SPEEDS_HZ;
    println!(
        "| cycles per instruction | keeps up with, kHz | load at {a:.0}, {b:.0}, {c:.0} turns/s | next rate tried, \
         kHz | blocks lost there |"
    );
    println!("| --- | --- | --- | --- | --- |");
    for cycles in CYCLES {
        println!("{}", row(&image, cycles));
    }
    println!("\n| waveforms | converter, kHz | blocks lost in 4 s at {a:.0}, {b:.0}, {c:.0} turns/s | load there |");
    println!("| --- | --- | --- | --- |");
    for (name, capture) in WAVEFORMS {
        for rate_hz in WITH_WAVEFORMS_HZ {
            println!("{}", row_with_waveforms(&image, name, capture, rate_hz));
        }
    }
    println!(
        "\n| sensors | converter, kHz | blocks lost in 4 s at {a:.0}, {b:.0}, {c:.0} turns/s | load there | buffers \
         free at worst there |"
    );
    println!("| --- | --- | --- | --- | --- |");
    for (sensors, rates_hz) in [(1, WITH_WAVEFORMS_HZ), (2, TWO_SENSOR_RATES_HZ)] {
        for rate_hz in rates_hz {
            println!("{}", row_of_sensors(&image, sensors, rate_hz));
        }
    }
    ExitCode::SUCCESS
}

fn row_of_sensors(image: &Image, sensors: usize, rate_hz: f64) -> String {
    let second = (sensors == 2).then(SecondSensor::default);
    let config = Configuration { second, ..configured_for(rate_hz) };
    let outcomes = SPEEDS_HZ.map(|speed_hz| run(image, &config, WITH_WAVEFORMS_CYCLES, speed_hz));
    let lost = outcomes.map(|outcome| outcome.lost.to_string()).join(", ");
    let loads = outcomes.map(|outcome| format!("{:.0} %", 100.0 * outcome.load)).join(", ");
    let free = outcomes.map(|outcome| format!("{:.0} %", 100.0 * outcome.buffers_free())).join(", ");
    format!("| {sensors} | {:.0} | {lost} | {loads} | {free} |", outcomes[0].rate_hz / 1e3)
}

fn row_with_waveforms(image: &Image, name: &str, capture: CaptureConfig, rate_hz: f64) -> String {
    let config = Configuration { capture, ..configured_for(rate_hz) };
    let outcomes = SPEEDS_HZ.map(|speed_hz| run(image, &config, WITH_WAVEFORMS_CYCLES, speed_hz));
    let lost = outcomes.map(|outcome| outcome.lost.to_string()).join(", ");
    let loads = outcomes.map(|outcome| format!("{:.0} %", 100.0 * outcome.load)).join(", ");
    format!("| {name} | {:.0} | {lost} | {loads} |", outcomes[0].rate_hz / 1e3)
}

fn row(image: &Image, cycles: f64) -> String {
    let mut fails = String::from("the converter's limit | ");
    let mut held: Vec<(f64, Vec<Outcome>)> = Vec::new();
    for period in PERIODS {
        let rate_hz = TICKS_PER_SECOND / f64::from(period);
        let outcomes = at_all_speeds(image, rate_hz, cycles);
        match outcomes.iter().find(|outcome| outcome.lost > 0) {
            Some(outcome) => {
                held.clear();
                fails = format!("{:.1} | {} at {:.0} turns/s", rate_hz / 1e3, outcome.lost, outcome.speed_hz);
            }
            None => held.push((rate_hz, outcomes)),
        }
        if held.len() == MIN_HELD_RATES {
            break;
        }
    }
    let Some((rate_hz, outcomes)) = held.first() else { return format!("| {cycles:.2} | none | | {fails} |") };
    let loads: Vec<String> = outcomes.iter().rev().map(|outcome| format!("{:.0} %", 100.0 * outcome.load)).collect();
    format!("| {cycles:.2} | {:.1} | {} | {fails} |", rate_hz / 1e3, loads.join(", "))
}

/// Fastest speed first; ends with the first at which a block is lost.
fn at_all_speeds(image: &Image, rate_hz: f64, cycles: f64) -> Vec<Outcome> {
    let mut outcomes = Vec::new();
    for speed_hz in SPEEDS_HZ.into_iter().rev() {
        let outcome = run(image, &configured_for(rate_hz), cycles, speed_hz);
        // A configuration that the image refuses would be measured at the default's rate.
        assert!((outcome.rate_hz / rate_hz - 1.0).abs() < 0.01, "{outcome:?} at {rate_hz} Hz");
        outcomes.push(outcome);
        if outcome.lost > 0 {
            break;
        }
    }
    outcomes
}
