//! Output pins as embedded-hal knows them: every change is one write to the port's set/reset register and reads
//! nothing, so an interrupt that writes another pin of the port is never undone. RM0090 section 8.4.7.

use crate::pac::{gpioa, gpiob, gpioi};
use core::convert::Infallible;
use embedded_hal::digital::{ErrorType, OutputPin};

/// A port with a set/reset register.
pub trait Port {
    /// Writes it: ones in the lower half set pins, in the upper half reset them.
    fn set_reset(&self, bits: u32);
}

macro_rules! ports {
    ($($block:ident),*) => {
        $(
            impl Port for $block::RegisterBlock {
                fn set_reset(&self, bits: u32) {
                    // SAFETY: every value of this register is defined; zeros leave pins alone.
                    self.bsrr().write(|w| unsafe { w.bits(bits) });
                }
            }
        )*
    };
}

ports!(gpioa, gpiob, gpioi);

/// A pin of a port, which [`crate::pins`] has made an output.
#[derive(Clone, Copy, Debug)]
pub struct Output<'r, P> {
    port: &'r P,
    bit: u32,
}

impl<'r, P: Port> Output<'r, P> {
    /// Pin of a number from 0 to 15; only the lowest four bits count.
    pub const fn new(port: &'r P, number: u8) -> Self {
        Self { port, bit: 1 << (number & 15) }
    }
}

impl<P> ErrorType for Output<'_, P> {
    type Error = Infallible;
}

impl<P: Port> OutputPin for Output<'_, P> {
    fn set_low(&mut self) -> Result<(), Infallible> {
        self.port.set_reset(self.bit << 16);
        Ok(())
    }

    fn set_high(&mut self) -> Result<(), Infallible> {
        self.port.set_reset(self.bit);
        Ok(())
    }
}
