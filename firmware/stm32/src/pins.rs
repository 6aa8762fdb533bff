//! Pins: tach PA0 (TIM5 channel 1), signal PA1 (ADC1 channel 1), link PA9 and PA10 (USART1), light PC12 (low is lit).
//!
//! As on an Olimex STM32-H405. The debug pins PA13 and PA14 stay as reset leaves them.

use crate::pac::{gpioa, gpioi};

/// Pin number of the light at port C.
pub const LIGHT: u8 = 12;

/// Sets the pins up.
pub fn configure(port_a: &gpioa::RegisterBlock, port_c: &gpioi::RegisterBlock) {
    // Alternate function numbers before the mode, so that no pin shows another peripheral in between.
    // SAFETY: 2 is TIM5, 7 is USART1 (DS8626 table 9).
    port_a.afrl().modify(|_, w| unsafe { w.afr(0).bits(2) });
    // SAFETY: as above.
    port_a.afrh().modify(|_, w| unsafe { w.afr(1).bits(7).afr(2).bits(7) });
    // A tach pick-up is most often an open collector; the idle link is high.
    port_a.pupdr().modify(|_, w| w.pupdr0().pull_up().pupdr10().pull_up());
    port_a.moder().modify(|_, w| w.moder0().alternate().moder1().analog().moder9().alternate().moder10().alternate());
    set_light(port_c, false);
    port_c.moder().modify(|_, w| w.moder12().output());
}

/// Switches the light; one write, no read.
pub fn set_light(port_c: &gpioi::RegisterBlock, lit: bool) {
    port_c.bsrr().write(|w| if lit { w.br12().set_bit() } else { w.bs12().set_bit() });
}
