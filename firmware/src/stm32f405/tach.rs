//! The tach's interrupt: captured edges into the queue.

use super::tim5;
use crate::interrupt_cell::InterruptCell;
use core::sync::atomic::{AtomicU32, Ordering};
use heapless::spsc::Producer;
use meshband_stm32::filter::Filter;
use meshband_stm32::pac::interrupt;
use meshband_stm32::time_base;

struct Tach {
    edges: Producer<'static, u32>,
    filter: Filter,
}

static TACH: InterruptCell<Tach> = InterruptCell::new();
static LOST: AtomicU32 = AtomicU32::new(0);

/// Hands the handler its queue, before the interrupt is unmasked.
pub fn install(edges: Producer<'static, u32>, filter: Filter) {
    // SAFETY: `Board::start` runs once and unmasks the interrupt afterwards.
    unsafe { TACH.install(Tach { edges, filter }) };
}

/// Edges lost: overwritten in the capture register or refused by the queue.
pub fn lost() -> u32 {
    LOST.load(Ordering::Relaxed)
}

#[interrupt]
fn TIM5() {
    // SAFETY: this is the one handler.
    unsafe {
        TACH.with(|tach| {
            let capture = time_base::take_edge(tim5(), tach.filter);
            let refused = capture.tick.is_some_and(|tick| tach.edges.enqueue(tick).is_err());
            let lost = u32::from(capture.lost) + u32::from(refused);
            LOST.store(lost.saturating_add(LOST.load(Ordering::Relaxed)), Ordering::Relaxed);
        });
    }
}
