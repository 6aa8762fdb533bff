//! From ADC codes to the low rate of the mesh bands: a comb, short half-band stages, and the comb's droop undone.
//!
//! The bands fill little of the rate they come at, so nothing steep is needed anywhere: the [`Comb`] takes the rate
//! down to four (or eight, sixteen, ...) times the wanted one with four additions per code, half-band stages of 4
//! distinct taps follow, one of 7 at the end. The wanted band ends at [`BAND_SHARE`] of the output rate; only what
//! would fold into *it* is kept out, by 90 dB at least: comb -90 dB, early stages -109 dB, last -99 dB (equiripple
//! designs). Above the band the output is neither flat nor free of aliases; the order chain's filter bank does not
//! look there.
//!
//! The comb's ratio is any integer up to 16, so that the output rate fits the speed to a few per cent where octaves
//! would waste up to half of it, and everything behind it runs that much slower.
//!
//! The droop (at most 0.3 dB) is undone by 5 symmetric taps at the output rate, exact at two frequencies of the band.
//! All parts have linear phase; the delay is exact in ADC samples.
//!
//! Cost (Cortex-M4F in QEMU): 10 to 15 instructions per code in all. RAM: 2.6 KiB.

use crate::comb::{Comb, HIGHEST_RATIO, MOST_CODES};
use crate::decimate::{HalfBand, Scratch};
use crate::math;

/// Upper edge of the wanted band over the output rate.
pub const BAND_SHARE: f32 = 0.27;
/// Most codes per call, and outputs of the comb that are filtered in one go: a stage costs the same 200 instructions
/// for one.
pub const BATCH: usize = MOST_CODES;
/// Lowest ratio of a comb that only two half-band stages follow.
const LOWEST_RATIO: u32 = 6;
/// Most half-band stages.
pub const MAX_STAGES: u8 = 7;

#[allow(clippy::excessive_precision)]
const EARLY_TAPS: [f32; 4] = [0.301_111_09, -0.063_601_301, 0.014_208_960, -0.001_718_749_1];
#[allow(clippy::excessive_precision)]
const LAST_TAPS: [f32; 7] =
    [0.311_453_67, -0.087_079_728, 0.036_405_952, -0.014_720_227, 0.005_039_463_0, -0.001_288_373_9, 0.000_189_243_12];

/// How far to decimate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Decimation {
    /// The comb's ratio, 1 to 16. A small one needs more half-band stages behind it: see [`Decimation::up_to`].
    pub comb: u8,
    /// Half-band stages, up to [`MAX_STAGES`].
    pub stages: u8,
}

impl Decimation {
    /// None at all.
    pub const NONE: Self = Self { comb: 1, stages: 0 };
    /// As far as it goes.
    pub const MAXIMUM: Self = Self { comb: HIGHEST_RATIO as u8, stages: MAX_STAGES };

    /// ADC samples per output.
    pub fn ratio(self) -> u32 {
        u32::from(self.comb) << self.stages
    }

    /// The largest ratio up to `wanted`, with as few half-band stages as the comb's aliases allow: two behind a ratio
    /// of at least 6 (shorter sums have higher side lobes), three behind any other.
    pub fn up_to(wanted: f32) -> Self {
        let mut best = Self { comb: 1, stages: u8::from(wanted >= 2.0) };
        for stages in 2..=MAX_STAGES {
            let comb = (wanted / (1u32 << stages) as f32) as u32;
            let comb = match comb {
                0 => break,
                2..LOWEST_RATIO if stages < 3 => 1,
                // Those the comb has code of their own for.
                11.. => comb.min(HIGHEST_RATIO) & !1,
                comb => comb,
            };
            let next = Self { comb: comb as u8, stages };
            if next.ratio() > best.ratio() {
                best = next;
            }
        }
        best
    }
}

/// Comb, half-band stages and equaliser with their memory.
#[derive(Clone, Debug)]
pub struct MeshDecimator {
    decimation: Decimation,
    comb: Comb,
    early: [HalfBand<4, 8>; MAX_STAGES as usize - 1],
    last: HalfBand<7, 14>,
    equaliser: Equaliser,
    scratch: Scratch,
    /// Outputs of the comb that wait until it pays to filter them.
    waiting: [f32; 2 * BATCH],
    waits: usize,
}

impl MeshDecimator {
    /// Without samples.
    pub fn new(decimation: Decimation) -> Self {
        let decimation = Decimation { stages: decimation.stages.min(MAX_STAGES), ..decimation };
        Self {
            decimation,
            comb: Comb::new(u32::from(decimation.comb)),
            early: [const { HalfBand::new(&EARLY_TAPS) }; MAX_STAGES as usize - 1],
            last: HalfBand::new(&LAST_TAPS),
            equaliser: Equaliser::new(decimation),
            scratch: Scratch::ZEROS,
            waiting: [0.0; 2 * BATCH],
            waits: 0,
        }
    }

    /// Decimation in force.
    pub fn decimation(&self) -> Decimation {
        self.decimation
    }

    /// Filters codes, [`BATCH`] at most. Outputs come in bursts, in order; the slice is good until the next call.
    pub fn process(&mut self, codes: &[u16], per_code: f32, zero: u16) -> &[f32] {
        let codes = codes.get(..BATCH).unwrap_or(codes);
        let room = self.waiting.get_mut(self.waits..).unwrap_or_default();
        self.waits += self.comb.process(codes, per_code, zero, room);
        if self.waits < BATCH {
            return &[];
        }
        let mut count = core::mem::take(&mut self.waits);
        for stage in self.early.iter_mut().take(usize::from(self.decimation.stages).saturating_sub(1)) {
            count = stage.process(self.waiting.get_mut(..count).unwrap_or_default(), &mut self.scratch);
        }
        if self.decimation.stages > 0 {
            count = self.last.process(self.waiting.get_mut(..count).unwrap_or_default(), &mut self.scratch);
        }
        let outputs = self.waiting.get_mut(..count).unwrap_or_default();
        self.equaliser.process(outputs);
        outputs
    }

    /// ADC samples between the instant an output describes and the newest one it needed.
    pub fn delay_samples(&self) -> u32 {
        let half_bands = match self.decimation.stages {
            0 => 0,
            stages => {
                let before_last = 1 << (stages - 1);
                HalfBand::<4, 8>::DELAY * (before_last - 1) + HalfBand::<7, 14>::DELAY * before_last
            }
        };
        self.comb.delay_samples() + self.comb.ratio() * half_bands + Equaliser::DELAY * self.decimation.ratio()
    }

    /// Outputs after a restart that still see the zeros before it.
    pub fn settling_outputs(&self) -> u32 {
        (2 * self.delay_samples()).checked_div(self.decimation.ratio()).unwrap_or(0) + 2
    }
}

/// 5 symmetric taps that undo the comb's droop; a plain delay where there is no comb.
#[derive(Clone, Debug)]
struct Equaliser {
    centre: f32,
    near: f32,
    far: f32,
    /// Newest samples, newest last.
    held: [f32; 4],
}

impl Equaliser {
    /// Delay in samples.
    const DELAY: u32 = 2;
    /// Frequencies at which the droop is undone exactly, turns per sample.
    const EXACT_TURNS_PER_SAMPLE: [f32; 2] = [0.15, 0.26];

    fn new(decimation: Decimation) -> Self {
        let cosine = |turns: f32| math::cos(core::f32::consts::TAU * turns);
        // Gain wanted at each of the two, less one: near (2 - 2 cos w) + far (2 - 2 cos 2w).
        let [[a, b, wanted], [c, d, other]] = Self::EXACT_TURNS_PER_SAMPLE.map(|turns| {
            [2.0 - 2.0 * cosine(turns), 2.0 - 2.0 * cosine(2.0 * turns), 1.0 / comb_gain(decimation, turns) - 1.0]
        });
        let determinant = a * d - b * c;
        let (near, far) = ((wanted * d - b * other) / determinant, (a * other - wanted * c) / determinant);
        Self { centre: 1.0 + 2.0 * (near + far), near: -near, far: -far, held: [0.0; 4] }
    }

    fn process(&mut self, samples: &mut [f32]) {
        for sample in samples {
            let [a, b, c, d] = self.held;
            self.held = [b, c, d, *sample];
            *sample = self.centre * c + self.near * (b + d) + self.far * (a + *sample);
        }
    }
}

/// Gain of the comb at a frequency in turns per output sample: sin(R x) / (R sin x) to the fourth. All arguments are
/// small.
fn comb_gain(decimation: Decimation, turns: f32) -> f32 {
    let x = core::f32::consts::PI * turns / decimation.ratio() as f32;
    let sine_share = |x: f32| 1.0 - x * x / 6.0 * (1.0 - x * x / 20.0);
    let mean = sine_share(f32::from(decimation.comb) * x) / sine_share(x);
    mean * mean * mean * mean
}
