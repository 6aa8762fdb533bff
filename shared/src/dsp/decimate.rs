//! Half-band decimation by 2^k: a cascade of symmetric FIR stages in f32.
//!
//! Usable band: 1/2.56 of the output rate. The stage next to the output needs the steepest transition (55 taps, 14
//! distinct), the one before it 5 distinct taps, all earlier ones 3. Half-band symmetry makes every other tap zero and
//! the pass-band ripple equal to the stop-band ripple: stop band -95 dB, ripple 0.0002 dB, single-precision noise
//! lower. Design: Kaiser window for the last stage, equiripple for the others, taps normalised to unit gain at zero
//! frequency. The taps are linear-phase; the group delay is exact and kept in ADC samples so that a sample can be
//! related to the tach's angle. The mesh bands need much less and have [`crate::mesh_decimator`].
//!
//! Cost (Cortex-M4F in QEMU): see `tests/snapshots/instructions.txt`.

/// Most stages of a cascade.
pub const MAX_STAGES: usize = 10;

// Nine digits as designed; the nearest f32 is what counts.
#[allow(clippy::excessive_precision)]
const LAST_TAPS: [f32; 14] = [
    0.316_471_6,
    -0.100_698_16,
    0.055_016_434,
    -0.034_086_317,
    0.021_855_613,
    -0.013_964_078,
    0.008_699_519,
    -0.005_199_257_6,
    0.002_935_070_4,
    -0.001_536_985_7,
    0.000_728_172_63,
    -0.000_299_704_48,
    9.888_446_4e-5,
    -2.079_222_8e-5,
];
#[allow(clippy::excessive_precision)]
const SECOND_TAPS: [f32; 5] = [0.305_888_96, -0.073_738_904, 0.022_366_794, -0.005_150_751_9, 0.000_633_900_33];
#[allow(clippy::excessive_precision)]
const EARLY_TAPS: [f32; 3] = [0.294_336_17, -0.050_931_306, 0.006_595_134_7];

/// Pairs of samples filtered in one go.
const RUN: usize = 64;
/// Side and centre samples kept by the longest stage.
const LONGEST_SIDE: usize = 28;
const LONGEST_CENTRE: usize = 14;

/// Work space of a stage; its content is never read. Kept by the owner because clearing it would cost a third of a run.
#[derive(Clone, Debug)]
pub(crate) struct Scratch {
    side: [f32; LONGEST_SIDE + RUN],
    centre: [f32; LONGEST_CENTRE + RUN],
}

impl Scratch {
    pub(crate) const ZEROS: Self = Self { side: [0.0; LONGEST_SIDE + RUN], centre: [0.0; LONGEST_CENTRE + RUN] };
}

/// One half-band stage with `M` distinct non-zero side taps; `W` is `2 M`.
///
/// A run of samples is parted into those under the side taps and those on their way to the centre tap, each behind its
/// history in one piece, so that the sums need no ring and their lengths are known to the compiler.
#[derive(Clone, Debug)]
pub(crate) struct HalfBand<const M: usize, const W: usize> {
    taps: &'static [f32; M],
    /// Newest samples under the side taps.
    side: [f32; W],
    /// Newest samples on their way to the centre tap.
    centre: [f32; M],
    /// First sample of an incomplete pair.
    held: Option<f32>,
}

impl<const M: usize, const W: usize> HalfBand<M, W> {
    pub(crate) const fn new(taps: &'static [f32; M]) -> Self {
        Self { taps, side: [0.0; W], centre: [0.0; M], held: None }
    }

    fn reset(&mut self) {
        *self = Self::new(self.taps);
    }

    /// Group delay in input samples, counted from the second sample of the newest pair.
    pub(crate) const DELAY: u32 = 2 * M as u32 - 1;

    /// Filters in place and returns the number of outputs.
    pub(crate) fn process(&mut self, samples: &mut [f32], scratch: &mut Scratch) -> usize {
        let (mut taken, mut outputs) = (0, 0);
        while let Some((used, made)) = self.run(samples, taken, outputs, scratch) {
            (taken, outputs) = (taken + used, outputs + made);
        }
        outputs
    }

    /// Filters up to [`RUN`] pairs from `samples[taken..]` to `samples[outputs..]`; samples used and outputs made.
    /// `None` at the end; a sample without partner is held. All places exist: asking is cheaper than a panic path.
    fn run(
        &mut self,
        samples: &mut [f32],
        taken: usize,
        outputs: usize,
        scratch: &mut Scratch,
    ) -> Option<(usize, usize)> {
        let fresh = samples.get(taken..).filter(|fresh| !fresh.is_empty())?;
        let Scratch { side, centre } = scratch;
        *side.first_chunk_mut::<W>()? = self.side;
        *centre.first_chunk_mut::<M>()? = self.centre;
        let mut start = 0;
        if let Some(first) = self.held.take() {
            (*centre.get_mut(M)?, *side.get_mut(W)?) = (first, *fresh.first()?);
            start = 1;
        }
        let whole = ((fresh.len() - start) / 2).min(RUN - start);
        let (older, newer) = (centre.get_mut(M + start..)?.iter_mut(), side.get_mut(W + start..)?.iter_mut());
        // The newest sample of a pair meets the outermost side tap, the older one the centre branch.
        for (pair, (older, newer)) in fresh.get(start..start + 2 * whole)?.chunks_exact(2).zip(older.zip(newer)) {
            (*older, *newer) = (*pair.first()?, *pair.last()?);
        }
        let pairs = start + whole;
        if pairs == 0 {
            self.held = fresh.first().copied();
            return None;
        }
        let middle = centre.get(1..=pairs)?;
        let windows = side.get(1..W + pairs)?.windows(W);
        for ((output, &middle), window) in
            samples.get_mut(outputs..outputs + pairs)?.iter_mut().zip(middle).zip(windows)
        {
            *output = self.sum(middle, window);
        }
        self.side = *side.get(pairs..)?.first_chunk::<W>()?;
        self.centre = *centre.get(pairs..)?.first_chunk::<M>()?;
        Some((start + 2 * whole, pairs))
    }

    #[inline]
    fn sum(&self, middle: f32, window: &[f32]) -> f32 {
        let mut sum = 0.5 * middle;
        if let Some(window) = window.first_chunk::<W>() {
            for tap in 0..M {
                sum += self.taps[tap] * (window[M - 1 - tap] + window[M + tap]);
            }
        }
        sum
    }
}

/// Decimation by 2^k, k from 0 to [`MAX_STAGES`].
#[derive(Clone, Debug)]
pub struct Cascade {
    stages: usize,
    early: [HalfBand<3, 6>; MAX_STAGES - 2],
    second: HalfBand<5, 10>,
    last: HalfBand<14, 28>,
    scratch: Scratch,
}

impl Cascade {
    /// A cascade of `stages` half-band stages, limited to [`MAX_STAGES`].
    pub fn new(stages: u8) -> Self {
        Self {
            stages: usize::from(stages).min(MAX_STAGES),
            early: [const { HalfBand::new(&EARLY_TAPS) }; MAX_STAGES - 2],
            second: HalfBand::new(&SECOND_TAPS),
            last: HalfBand::new(&LAST_TAPS),
            scratch: Scratch::ZEROS,
        }
    }

    /// Changes the number of stages and forgets all samples.
    pub fn restart(&mut self, stages: u8) {
        self.stages = usize::from(stages).min(MAX_STAGES);
        self.early.iter_mut().for_each(HalfBand::reset);
        self.second.reset();
        self.last.reset();
    }

    /// Number of stages.
    pub fn stages(&self) -> u8 {
        self.stages as u8
    }

    /// Filters in place; the outputs are `samples[..returned]`.
    pub fn process(&mut self, samples: &mut [f32]) -> usize {
        let mut count = samples.len();
        for stage in self.early.iter_mut().take(self.stages.saturating_sub(2)) {
            count = stage.process(samples.get_mut(..count).unwrap_or_default(), &mut self.scratch);
        }
        if self.stages >= 2 {
            count = self.second.process(samples.get_mut(..count).unwrap_or_default(), &mut self.scratch);
        }
        if self.stages >= 1 {
            count = self.last.process(samples.get_mut(..count).unwrap_or_default(), &mut self.scratch);
        }
        count
    }

    /// Input samples between the instant an output describes and the newest input sample it needed.
    pub fn delay_samples(&self) -> u32 {
        let early = self.stages.saturating_sub(2) as u32;
        let mut delay = HalfBand::<3, 6>::DELAY * ((1 << early) - 1);
        if self.stages >= 2 {
            delay += HalfBand::<5, 10>::DELAY << early;
        }
        if self.stages >= 1 {
            delay += HalfBand::<14, 28>::DELAY << (self.stages as u32 - 1);
        }
        delay
    }

    /// Outputs after a restart that still see the zeros before it.
    pub fn settling_outputs(&self) -> u32 {
        if self.stages == 0 { 0 } else { ((2 * self.delay_samples()) >> self.stages) + 2 }
    }
}
