//! Golden hashes: every stage run on a fixed pseudo-random input, its output bits hashed (32-bit FNV-1a).
//!
//! Nothing here depends on the target, so the host, QEMU and the board must give the same numbers: the tests run it
//! on the host, the QEMU image at its start. The node's own check is smaller ([`meshband::self_test::mathematics`]).
//! A changed hash is a changed result: change [`EXPECTED_HASHES`] only together with the reason.
//!
//! Cost: 3.4 M instructions (Cortex-M4F in QEMU), 40 ms at 168 MHz; 8 KiB of stack.

use meshband::alias::{self, Origin};
use meshband::config::TachWheel;
use meshband::decimate::Cascade;
use meshband::envelope::envelope;
use meshband::indicators::{Moments, fm0};
use meshband::math;
use meshband::mesh_decimator::{BATCH, Decimation, MeshDecimator};
use meshband::order::OrderTracker;
use meshband::rise_time::{Polarity, RiseTime, RiseTimeConfig};
use meshband::spectrum::amplitude_spectrum;
use meshband::tach::TachTracker;
use meshband::tsa::{self, RegularLines};
use meshband::units::{Hertz, TicksPerSecond};
use meshband::window::Window;
use meshband::zoom::{Averaging, MeshZoom, ZoomConfig};
use microfft::Complex32;

/// Number of stages.
pub const STAGES: usize = 12;

/// Hash of one stage's output.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StageHash {
    /// Name of the module.
    pub stage: &'static str,
    /// FNV-1a over the bits of its results.
    pub hash: u32,
}

/// The hashes every target must give.
pub const EXPECTED_HASHES: [StageHash; STAGES] = [
    StageHash { stage: "math", hash: 0xe638_42a1 },
    StageHash { stage: "window", hash: 0x5745_6861 },
    StageHash { stage: "spectrum", hash: 0xe3ef_d032 },
    StageHash { stage: "order", hash: 0xd728_e2c2 },
    StageHash { stage: "zoom", hash: 0x6093_abbd },
    StageHash { stage: "tsa", hash: 0x8739_766f },
    StageHash { stage: "envelope", hash: 0xa80b_c33a },
    StageHash { stage: "rise_time", hash: 0xa6e3_6ebc },
    StageHash { stage: "alias", hash: 0xcb63_4942 },
    StageHash { stage: "decimate", hash: 0x4a34_005d },
    StageHash { stage: "mesh_decimator", hash: 0x7c28_c0fc },
    StageHash { stage: "tach", hash: 0xc2e6_e6c4 },
];

/// FNV-1a over 32-bit words, byte by byte.
struct Fnv(u32);

impl Fnv {
    fn new() -> Self {
        Self(0x811c_9dc5)
    }

    fn word(&mut self, word: u32) {
        for byte in word.to_le_bytes() {
            self.0 = (self.0 ^ u32::from(byte)).wrapping_mul(0x0100_0193);
        }
    }

    fn value(&mut self, x: f32) {
        self.word(x.to_bits());
    }

    fn values(mut self, values: &[f32]) -> u32 {
        for &x in values {
            self.value(x);
        }
        self.0
    }
}

/// Marsaglia's xorshift, uniform in -1..1.
struct Noise(u32);

impl Noise {
    fn next(&mut self) -> f32 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 17;
        self.0 ^= self.0 << 5;
        (self.0 as i32) as f32 * (1.0 / 2_147_483_648.0)
    }
}

/// Runs all stages and hashes their results, in the order of [`EXPECTED_HASHES`].
pub fn hashes() -> [StageHash; STAGES] {
    let results: [u32; STAGES] = [
        math_stage(),
        window_stage(),
        spectrum_stage(),
        order_stage(),
        zoom_stage(),
        tsa_stage(),
        envelope_stage(),
        rise_time_stage(),
        alias_stage(),
        decimate_stage(),
        mesh_decimator_stage(),
        tach_stage(),
    ];
    core::array::from_fn(|i| StageHash { stage: EXPECTED_HASHES[i].stage, hash: results[i] })
}

/// Compares all stages with [`EXPECTED_HASHES`]; the first one that differs.
pub fn self_test() -> Result<(), StageHash> {
    for (found, expected) in hashes().into_iter().zip(EXPECTED_HASHES) {
        if found != expected {
            return Err(found);
        }
    }
    Ok(())
}

#[inline(never)]
fn math_stage() -> u32 {
    let mut noise = Noise(1);
    let mut hash = Fnv::new();
    for _ in 0..256 {
        let (x, y) = (noise.next(), noise.next());
        let (c, s) = math::cossin((x * 2e9) as i32 as u32);
        let positive = x.abs() + 1e-9;
        for value in [
            c,
            s,
            math::sin(4.0 * x),
            math::sinc(9.0 * y),
            math::sqrt(positive),
            math::atan2(y, x),
            math::log10(positive),
            math::exp(3.0 * x),
            math::decibels_coarse(positive),
            math::floor(1000.0 * y),
        ] {
            hash.value(value);
        }
    }
    hash.0
}

#[inline(never)]
fn window_stage() -> u32 {
    let mut hash = Fnv::new();
    for window in [Window::Rectangular, Window::Hann, Window::BlackmanHarris, Window::FlatTop] {
        let mut ones = [1.0f32; 64];
        window.apply(&mut ones, 0.25);
        for x in ones {
            hash.value(x);
        }
        for x in [window.enbw_bins(), window.scallop_loss_db(), window.offset_from_ratio(0.7)] {
            hash.value(x);
        }
    }
    hash.0
}

fn signal<const N: usize>(seed: u32) -> [f32; N] {
    let mut noise = Noise(seed);
    core::array::from_fn(|n| {
        let carrier = math::cossin((n as u32).wrapping_mul(0x1357_9bdf)).0;
        3.0 * carrier + 0.5 * noise.next()
    })
}

#[inline(never)]
fn spectrum_stage() -> u32 {
    let mut samples = signal::<512>(2);
    let mut amplitudes = [0.0f32; 257];
    match amplitude_spectrum(&mut samples, Window::Hann, &mut amplitudes) {
        Ok(()) => Fnv::new().values(&amplitudes),
        Err(_) => 0,
    }
}

#[inline(never)]
fn order_stage() -> u32 {
    let mut tracker = OrderTracker::<512>::new();
    let samples = signal::<512>(3);
    let mut hash = Fnv::new();
    if tracker.push_samples(&samples, u32::MAX - 9000, 37).is_err() {
        return 0;
    }
    // Marks of an accelerating shaft, across the wrap of the time base.
    for mark in [100u32, 4600, 8900, 13_000, 16_950] {
        tracker.push_mark((u32::MAX - 9000).wrapping_add(mark));
    }
    while let Ok(Some(turn)) = tracker.next_turn() {
        let mut out = [0.0f32; 96];
        tracker.resample(&turn, 0, 96, &mut out);
        for x in out {
            hash.value(x);
        }
        hash.value(turn.speed_change);
    }
    hash.0
}

#[inline(never)]
fn zoom_stage() -> u32 {
    let config =
        ZoomConfig { teeth: 17, turns: 8, window: Window::Hann, averaging: Averaging::Exponential { weight: 0.25 } };
    let Ok(mut zoom) = MeshZoom::<128, 2>::new(config) else {
        return 0;
    };
    let mut noise = Noise(4);
    let mut records = 0;
    let mut phase = 0u32;
    while records < 2 {
        // One turn is 2^32; the pinion's sixteenth order beside the mesh frequency is a lower sideband.
        let step = u32::MAX / zoom.samples_per_turn().max(1);
        let mesh = math::cossin(phase.wrapping_mul(17)).0;
        let sideband = math::cossin(phase.wrapping_mul(16)).1;
        records += zoom.push(&[2.0 * mesh + 0.3 * sideband + 0.1 * noise.next()]);
        phase = phase.wrapping_add(step);
    }
    let mut hash = Fnv::new();
    for harmonic in 1..=2 {
        for bin in -40..=40 {
            hash.value(zoom.amplitude(harmonic, bin).unwrap_or(-1.0));
        }
        hash.value(zoom.sideband_energy_ratio(harmonic, 1.0).unwrap_or(-1.0));
    }
    hash.0
}

#[inline(never)]
fn tsa_stage() -> u32 {
    let average = signal::<256>(5);
    let lines = RegularLines { teeth: 19, shaft_orders: 2, sidebands: 1 };
    let (mut work, mut out) = ([0.0f32; 256], [0.0f32; 256]);
    let mut hash = Fnv::new();
    if tsa::difference(&average, &lines, &mut work, &mut out).is_err() {
        return 0;
    }
    for x in out {
        hash.value(x);
    }
    let moments = Moments::of(&out);
    for x in [moments.mean, moments.m2, moments.kurtosis, moments.sixth, moments.eighth, moments.crest()] {
        hash.value(x);
    }
    if let Ok(Some(fm0)) = fm0(&average, 19, &mut work) {
        hash.value(fm0);
    }
    hash.0
}

#[inline(never)]
fn envelope_stage() -> u32 {
    let mut samples = signal::<256>(6);
    let (mut work, mut out) = ([Complex32::new(0.0, 0.0); 64], [0.0f32; 64]);
    match envelope(&mut samples, 5, 45, &mut work, &mut out) {
        Ok(()) => Fnv::new().values(&out),
        Err(_) => 0,
    }
}

#[inline(never)]
fn rise_time_stage() -> u32 {
    let config = RiseTimeConfig { polarity: Polarity::Either, minimum_height: 0.5 };
    let mut estimator = RiseTime::<256>::new(config, 100.5);
    let mut noise = Noise(7);
    let mut hash = Fnv::new();
    let mut level = 0.0f32;
    for n in 0..4000u32 {
        // A first-order lag behind a square wave.
        let target = if n % 100 < 50 { 1.0 } else { 0.0 };
        level += 0.1 * (target - level);
        if let Some(edge) = estimator.push(level + 0.002 * noise.next()) {
            hash.value(edge.rise_samples);
            hash.value(edge.height);
        }
    }
    if let Ok(result) = estimator.result() {
        hash.value(result.samples_per_edge);
        hash.value(result.deviation_samples);
    }
    hash.0
}

#[inline(never)]
fn alias_stage() -> u32 {
    let mut noise = Noise(8);
    let mut hash = Fnv::new();
    for _ in 0..64 {
        let line = 5000.0 * noise.next().abs();
        match alias::explain(line, 293.303, 10_000.0, 20.0, 60) {
            Origin::Genuine(found) => hash.value(found.appears_hz),
            Origin::Folded(found) => {
                hash.word(found.harmonic);
                hash.value(found.appears_hz);
            }
            Origin::Unexplained => hash.word(0),
        }
    }
    hash.0
}

#[inline(never)]
fn decimate_stage() -> u32 {
    let mut samples = signal::<512>(9);
    let count = Cascade::new(4).process(&mut samples);
    Fnv::new().values(samples.get(..count).unwrap_or_default())
}

#[inline(never)]
fn mesh_decimator_stage() -> u32 {
    let mut noise = Noise(10);
    let mut decimator = MeshDecimator::new(Decimation { comb: 7, stages: 3 });
    let mut hash = Fnv::new();
    for _ in 0..24 {
        let codes: [u16; BATCH] = core::array::from_fn(|_| (32_768.0 + 30_000.0 * noise.next()) as u16);
        for &x in decimator.process(&codes, 0.01, 31_000) {
            hash.value(x);
        }
    }
    hash.0
}

#[inline(never)]
fn tach_stage() -> u32 {
    let wheel =
        TachWheel { pulses_per_turn: 12, missing: 1, pinion_per_tach: 2.5, highest: Hertz(80.0), lowest: Hertz(0.5) };
    let mut tach = TachTracker::new(wheel, TicksPerSecond(84_000_000));
    let mut noise = Noise(11);
    let mut hash = Fnv::new();
    let (mut instant, mut gap) = (1u64 << 32, 1_000_000.0f32);
    for position in 0..400u32 {
        // A run-up that levels out, jitter, and now and then a pulse too few or too many.
        gap *= if position < 200 { 0.997 } else { 1.0 };
        instant += gap as u64;
        let jitter = 100.0 * noise.next();
        if position % 12 == 11 || position % 97 == 50 {
            continue;
        }
        tach.on_pulse(instant.saturating_add_signed(jitter as i64));
        if position % 89 == 40 {
            tach.on_pulse(instant + gap as u64 / 3);
        }
        let speed = tach.speed(instant + 1000);
        for value in [speed.pinion.0, speed.uncertainty, speed.acceleration_hz_per_s, speed.pulse_error] {
            hash.value(value);
        }
        hash.word(speed.validity as u32);
    }
    hash.0
}
