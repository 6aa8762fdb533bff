//! Clocks: 168 MHz from an 8 MHz crystal, from the internal oscillator where no crystal starts.
//!
//! The PLL runs from 2 MHz (the manual's advice against jitter): 2 MHz x 168 / 2 = 168 MHz; 48 MHz for USB falls off
//! at Q = 7. APB1 runs at 42 MHz and its timers at 84 MHz; APB2 at 84 MHz. The crystal stays watched: should it fail
//! later, the clock security system switches to the internal oscillator and raises the non-maskable interrupt,
//! whose handler restarts the node. All waits are bounded. RM0090 sections 3.5 and 7.

use crate::pac::{flash, rcc};
pub use crate::reset::ResetCause;

/// Core clock, Hz.
pub const CORE_HZ: u32 = 168_000_000;
/// Rate of the timers of APB1, hence of the time base, Hz.
pub const TIMER_HZ: u32 = 84_000_000;
/// Clock of USART1 and of the converter's divider, Hz.
pub const APB2_HZ: u32 = 84_000_000;
/// Polls of an oscillator before it counts as absent: over 50 ms at 16 MHz; crystals need 2 ms.
pub const PATIENCE: u32 = 100_000;

/// What drives the clocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Oscillator {
    /// Crystal of 8 MHz.
    Crystal,
    /// Internal oscillator: every frequency reported carries its 1 % (25 degrees Celsius).
    Internal,
}

/// The PLL did not lock or was not taken: the core still runs at 16 MHz from the internal oscillator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PllFault;

/// Brings the clocks up.
///
/// # Errors
/// [`PllFault`] when the PLL does not serve within the patience.
pub fn start(rcc: &rcc::RegisterBlock, flash: &flash::RegisterBlock) -> Result<Oscillator, PllFault> {
    rcc.apb1enr().modify(|_, w| w.pwren().set_bit());
    let oscillator = if crystal_starts(rcc) { Oscillator::Crystal } else { Oscillator::Internal };
    // Five wait states for more than 150 MHz at 2.7 V to 3.6 V, before the clock rises.
    flash.acr().write(|w| w.latency().ws5().prften().enabled().icen().enabled().dcen().enabled());
    rcc.pllcfgr().write(|w| {
        let divided = match oscillator {
            // SAFETY: 4 and 8 lie in the divider's range of 2 to 63 and give 2 MHz.
            Oscillator::Crystal => unsafe { w.pllsrc().hse().pllm().bits(4) },
            // SAFETY: as above.
            Oscillator::Internal => unsafe { w.pllsrc().hsi().pllm().bits(8) },
        };
        // SAFETY: 168 lies in 50 to 432, 7 in 2 to 15.
        unsafe { divided.plln().bits(168).pllp().div2().pllq().bits(7) }
    });
    rcc.cr().modify(|_, w| w.pllon().set_bit());
    wait_for(|| rcc.cr().read().pllrdy().bit_is_set())?;
    rcc.cfgr().modify(|_, w| w.hpre().div1().ppre1().div4().ppre2().div2());
    rcc.cfgr().modify(|_, w| w.sw().pll());
    wait_for(|| rcc.cfgr().read().sws().is_pll())?;
    if oscillator == Oscillator::Crystal {
        rcc.cr().modify(|_, w| w.csson().set_bit());
    }
    Ok(oscillator)
}

fn crystal_starts(rcc: &rcc::RegisterBlock) -> bool {
    rcc.cr().modify(|_, w| w.hseon().set_bit());
    let started = wait_for(|| rcc.cr().read().hserdy().bit_is_set()).is_ok();
    if !started {
        rcc.cr().modify(|_, w| w.hseon().clear_bit());
    }
    started
}

fn wait_for(mut ready: impl FnMut() -> bool) -> Result<(), PllFault> {
    if (0..PATIENCE).any(|_| ready()) { Ok(()) } else { Err(PllFault) }
}

/// Gives clocks to everything the node uses.
pub fn enable_peripherals(rcc: &rcc::RegisterBlock) {
    rcc.ahb1enr().modify(|_, w| {
        w.gpioaen().set_bit().gpiocen().set_bit().dma1en().set_bit().dma2en().set_bit().ccmdataramen().set_bit()
    });
    rcc.apb1enr().modify(|_, w| w.tim2en().set_bit().tim3en().set_bit().tim5en().set_bit());
    rcc.apb2enr().modify(|_, w| w.adc1en().set_bit().usart1en().set_bit());
    // The enable takes two clocks to arrive; a read back waits that long (errata 2.1.13).
    let _ = rcc.apb2enr().read();
}

/// Reads and clears the reset flags.
pub fn reset_cause(rcc: &rcc::RegisterBlock) -> ResetCause {
    let flags = rcc.csr().read().bits();
    rcc.csr().modify(|_, w| w.rmvf().set_bit());
    ResetCause::of_flags(flags)
}
