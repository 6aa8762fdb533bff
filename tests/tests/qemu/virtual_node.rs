//! The firmware in QEMU and the same code on the host send the same frames from the same record.

use meshband::config::{Configuration, GearPair};
use meshband::events::EventKind;
use meshband::frame::Packet;
use meshband::message::{Message, Reply};
use meshband::replay::Header;
use meshband_host::virtual_node::frames::Received;
use meshband_host::virtual_node::image::{Image, Source};
use meshband_host::virtual_node::qemu::{Finished, Qemu};
use meshband_host::virtual_node::simulation;
use meshband_tests::qemu_node::machine;
use std::f64::consts::TAU;

const RATE_HZ: f64 = 100_000.0;

/// Mesh harmonics with a shaft sideband at a shaft rate that changes linearly; one pulse per turn.
fn gear_signal(seconds: f64, from_hz: f64, to_hz: f64, teeth: u16) -> (Vec<f64>, Vec<f64>) {
    let turns = |t: f64| from_hz * t + (to_hz - from_hz) * t * t / (2.0 * seconds);
    let samples = (0..(seconds * RATE_HZ) as usize)
        .map(|n| {
            let turn = turns(n as f64 / RATE_HZ);
            let mesh = TAU * turn * f64::from(teeth);
            let modulation = 1.0 + 0.2 * (TAU * turn).cos();
            (1..=5).map(|h| modulation * 10.0 / f64::from(h) * (f64::from(h) * mesh).cos()).sum()
        })
        .collect();
    let edges = (1..).map(f64::from).map(|turn| time_of(turn, seconds, from_hz, to_hz)).take_while(|t| *t < seconds);
    (samples, edges.collect())
}

/// Instant at which the shaft has made `turn` turns.
fn time_of(turn: f64, seconds: f64, from_hz: f64, to_hz: f64) -> f64 {
    let a = (to_hz - from_hz) / (2.0 * seconds);
    if a == 0.0 { turn / from_hz } else { ((from_hz * from_hz + 4.0 * a * turn).sqrt() - from_hz) / (2.0 * a) }
}

fn image(seconds: f64, from_hz: f64, to_hz: f64) -> Image {
    let (samples, edges) = gear_signal(seconds, from_hz, to_hz, 20);
    let config = Configuration { gears: GearPair { pinion_teeth: 20, gear_teeth: 30 }, ..Configuration::default() };
    let source = Source { samples: &samples, rate_hz: RATE_HZ, edges_s: &edges };
    Image::new(source, &config, |header: Header| header).expect("a sound signal")
}

fn assert_same(run: &Finished, image: &Image) {
    let simulated = simulation::run(&image.bytes).expect("the host runs it");
    assert_eq!(run.blocks().expect("a whole log"), simulated.blocks, "{}", run.console);
    assert_eq!((run.statistic("lost"), run.statistic("missed")), (Some("0"), Some("0")), "{}", run.console);
    assert_eq!(run.statistic("codes_crc"), Some(format!("{:08x}", simulated.codes_crc).as_str()), "{}", run.console);
    assert!(run.link == simulated.link, "frames differ: {} and {} bytes", run.link.len(), simulated.link.len());
}

#[test]
fn golden_firmware_in_qemu_and_host_send_the_same_frames_at_steady_speed() {
    let Some(machine) = machine("steady speed") else { return };
    let image = image(2.5, 15.0, 15.0);
    let run = machine.run(&image.bytes).expect("runs to its end");
    assert_same(&run, &image);
    let received = Received::decode(&run.link);
    assert_eq!((received.refused, received.lost), (0, 0));
    let statistics = received.statistics().expect("closing statistics");
    assert_eq!(statistics.blocks_lost, 0);
    let spectrum = received.spectra().last().expect("at least one spectrum");
    for (h, band) in (1..).zip(&spectrum.bands) {
        let relative = f64::from(band.line.frequency_hz) / (300.0 * f64::from(h)) - 1.0;
        assert!(relative.abs() < 5e-4, "harmonic {h}: {} Hz", band.line.frequency_hz);
        let decibels = 20.0 * (f64::from(band.line.amplitude) / (10.0 / f64::from(h))).log10();
        assert!(decibels.abs() < 0.5, "harmonic {h}: {decibels} dB");
    }
    assert_eq!(spectrum.bands.len(), 5);
}

#[test]
fn golden_firmware_in_qemu_and_host_send_the_same_frames_in_a_run_up() {
    let Some(machine) = machine("run-up") else { return };
    let image = image(4.0, 3.0, 25.0);
    let run = machine.run(&image.bytes).expect("runs to its end");
    assert_same(&run, &image);
    let again = machine.run(&image.bytes).expect("runs to its end");
    assert!(run.link == again.link, "two runs differ");
}

/// All packets but what the self-test says: it counts samples against a clock that it reads when blocks arrive, and
/// here they arrive late.
fn without_self_test(link: &[u8]) -> Vec<Packet> {
    let said_by_it = |packet: &Packet| match packet {
        Packet::Message(Message::Event(event)) => event.kind == EventKind::SelfTestFailed,
        other => matches!(other, Packet::Message(Message::SelfTest(_))),
    };
    let mut packets = Received::decode(link).packets;
    packets.retain(|packet| !said_by_it(packet));
    for packet in &mut packets {
        if let Packet::Reply(Reply::Statistics(statistics)) = packet {
            statistics.events.retain(|count| count.kind != EventKind::SelfTestFailed as u8);
        }
    }
    packets
}

#[test]
fn golden_a_late_processor_sends_what_the_host_computes_from_the_same_blocks() {
    let Some(machine) = machine("late processor") else { return };
    let image = image(4.0, 3.0, 25.0);
    let planned = simulation::run(&image.bytes).expect("the host runs it");
    let (mut late, mut lossy) = (0, 0);
    for icount_shift in [4, 5] {
        let run = Qemu { icount_shift, ..machine.clone() }.run(&image.bytes).expect("runs to its end");
        let blocks = run.blocks().expect("a whole log");
        let lost = run.count("lost") + run.count("missed");
        println!(
            "{} MIPS: {} blocks, {lost} lost, as planned: {}",
            1000 >> icount_shift,
            blocks.len(),
            blocks == planned.blocks
        );
        late += u32::from(blocks != planned.blocks);
        lossy += u32::from(lost > 0);
        assert_eq!(run.count("edges_lost"), 0, "{}", run.console);
        let followed = simulation::follow(&image.bytes, &blocks).expect("the host follows it");
        assert_eq!(run.statistic("codes_crc"), Some(format!("{:08x}", followed.codes_crc).as_str()), "{}", run.console);
        assert!(
            without_self_test(&run.link) == without_self_test(&followed.link),
            "frames differ at shift {icount_shift}"
        );
    }
    assert!(late > 0 && lossy > 0, "no pace was too slow: nothing is proven");
}
