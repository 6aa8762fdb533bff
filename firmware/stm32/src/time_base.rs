//! Time base and captures: TIM5, 32 bits, free-running at 84 MHz.
//!
//! Channel 1 captures the tach's edges behind a digital filter; channel 2 captures TIM3's update, the instant of a
//! block's last sample; channel 4 captures a pulse per second. All are counts of the same counter, so samples and
//! edges share one time without any correction but the filter's own delay, which is constant and taken off. Wraps
//! every 51 s. RM0090 section 18.3.5.

use crate::block_stamp::Captured;
use crate::design_parameters::CAPTURE_LATENCY;
use crate::filter::{FILTERS, Filter};
use crate::pac::tim5;

/// An edge's stamp lies at most this far behind the present instant when it is in the queue, ticks: the longest
/// filter's delay and the latency. The longest whichever is in force: edges may be on their way through the one
/// before.
pub const EDGE_SETTLING: u32 = FILTERS[FILTERS.len() - 1].ticks + CAPTURE_LATENCY;

/// Filter of the pulse per second: the longest one that the tach's divider of the filters' clock leaves alone.
const PULSE_FILTER: Filter = FILTERS[0];
const _: () = assert!(PULSE_FILTER.code == 3, "decides on the undivided clock");

/// Which edge of the tach counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Edge {
    /// From low to high.
    Rising,
    /// From high to low.
    Falling,
}

/// What TIM5's interrupt found on channel 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Capture {
    /// Instant of the edge, filter delay taken off.
    pub tick: Option<u32>,
    /// At least one edge was overwritten before it was read.
    pub lost: bool,
}

/// Sets the counter and both captures up and starts them.
pub fn start(tim5: &tim5::RegisterBlock, edge: Edge, filter: Filter) {
    tim5.cr1().reset();
    tim5.psc().write(|w| w.psc().set(0));
    tim5.arr().write(|w| w.arr().set(u32::MAX));
    // TRC is ITR1, which for TIM5 is TIM3 (RM0090, TIMx internal trigger connection); no slave mode: the counter runs
    // on.
    tim5.smcr().write(|w| w.ts().itr1());
    tim5.ccmr1_input().write(|w| w.cc1s().ti1().cc2s().trc());
    // SAFETY: every value of the four-bit filter field is defined.
    tim5.ccmr2_input().write(|w| unsafe { w.cc4s().ti4().ic4f().bits(PULSE_FILTER.code) });
    set_filter(tim5, filter);
    set_edge(tim5, edge);
    tim5.egr().write(|w| w.ug().update());
    tim5.dier().write(|w| w.cc1ie().enabled());
    tim5.cr1().modify(|_, w| w.cen().enabled());
}

/// Chooses the edge of the tach, at any time: one write, so that neither capture stops.
pub fn set_edge(tim5: &tim5::RegisterBlock, edge: Edge) {
    tim5.ccer().write(|w| {
        let w = w.cc1e().set_bit().cc2e().set_bit().cc4e().set_bit();
        match edge {
            Edge::Rising => w.cc1p().clear_bit(),
            Edge::Falling => w.cc1p().set_bit(),
        }
    });
}

/// Changes the tach's filter, at any time: field and divider are no part of the counting.
pub fn set_filter(tim5: &tim5::RegisterBlock, filter: Filter) {
    tim5.cr1().modify(|_, w| if filter.clock_division == 2 { w.ckd().div4() } else { w.ckd().div1() });
    // SAFETY: every value of the four-bit filter field is defined.
    tim5.ccmr1_input().modify(|_, w| unsafe { w.ic1f().bits(filter.code) });
}

/// Present instant.
pub fn now(tim5: &tim5::RegisterBlock) -> u32 {
    tim5.cnt().read().bits()
}

/// Instant before which every edge has been captured and queued.
pub fn horizon(tim5: &tim5::RegisterBlock) -> u32 {
    now(tim5).wrapping_sub(EDGE_SETTLING)
}

/// Takes a captured edge; for TIM5's interrupt.
pub fn take_edge(tim5: &tim5::RegisterBlock, filter: Filter) -> Capture {
    let status = tim5.sr().read();
    let lost = status.cc1of().bit_is_set();
    if lost {
        clear(tim5, |w| w.cc1of().clear_bit());
    }
    // Reading the captured count clears its flag.
    let tick = status.cc1if().bit_is_set().then(|| tim5.ccr1().read().bits().wrapping_sub(filter.ticks));
    Capture { tick, lost }
}

/// Takes the instant of a pulse per second not yet taken, filter delay taken off; the newest one where several have
/// come.
pub fn take_second_pulse(tim5: &tim5::RegisterBlock) -> Option<u32> {
    let status = tim5.sr().read();
    if status.cc4of().bit_is_set() {
        clear(tim5, |w| w.cc4of().clear_bit());
    }
    // Reading the captured count clears its flag.
    status.cc4if().bit_is_set().then(|| tim5.ccr4().read().bits().wrapping_sub(PULSE_FILTER.ticks))
}

/// Takes the instant of the newest block's last sample, if there is one that was not taken yet, and whether a border
/// before it went unnoticed.
pub fn take_border(tim5: &tim5::RegisterBlock) -> Captured {
    let status = tim5.sr().read();
    // Reading the captured count clears its flag.
    let last_tick = status.cc2if().bit_is_set().then(|| tim5.ccr2().read().bits());
    // A border between the two reads has overwritten the count; one behind them has raised the flag anew.
    let missed = status.cc2of().bit_is_set() || tim5.sr().read().cc2of().bit_is_set();
    if missed {
        clear(tim5, |w| w.cc2of().clear_bit());
    }
    Captured { last_tick, missed }
}

/// Whether a border has passed since the last one was taken.
pub fn border_waits(tim5: &tim5::RegisterBlock) -> bool {
    tim5.sr().read().cc2if().bit_is_set()
}

/// Clears flags of the status register, and only these: writing one leaves a flag as it is, so a flag that rises
/// meanwhile is not lost, as it would be with read-modify-write.
fn clear(tim5: &tim5::RegisterBlock, flags: impl FnOnce(&mut crate::pac::tim5::sr::W) -> &mut crate::pac::tim5::sr::W) {
    tim5.sr().write(|w| {
        // SAFETY: ones leave all flags alone; reserved bits ignore them.
        flags(unsafe { w.bits(u32::MAX) })
    });
}
