//! The latest samples of a long time in little memory: blocks with a common exponent, the oldest overwritten.
//!
//! Core-coupled memory beside the stack has room for 21 KB. Two seconds at 10 kHz and more therefore get little over
//! eight bits a sample: 32 samples share a power of two, each is a signed byte times it. The error is at most 1/127
//! of the largest of its block and 1/32 of a 16-bit code; against the same samples at 12 bits a loud block is
//! coarser, a quiet one finer, since decimated samples are finer than the converter's steps. The whole of the
//! converter's range is held.
//!
//! RAM: 33 bytes per 32 samples. Cost: 6 instructions per sample.

use crate::math;

/// Samples of a block.
pub const BLOCK: usize = 32;
/// Bytes of a block: its exponent, then its samples.
pub const BLOCK_BYTES: usize = BLOCK + 1;
/// Blocks held: 2 s at 10.24 kHz.
pub const BLOCKS: usize = 640;
/// Units of the samples per code of 16 bit.
pub const UNITS_PER_CODE: f32 = 16.0;

/// A block as it is held.
pub type Coded = [u8; BLOCK_BYTES];

/// Codes a block: exponent, then signed bytes. `samples` are codes about zero.
// Inline, as all that runs seldom here: an image then compiles it for size, as it does its own code, and not for speed.
#[inline]
pub fn encode(samples: &[f32; BLOCK]) -> Coded {
    let largest = samples.iter().fold(0u32, |largest, &sample| largest.max(unit(sample).unsigned_abs()));
    let mut exponent = 0u8;
    while (largest + half(exponent) as u32) >> exponent > 127 {
        exponent += 1;
    }
    let mut coded = [exponent; BLOCK_BYTES];
    for (place, &sample) in coded.iter_mut().skip(1).zip(samples) {
        *place = ((unit(sample) + half(exponent)) >> exponent) as i8 as u8;
    }
    coded
}

/// A sample in units.
#[inline]
fn unit(sample: f32) -> i32 {
    math::round(sample * UNITS_PER_CODE) as i32
}

/// Samples of a block, in units of 1/[`UNITS_PER_CODE`] of a code.
pub fn decode(coded: &Coded) -> [i32; BLOCK] {
    core::array::from_fn(|place| decode_one(coded, place))
}

/// One of them; 0 behind the end.
pub fn decode_one(coded: &Coded, place: usize) -> i32 {
    let exponent = coded[0].min(24);
    coded.get(1 + place).map_or(0, |&sample| i32::from(sample as i8) << exponent)
}

fn half(exponent: u8) -> i32 {
    (1 << exponent) >> 1
}

/// The latest samples.
#[derive(Clone, Debug)]
pub struct SampleRing {
    blocks: [Coded; BLOCKS],
    next: usize,
    held: usize,
    waiting: [f32; BLOCK],
    waits: usize,
}

impl SampleRing {
    /// Without samples.
    pub const EMPTY: Self =
        Self { blocks: [[0; BLOCK_BYTES]; BLOCKS], next: 0, held: 0, waiting: [0.0; BLOCK], waits: 0 };

    /// Forgets all samples.
    pub fn clear(&mut self) {
        (self.next, self.held, self.waits) = (0, 0, 0);
    }

    /// Takes a sample, in codes; true when a block has become complete.
    #[inline]
    pub fn push(&mut self, sample: f32) -> bool {
        if let Some(place) = self.waiting.get_mut(self.waits) {
            *place = sample;
        }
        self.waits += 1;
        if self.waits < BLOCK {
            return false;
        }
        self.waits = 0;
        if let Some(block) = self.blocks.get_mut(self.next) {
            *block = encode(&self.waiting);
        }
        self.next = (self.next + 1) % BLOCKS;
        self.held = (self.held + 1).min(BLOCKS);
        true
    }

    /// Complete blocks held.
    pub fn held(&self) -> usize {
        self.held
    }

    /// Samples that do not make a block yet.
    pub fn waiting(&self) -> usize {
        self.waits
    }

    /// A block by its age, the oldest first.
    pub fn block(&self, index: usize) -> Option<&Coded> {
        if index >= self.held {
            return None;
        }
        self.blocks.get((self.next + BLOCKS - self.held + index) % BLOCKS)
    }
}
