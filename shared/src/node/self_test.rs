//! Self-test on the live inputs: does the converter really run at the timer's rate, does it move, is there a tach,
//! and does the signal chain still give the recorded result.
//!
//! Converters that run freely instead of by trigger, or miss triggers, give plausible spectra at wrong frequencies; so
//! [`BLOCKS`] blocks are counted against a clock read independently at their arrival. Blocks that a busy processor
//! lost were sampled too; their sequence numbers say how many. The test runs beside the measurement and costs it
//! nothing.
//!
//! An item has passed, failed, or not yet run. What fails is looked at again every [`BLOCKS`] blocks until it passes.
//! A sensor that has just been switched on lies at its rail for seconds: rails and noise fail only after
//! [`SETTLING_S`]. A machine that stands gives no tach edge, which tells nothing: that item runs with the first edge
//! and cannot fail; the node's state says that there is no speed. When things happen depends on the blocks alone, so
//! the result comes at the same block wherever the node runs.
//!
//! The mathematics hold the processor for longer than a block, and blocks that waited for it arrive faster than they
//! were sampled: counting begins once none waits. For the same reason a test is not begun anew within [`APART_S`].

use crate::config::CodeRange;
use crate::decimate::Cascade;
use crate::frame::CRC32;
use crate::message::SelfTest;
use crate::node::Block;
use crate::stream::WIDE_POINTS;
use crate::units::TicksPerSecond;
use crate::window::Window;

/// Sample count against the timer.
pub const SAMPLE_COUNT: u8 = 1 << 0;
/// Codes at the converter's rails.
pub const RAILS: u8 = 1 << 1;
/// Codes that never move.
pub const NOISE: u8 = 1 << 2;
/// A tach edge came; not run until then.
pub const TACH: u8 = 1 << 3;
/// The signal chain's result differs from the recorded one.
pub const MATHEMATICS: u8 = 1 << 4;

/// Blocks looked at together.
pub const BLOCKS: u32 = 32;
/// Blocks after which counting begins even where the newest one waited.
pub const MAX_WAITING_BLOCKS: u32 = 64;
/// Seconds from one test on request to the next.
pub const APART_S: u64 = 1;
/// Seconds that a sensor may lie at its rail after the start.
pub const SETTLING_S: u64 = 5;
/// Largest relative difference of the sample count from the timer's; covers the main loop's latency.
const TOLERANCE_PERCENT: u64 = 10;

/// What [`BLOCKS`] blocks show.
#[derive(Clone, Copy, Debug)]
struct Stretch {
    blocks: u32,
    /// Ticks that the samples stand for, and that passed by the clock.
    sampled: u64,
    passed: u64,
    codes: u32,
    railed: u32,
    lowest: u16,
    highest: u16,
}

impl Stretch {
    const NONE: Self = Self { blocks: 0, sampled: 0, passed: 0, codes: 0, railed: 0, lowest: u16::MAX, highest: 0 };
}

/// The test while it runs.
#[derive(Clone, Debug)]
pub struct SelfTestRun {
    result: SelfTest,
    /// Ticks until a sensor must have settled.
    settling: u64,
    stretch: Stretch,
    /// Arrival and sequence of the block before.
    before: Option<(u32, u32)>,
    /// Blocks left that are not counted as long as they arrive late.
    waiting: u32,
    /// Ticks since a request began the test.
    age: u64,
    edge: bool,
    /// Codes that are not at a rail, in force.
    range: CodeRange,
}

impl SelfTestRun {
    /// The test at the start of a node; `mathematics`: [`crate::node::Node::check_mathematics`].
    pub fn at_start(clock: TicksPerSecond, mathematics: bool) -> Self {
        Self { settling: u64::from(clock.0) * SETTLING_S, age: u64::MAX, ..Self::again(mathematics) }
    }

    /// The test on request: nothing has to settle.
    pub fn again(mathematics: bool) -> Self {
        let failed = if mathematics { 0 } else { MATHEMATICS };
        let result = SelfTest { run: MATHEMATICS, failed };
        let (stretch, range) = (Stretch::NONE, CodeRange::default().in_force());
        Self { result, settling: 0, stretch, before: None, waiting: MAX_WAITING_BLOCKS, age: 0, edge: false, range }
    }

    /// The same with the codes of a front end.
    pub fn with_range(self, range: CodeRange) -> Self {
        Self { range: range.in_force(), ..self }
    }

    /// Whether the last request's test was begun so recently that this one's is the same.
    pub fn is_recent(&self, clock: TicksPerSecond) -> bool {
        self.age < u64::from(clock.0) * APART_S
    }

    /// What is known so far.
    pub fn result(&self) -> SelfTest {
        self.result
    }

    /// A tach edge came.
    pub fn on_edge(&mut self) {
        self.edge = true;
    }

    /// A block came at `now_tick`; gives the result whenever it has changed.
    pub fn on_block(&mut self, block: &Block<'_>, now_tick: u32) -> Option<SelfTest> {
        let before = self.result;
        let ticks = block.period_ticks.saturating_mul(block.codes.len() as u32);
        self.age = self.age.saturating_add(u64::from(ticks));
        if self.edge {
            self.judge(TACH, true);
        }
        let open = SAMPLE_COUNT | RAILS | NOISE;
        // The clock may be read a little before the block's end.
        let is_late = now_tick.wrapping_sub(block.end_tick()).cast_signed() > ticks.cast_signed();
        if self.waiting > 0 {
            self.waiting = if is_late { self.waiting - 1 } else { 0 };
        }
        if self.waiting == 0 && self.result.run & !self.result.failed & open != open {
            self.look(block, now_tick, is_late);
        }
        (self.result != before).then_some(self.result)
    }

    fn look(&mut self, block: &Block<'_>, now_tick: u32, is_late: bool) {
        let stretch = &mut self.stretch;
        if let Some((arrived, sequence)) = self.before {
            let blocks = block.sequence.wrapping_sub(sequence);
            let ticks = u64::from(block.period_ticks) * block.codes.len() as u64 * u64::from(blocks);
            stretch.sampled += ticks;
            stretch.passed += u64::from(now_tick.wrapping_sub(arrived));
            self.settling = self.settling.saturating_sub(ticks);
        }
        self.before = Some((now_tick, block.sequence));
        for &code in block.codes {
            stretch.railed += u32::from(self.range.is_beyond(code));
            stretch.lowest = stretch.lowest.min(code);
            stretch.highest = stretch.highest.max(code);
        }
        stretch.codes = stretch.codes.saturating_add(block.codes.len() as u32);
        stretch.blocks += 1;
        // A stretch ends, as it begins, with a block that was not kept waiting by other work.
        if stretch.blocks < BLOCKS || (is_late && stretch.blocks < BLOCKS + MAX_WAITING_BLOCKS) {
            return;
        }
        let Stretch { sampled, passed, codes, railed, lowest, highest, .. } =
            core::mem::replace(stretch, Stretch::NONE);
        self.judge(SAMPLE_COUNT, sampled.abs_diff(passed) * 100 <= passed * TOLERANCE_PERCENT);
        for (item, sound) in [(RAILS, railed <= codes / 100), (NOISE, lowest < highest)] {
            if sound || self.settling == 0 {
                self.judge(item, sound);
            }
        }
    }

    fn judge(&mut self, item: u8, sound: bool) {
        self.result.run |= item;
        self.result.failed = if sound { self.result.failed & !item } else { self.result.failed | item };
    }
}

/// CRC-32 that [`mathematics`] must give on every target.
pub const MATHEMATICS_HASH: u32 = 0x0650_11b0;

/// CRC-32 over the bits of a fixed pseudo-random record's spectrum: half-band cascade, window and the 4096-point
/// transform that the node's own records go through, with their coefficients as they lie in the memory. `work` is
/// overwritten.
///
/// Cost: 1.1 M instructions, 7 ms at 168 MHz.
pub fn mathematics(work: &mut [f32; WIDE_POINTS]) -> u32 {
    let mut state = 1u32;
    let mut cascade = Cascade::new(3);
    // Filtered in place, run by run; what the cascade leaves goes back over the front of its run, the rest stays noise.
    for run in work.chunks_mut(128) {
        for x in run.iter_mut() {
            // Marsaglia's xorshift.
            state ^= state << 13;
            state ^= state >> 17;
            state ^= state << 5;
            *x = (state as i32) as f32 * (1.0 / 2_147_483_648.0);
        }
        cascade.process(run);
    }
    Window::BlackmanHarris.apply(work, 0.0);
    let _ = microfft::real::rfft_4096(work);
    let mut digest = CRC32.digest();
    for x in work.iter() {
        digest.update(&x.to_bits().to_le_bytes());
    }
    digest.finalize()
}
