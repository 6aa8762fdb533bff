//! Converters of the signals: ADC3 with channel 1 (PA1) and, for a second sensor, ADC2 with channel 2 (PA2); 12 bits
//! left-aligned, one conversion per trigger of TIM2.
//!
//! Both listen to the same trigger and run on the same divided clock, so that they hold their inputs at the same edge
//! of it. Not the controller's dual mode: that puts both results into one word, pair by pair, and the node wants each
//! channel's samples in a row.
//!
//! 84 MHz / 4 = 21 MHz converter clock; 15 cycles of sampling and 12 of conversion: 1.29 us, for
//! source impedances up to about 8 kilohm (DS8626 equation 1). Left alignment gives the codes in 16 bits that the node
//! expects, steps of 16. RM0090 section 13.

use crate::pac::{adc_common, adc1};

/// External trigger EXTSEL: TIM2's TRGO (RM0090, external trigger for regular channels).
pub const TRIGGER_TIM2_TRGO: u8 = 0b0110;
/// Channel of the signal at ADC3, pin PA1.
pub const CHANNEL: u8 = 1;
/// Channel of the second sensor's signal at ADC2, pin PA2.
pub const SECOND_CHANNEL: u8 = 2;

/// Sets the clock of all converters, and switches the internal reference and the temperature sensor on
/// ([`crate::housekeeping`]).
pub fn configure(common: &adc_common::RegisterBlock) {
    common.ccr().write(|w| w.adcpre().div4().tsvrefe().enabled());
}

/// Sets a converter up for a channel (0 to 9); it waits for triggers from here on.
pub fn start(adc: &adc1::RegisterBlock, channel: u8) {
    // An overrun ends the requests to DMA, and with them the block interrupts: it needs an interrupt of its own.
    adc.cr1().write(|w| w.res().twelve_bit().scan().disabled().ovrie().enabled());
    // SAFETY: sampling code 1 (15 cycles) and the channel exist.
    adc.smpr2().write(|w| unsafe { w.bits(1 << (3 * channel)) });
    adc.sqr1().write(|w| w.l().set(0));
    // SAFETY: as above.
    adc.sqr3().write(|w| unsafe { w.sq1().bits(channel) });
    adc.cr2().write(|w| {
        let w = w.adon().enabled().align().left().cont().single();
        // One request per conversion, and requests go on after the last transfer (DDS): the buffers are a circle.
        let w = w.dma().enabled().dds().continuous();
        w.extsel().tim2trgo().exten().rising_edge()
    });
}

/// Takes the overrun flag. After an overrun the converter makes no more requests until the flag is cleared.
pub fn take_overrun(adc: &adc1::RegisterBlock) -> bool {
    let overrun = adc.sr().read().ovr().bit_is_set();
    if overrun {
        // SAFETY: ones leave the other flags alone.
        adc.sr().write(|w| unsafe { w.bits(u32::MAX).ovr().clear_bit() });
    }
    overrun
}

/// Stops the converter and clears its flags; [`start`] sets it up anew.
pub fn stop(adc: &adc1::RegisterBlock) {
    adc.cr2().reset();
    adc.sr().reset();
}
