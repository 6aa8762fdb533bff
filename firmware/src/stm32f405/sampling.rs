//! The block interrupt: a complete buffer out, a fresh one in, the next period published.
//!
//! When a rate changes and when a block began is decided by the timers alone; this handler has a whole block's
//! time to read it. It also watches that transfers keep step with triggers; where they do not, or the converter reports an
//! overrun (an interrupt of its own: after one no block would ever be complete), sampling starts anew and the node sees a
//! gap in the sequence, never a shifted block.

use super::{adc_common, adc1, dma1, dma2, tim2, tim3, tim5};
use crate::interrupt_cell::InterruptCell;
use core::ptr;
use core::sync::atomic::{AtomicU32, Ordering, fence};
use heapless::spsc::Producer;
use meshband::pipeline::{Codes, EmptyBuffers, Filled, Request};
use meshband_stm32::block_stamp::{Borders, is_aligned};
use meshband_stm32::dma::{self, Target};
use meshband_stm32::pac::interrupt;
use meshband_stm32::period::reload_of;
use meshband_stm32::{BLOCK_SAMPLES, adc, sample_clock, time_base};

const _: () = assert!(BLOCK_SAMPLES as usize == meshband::pipeline::BLOCK_SAMPLES);

/// The word DMA copies to the sample timer's reload at each border.
static RELOAD: AtomicU32 = AtomicU32::new(0);
static RESTARTS: AtomicU32 = AtomicU32::new(0);
static SAMPLING: InterruptCell<Sampling> = InterruptCell::new();

struct Sampling {
    borders: Borders,
    /// Buffers at the stream's two addresses.
    filling: [&'static mut Codes; 2],
    blocks: Producer<'static, Filled>,
    free: EmptyBuffers,
    request: &'static Request,
}

/// Hands the handler its queues and starts sampling; `None` if there are less than two buffers.
pub fn install(
    period_ticks: u32,
    blocks: Producer<'static, Filled>,
    mut free: EmptyBuffers,
    request: &'static Request,
) -> Option<()> {
    let filling = [free.take()?, free.take()?];
    let mut sampling = Sampling { borders: Borders::starting(period_ticks), filling, blocks, free, request };
    sampling.start();
    // SAFETY: `Board::start` runs once and unmasks the interrupt afterwards.
    unsafe { SAMPLING.install(sampling) };
    Some(())
}

/// Times sampling had to be started anew.
pub fn restarts() -> u32 {
    RESTARTS.load(Ordering::Relaxed)
}

impl Sampling {
    /// Everything from the timers to the first buffer, from a standstill.
    fn start(&mut self) {
        let period = self.borders.published();
        RELOAD.store(reload_of(period), Ordering::Relaxed);
        sample_clock::configure(tim2(), tim3(), period);
        let buffers = self.filling.each_mut().map(|codes| codes.as_mut_ptr() as u32);
        // SAFETY: all addresses are of static memory in SRAM and of the registers named; a buffer leaves `filling`
        // only while it is not the stream's target.
        unsafe {
            sample_clock::configure_reload(dma1(), RELOAD.as_ptr() as u32, ptr::from_ref(tim2().arr()) as u32);
            dma::start_double_buffer(dma2(), ptr::from_ref(adc1().dr()) as u32, buffers, BLOCK_SAMPLES);
        }
        adc::start(adc1(), adc_common());
        // A border captured before does not count.
        let _ = time_base::take_border(tim5());
        sample_clock::start(tim2(), tim3());
    }

    fn restart(&mut self) {
        RESTARTS.fetch_add(1, Ordering::Relaxed);
        sample_clock::stop(tim2(), tim3());
        adc::stop(adc1());
        self.borders.restart();
        self.start();
    }

    fn on_overrun(&mut self) {
        if adc::take_overrun(adc1()) {
            self.restart();
        }
    }

    fn on_interrupt(&mut self) {
        let flags = dma::take_flags(dma2(), dma::ADC_STREAM);
        let stream = dma2().st(dma::ADC_STREAM);
        let counted = sample_clock::counted(tim3());
        let remaining = stream.ndtr().read().ndt().bits();
        if flags.error || adc::take_overrun(adc1()) || !is_aligned(counted, remaining) {
            self.restart();
            return;
        }
        if !flags.complete {
            return;
        }
        // What DMA wrote is visible from here on.
        fence(Ordering::Acquire);
        let border = time_base::take_border(tim5());
        let next = sample_clock::period(tim2());
        // A border that came meanwhile has brought another block's period.
        let next = (!time_base::border_waits(tim5())).then_some(next);
        let stamp = self.borders.on_border(border, next);
        RELOAD.store(self.borders.publish(self.request.latest()), Ordering::Relaxed);
        // A block without a stamp is given up, and its buffer filled again.
        let Some(stamp) = stamp else { return };
        let (idle, [first, second]) = (dma::target(stream).other(), &mut self.filling);
        let place = if idle == Target::Memory0 { first } else { second };
        match self.free.take() {
            Some(fresh) => {
                // SAFETY: the buffer is static memory in SRAM that nobody else holds, and `idle` is not the target.
                unsafe { dma::exchange(stream, idle, fresh.as_mut_ptr() as u32) };
                let codes = core::mem::replace(place, fresh);
                let filled = Filled {
                    codes,
                    first_tick: stamp.first_tick,
                    period_ticks: stamp.period_ticks,
                    sequence: stamp.sequence,
                    overrun: stamp.overrun,
                };
                // There are as many places in the queue as buffers: a block always finds one.
                let _ = self.blocks.enqueue(filled);
            }
            // No buffer to go on with: this block is given up and its buffer filled again.
            None => self.borders.mark_loss(),
        }
    }
}

#[interrupt]
fn DMA2_STREAM0() {
    // SAFETY: this handler and the next share a priority.
    unsafe { SAMPLING.with(Sampling::on_interrupt) };
}

#[interrupt]
fn ADC() {
    // SAFETY: as above.
    unsafe { SAMPLING.with(Sampling::on_overrun) };
}
