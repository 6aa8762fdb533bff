//! Instruction counts of the node's stages on QEMU's `mps2-an386`, one `bench: name value` line each.
//!
//! With `-icount shift=6` an instruction takes 64 ns of virtual time and the board's counter ticks every 40 ns, so a
//! difference of counts tells instructions to within one. The signal is made outside the counted stretches.
//! `cargo xtask bench-node` builds, runs and compares with the committed counts.
#![no_std]
#![no_main]

use core::mem::MaybeUninit;
use cortex_m_rt::entry;
use defmt_semihosting as _;
use meshband::buffers::{Buffers, LentArrays};
use meshband::config::{CaptureConfig, CaptureRate, Configuration, Sensor, TachWheel};
use meshband::decimate::Cascade;
use meshband::gear_condition;
use meshband::identity::Identity;
use meshband::indicators::RunEnsemble;
use meshband::law::LawForm;
use meshband::math;
use meshband::mesh_band::{self, Chain, MeshPlan};
use meshband::mesh_decimator::{Decimation, MeshDecimator};
use meshband::node::Block;
use meshband::peaks;
use meshband::pipeline::BLOCK_SAMPLES;
use meshband::rate_plan::{RateGrant, RatePlan};
use meshband::rise_time::{Polarity, RiseTime, RiseTimeConfig};
use meshband::sample_ring::SampleRing;
use meshband::session::Session;
use meshband::stream::{CHUNK, Stream};
use meshband::tach::TachTracker;
use meshband::units::{Hertz, TicksPerSecond};
use meshband::window::Window;
use meshband::zoom::{Averaging, ZoomConfig};
use meshband_node::an386::registers::CLOCK_HZ;
use meshband_node::an386::time::TimeBase;
use meshband_node::runner::{NodeCapture, open_capture};
use semihosting::{eprintln, process};

const CLOCK: TicksPerSecond = TicksPerSecond(CLOCK_HZ);
const TEETH: u32 = 20;

/// Counts instructions of a stretch of code, without those of counting.
#[derive(Clone, Copy)]
struct Counter {
    time: TimeBase,
    own_ticks: u32,
}

impl Counter {
    fn start() -> Self {
        let time = TimeBase::start();
        let before = time.now();
        Self { time, own_ticks: time.now().wrapping_sub(before) }
    }

    fn count(self, work: impl FnOnce()) -> u64 {
        let before = self.time.now();
        work();
        u64::from(self.time.now().wrapping_sub(before).saturating_sub(self.own_ticks)) * 40 / 64
    }
}

fn report(name: &str, speed_hz: u32, value: u64) {
    eprintln!("bench: {name}@{speed_hz} {value}");
}

/// A gear pair's codes: mesh harmonics 1, 2 and 5 with a shaft sideband and some noise.
struct Signal {
    turn: u32,
    step: u32,
    noise: u32,
}

impl Signal {
    fn new(speed_hz: u32, period_ticks: u32) -> Self {
        let step = ((u64::from(speed_hz) * u64::from(period_ticks)) << 32) / u64::from(CLOCK_HZ);
        Self { turn: 0, step: step as u32, noise: 1 }
    }

    fn next(&mut self) -> f32 {
        self.noise ^= self.noise << 13;
        self.noise ^= self.noise >> 17;
        self.noise ^= self.noise << 5;
        let order = |n: u32| math::cossin(self.turn.wrapping_mul(n)).0;
        let x = 100.0 * order(TEETH) + 50.0 * order(2 * TEETH) + 20.0 * order(5 * TEETH) + 10.0 * order(TEETH + 1);
        self.turn = self.turn.wrapping_add(self.step);
        x + self.noise as i32 as f32 * 1e-9
    }

    fn code(&mut self) -> u16 {
        (32_768.0 + 100.0 * self.next()) as u16
    }
}

fn configuration() -> Configuration {
    let mut config = Configuration::default();
    config.gears.pinion_teeth = TEETH as u16;
    config
}

fn grant(config: &Configuration, speed_hz: u32) -> RateGrant {
    let law = config.law.bandwidth(Hertz(speed_hz as f32));
    RatePlan::new(CLOCK, config.limits).grant(config.policy.rate(law.bandwidth))
}

/// Samples of the whole node's waveform, where the released board has them.
#[unsafe(link_section = ".core")]
static mut SAMPLES: MaybeUninit<SampleRing> = MaybeUninit::uninit();

#[entry]
fn main() -> ! {
    static mut BUFFERS: Buffers = Buffers::ZERO;
    static mut RECORD: [f32; 4096] = [0.0; 4096];
    static mut CAPTURE: MaybeUninit<NodeCapture> = MaybeUninit::uninit();
    let counter = Counter::start();
    let config = configuration();
    stages(counter, RECORD);
    for speed_hz in [1, 2, 5, 10, 15, 20, 25] {
        mesh_path(counter, &config, speed_hz, BUFFERS.chain());
    }
    let samples = &raw mut SAMPLES;
    // SAFETY: the only reference to it, taken once: this function is entered once.
    let samples = unsafe { &mut *samples };
    let arrays = &mut LentArrays { buffers: BUFFERS, capture: open_capture(CAPTURE, samples) };
    whole(counter, config.clone(), 25, "chain", arrays);
    // A law that asks for the highest rate the limits allow.
    let mut fast = config;
    fast.law.form = LawForm::Quadratic { a_per_hz: 0.0, b: 0.0, c_hz: 77_900.0 };
    whole(counter, fast.clone(), 25, "chain-highest-rate", arrays);
    for (keep, name) in [(CaptureRate::Fixed, "chain-with-waveform"), (CaptureRate::Law, "chain-with-waveform-at-law")]
    {
        fast.capture = CaptureConfig { keep, rate: Hertz(0.0) };
        whole(counter, fast.clone(), 25, name, arrays);
    }
    eprintln!("node: finished");
    process::exit(0)
}

/// Stages by themselves, instructions per thousand samples or per call.
fn stages(counter: Counter, record: &mut [f32; 4096]) {
    let mut signal = Signal::new(25, 67);
    for stages in [1, 2, 3, 5] {
        let mut cascade = Cascade::new(stages);
        let mut total = 0;
        for _ in 0..32 {
            let mut samples: [f32; 128] = core::array::from_fn(|_| signal.next());
            total += counter.count(|| {
                core::hint::black_box(cascade.process(&mut samples));
            });
        }
        report("decimate-per-4096-samples", u32::from(stages), total);
    }
    let wheel = TachWheel { pulses_per_turn: 60, missing: 2, ..Configuration::default().tach };
    let mut tach = TachTracker::new(wheel, CLOCK);
    let mut total = 0;
    for position in (1u64..=1000).filter(|position| position % 60 < 58) {
        total += counter.count(|| tach.on_pulse((1 << 33) + position * 16_667));
    }
    report("tach-per-967-pulses", 25, total);
    for (comb, stages) in [(7, 2), (16, 2), (16, 5)] {
        let mut decimator = MeshDecimator::new(Decimation { comb, stages });
        let mut total = 0;
        for _ in 0..32 {
            let codes: [u16; 128] = core::array::from_fn(|_| signal.code());
            total += counter.count(|| {
                core::hint::black_box(decimator.process(&codes, 0.1, 32_768));
            });
        }
        report("mesh-decimate-per-4096-codes", 100 * u32::from(comb) + u32::from(stages), total);
    }
    let fill = |record: &mut [f32], signal: &mut Signal| record.iter_mut().for_each(|x| *x = signal.next());
    fill(record, &mut signal);
    report(
        "fft-4096",
        0,
        counter.count(|| {
            core::hint::black_box(microfft::real::rfft_4096(record));
        }),
    );
    fill(record, &mut signal);
    let (samples, window) = record.split_at_mut(2048);
    report("window-and-power-2048", 0, counter.count(|| window_and_power(samples, window)));
    fill(record, &mut signal);
    report(
        "wideband-peaks",
        0,
        counter.count(|| {
            core::hint::black_box(peaks::strongest(record, 45.0));
        }),
    );
    fill(record, &mut signal);
    let (average, rest) = record.split_at_mut(1024);
    let (work, rest) = rest.split_at_mut(1024);
    let split = &mut rest[..1024];
    let mut ensemble = RunEnsemble::default();
    report(
        "gear-condition-1024",
        0,
        counter.count(|| {
            let _ = core::hint::black_box(gear_condition::of_average(
                average,
                TEETH as u16,
                |run| ensemble.add(run),
                work,
                split,
            ));
        }),
    );
    let mut rise = RiseTime::<256>::new(RiseTimeConfig { polarity: Polarity::Either, minimum_height: 1.0 }, 700.0);
    fill(record, &mut signal);
    report(
        "rise-time-per-4096-samples",
        0,
        counter.count(|| {
            for &x in record.iter() {
                core::hint::black_box(rise.push(x));
            }
        }),
    );
}

/// What a spectrum needs beside its transform: a window from a table and the averaged power of each bin, four at a
/// time as CMSIS-DSP does it.
#[inline(never)]
fn window_and_power(samples: &mut [f32], other: &mut [f32]) {
    for (x, w) in samples.chunks_exact_mut(4).zip(other.chunks_exact(4)) {
        if let ([a, b, c, d], [p, q, r, s]) = (x, w) {
            (*a, *b, *c, *d) = (*a * p, *b * q, *c * r, *d * s);
        }
    }
    for (x, mean) in samples.chunks_exact(4).zip(other.chunks_exact_mut(2)) {
        if let ([a, b, c, d], [one, two]) = (x, mean) {
            (*one, *two) = (*one + 0.25 * (a * a + b * b - *one), *two + 0.25 * (c * c + d * d - *two));
        }
    }
    core::hint::black_box((samples, other));
}

/// From codes to mesh-band spectra without anything else, instructions per second of signal.
fn mesh_path(counter: Counter, config: &Configuration, speed_hz: u32, chain: &mut Chain) {
    let grant = grant(config, speed_hz);
    let followed = mesh_band::Followed::of(config, 0);
    let plan = MeshPlan::new(&followed, config.mesh.harmonics, Hertz(speed_hz as f32), grant.adc);
    let turns = mesh_band::record_turns(TEETH as u16);
    let averaging = Averaging::Linear { records: 1 };
    // The average is full after one turn and costs nothing from then on.
    let zoom = ZoomConfig { teeth: TEETH as u16, turns, window: Window::Hann, averaging };
    if chain.configure(zoom, 32, 1).is_err() {
        process::exit(1);
    }
    let mut stream = Stream::new();
    stream.restart(1 << 32, grant.period_ticks, plan.decimation);
    chain.set_samples_per_pitch(usize::from(plan.samples_per_pitch));
    let mut signal = Signal::new(speed_hz, grant.period_ticks);
    let sensor = Sensor { acceleration_per_code: config.sensor.acceleration_per_code, zero_code: 32_768 };
    let (mut filter, mut order, mut ticks, mut mark) = (0u64, 0u64, 0u64, 0u64);
    let turn_ticks = u64::from(CLOCK_HZ / speed_hz);
    // Whole turns: one record's worth and the same at any speed.
    let turns = 2 * u64::from(turns);
    while ticks < turns * turn_ticks {
        // As the node does it: samples per chunk, turns per block.
        for _ in 0..BLOCK_SAMPLES / CHUNK {
            let codes: [u16; CHUNK] = core::array::from_fn(|_| signal.code());
            let mut kept = ([0.0f32; CHUNK], 0usize, 0u64, 1u32);
            let take = |samples: &[f32], tick: u64, period: u32| {
                kept.0[..samples.len()].copy_from_slice(samples);
                (kept.1, kept.2, kept.3) = (samples.len(), tick, period);
            };
            filter += counter.count(|| stream.push(&codes, &sensor, |_, _| {}, take));
            ticks += CHUNK as u64 * u64::from(grant.period_ticks);
            if kept.1 > 0 {
                order += counter.count(|| chain.push_samples(&kept.0[..kept.1], kept.2 as u32, kept.3));
            }
        }
        order += counter.count(|| {
            while mark * turn_ticks < ticks {
                chain.push_mark((mark * turn_ticks) as u32);
                mark += 1;
            }
            chain.process();
        });
    }
    let per_second = |count: u64| count * u64::from(CLOCK_HZ) / ticks;
    report("mesh-decimation-per-s", speed_hz, per_second(filter));
    report("mesh-order-domain-per-s", speed_hz, per_second(order));
    report("law-rate-hz", speed_hz, grant.output.0 as u64);
    report("law-stages", speed_hz, u64::from(grant.stages));
    report("adc-rate-hz", speed_hz, grant.adc.0 as u64);
}

/// The whole node with its link, instructions per second of signal and the costliest block.
fn whole(counter: Counter, config: Configuration, speed_hz: u32, name: &str, arrays: &mut LentArrays<'_>) {
    let arrays = LentArrays { buffers: arrays.buffers, capture: arrays.capture };
    let Ok(mut session) = Session::with_arrays(config, CLOCK, Identity::HOST, arrays) else { process::exit(1) };
    let turn_ticks = CLOCK_HZ / speed_hz;
    let (mut ticks, mut edge, mut sequence, mut turn) = (0u64, 0u64, 0u32, 0u32);
    let (mut total, mut counted, mut worst, mut bytes) = (0u64, 0u64, 0u64, 0u64);
    let mut period_ticks = session.node().requested_period_ticks();
    while ticks < 2 * u64::from(CLOCK_HZ) {
        let mut signal = Signal::new(speed_hz, period_ticks);
        signal.turn = turn;
        let codes: [u16; BLOCK_SAMPLES] = core::array::from_fn(|_| signal.code());
        turn = signal.turn;
        let end = ticks + BLOCK_SAMPLES as u64 * u64::from(period_ticks);
        let spent = counter.count(|| {
            while edge < end {
                session.on_edge(edge as u32);
                edge += u64::from(turn_ticks);
            }
            let block =
                Block { codes: &codes, second: &[], first_tick: ticks as u32, period_ticks, sequence, overrun: false };
            session.on_block(block, &mut |frame| bytes += frame.len() as u64);
        });
        // The first half second finds the speed and the rate.
        if ticks > u64::from(CLOCK_HZ) / 2 {
            total += spent;
            counted += end - ticks;
            worst = worst.max(spent);
        }
        (ticks, sequence) = (end, sequence + 1);
        period_ticks = session.node().requested_period_ticks();
    }
    eprintln!("bench: {name}-per-s@{speed_hz} {}", total * u64::from(CLOCK_HZ) / counted);
    eprintln!("bench: {name}-worst-block@{speed_hz} {worst}");
    eprintln!("bench: {name}-adc-hz@{speed_hz} {}", CLOCK_HZ / period_ticks);
    eprintln!("bench: {name}-link-bytes@{speed_hz} {bytes}");
}

// SAFETY: no other symbol has this name; the entry of the fault (`meshband_node::fault`) calls it.
#[unsafe(no_mangle)]
extern "C" fn on_fault(program_counter: u32, _stack_overflow: bool) -> ! {
    eprintln!("bench: hard fault at {program_counter:#010x}");
    process::exit(3)
}

#[panic_handler]
fn panic(info: &core::panic::PanicInfo) -> ! {
    eprintln!("bench: panic: {}", info.message());
    process::exit(2)
}
