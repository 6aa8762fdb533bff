//! Days of many nodes, faster than real time: how large the history becomes, and how fast it is written and asked.
//!
//! Messages of each node at a fixed interval, made up (seeded), as entries with real frames through the same rows and
//! files as live ones. Journal and ports are left out. With `--rollup` each day is rolled up and thinned when it is
//! over, as a gateway does, and what the rollups say is compared with [what was made up](truth). A year of 100 nodes
//! with values every 60 s is 105 million rows; the size of rollups does not depend on the interval where every minute
//! has values.

mod made_up;
mod truth;

use crate::config::Rollup;
use crate::error::{Error, Result};
use crate::history::buckets::Level;
use crate::history::files::{Format, partition, partitions};
use crate::history::rollup::Keeper;
use crate::history::rows::Rows;
use crate::history::store::Store;
use crate::history::{compact, day, files, levels};
use crate::journal::entry::{Body, Entry};
use crate::stop::Stop;
use clap::Args;
#[cfg(test)]
pub use made_up::status;
use made_up::{Plan, messages};
use meshband::frame::{MAX_FRAME, encode};
use meshband::message::Message;
use std::path::{Path, PathBuf};
use std::time::Instant;
use truth::Truth;

/// Rows of a file before it is merged into its day's: what is in memory.
const SLICE_ROWS: u64 = 40_000;
/// Seconds of a day.
const DAY_S: u64 = 86_400;
/// A day is rolled up so long behind its end, s.
const BEHIND_S: u64 = 3600;

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
    /// Spectrum and strongest lines as well, as a live node sends them
    #[arg(long)]
    spectra: bool,
    /// Folder of rollups: every day is rolled up and thinned when it is over, and compared with what was made up
    #[arg(long)]
    rollup: Option<PathBuf>,
    /// Days that raw rows stay; without it, for ever
    #[arg(long, requires = "rollup")]
    raw_days: Option<u32>,
    /// Days that buckets of a minute stay; without it, for ever
    #[arg(long, requires = "rollup")]
    minute_days: Option<u32>,
    /// Raw rows so near an alarm stay for ever, s
    #[arg(long, requires = "rollup", default_value_t = 600)]
    alarm_seconds: u32,
}

/// Rows, bytes and times so far.
#[derive(Default)]
struct Sums {
    number: u64,
    /// Bytes of raw days, merged and before they were thinned.
    raw_bytes: u64,
    write_s: f64,
    merge_s: f64,
    rollup_s: f64,
}

/// Writes the days and prints rows, bytes and times.
///
/// # Errors
/// For a folder in use, nonsense, rollups that differ from what was made up, and of the file system.
pub fn run(args: &SynthesiseArgs, stop: &Stop) -> Result {
    for folder in [Some(&args.folder), args.rollup.as_ref()].into_iter().flatten() {
        if folder.read_dir().is_ok_and(|mut items| items.next().is_some()) {
            return Err(Error::new(folder.display(), "is not empty; name a new folder"));
        }
    }
    if args.nodes == 0 || args.per_machine == 0 || args.interval == 0 || args.days == 0 {
        return Err(Error::new("synthesise", "nodes, machines, days and interval must be 1 or more"));
    }
    if !args.from.is_multiple_of(DAY_S) {
        return Err(Error::new("synthesise", "--from must be a midnight, UTC: a multiple of 86400"));
    }
    let (store, format) = (Store::open(&args.folder)?, Format::history()?);
    let rule = Rollup {
        folder: None,
        raw_days: args.raw_days,
        minute_days: args.minute_days,
        alarm_seconds: args.alarm_seconds,
    };
    let mut rollup = match &args.rollup {
        Some(folder) => Some((Keeper::open(folder, &rule)?, Truth::default())),
        None => None,
    };
    let mut sums = Sums::default();
    for day in 0..args.days {
        let mut timed = Instant::now();
        write_day(args, &store, &format, day, &mut sums, rollup.as_mut().map(|(_, truth)| truth), stop)?;
        sums.write_s += lap(&mut timed);
        sums.raw_bytes += merge_day(args, &store, &format, day)?;
        sums.merge_s += lap(&mut timed);
        if let Some((keeper, _)) = &mut rollup {
            let now = args.from + (day + 1) * DAY_S + BEHIND_S;
            keeper.pass(&store, now as i64 * 1_000_000, || true)?;
            sums.rollup_s += lap(&mut timed);
        }
    }
    report(args, &sums)?;
    match (&args.rollup, rollup) {
        (Some(folder), Some((keeper, truth))) => {
            drop(keeper);
            report_rollup(args, folder, &truth, &sums)
        }
        _ => Ok(()),
    }
}

/// Seconds since the last look.
fn lap(since: &mut Instant) -> f64 {
    std::mem::replace(since, Instant::now()).elapsed().as_secs_f64()
}

fn report(args: &SynthesiseArgs, sums: &Sums) -> Result {
    let node_days = u64::from(args.nodes) * args.days;
    println!(
        "{} nodes, {} days, values every {} s (seed {}): {} rows, {:.1} MB, {:.1} kB per node and day, {:.1} bytes per \
         row",
        args.nodes,
        args.days,
        args.interval,
        args.seed,
        sums.number,
        sums.raw_bytes as f64 / 1e6,
        sums.raw_bytes as f64 / 1e3 / node_days as f64,
        sums.raw_bytes as f64 / sums.number as f64
    );
    println!(
        "written in {:.1} s ({:.0} rows/s), merged in {:.1} s more",
        sums.write_s,
        sums.number as f64 / sums.write_s,
        sums.merge_s
    );
    Ok(())
}

/// Sizes of what is left, and whether the rollups say what was made up.
fn report_rollup(args: &SynthesiseArgs, folder: &Path, truth: &Truth, sums: &Sums) -> Result {
    let node_days = (u64::from(args.nodes) * args.days) as f64;
    let raw = bytes(&args.folder)?;
    println!("rolled up and thinned in {:.1} s", sums.rollup_s);
    println!(
        "| what | MB | kB per node and day of all days | ranges compared | differ |\n| --- | --- | --- | --- | --- |"
    );
    let line = |what: &str, bytes: u64, compared: &str| {
        println!("| {what} | {:.1} | {:.2} | {compared} |", bytes as f64 / 1e6, bytes as f64 / 1e3 / node_days);
    };
    line("raw rows that stay", raw, " | ");
    let (mut all, mut differ) = (raw, 0);
    for level in Level::ALL {
        let (size, compared) = (bytes(&levels::root(folder, level))?, truth.compare(folder, level)?);
        line(level.name(), size, &format!("{} | {}", compared.ranges, compared.differ));
        all += size;
        differ += compared.differ;
    }
    line("all", all, " | ");
    println!("all of raw rows as written: {:.2} %", 100.0 * all as f64 / sums.raw_bytes as f64);
    if differ > 0 {
        return Err(Error::new(folder.display(), format!("{differ} ranges differ from what was made up: a defect")));
    }
    Ok(())
}

/// Bytes of all files below a root of partitions.
fn bytes(root: &Path) -> Result<u64> {
    let mut sum = 0;
    for partition in partitions(root)? {
        sum += files::parts(&partition)?.iter().map(size).sum::<u64>();
    }
    Ok(sum)
}

fn size(part: &files::Part) -> u64 {
    std::fs::metadata(&part.path).map_or(0, |data| data.len())
}

fn machines(args: &SynthesiseArgs) -> u32 {
    args.nodes.div_ceil(args.per_machine)
}

fn machine_name(machine: u32) -> String {
    format!("machine-{machine:04}")
}

fn node_name(node: u32) -> String {
    format!("node-{node:05}")
}

fn day_name(args: &SynthesiseArgs, second: u64) -> String {
    day::of((args.from + second) as i64 * 1_000_000)
}

fn write_day(
    args: &SynthesiseArgs,
    store: &Store,
    format: &Format,
    day: u64,
    sums: &mut Sums,
    mut truth: Option<&mut Truth>,
    stop: &Stop,
) -> Result {
    let kinds = if args.spectra { 4 } else { 2 };
    let rows = u64::from(args.per_machine.min(args.nodes)) * kinds * DAY_S / args.interval;
    let slices = rows.div_ceil(SLICE_ROWS).max(1);
    let border = |slice: u64| day * DAY_S + (DAY_S * slice / slices).next_multiple_of(args.interval).min(DAY_S);
    for slice in 0..slices {
        for machine in 0..machines(args) {
            if stop.asked() {
                return Err(Error::new("synthesise", "interrupted; the folder holds whole files only"));
            }
            let seconds = border(slice)..border(slice + 1);
            write_slice(args, (store, format), machine, seconds, &mut sums.number, truth.as_deref_mut())?;
        }
    }
    Ok(())
}

/// One machine's part of a day.
fn write_slice(
    args: &SynthesiseArgs,
    (store, format): (&Store, &Format),
    machine: u32,
    seconds: std::ops::Range<u64>,
    number: &mut u64,
    mut truth: Option<&mut Truth>,
) -> Result {
    let (name, day) = (machine_name(machine), day_name(args, seconds.start));
    let plan = Plan { seed: args.seed, seconds: args.days * DAY_S, interval: args.interval, spectra: args.spectra };
    let (mut rows, first) = (Rows::default(), *number);
    for second in seconds.step_by(args.interval as usize) {
        for node in (machine * args.per_machine)..((machine + 1) * args.per_machine).min(args.nodes) {
            let time_us = (args.from + second) as i64 * 1_000_000 + i64::from(node % 1000) * 100;
            for (kind, message) in messages(&plan, machine, node, second).into_iter().enumerate() {
                let sequence = (second / args.interval * 4) as u16 + kind as u16;
                rows.push(*number, &entry(&name, node, time_us, sequence, &message)?);
                *number += 1;
                if let Some(truth) = &mut truth {
                    truth.take(node, time_us, &message);
                }
            }
        }
    }
    if *number > first {
        let partition = partition(store.root(), &name, &day);
        files::write(&partition, (first, *number - 1), format, [rows.finish()])?;
    }
    Ok(())
}

/// Merges a day's files; gives their bytes then.
fn merge_day(args: &SynthesiseArgs, store: &Store, format: &Format, day: u64) -> Result<u64> {
    let mut bytes = 0;
    for machine in 0..machines(args) {
        let partition = partition(store.root(), &machine_name(machine), &day_name(args, day * DAY_S));
        compact::compact(store, &partition, 2, format)?;
        bytes += files::parts(&partition)?.iter().map(size).sum::<u64>();
    }
    Ok(bytes)
}

fn entry(machine: &str, node: u32, time_us: i64, sequence: u16, message: &Message) -> Result<Entry> {
    let mut buffer = [0; MAX_FRAME];
    let frame = encode(message, sequence, &mut buffer).map_err(|reason| Error::new("frame", format!("{reason:?}")))?;
    let body = Body::Frame(frame[1..frame.len() - 1].to_vec());
    let (node, machine) = (node_name(node), machine.to_owned());
    Ok(Entry { node, machine, unit: [1, 2, 3], boot: 1, received_us: time_us + 2000, time_us, body })
}
