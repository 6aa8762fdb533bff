//! A line that others speak on, too (RS-485): its driver is on only while the node sends.
//!
//! The driver goes on before the first start bit and off in the interrupt at the end of the last stop bit, within
//! microseconds: the master may send again 3.5 characters later, and a turn of the main loop can take longer than
//! that. The interrupt comes once per answer. Off is what reset and a crash leave the pin at. Source: RM0090 section
//! 30.3.2 (TC), "MODBUS over serial line V1.02" section 2.5.1.

use super::{port_a, usart1};
use meshband::config::{LineFormat, Parity};
use meshband_drivers::switch::{Polarity, Switch};
use meshband_stm32::output::Output;
use meshband_stm32::pac::interrupt;
use meshband_stm32::pins;
use meshband_stm32::uart::{self, Character};

/// Level that switches the driver on.
const DRIVER: Polarity = Polarity::ActiveHigh;

/// Sets rate and character.
pub fn set_format(format: LineFormat) {
    let character = match format.parity {
        Parity::Even => Character::Even,
        Parity::Odd => Character::Odd,
        Parity::NoneTwoStop => Character::TwoStop,
        Parity::NoneOneStop => Character::OneStop,
    };
    uart::set_format(usart1(), format.bits_per_second, character);
}

/// Takes the line, before sending.
pub fn seize() {
    uart::forget_end(usart1());
    drive(true);
}

/// Gives the line back when what is being sent has ended.
pub fn release_at_end() {
    uart::announce_end(usart1());
}

fn drive(on: bool) {
    let Ok(()) = Switch::new(Output::new(port_a(), pins::DRIVER_ENABLE), DRIVER).set(on);
}

#[interrupt]
fn USART1() {
    if uart::take_end(usart1()) {
        drive(false);
    }
}
