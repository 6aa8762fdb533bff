//! Tachometer: TIM2, 32 bits wide at 84 MHz, captures rising edges of PA0 on channel 1.
//!
//! The counter runs free and is the board's time base. Source: reference manual RM0090, section 18.

use heapless::spsc::Producer;
use stm32f4xx_hal::pac::TIM2;
use stm32f4xx_hal::rcc::{Enable, Rcc, Reset};

/// Input filter: eight equal samples at the dead-time clock, 84 MHz, so that spikes below 95 ns do not count.
const FILTER_EIGHT_SAMPLES: u8 = 0b0011;

/// State of the capture, owned by its interrupt.
pub struct Tach {
    timer: TIM2,
    edges: Producer<'static, u32>,
    lost: u32,
}

impl Tach {
    /// Starts the free-running counter and the capture.
    pub fn start(timer: TIM2, rcc: &mut Rcc, edges: Producer<'static, u32>) -> Self {
        TIM2::enable(rcc);
        TIM2::reset(rcc);
        timer.psc().write(|w| w.psc().set(0));
        timer.arr().write(|w| w.arr().set(u32::MAX));
        timer.ccmr1_input().write(|w| w.cc1s().ti1().ic1f().set(FILTER_EIGHT_SAMPLES));
        timer.ccer().write(|w| w.cc1e().set_bit());
        timer.egr().write(|w| w.ug().update());
        timer.dier().write(|w| w.cc1ie().enabled());
        timer.cr1().write(|w| w.cen().enabled());
        Self { timer, edges, lost: 0 }
    }

    /// Present count.
    pub fn now(&self) -> u32 {
        self.timer.cnt().read().bits()
    }

    /// Edges lost since start.
    pub fn lost(&self) -> u32 {
        self.lost
    }

    /// The capture interrupt.
    pub fn on_interrupt(&mut self) {
        let status = self.timer.sr().read();
        if status.cc1of().bit_is_set() {
            self.timer.sr().modify(|_, w| w.cc1of().clear_bit());
            self.lost = self.lost.saturating_add(1);
        }
        if status.cc1if().bit_is_set() {
            // Reading the captured count also clears the flag.
            let tick = self.timer.ccr1().read().bits();
            if self.edges.enqueue(tick).is_err() {
                self.lost = self.lost.saturating_add(1);
            }
        }
    }
}
