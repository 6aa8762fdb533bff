//! The node's large memory, apart from its state.
//!
//! All arrays, all zero at the start: a static of this type lies in .bss, costs no flash and no start-up time, and is
//! never on the stack. The node itself is a few KiB that may be moved.
//!
//! RAM: order tracking 32 KiB, mesh bands 12 bytes per point and harmonic, average 8 KiB, wideband record 16 KiB, kept
//! snapshot 8 KiB; the sum is asserted below.

use crate::mesh_band::Chain;
use crate::stream::WIDE_POINTS;

/// Order chain, wideband record and snapshot.
#[derive(Clone, Debug)]
pub struct Buffers {
    pub(crate) chain: Chain,
    pub(crate) wide: [f32; WIDE_POINTS],
    pub(crate) snapshot: [i16; WIDE_POINTS],
}

impl Buffers {
    /// Empty buffers, all zero bytes.
    pub const ZERO: Self = Self { chain: Chain::IDLE, wide: [0.0; WIDE_POINTS], snapshot: [0; WIDE_POINTS] };

    /// The order chain, to be run without a node.
    pub fn chain(&mut self) -> &mut Chain {
        &mut self.chain
    }
}

/// Most bytes of [`Buffers`].
pub const BUDGET: usize = 87 * 1024;

const _: () = assert!(core::mem::size_of::<Buffers>() <= BUDGET);
