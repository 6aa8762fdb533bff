//! The block interrupt: a complete buffer out, a fresh one in, the next period published.
//!
//! When a rate changes and when a block began is decided by the timers alone; this handler has a whole block's
//! time to read it. It also watches that transfers keep step with triggers; where they do not, or the converter
//! reports an overrun (an interrupt of its own: after one no block would ever be complete), sampling starts anew and
//! the node sees a gap in the sequence, never a shifted block.

use super::{adc_common, adc2, adc3, dma1, dma2, tim2, tim3, tim5};
use crate::interrupt_cell::InterruptCell;
use core::ptr;
use core::sync::atomic::{AtomicBool, AtomicU32, Ordering, fence};
use heapless::spsc::Producer;
use meshband::pipeline::{Channels, Codes, EmptyBuffers, Filled, Request};
use meshband_stm32::block_stamp::{Borders, is_aligned};
use meshband_stm32::dma::{self, ADC2_STREAM, ADC3_STREAM, Target};
use meshband_stm32::pac::interrupt;
use meshband_stm32::period::reload_of;
use meshband_stm32::{BLOCK_SAMPLES, adc, sample_clock, time_base};

const _: () = assert!(BLOCK_SAMPLES as usize == meshband::pipeline::BLOCK_SAMPLES);

/// The word DMA copies to the sample timer's reload at each border.
static RELOAD: AtomicU32 = AtomicU32::new(0);
static RESTARTS: AtomicU32 = AtomicU32::new(0);
/// Whether the configuration in force has a second sensor.
static SECOND_SENSOR: AtomicBool = AtomicBool::new(false);
static SAMPLING: InterruptCell<Sampling> = InterruptCell::new();

struct Sampling {
    borders: Borders,
    channels: Channels,
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
    channels: Channels,
) -> Option<()> {
    follow(channels);
    let filling = [free.take()?, free.take()?];
    let borders = Borders::starting(period_ticks, instants(channels));
    let mut sampling = Sampling { borders, channels, filling, blocks, free, request };
    sampling.start();
    // SAFETY: `Board::start` runs once and unmasks the interrupt afterwards.
    unsafe { SAMPLING.install(sampling) };
    Some(())
}

/// Takes up another number of sensors at the end of the running block; sampling then starts anew.
pub fn follow(channels: Channels) {
    SECOND_SENSOR.store(channels == Channels::Two, Ordering::Relaxed);
}

fn wanted() -> Channels {
    if SECOND_SENSOR.load(Ordering::Relaxed) { Channels::Two } else { Channels::One }
}

fn instants(channels: Channels) -> u16 {
    channels.instants() as u16
}

/// Times sampling had to be started anew.
pub fn restarts() -> u32 {
    RESTARTS.load(Ordering::Relaxed)
}

impl Sampling {
    /// Everything from the timers to the first buffer, from a standstill.
    fn start(&mut self) {
        let (period, samples) = (self.borders.published(), instants(self.channels));
        RELOAD.store(reload_of(period), Ordering::Relaxed);
        sample_clock::configure(tim2(), tim3(), period, samples);
        let buffers = self.filling.each_mut().map(|codes| codes.as_mut_ptr() as u32);
        adc::configure(adc_common());
        // SAFETY: all addresses are of static memory in SRAM and of the registers named; a buffer leaves `filling`
        // only while it is not the stream's target.
        unsafe {
            sample_clock::configure_reload(dma1(), RELOAD.as_ptr() as u32, ptr::from_ref(tim2().arr()) as u32);
            if self.channels == Channels::Two {
                let halves = buffers.map(|buffer| second_half(buffer, samples));
                dma::start_double_buffer(dma2(), ADC2_STREAM, ptr::from_ref(adc2().dr()) as u32, halves, samples);
            }
            dma::start_double_buffer(dma2(), ADC3_STREAM, ptr::from_ref(adc3().dr()) as u32, buffers, samples);
        }
        if self.channels == Channels::Two {
            adc::start(adc2(), adc::SECOND_CHANNEL);
        }
        adc::start(adc3(), adc::CHANNEL);
        // A border captured before does not count.
        let _ = time_base::take_border(tim5());
        sample_clock::start(tim2(), tim3());
    }

    fn restart(&mut self) {
        RESTARTS.fetch_add(1, Ordering::Relaxed);
        sample_clock::stop(tim2(), tim3());
        adc::stop(adc3());
        adc::stop(adc2());
        dma::stop(dma2().st(ADC2_STREAM.number));
        self.channels = wanted();
        self.borders.restart(instants(self.channels));
        self.start();
    }

    fn on_overrun(&mut self) {
        if self.take_overrun() {
            self.restart();
        }
    }

    fn take_overrun(&mut self) -> bool {
        // Both, so that neither stays pending.
        adc::take_overrun(adc3()) | adc::take_overrun(adc2())
    }

    /// Whether a converter's transfers keep step with the triggers, and no bus error has stopped them.
    fn keeps_step(&self, stream: &dma::Stream, error: bool) -> bool {
        let counted = sample_clock::counted(tim3());
        let remaining = stream.ndtr().read().ndt().bits();
        !error && is_aligned(counted, remaining, instants(self.channels))
    }

    fn on_interrupt(&mut self) {
        let flags = dma::take_flags(dma2(), ADC3_STREAM.number);
        let stream = dma2().st(ADC3_STREAM.number);
        let second = (self.channels == Channels::Two).then(|| dma2().st(ADC2_STREAM.number));
        let second_error = dma::take_flags(dma2(), ADC2_STREAM.number).error;
        let in_step =
            self.keeps_step(stream, flags.error) && second.is_none_or(|second| self.keeps_step(second, second_error));
        if self.take_overrun() || !in_step || wanted() != self.channels {
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
        let idle = dma::target(stream).other();
        if second.is_some_and(|second| dma::target(second) != dma::target(stream)) {
            self.restart();
            return;
        }
        let [first, other] = &mut self.filling;
        let place = if idle == Target::Memory0 { first } else { other };
        match self.free.take() {
            Some(fresh) => {
                // SAFETY: the buffer is static memory in SRAM that nobody else holds, and `idle` is not the target.
                unsafe {
                    let buffer = fresh.as_mut_ptr() as u32;
                    dma::exchange(stream, idle, buffer);
                    if let Some(second) = second {
                        dma::exchange(second, idle, second_half(buffer, instants(self.channels)));
                    }
                }
                let codes = core::mem::replace(place, fresh);
                let filled = Filled {
                    codes,
                    channels: self.channels,
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

/// Where the second sensor's samples begin in a buffer.
const fn second_half(buffer: u32, samples: u16) -> u32 {
    buffer + samples as u32 * size_of::<u16>() as u32
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
