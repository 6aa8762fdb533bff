//! The flashed image for a long time, with everything that may befall a board, at random; prints a page in Markdown.
//! Exit code 1 where something did not hold, with one line.
//!
//! Beside `cargo xtask soak`, which has the node's code alone on the host: here run the very image, its loader, its
//! interrupts, its DMA and its watchdog. Arguments: the image, then `--hours H` (1) and `--seed S` (1). Cost: about
//! half of the time that is emulated, on one core.

#[path = "../tests/flashed/compared/mod.rs"]
mod compared;
#[path = "../tests/flashed/image.rs"]
mod image;

use compared::{Node, STARTED_S, TEETH, TICKS_PER_SECOND, configuration, packets};
use meshband::frame::Packet;
use meshband::message::{Message, Reply, Request, Statistics, Status};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::f64::consts::TAU;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Instant;

/// Relative error of the speed that a quiet part may show.
const SPEED_ERROR: f64 = 2e-3;
/// How far the age of the last status may vary, s.
const DRIFT_S: f64 = 1.5;
/// Blocks that may have been sampled and not yet processed when the statistics were asked for.
const MAX_PENDING_BLOCKS: u64 = 8;
/// Questions after a part, and what each may take, s: random bytes may have begun a frame that swallows the first.
const QUESTIONS: u32 = 3;
const QUESTION_S: f64 = 0.2;
/// Share of a part in which the speed changes.
const RAMP: f64 = 0.3;

/// What befalls the board in a part.
#[derive(Clone, Copy, Debug)]
enum Fault {
    None,
    NoPulses,
    /// So many extra pulses per second.
    Pulses(f64),
    /// A signal far beyond the converter's range.
    Overload,
    /// A sensor that has fallen off: the middle of the range.
    Silence,
    /// So many random bytes per second on the line.
    RandomBytes(f64),
    /// So many requests per second.
    Requests(f64),
}

/// What was seen.
#[derive(Default)]
struct Seen {
    parts: u32,
    quiet: u32,
    blocks: u64,
    broken: usize,
    bytes: u64,
    packets: u64,
    worst_speed: f64,
    /// Least and most that the last status of a quiet part was behind, s.
    lag_s: Option<[f64; 2]>,
    /// Resident memory after the first tenth, and the most since then, kB.
    memory: [u64; 2],
    statistics: Option<Statistics>,
}

fn main() -> ExitCode {
    let mut arguments = std::env::args_os().skip(1);
    let Some(image) = arguments.next().and_then(|path| image::with_loader(path.as_ref()).ok()) else {
        eprintln!("usage: soak IMAGE [--hours H] [--seed S], the ELF file of the STM32F405, its loader beside it");
        return ExitCode::from(2);
    };
    let words: Vec<String> = arguments.map(|word| word.to_string_lossy().into_owned()).collect();
    let (mut hours, mut seed) = (1.0_f64, 1_u64);
    for pair in words.chunks(2) {
        let parsed = match pair {
            [name, value] if name == "--hours" => value.parse().map(|h| hours = h).is_ok(),
            [name, value] if name == "--seed" => value.parse().map(|s| seed = s).is_ok(),
            _ => false,
        };
        if !(parsed && hours > 0.0) {
            eprintln!("soak: --hours H and --seed S are taken, not {}", pair.join(" "));
            return ExitCode::from(2);
        }
    }
    let begin = Instant::now();
    let mut soak = Soak::new(&image, seed);
    match soak.run(3600.0 * hours) {
        Ok(()) => {
            print!("{}", soak.page(hours, seed, begin.elapsed().as_secs_f64()));
            ExitCode::SUCCESS
        }
        Err(what) => {
            eprintln!("soak: after {:.0} s: {what}", soak.node.board.seconds());
            ExitCode::FAILURE
        }
    }
}

struct Soak {
    node: Node,
    random: ChaCha8Rng,
    speed_hz: f64,
    /// Turns so far.
    turns: f64,
    status: Option<Status>,
    seen: Seen,
}

impl Soak {
    fn new(image: &meshband_emulator::elf::Image, seed: u64) -> Self {
        let mut node = Node::new(image, &configuration());
        node.run_until(STARTED_S);
        let random = ChaCha8Rng::seed_from_u64(seed);
        Self { node, random, speed_hz: 5.0, turns: 0.0, status: None, seen: Seen::default() }
    }

    fn run(&mut self, until_s: f64) -> Result<(), String> {
        while self.node.board.seconds() < until_s {
            let (fault, next_hz) = self.part();
            self.look(fault, next_hz)?;
            self.seen.parts += 1;
            let early = self.node.board.seconds() < 0.1 * until_s;
            let place = &mut self.seen.memory[usize::from(!early)];
            *place = (*place).max(resident_kb());
        }
        Ok(())
    }

    /// Some seconds at a new speed with a fault, or none.
    fn part(&mut self) -> (Fault, f64) {
        let length_s = self.random.random_range(5.0..40.0);
        let next_hz = if self.random.random_bool(0.1) { 0.0 } else { self.random.random_range(1.0..25.0) };
        let fault = self.fault();
        let course = Course {
            start_s: self.node.board.seconds(),
            ramp_s: RAMP * length_s,
            from_hz: self.speed_hz,
            to_hz: next_hz,
        };
        let gain = match fault {
            Fault::Overload => 4.0,
            Fault::Silence => 0.0,
            _ => 0.12,
        };
        let before = self.turns;
        self.node.board.set_analogue(Arc::new(move |time_s| signal(before + course.turns(time_s), gain)));
        let end_s = course.start_s + length_s;
        let mut edges = match fault {
            Fault::NoPulses => Vec::new(),
            _ => course.edges(before, end_s + f64::from(QUESTIONS) * QUESTION_S),
        };
        if let Fault::Pulses(per_second) = fault {
            let extra = (per_second * length_s) as usize;
            edges.extend((0..extra).map(|_| self.random.random_range(course.start_s..end_s)));
            edges.sort_by(f64::total_cmp);
            edges.dedup_by(|a, b| *a - *b < 1e-4);
        }
        self.node.board.add_tach_edges(&edges);
        while self.node.board.seconds() < end_s {
            self.speak(fault);
            self.node.run_until(f64::min(self.node.board.seconds() + 1.0, end_s));
            self.listen();
        }
        self.turns = before + course.turns(end_s);
        self.speed_hz = next_hz;
        (fault, next_hz)
    }

    fn fault(&mut self) -> Fault {
        match self.random.random_range(0..12) {
            0 => Fault::NoPulses,
            1 => Fault::Pulses(self.random.random_range(0.5..20.0)),
            2 => Fault::Overload,
            3 => Fault::Silence,
            4 => Fault::RandomBytes(self.random.random_range(10.0..2000.0)),
            5 => Fault::Requests(self.random.random_range(1.0..20.0)),
            _ => Fault::None,
        }
    }

    /// What the host, or the line, says within a second.
    fn speak(&mut self, fault: Fault) {
        match fault {
            Fault::RandomBytes(per_second) => {
                let bytes: Vec<u8> = (0..per_second as usize).map(|_| self.random.random()).collect();
                self.node.board.send(&bytes);
            }
            Fault::Requests(per_second) => {
                let all =
                    [Request::Identify, Request::Statistics, Request::Snapshot, Request::Events, Request::SelfTest];
                for _ in 0..per_second as usize {
                    let request = all[self.random.random_range(0..all.len())].clone();
                    self.node.ask(request);
                }
            }
            _ => {}
        }
    }

    /// Takes over what was sent and sampled, and forgets it, as memory is to stay as it is.
    fn listen(&mut self) {
        self.seen.bytes += self.node.link.len() as u64;
        self.seen.blocks += self.node.blocks.len() as u64;
        for packet in packets(&self.node.link) {
            self.seen.packets += 1;
            match packet {
                Packet::Message(Message::Status(status)) => self.status = Some(status),
                Packet::Reply(Reply::Statistics(statistics)) => self.seen.statistics = Some(statistics),
                _ => {}
            }
        }
        self.seen.broken += self.node.broken;
        self.node.forget();
        self.node.requests.clear();
    }

    /// Whether everything is as it should be after a part.
    fn look(&mut self, fault: Fault, speed_hz: f64) -> Result<(), String> {
        let (status, at_s) = (self.status.take(), self.node.board.seconds());
        let before = self.seen.statistics.take();
        let mut asked_at = 0;
        for _ in 0..QUESTIONS {
            asked_at = self.seen.blocks;
            self.node.ask(Request::Statistics);
            self.node.run_for(QUESTION_S);
            self.listen();
        }
        self.turns += (self.node.board.seconds() - at_s) * self.speed_hz;
        let now = self.seen.statistics.clone().ok_or("no answer")?;
        self.counted(asked_at, before.as_ref(), &now)?;
        if self.seen.broken > 0 || self.node.resets() > 0 {
            return Err(format!("{} broken blocks, {} resets", self.seen.broken, self.node.resets()));
        }
        if matches!(fault, Fault::None) {
            let status = status.ok_or("no status in a quiet part")?;
            self.quiet(&status, at_s, speed_hz)?;
        }
        Ok(())
    }

    /// Every block counted once and none lost, as many samples as the blocks hold, no counter back.
    fn counted(&self, asked_at: u64, before: Option<&Statistics>, now: &Statistics) -> Result<(), String> {
        let processed = u64::from(now.blocks);
        if now.blocks_lost > 0 || processed > self.seen.blocks || processed + MAX_PENDING_BLOCKS < asked_at {
            let made = self.seen.blocks;
            return Err(format!("{made} blocks were sampled, {processed} processed and {} lost", now.blocks_lost));
        }
        if now.samples != compared::BLOCK as u64 * processed {
            return Err(format!("{} samples in {processed} blocks", now.samples));
        }
        let grows = before.is_none_or(|before| {
            now.pulses >= before.pulses
                && now.pulses_missed >= before.pulses_missed
                && now.pulses_spurious >= before.pulses_spurious
                && now.relocks >= before.relocks
        });
        if grows { Ok(()) } else { Err(format!("a counter went back: {before:?} {now:?}")) }
    }

    /// Speed and clock of a part without a fault.
    fn quiet(&mut self, status: &Status, at_s: f64, speed_hz: f64) -> Result<(), String> {
        let lag_s = at_s - status.tick as f64 / TICKS_PER_SECOND;
        let [least, most] = self.seen.lag_s.get_or_insert([lag_s; 2]);
        (*least, *most) = (least.min(lag_s), most.max(lag_s));
        if *most - *least > DRIFT_S {
            return Err(format!("the node's clock lags by {least:.2} to {most:.2} s"));
        }
        if speed_hz > 0.0 {
            let error = (f64::from(status.speed_hz) / speed_hz - 1.0).abs();
            self.seen.worst_speed = self.seen.worst_speed.max(error);
            if error > SPEED_ERROR {
                return Err(format!("the speed is off by {error:.1e} in a quiet part: {status:?}"));
            }
        }
        self.seen.quiet += 1;
        Ok(())
    }

    fn page(&self, hours: f64, seed: u64, took_s: f64) -> String {
        let Seen { parts, quiet, blocks, bytes, packets, worst_speed, memory, .. } = &self.seen;
        let lag_s = self.seen.lag_s.unwrap_or_default();
        let last = self.seen.statistics.as_ref();
        let of = |value: fn(&Statistics) -> u32| last.map_or(0, value);
        format!(
            "# Soak of the flashed image\n\nWritten by `cargo xtask soak-image --hours {hours} --seed {seed}`: the \
             released image with its loader on the emulated chip at two \
             cycles per instruction, {:.2} h of its time in {took_s:.0} s, {parts} parts of 5 to 40 s with random \
             speeds of 1 to 25 turns/s \
             (standstill among them), half of them quiet, the others with no pulses, extra pulses, a signal far \
             beyond the converter's range, a silent sensor, \
             random bytes on the line, or up to 20 requests a second. After each part: no block lost or broken, no \
             reset, as many samples as the \
             blocks hold, no counter back; in quiet parts the speed within {SPEED_ERROR} of the truth and the age of \
             the last status by \
             the emulator's clock within {DRIFT_S} s of that at any other time.\n\n\
             | what | value |\n| --- | --- |\n| blocks sampled, lost, broken | {blocks}, {}, 0 |\n| pulses taken, \
             missed, refused | {}, {}, {} |\n\
             | locked anew | {} |\n| bytes and packets heard | {bytes}, {packets} |\n| quiet parts, worst error of \
             the speed | {quiet}, {worst_speed:.1e} |\n\
             | age of the last status, most less least, s | {:.3} |\n| resident memory of the emulator in the first \
             tenth, most since, kB | {}, {} |\n",
            self.node.board.seconds() / 3600.0,
            of(|s| s.blocks_lost),
            of(|s| s.pulses),
            of(|s| s.pulses_missed),
            of(|s| s.pulses_spurious),
            of(|s| s.relocks),
            lag_s[1] - lag_s[0],
            memory[0],
            memory[1],
        )
    }
}

/// A speed that changes at first and then stays.
#[derive(Clone, Copy)]
struct Course {
    start_s: f64,
    ramp_s: f64,
    from_hz: f64,
    to_hz: f64,
}

impl Course {
    /// Turns since the start.
    fn turns(&self, time_s: f64) -> f64 {
        let t = time_s - self.start_s;
        let ramp = t.clamp(0.0, self.ramp_s);
        let mean = self.from_hz + 0.5 * (self.to_hz - self.from_hz) * ramp / self.ramp_s;
        mean * ramp + self.to_hz * (t - ramp)
    }

    /// Instants until `end_s` at which the turns, `before` of them at the start, are whole.
    fn edges(&self, before: f64, end_s: f64) -> Vec<f64> {
        let last = before + self.turns(end_s);
        let whole = (before.floor() as i64 + 1..).map(|n| n as f64).take_while(|n| *n < last);
        whole.map(|n| self.instant(n - before)).collect()
    }

    /// When so many turns are done: the ramp's parabola, then the line behind it.
    fn instant(&self, turns: f64) -> f64 {
        let in_ramp = 0.5 * (self.from_hz + self.to_hz) * self.ramp_s;
        let t = if turns > in_ramp {
            self.ramp_s + (turns - in_ramp) / self.to_hz
        } else {
            let slope = (self.to_hz - self.from_hz) / self.ramp_s;
            // The root that stays exact for small slopes.
            2.0 * turns / (self.from_hz + (self.from_hz * self.from_hz + 2.0 * slope * turns).max(0.0).sqrt())
        };
        self.start_s + t
    }
}

/// Five mesh harmonics with a sideband of the shaft, as a share of the converter's range.
fn signal(turns: f64, gain: f64) -> f64 {
    let turn = TAU * turns.fract();
    let modulation = 1.0 + 0.2 * turn.cos();
    let sum: f64 = (1..=5).map(|h| (f64::from(h) * f64::from(TEETH) * turn).cos() / f64::from(h)).sum();
    0.5 + gain * modulation * sum
}

/// Resident memory, kB; 0 where the system does not tell.
fn resident_kb() -> u64 {
    let text = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = text.lines().find_map(|line| line.strip_prefix("VmRSS:")).unwrap_or_default();
    line.split_whitespace().next().and_then(|number| number.parse().ok()).unwrap_or(0)
}
