//! DMA: the converters' double buffers, and what all streams share.
//!
//! Double-buffer mode: while one buffer fills, the other's address may be exchanged, so each block lands in a buffer
//! of its own and nothing is copied. RM0090 section 10.

pub use crate::pac::dma2::{RegisterBlock, ST as Stream};

/// A stream of DMA2 that serves a converter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ConverterStream {
    /// Number of the stream.
    pub number: usize,
    /// Request channel.
    channel: u8,
    /// Of four, 3 highest.
    priority: u8,
    /// A complete buffer asks for an interrupt.
    interrupts: bool,
}

/// That of ADC3.
pub const ADC3_STREAM: ConverterStream = ConverterStream { number: 0, channel: 2, priority: 2, interrupts: true };
/// That of ADC2. Both converters ask at the same instant; this one is served first, so that behind the other one's
/// interrupt both buffers are complete.
pub const ADC2_STREAM: ConverterStream = ConverterStream { number: 3, channel: 1, priority: 3, interrupts: false };
/// Polls until a stream has stopped; the last transfer takes some tens of clocks.
const PATIENCE: u32 = 10_000;

/// Which of the two buffers a stream works on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Target {
    /// The one at M0AR.
    Memory0,
    /// The one at M1AR.
    Memory1,
}

impl Target {
    /// The other one.
    pub const fn other(self) -> Self {
        match self {
            Target::Memory0 => Target::Memory1,
            Target::Memory1 => Target::Memory0,
        }
    }
}

/// Status of a stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Flags {
    /// A buffer is complete.
    pub complete: bool,
    /// The bus refused a transfer; the stream has stopped.
    pub error: bool,
}

/// Stops a stream and waits, bounded, until it has.
pub fn stop(stream: &Stream) {
    stream.cr().modify(|_, w| w.en().disabled());
    for _ in 0..PATIENCE {
        if stream.cr().read().en().is_disabled() {
            return;
        }
    }
}

/// Bit position of a stream's flags in its status register.
const fn shift(stream: usize) -> u32 {
    // Streams 0 to 3 and 4 to 7 lie alike at 0, 6, 16, 22.
    match stream & 3 {
        0 => 0,
        1 => 6,
        2 => 16,
        _ => 22,
    }
}

/// Clears all flags of a stream.
pub fn clear_flags(dma: &RegisterBlock, stream: usize) {
    let bits = 0b11_1101 << shift(stream);
    // SAFETY: ones at this stream's flags clear them; the rest ignores zeros.
    unsafe {
        if stream < 4 {
            dma.lifcr().write(|w| w.bits(bits));
        } else {
            dma.hifcr().write(|w| w.bits(bits));
        }
    }
}

/// Reads a stream's flags and clears them.
pub fn take_flags(dma: &RegisterBlock, stream: usize) -> Flags {
    let status = if stream < 4 { dma.lisr().read().bits() } else { dma.hisr().read().bits() } >> shift(stream);
    clear_flags(dma, stream);
    Flags { complete: status & (1 << 5) != 0, error: status & ((1 << 3) | (1 << 2)) != 0 }
}

/// Stops a stream and names its two ends and the number of transfers; what is left is its control register.
///
/// # Safety
/// `register` must be the one of the device that will request the transfers, and `memory` of `count` items in what
/// the DMA reaches: writable, or unchanged until the stream is idle.
#[inline(always)]
pub unsafe fn prepare(dma: &RegisterBlock, number: usize, register: u32, memory: u32, count: u16) -> &Stream {
    let stream = dma.st(number);
    stop(stream);
    clear_flags(dma, number);
    // SAFETY: passed on to the caller.
    unsafe {
        stream.par().write(|w| w.pa().bits(register));
        stream.m0ar().write(|w| w.m0a().bits(memory));
    }
    stream.ndtr().write(|w| w.ndt().set(count));
    stream.fcr().write(|w| w.dmdis().enabled());
    stream
}

/// Starts a converter's double buffer: `samples` half-words each.
///
/// # Safety
/// `data_register` must be the data register of the stream's converter; both buffers must be writable memory of
/// `samples` half-words that DMA2 reaches, and nobody else may use a buffer while it is the stream's target.
// Inlined, so that the stream's number is a constant and no check of it is left.
#[inline(always)]
pub unsafe fn start_double_buffer(
    dma2: &RegisterBlock,
    of: ConverterStream,
    data_register: u32,
    buffers: [u32; 2],
    samples: u16,
) {
    // SAFETY: passed on to the caller.
    let stream = unsafe { prepare(dma2, of.number, data_register, buffers[0], samples) };
    // SAFETY: as above.
    stream.m1ar().write(|w| unsafe { w.m1a().bits(buffers[1]) });
    stream.cr().write(|w| {
        let w = w.chsel().set(of.channel).pl().set(of.priority).dbm().enabled().circ().enabled();
        let w = w.dir().peripheral_to_memory().minc().incremented().pinc().fixed();
        w.psize().bits16().msize().bits16().tcie().bit(of.interrupts).teie().bit(of.interrupts)
    });
    stream.cr().modify(|_, w| w.en().enabled());
}

/// The buffer that is filling now; the other one is complete.
pub fn target(stream: &Stream) -> Target {
    if stream.cr().read().ct().bit_is_set() { Target::Memory1 } else { Target::Memory0 }
}

/// Exchanges the address of the buffer that is not filling.
///
/// # Safety
/// `buffer` as for [`start_double_buffer`]; `idle` must not be the stream's target.
pub unsafe fn exchange(stream: &Stream, idle: Target, buffer: u32) {
    // SAFETY: passed on to the caller.
    unsafe {
        match idle {
            Target::Memory0 => stream.m0ar().write(|w| w.m0a().bits(buffer)),
            Target::Memory1 => stream.m1ar().write(|w| w.m1a().bits(buffer)),
        };
    }
}
