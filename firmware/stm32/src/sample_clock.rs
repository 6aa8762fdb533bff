//! Sample clock: TIM2 gives the sample period, TIM3 counts the samples of a block.
//!
//! TIM2's reload is preloaded: a new value written at any time governs from the next update on. The writing is done
//! by DMA at TIM3's update, which is the trigger of a block's *last* sample; TIM2 takes the value at its next
//! update, the trigger of the next block's first sample. So the distance from a block's last sample to the next
//! block's first is the old period, every distance inside the new block is the new one, and a block's first sample
//! comes exactly `samples x period` after its predecessor's. RM0090 sections 18.3 and 18.4.

use crate::dma;
use crate::pac::{tim2, tim3};
use crate::period::reload_of;

/// Stream of DMA1 that TIM3's update requests.
pub const RELOAD_STREAM: usize = 2;
/// Request channel of TIM3's update in that stream.
const RELOAD_CHANNEL: u8 = 5;
/// Sets both timers up for blocks of so many samples (at least 1), stopped.
pub fn configure(tim2: &tim2::RegisterBlock, tim3: &tim3::RegisterBlock, period_ticks: u32, samples: u16) {
    tim2.cr1().write(|w| w.arpe().enabled().urs().counter_only());
    tim2.cr2().write(|w| w.mms().update());
    tim2.psc().write(|w| w.psc().set(0));
    tim2.arr().write(|w| w.arr().set(reload_of(period_ticks)));
    // Loads the preloaded registers; with URS set this raises no flag, and TIM3 is not yet listening.
    tim2.egr().write(|w| w.ug().update());

    tim3.cr1().write(|w| w.urs().counter_only());
    tim3.cr2().write(|w| w.mms().update());
    tim3.psc().write(|w| w.psc().set(0));
    tim3.arr().write(|w| w.arr().set(samples.saturating_sub(1)));
    tim3.egr().write(|w| w.ug().update());
    // Counts TIM2's updates: external clock mode 1 from ITR1, which is TIM2 (RM0090, TIMx internal trigger connection).
    tim3.smcr().write(|w| w.ts().itr1().sms().ext_clock_mode());
    tim3.dier().write(|w| w.ude().enabled());
}

/// Lets DMA copy the word at `reload_address` to TIM2's reload register (`register_address`) at each block border.
///
/// # Safety
/// `reload_address` must stay a valid, aligned word in memory that DMA1 reaches (not the core-coupled one), and
/// `register_address` must be TIM2's reload register.
pub unsafe fn configure_reload(dma1: &dma::RegisterBlock, reload_address: u32, register_address: u32) {
    // SAFETY: passed on to the caller.
    let stream = unsafe { dma::prepare(dma1, RELOAD_STREAM, register_address, reload_address, 1) };
    stream.cr().write(|w| {
        let w = w.chsel().set(RELOAD_CHANNEL).pl().very_high();
        w.dir().memory_to_peripheral().psize().bits32().msize().bits32().circ().enabled()
    });
    stream.cr().modify(|_, w| w.en().enabled());
}

/// Starts sampling: the first trigger comes one period from now.
pub fn start(tim2: &tim2::RegisterBlock, tim3: &tim3::RegisterBlock) {
    tim3.cr1().modify(|_, w| w.cen().enabled());
    tim2.cr1().modify(|_, w| w.cen().enabled());
}

/// Stops sampling.
pub fn stop(tim2: &tim2::RegisterBlock, tim3: &tim3::RegisterBlock) {
    tim2.cr1().modify(|_, w| w.cen().disabled());
    tim3.cr1().modify(|_, w| w.cen().disabled());
    tim3.dier().write(|w| w.ude().disabled());
    tim3.smcr().reset();
}

/// The sample period that the block behind the last border has: the preload register, which the timer takes up with the
/// block's first trigger.
pub fn period(tim2: &tim2::RegisterBlock) -> u32 {
    tim2.arr().read().arr().bits().wrapping_add(1)
}

/// Triggers of the running block so far.
pub fn counted(tim3: &tim3::RegisterBlock) -> u16 {
    tim3.cnt().read().cnt().bits()
}
