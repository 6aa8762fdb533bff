//! A day of many nodes, faster than real time: how large the history becomes, and how fast it is written and asked.
//!
//! Status and indicators of each node at a fixed interval, made up but of plausible size and scatter (seeded), as
//! entries with real frames through the same rows and files as live ones. What is left out is the journal and the
//! ports. One machine in fifty drifts, so that queries have something to find.

use crate::error::{Error, Result};
use crate::history::files::Format;
use crate::history::rows::Rows;
use crate::history::store::Store;
use crate::history::{compact, day, files};
use crate::journal::entry::{Body, Entry};
use crate::stop::Stop;
use clap::Args;
use meshband::frame::{MAX_FRAME, encode};
use meshband::message::{AlarmState, Bound, GearIndicators, Indicators, Message, Quality, SensorStatus, Status, Tag};
use meshband::node::State;
use meshband::shaft_lines::{OrderLine, ShaftOrders};
use meshband::tach::Validity;
use meshband::waveform::CapturePhase;
use std::path::PathBuf;
use std::time::Instant;

/// Ticks per second of the made-up nodes.
const CLOCK: u64 = 84_000_000;
/// Files per machine and day before they are merged: one is what a batch holds in memory.
const SLICES: u64 = 12;

/// What to make.
#[derive(Args)]
pub struct SynthesiseArgs {
    /// Root folder of the history; must be empty or absent
    folder: PathBuf,
    /// Nodes
    #[arg(long, default_value_t = 1000)]
    nodes: u32,
    /// Nodes per machine
    #[arg(long, default_value_t = 10)]
    per_machine: u32,
    /// Days
    #[arg(long, default_value_t = 1)]
    days: u64,
    /// Seconds between the values of a node
    #[arg(long, default_value_t = 10)]
    interval: u64,
    /// First instant, seconds since 1970
    #[arg(long, default_value_t = 1_767_225_600)]
    from: u64,
    /// Seed
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

/// Writes the days and prints rows, bytes and times.
///
/// # Errors
/// For a folder in use, nonsense, and of the file system.
pub fn run(args: &SynthesiseArgs, stop: &Stop) -> Result {
    if args.folder.read_dir().is_ok_and(|mut items| items.next().is_some()) {
        return Err(Error::new(args.folder.display(), "is not empty"));
    }
    if args.nodes == 0 || args.per_machine == 0 || args.interval == 0 || args.days == 0 {
        return Err(Error::new("synthesise", "nodes, machines, days and interval must be 1 or more"));
    }
    let start = Instant::now();
    let machines = args.nodes.div_ceil(args.per_machine);
    let (mut number, mut rows) = (0, 0);
    for slice in 0..args.days * SLICES {
        for machine in 0..machines {
            if stop.asked() {
                return Err(Error::new("synthesise", "interrupted; the folder holds whole files only"));
            }
            let count = write_slice(args, machine, slice, &mut number)?;
            rows += count;
        }
    }
    let written = start.elapsed();
    let (store, format) = (Store::open(&args.folder)?, Format::history()?);
    let partitions = files::partitions(store.root())?;
    for partition in &partitions {
        compact::compact(&store, partition, 2, &format)?;
    }
    let bytes: u64 =
        partitions.iter().filter_map(|partition| files::parts(partition).ok()).flatten().map(|part| size(&part)).sum();
    let node_days = u64::from(args.nodes) * args.days;
    println!(
        "{} nodes, {} days, values every {} s (seed {}): {rows} rows in {} partitions, {:.1} MB, {:.1} kB per node \
         and day, {:.1} bytes per row",
        args.nodes,
        args.days,
        args.interval,
        args.seed,
        partitions.len(),
        bytes as f64 / 1e6,
        bytes as f64 / 1e3 / node_days as f64,
        bytes as f64 / rows as f64
    );
    println!(
        "written in {:.1} s ({:.0} rows/s), merged in {:.1} s more",
        written.as_secs_f64(),
        rows as f64 / written.as_secs_f64(),
        (start.elapsed() - written).as_secs_f64()
    );
    Ok(())
}

fn size(part: &files::Part) -> u64 {
    std::fs::metadata(&part.path).map_or(0, |data| data.len())
}

/// One machine's part of a day.
fn write_slice(args: &SynthesiseArgs, machine: u32, slice: u64, number: &mut u64) -> Result<u64> {
    let length = 86_400 / SLICES;
    let name = format!("machine-{machine:04}");
    let (mut rows, first) = (Rows::default(), *number);
    let begin = slice * length;
    for second in (begin.next_multiple_of(args.interval)..begin + length).step_by(args.interval as usize) {
        for node in (machine * args.per_machine)..((machine + 1) * args.per_machine).min(args.nodes) {
            for (kind, message) in values(args.seed, machine, node, second).into_iter().enumerate() {
                let time_us = (args.from + second) as i64 * 1_000_000 + i64::from(node % 1000) * 100;
                let sequence = (second / args.interval * 2) as u16 + kind as u16;
                rows.push(*number, &entry(&name, node, time_us, sequence, &message)?);
                *number += 1;
            }
        }
    }
    let count = *number - first;
    if count > 0 {
        let day = day::of((args.from + begin) as i64 * 1_000_000);
        let partition = args.folder.join(format!("machine={name}")).join(format!("day={day}"));
        files::write(&partition, (first, *number - 1), &Format::history()?, [rows.finish()])?;
    }
    Ok(count)
}

fn entry(machine: &str, node: u32, time_us: i64, sequence: u16, message: &Message) -> Result<Entry> {
    let mut buffer = [0; MAX_FRAME];
    let frame = encode(message, sequence, &mut buffer).map_err(|reason| Error::new("frame", format!("{reason:?}")))?;
    let body = Body::Frame(frame[1..frame.len() - 1].to_vec());
    let (node, machine) = (format!("node-{node:05}"), machine.to_owned());
    Ok(Entry { node, machine, unit: [1, 2, 3], boot: 1, received_us: time_us + 2000, time_us, body })
}

/// Status and indicators of a node at a second.
fn values(seed: u64, machine: u32, node: u32, second: u64) -> [Message; 2] {
    let scatter = |salt: u64| unit_scatter(seed ^ (u64::from(node) << 40) ^ (second << 8) ^ salt);
    // Eight hours at each of three speeds; the load follows.
    let speed = [8.0, 12.0, 16.0][(second / 28_800 % 3) as usize] * (1.0 + 0.002 * scatter(1));
    let drift = if machine % 50 == 7 { 1.0 + 0.3 * second as f32 / 86_400.0 } else { 1.0 };
    let rms = (0.5 + 0.1 * speed) * (1.0 + 0.05 * scatter(2)) * drift;
    let tick = second * CLOCK;
    let tag = Tag {
        first_tick: tick,
        speed_hz: speed,
        speed_uncertainty: 1e-4,
        validity: Validity::Locked,
        period_ticks: 420,
        stages: 3,
        rate_hz: 25_000.0,
        resolution_hz: 0.5,
        aliasing: false,
    };
    let gear = GearIndicators {
        tick,
        speed_hz: speed,
        turns: 48,
        rms: 0.8 * rms,
        crest: 3.0 + 0.3 * scatter(3),
        kurtosis: 2.8 + 0.2 * scatter(4),
        regular_rms: 0.7 * rms,
        residual_rms: 0.1 * rms,
        difference_rms: 0.09 * rms,
        fm0: 4.0 + 0.2 * scatter(5),
        fm4: 3.0 + 0.15 * scatter(6),
        m6a: 15.0 + 2.0 * scatter(7),
        na4: 1.0 + 0.1 * scatter(8),
        ..GearIndicators::default()
    };
    let kurtosis = 3.0 + 0.1 * scatter(9);
    let peak = 4.0 * rms * (1.0 + 0.1 * scatter(10));
    let indicators = Indicators {
        tag,
        rms,
        peak,
        crest: peak / rms,
        kurtosis,
        sideband_energy_ratio: 0.2,
        gear: Some(gear),
        bandwidth: None,
        quality: Quality { turns: 48, duration_s: 48.0 / speed, ..Quality::default() },
        velocity_rms: rms / (core::f32::consts::TAU * 20.0 * speed),
        velocity_band_hz: [10.0, 1000.0],
        pinion: orders(48, 0.02 * rms, scatter),
        wheel: orders(24, 0.015 * rms, |salt| scatter(salt + 6)),
        ..Indicators::default()
    };
    [Message::Status(status(tick, speed)), Message::Indicators(indicators)]
}

/// Orders of a shaft that fall off with their number.
fn orders(turns: u16, first: f32, scatter: impl Fn(u64) -> f32) -> Option<ShaftOrders> {
    let line = |order: u64| OrderLine {
        amplitude: first / (order + 1) as f32 * (1.0 + 0.1 * scatter(11 + order)),
        phase_deg: 180.0 * scatter(14 + order),
    };
    Some(ShaftOrders { lines: [line(0), line(1), line(2)], turns })
}

/// A plausible status of a measuring node.
pub fn status(tick: u64, speed_hz: f32) -> Status {
    Status {
        state: State::Measuring,
        validity: Validity::Locked,
        tick,
        speed_hz,
        speed_uncertainty: 1e-4,
        age_s: 0.05,
        bandwidth_hz: 700.0 * speed_hz,
        law_clamped: false,
        law_provisional: false,
        requested_hz: 1800.0 * speed_hz,
        granted_hz: 1810.0 * speed_hz,
        adc_hz: 200_000.0,
        period_ticks: 420,
        stages: 3,
        residual_ppm: 5000.0,
        limited: false,
        safe_rate: false,
        block: (tick / 1_000_000) as u32,
        available_hz: 650.0 * speed_hz,
        bound: Bound::AnalogueFilter,
        alarms: AlarmState::default(),
        capture: CapturePhase::default(),
        alerts: 0,
        sensor: SensorStatus::default(),
    }
}

/// A number between -1 and 1 that depends on nothing but its key (SplitMix64).
fn unit_scatter(key: u64) -> f32 {
    let mut z = key.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^= z >> 31;
    (z >> 40) as f32 / (1u64 << 23) as f32 - 1.0
}
