//! Independent watchdog: its own oscillator, cannot be stopped once started.
//!
//! Eight seconds nominal: at the oscillator's fast end still longer than the erasure of a 128 KiB sector of flash, 2
//! s at most, during which the core stands still. RM0090 section 21.

use crate::design_parameters::WATCHDOG_MS;
use crate::pac::iwdg;

/// Prescaler 256: 8 ms per count at 32 kHz.
const MS_PER_COUNT: u32 = 8;

/// Starts it.
pub fn start(iwdg: &iwdg::RegisterBlock) {
    iwdg.kr().write(|w| w.key().start());
    iwdg.kr().write(|w| w.key().unlock());
    iwdg.pr().write(|w| w.pr().divide_by256());
    iwdg.rlr().write(|w| w.rl().set((WATCHDOG_MS / MS_PER_COUNT) as u16 - 1));
    feed(iwdg);
}

/// Tells it that the main loop lives.
pub fn feed(iwdg: &iwdg::RegisterBlock) {
    iwdg.kr().write(|w| w.key().feed());
}
