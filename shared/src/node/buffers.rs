//! The node's large memory, apart from its state.
//!
//! [`Buffers`] are all zero at the start: a static of this type lies in .bss, costs no flash and no start-up time,
//! and is never on the stack. [`Capture`], which no more RAM than this is left for, lies where a board has other
//! memory. The node itself is a few KiB that may be moved.
//!
//! RAM: order tracking 32 KiB, mesh bands 12 bytes per point and harmonic, average 8 KiB, wideband record 16 KiB, kept
//! snapshot 8 KiB, spectrum to be sent 1 KiB; the sum is asserted below.

use crate::capture::Capture;
use crate::mesh_band::Chain;
use crate::message::Spectrum;
use crate::sample_ring::SampleRing;
use crate::stream::WIDE_POINTS;
use core::borrow::BorrowMut;

/// Order chain, wideband record and snapshot.
#[derive(Clone, Debug)]
pub struct Buffers {
    pub(crate) chain: Chain,
    pub(crate) wide: [f32; WIDE_POINTS],
    pub(crate) snapshot: [i16; WIDE_POINTS],
    pub(crate) outgoing: OutgoingSpectrum,
}

/// The newest mesh-band spectrum until it is sent: a kilobyte that is nothing for the stack.
#[derive(Clone, Debug)]
pub struct OutgoingSpectrum {
    pub(crate) spectrum: Spectrum,
    /// Gear that it is of: 0 the pinion.
    pub(crate) gear: u8,
    pub(crate) waits: bool,
}

impl Buffers {
    /// Empty buffers, all zero bytes.
    pub const ZERO: Self = Self {
        chain: Chain::IDLE,
        wide: [0.0; WIDE_POINTS],
        snapshot: [0; WIDE_POINTS],
        outgoing: OutgoingSpectrum { spectrum: Spectrum::EMPTY, gear: 0, waits: false },
    };

    /// The order chain, to be run without a node.
    pub fn chain(&mut self) -> &mut Chain {
        &mut self.chain
    }
}

/// Most bytes of [`Buffers`].
pub const BUDGET: usize = 88 * 1024;

/// Most bytes of [`Capture`] with its samples.
const CAPTURE_BUDGET: usize = 25 * 1024;

const _: () = assert!(core::mem::size_of::<Buffers>() <= BUDGET);
const _: () = assert!(core::mem::size_of::<Capture>() <= CAPTURE_BUDGET);

/// Where a node's arrays lie.
pub trait Arrays {
    /// How the samples of waveforms are held.
    type Ring: BorrowMut<SampleRing>;

    /// All of them.
    fn parts(&mut self) -> (&mut Buffers, &mut Capture<Self::Ring>);

    /// What the products are made in.
    fn buffers(&self) -> &Buffers;

    /// Waveforms.
    fn capture(&self) -> &Capture<Self::Ring>;

    /// What the products are made in.
    fn buffers_mut(&mut self) -> &mut Buffers {
        self.parts().0
    }

    /// Waveforms.
    fn capture_mut(&mut self) -> &mut Capture<Self::Ring> {
        self.parts().1
    }
}

/// Arrays of a node's own.
#[derive(Clone, Debug)]
pub struct OwnArrays {
    buffers: Buffers,
    capture: Capture,
}

impl OwnArrays {
    /// Empty arrays.
    pub fn new() -> Self {
        Self { buffers: Buffers::ZERO, capture: Capture::new(SampleRing::EMPTY) }
    }
}

impl Default for OwnArrays {
    fn default() -> Self {
        Self::new()
    }
}

impl Arrays for OwnArrays {
    type Ring = SampleRing;

    fn parts(&mut self) -> (&mut Buffers, &mut Capture) {
        (&mut self.buffers, &mut self.capture)
    }

    fn buffers(&self) -> &Buffers {
        &self.buffers
    }

    fn capture(&self) -> &Capture {
        &self.capture
    }
}

/// Arrays in statics of a board.
#[derive(Debug)]
pub struct LentArrays<'a> {
    /// What the products are made in.
    pub buffers: &'a mut Buffers,
    /// Waveforms.
    pub capture: &'a mut Capture<&'static mut SampleRing>,
}

impl Arrays for LentArrays<'_> {
    type Ring = &'static mut SampleRing;

    fn parts(&mut self) -> (&mut Buffers, &mut Capture<&'static mut SampleRing>) {
        (self.buffers, self.capture)
    }

    fn buffers(&self) -> &Buffers {
        self.buffers
    }

    fn capture(&self) -> &Capture<&'static mut SampleRing> {
        self.capture
    }
}
