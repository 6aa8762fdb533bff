//! The tach's interrupt: captured edges into the queue.

use super::tim5;
use crate::interrupt_cell::InterruptCell;
use core::sync::atomic::{AtomicU32, AtomicUsize, Ordering};
use heapless::spsc::Producer;
use meshband_stm32::filter::{FILTERS, Filter};
use meshband_stm32::pac::interrupt;
use meshband_stm32::time_base;

static TACH: InterruptCell<Producer<'static, u32>> = InterruptCell::new();
/// Place in [`FILTERS`] of the filter in force.
static FILTER: AtomicUsize = AtomicUsize::new(0);
static LOST_EDGES: AtomicU32 = AtomicU32::new(0);

/// Hands the handler its queue, before the interrupt is unmasked.
pub fn install(edges: Producer<'static, u32>) {
    // SAFETY: `Board::start` runs once and unmasks the interrupt afterwards.
    unsafe { TACH.install(edges) };
}

/// Takes another filter into use. An edge that is on its way through may be stamped with the other one's delay: 12 us.
pub fn set_filter(filter: Filter) {
    let place = FILTERS.iter().position(|known| *known == filter).unwrap_or(0);
    FILTER.store(place, Ordering::Relaxed);
    time_base::set_filter(tim5(), filter);
}

fn filter() -> Filter {
    FILTERS.get(FILTER.load(Ordering::Relaxed)).copied().unwrap_or(FILTERS[0])
}

/// Edges lost: overwritten in the capture register or refused by the queue.
pub fn lost() -> u32 {
    LOST_EDGES.load(Ordering::Relaxed)
}

#[interrupt]
fn TIM5() {
    // SAFETY: this is the one handler.
    unsafe {
        TACH.with(|edges| {
            let capture = time_base::take_edge(tim5(), filter());
            let refused = capture.tick.is_some_and(|tick| edges.enqueue(tick).is_err());
            let lost = u32::from(capture.lost) + u32::from(refused);
            LOST_EDGES.store(lost.saturating_add(LOST_EDGES.load(Ordering::Relaxed)), Ordering::Relaxed);
        });
    }
}
