//! Pins, and what each is until its driver takes it over.
//!
//! | pin | function | at first |
//! | --- | --- | --- |
//! | PA0 | tach, TIM5 channel 1 | pulled up |
//! | PA1 | signal, ADC3 channel 1 | analogue |
//! | PA2 | second sensor's signal, ADC2 channel 2 | analogue |
//! | PA3 | pulse per second, TIM5 channel 4 | pulled down |
//! | PA4 | bias of the sensor behind a divider, ADC1 channel 4 | analogue |
//! | PA8 | driver enable of a shared line, high while sending | low: others speak |
//! | PA9, PA10 | link, USART1 | idle |
//! | PB12 | select of the amplifier | high: not selected |
//! | PB13, PB15 | clock and data to the amplifier, SPI2 | low |
//! | PC6 | output "sensor in order" | low: not energised |
//! | PC8 | alarm output | low: not energised |
//! | PC9 | sensor supply | low: off |
//! | PC12 | light, low is lit | high: dark |
//!
//! Light as on an Olimex STM32-H405. The debug pins PA13 and PA14 stay as reset leaves them, USB's PA11 and PA12 too.
//! The amplifier's bus keeps away from port A, where the signal comes in.

use crate::output::Port;
use crate::pac::{gpioa, gpiob, gpioi};

/// Pin at port A that switches the driver of a shared line on.
pub const DRIVER_ENABLE: u8 = 8;
/// Pin at port B that selects the amplifier.
pub const AMPLIFIER_SELECT: u8 = 12;
/// Pin at port C of the output that says that the sensor is in order.
pub const SENSOR_OK: u8 = 6;
/// Pin at port C of the alarm output.
pub const ALARM: u8 = 8;
/// Pin at port C of the sensor supply.
pub const SENSOR_SUPPLY: u8 = 9;
/// Pin at port C of the light.
pub const LIGHT: u8 = 12;

/// Sets the pins up. Levels and alternate functions before the mode, so that no pin shows anything else in between.
pub fn configure(port_a: &gpioa::RegisterBlock, port_b: &gpiob::RegisterBlock, port_c: &gpioi::RegisterBlock) {
    // SAFETY: 2 is TIM5, 7 is USART1 (DS8626 table 9).
    port_a.afrl().modify(|_, w| unsafe { w.afr(0).bits(2).afr(3).bits(2) });
    // SAFETY: as above.
    port_a.afrh().modify(|_, w| unsafe { w.afr(1).bits(7).afr(2).bits(7) });
    // A tach pick-up is most often an open collector; the idle link is high; a pulse per second comes from a driven
    // output, or from nowhere.
    port_a.pupdr().modify(|_, w| w.pupdr0().pull_up().pupdr3().pull_down().pupdr10().pull_up());
    port_a.set_reset(1 << (DRIVER_ENABLE + 16));
    port_a.moder().modify(|_, w| {
        let w = w.moder0().alternate().moder1().analog().moder2().analog().moder3().alternate().moder4().analog();
        w.moder8().output().moder9().alternate().moder10().alternate()
    });
    configure_amplifier(port_b);
    port_c.set_reset(1 << LIGHT | 1 << (SENSOR_OK + 16) | 1 << (ALARM + 16) | 1 << (SENSOR_SUPPLY + 16));
    port_c.moder().modify(|_, w| w.moder6().output().moder8().output().moder9().output().moder12().output());
}

fn configure_amplifier(port: &gpiob::RegisterBlock) {
    port.set_reset(1 << AMPLIFIER_SELECT);
    // SAFETY: 5 is SPI2 (DS8626 table 9).
    port.afrh().modify(|_, w| unsafe { w.afr(5).bits(5).afr(7).bits(5) });
    // The slowest edges end at 2 MHz to 8 MHz (DS8626, AC characteristics of pins), the bus runs at 5.25 MHz.
    port.ospeedr().modify(|_, w| w.ospeedr13().medium_speed().ospeedr15().medium_speed());
    port.moder().modify(|_, w| w.moder12().output().moder13().alternate().moder15().alternate());
}
