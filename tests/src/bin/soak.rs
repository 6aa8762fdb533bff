//! A node for a long time, with everything that may befall it, at random; prints a page in Markdown. Exit code 1 where
//! something did not hold, with one line.
//!
//! Virtual time: the plant hands blocks and edges over as fast as the host computes them, so a day takes minutes to
//! an hour. `--hours H` (24), `--seed S` (1).

use meshband::message::{Request, Statistics};
use meshband_tests::plant::{CLOCK_HZ, Fault, Plant, configuration};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::time::Instant;

/// Samples of a whole block of the plant.
const BLOCK: u64 = 512;
/// Relative error of the speed that a quiet run may show.
const SPEED_ERROR: f64 = 2e-3;

/// How far the age of the last status may vary, s; a drift of 25 ppm would pass it within a day.
const DRIFT_S: f64 = 2.0;

/// What was seen.
#[derive(Default)]
struct Seen {
    parts: u32,
    frames: u64,
    quiet: u32,
    worst_speed: f64,
    /// Least and most that the last status of a quiet part was behind.
    lag_s: Option<[f64; 2]>,
    /// Resident memory after the first tenth and the most since then, kB.
    memory: [u64; 2],
}

fn main() {
    let (mut hours, mut seed) = (24.0_f64, 1_u64);
    let words: Vec<String> = std::env::args().skip(1).collect();
    for pair in words.chunks(2) {
        let parsed = match pair {
            [name, value] if name == "--hours" => value.parse().map(|h| hours = h).is_ok(),
            [name, value] if name == "--seed" => value.parse().map(|s| seed = s).is_ok(),
            _ => false,
        };
        if !(parsed && hours > 0.0) {
            eprintln!("soak: --hours H and --seed S are taken, not {}", pair.join(" "));
            std::process::exit(2);
        }
    }
    let start = Instant::now();
    match soak(hours, seed) {
        Ok((plant, seen)) => print!("{}", page(&plant, &seen, hours, seed, start.elapsed().as_secs_f64())),
        Err(what) => {
            eprintln!("soak: {what}");
            std::process::exit(1);
        }
    }
}

fn soak(hours: f64, seed: u64) -> Result<(Plant, Seen), String> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut plant = Plant::new(configuration(), seed);
    let mut seen = Seen::default();
    let mut before = plant.session.node().statistics();
    let mut speed_hz = 5.0;
    while plant.seconds() < 3600.0 * hours {
        let length_s = random.random_range(5.0..40.0);
        let next_hz = if random.random_bool(0.1) { 0.0 } else { random.random_range(1.0..25.0) };
        let fault = fault(&mut random);
        let from_hz = speed_hz;
        // A ramp, then the new speed: the tracker follows, and has the time to settle.
        let ramp_s = 0.3 * length_s;
        plant.run(length_s, |t| from_hz + (next_hz - from_hz) * (t / ramp_s).min(1.0), fault);
        speed_hz = next_hz;
        if random.random_bool(0.2) {
            let requests =
                [Request::Identify, Request::Statistics, Request::Snapshot, Request::Events, Request::SelfTest];
            plant.request(&requests[random.random_range(0..requests.len())]);
        }
        let now = plant.session.node().statistics();
        consistent(&plant, &before, &now).map_err(|what| format!("after {:.0} s: {what}", plant.seconds()))?;
        if matches!(fault, Fault::None) && next_hz > 0.0 {
            let at = plant.seconds();
            let said = speed_error_and_lag(&plant, next_hz);
            let (error, lag_s) = said.ok_or_else(|| format!("after {at:.0} s: no status in a quiet part"))?;
            seen.quiet += 1;
            seen.worst_speed = seen.worst_speed.max(error);
            let [least, most] = seen.lag_s.get_or_insert([lag_s; 2]);
            (*least, *most) = (least.min(lag_s), most.max(lag_s));
            if *most - *least > DRIFT_S {
                return Err(format!("after {at:.0} s: the node's clock lags by {least:.2} to {most:.2} s"));
            }
            if error > SPEED_ERROR {
                return Err(format!("after {at:.0} s: the speed is off by {error:.1e} in a quiet part"));
            }
        }
        seen.parts += 1;
        seen.frames += plant.frames.len() as u64;
        plant.frames.clear();
        let memory = resident_kb();
        let place = if plant.seconds() < 360.0 * hours { &mut seen.memory[0] } else { &mut seen.memory[1] };
        *place = (*place).max(memory);
        before = now;
    }
    Ok((plant, seen))
}

fn fault(random: &mut ChaCha8Rng) -> Fault {
    match random.random_range(0..12) {
        0 => Fault::Pulses(random.random_range(0.5..20.0)),
        1 => Fault::NoPulses,
        2 => Fault::Codes(|_, _| 0xffff),
        3 => Fault::Codes(|code, random| if random.random_bool(0.001) { 0 } else { code }),
        4 => Fault::Overrun,
        5 => Fault::LostBlocks,
        6 => Fault::Stall,
        7 => Fault::RandomBytes(random.random_range(10.0..2000.0)),
        _ => Fault::None,
    }
}

/// Every block is counted once, as processed or as lost, and every counter only grows.
fn consistent(plant: &Plant, before: &Statistics, now: &Statistics) -> Result<(), String> {
    let made = plant.blocks();
    let counted = u64::from(now.blocks) + u64::from(now.blocks_lost);
    // A block that is lost last is only known of with the next one.
    if !(counted == made || counted + 1 == made) {
        return Err(format!("{made} blocks were made, {} processed and {} lost", now.blocks, now.blocks_lost));
    }
    if now.samples != BLOCK * u64::from(now.blocks) {
        return Err(format!("{} samples in {} blocks", now.samples, now.blocks));
    }
    let grows = now.pulses >= before.pulses
        && now.pulses_missed >= before.pulses_missed
        && now.pulses_spurious >= before.pulses_spurious
        && now.relocks >= before.relocks
        && now.messages_dropped >= before.messages_dropped;
    if !grows {
        return Err(format!("a counter went back: {before:?} {now:?}"));
    }
    if plant.session.unsent() > 0 {
        return Err(format!("{} frames did not fit", plant.session.unsent()));
    }
    Ok(())
}

/// Relative error of the speed that the last status states, and how far its clock is behind the plant's, s.
fn speed_error_and_lag(plant: &Plant, truth_hz: f64) -> Option<(f64, f64)> {
    let status = plant.status()?;
    let error = (f64::from(status.speed_hz) / truth_hz - 1.0).abs();
    Some((error, plant.clock_s() - status.tick as f64 / f64::from(CLOCK_HZ)))
}

/// Resident memory, kB; 0 where the system does not tell.
fn resident_kb() -> u64 {
    let text = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = text.lines().find_map(|line| line.strip_prefix("VmRSS:")).unwrap_or_default();
    line.split_whitespace().next().and_then(|number| number.parse().ok()).unwrap_or(0)
}

fn page(plant: &Plant, seen: &Seen, hours: f64, seed: u64, took_s: f64) -> String {
    let s = plant.session.node().statistics();
    let reached = plant.seconds() / 3600.0;
    let lag_s = seen.lag_s.unwrap_or_default();
    format!(
        "# Soak\n\nWritten by `cargo xtask soak --hours {hours} --seed {seed}`: a node on the host, {reached:.2} h \
         of virtual time in \
         {took_s:.0} s, {} parts of 5 to 40 s with random speeds (standstill among them), two thirds of them quiet, \
         the others with \
         extra pulses, no pulses, stuck or flipped codes, overruns, lost blocks, a stalled line, or random bytes on \
         the line. After each \
         part: every block counted once, as many samples as the blocks hold, no counter back, no frame that does not \
         fit; in quiet \
         parts the speed within {SPEED_ERROR} of the truth and the node's clock (which its samples advance) at most \
         {DRIFT_S} s \
         more or less behind the plant's than at any other time.\n\n\
         | what | value |\n| --- | --- |\n| blocks made, processed, lost | {}, {}, {} |\n| samples | {} |\n\
         | pulses taken, missed, refused | {}, {}, {} |\n| locked anew | {} |\n| frames heard, messages dropped | \
         {}, {} |\n\
         | quiet parts, worst error of the speed | {}, {:.1e} |\n| age of the last status, least and most, s | \
         {:.3}, {:.3} |\n| resident memory in the first tenth, most since, kB | {}, {} |\n",
        seen.parts,
        plant.blocks(),
        s.blocks,
        s.blocks_lost,
        s.samples,
        s.pulses,
        s.pulses_missed,
        s.pulses_spurious,
        s.relocks,
        seen.frames,
        s.messages_dropped,
        seen.quiet,
        seen.worst_speed,
        lag_s[0],
        lag_s[1],
        seen.memory[0],
        seen.memory[1],
    )
}
