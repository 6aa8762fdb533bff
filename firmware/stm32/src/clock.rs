//! Clocks: 168 MHz from an 8 MHz crystal, from the internal oscillator where no crystal starts.
//!
//! The PLL runs from 2 MHz (the manual's advice against jitter): 2 MHz x 168 / 2 = 168 MHz; 48 MHz for USB falls off
//! at Q = 7. APB1 runs at 42 MHz and its timers at 84 MHz; APB2 at 84 MHz. The crystal stays watched: should it fail
//! later, the clock security system switches to the internal oscillator and raises the non-maskable interrupt,
//! whose handler restarts the node. All waits are bounded. RM0090 sections 3.5 and 7.
//!
//! Nothing is assumed of what ran before. The boot loader in ROM jumps to the image (`:leave`) with the PLL as the
//! clock and with peripherals running; PLL settings written meanwhile are ignored. So the core first goes back to the
//! internal oscillator with the PLL off, and every peripheral is reset.
//!
//! Functions that wait take a `pause` that runs between two looks at a register: nothing on the chip, a model of the
//! chip in tests.

use crate::pac::{flash, rcc};
pub use crate::reset::ResetCause;

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

/// Brings the clocks up, whatever the core runs from.
///
/// # Errors
/// [`PllFault`] when the PLL does not serve within the patience, or the internal oscillator does not.
pub fn start(
    rcc: &rcc::RegisterBlock,
    flash: &flash::RegisterBlock,
    pause: &mut impl FnMut(),
) -> Result<Oscillator, PllFault> {
    leave_pll(rcc, pause)?;
    rcc.apb1enr().modify(|_, w| w.pwren().set_bit());
    let oscillator = if crystal_starts(rcc, pause) { Oscillator::Crystal } else { Oscillator::Internal };
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
    wait_for(pause, || rcc.cr().read().pllrdy().bit_is_set())?;
    rcc.cfgr().modify(|_, w| w.hpre().div1().ppre1().div4().ppre2().div2());
    rcc.cfgr().modify(|_, w| w.sw().pll());
    wait_for(pause, || rcc.cfgr().read().sws().is_pll())?;
    if oscillator == Oscillator::Crystal {
        rcc.cr().modify(|_, w| w.csson().set_bit());
    }
    Ok(oscillator)
}

/// Back to the internal oscillator, as after a reset: the PLL takes settings only while it is off.
fn leave_pll(rcc: &rcc::RegisterBlock, pause: &mut impl FnMut()) -> Result<(), PllFault> {
    rcc.cr().modify(|_, w| w.hsion().set_bit());
    wait_for(pause, || rcc.cr().read().hsirdy().bit_is_set())?;
    rcc.cfgr().modify(|_, w| w.sw().hsi());
    wait_for(pause, || rcc.cfgr().read().sws().is_hsi())?;
    rcc.cr().modify(|_, w| w.csson().clear_bit().pllon().clear_bit());
    wait_for(pause, || rcc.cr().read().pllrdy().bit_is_clear())
}

fn crystal_starts(rcc: &rcc::RegisterBlock, pause: &mut impl FnMut()) -> bool {
    rcc.cr().modify(|_, w| w.hseon().set_bit());
    let started = wait_for(pause, || rcc.cr().read().hserdy().bit_is_set()).is_ok();
    if !started {
        rcc.cr().modify(|_, w| w.hseon().clear_bit());
    }
    started
}

fn wait_for(pause: &mut impl FnMut(), mut ready: impl FnMut() -> bool) -> Result<(), PllFault> {
    for _ in 0..PATIENCE {
        pause();
        if ready() {
            return Ok(());
        }
    }
    Err(PllFault)
}

/// Peripherals of the STM32F405 on AHB1: ports A to I, CRC, both DMA controllers, USB HS.
const AHB1_RESETS: u32 = 0x2060_11ff;
/// On AHB2: random numbers and USB FS.
const AHB2_RESETS: u32 = 0xc0;
/// On APB1: timers 2 to 7 and 12 to 14, window watchdog, SPI, UARTs, I2C, CAN, power control, DAC.
const APB1_RESETS: u32 = 0x36fe_c9ff;
/// On APB2: timers 1 and 8 to 11, USART1 and 6, converters, SDIO, SPI1, system configuration.
const APB2_RESETS: u32 = 0x0007_5933;

/// Puts every peripheral back to its reset state, whoever used it before. `pause` runs while they are held.
pub fn reset_peripherals(rcc: &rcc::RegisterBlock, pause: &mut impl FnMut()) {
    // SAFETY: these bits exist (RM0090 sections 7.3.5 to 7.3.9); nothing is in use yet.
    unsafe {
        rcc.ahb1rstr().write(|w| w.bits(AHB1_RESETS));
        rcc.ahb2rstr().write(|w| w.bits(AHB2_RESETS));
        rcc.apb1rstr().write(|w| w.bits(APB1_RESETS));
        rcc.apb2rstr().write(|w| w.bits(APB2_RESETS));
    }
    pause();
    rcc.ahb1rstr().reset();
    rcc.ahb2rstr().reset();
    rcc.apb1rstr().reset();
    rcc.apb2rstr().reset();
}

/// Gives clocks to everything the node uses.
pub fn enable_peripherals(rcc: &rcc::RegisterBlock) {
    rcc.ahb1enr().modify(|_, w| {
        let w = w.gpioaen().set_bit().gpioben().set_bit().gpiocen().set_bit();
        w.dma1en().set_bit().dma2en().set_bit().ccmdataramen().set_bit()
    });
    rcc.apb1enr().modify(|_, w| w.tim2en().set_bit().tim3en().set_bit().tim5en().set_bit().spi2en().set_bit());
    rcc.apb2enr().modify(|_, w| w.adc1en().set_bit().adc2en().set_bit().adc3en().set_bit().usart1en().set_bit());
    // The enable takes two clocks to arrive; a read back waits that long (errata 2.1.13).
    let _ = rcc.apb2enr().read();
}

/// Reads and clears the reset flags.
pub fn reset_cause(rcc: &rcc::RegisterBlock) -> ResetCause {
    let flags = rcc.csr().read().bits();
    rcc.csr().modify(|_, w| w.rmvf().set_bit());
    ResetCause::of_flags(flags)
}
