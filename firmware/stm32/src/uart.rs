//! Link: USART1 on PA9 and PA10, both directions by DMA2.
//!
//! USART1 because it runs from 84 MHz: 921 600 bit/s is met within 0.16 %, where USART2's 42 MHz gives 0.9 %; and
//! because the chip's own boot loader listens there. Reception is a circle that the main loop reads behind the DMA's
//! position: no interrupt per byte. Sending takes one transfer per run of contiguous bytes. RM0090 section 30.

use crate::design_parameters::{APB2_HZ, BITS_PER_SECOND};
use crate::dma;
use crate::pac::usart1;
use core::sync::atomic::{Ordering, fence};

/// Stream of DMA2 for reception.
pub const RECEIVE_STREAM: usize = 5;
/// Stream of DMA2 for sending.
pub const SEND_STREAM: usize = 7;
/// Request channel of USART1 in both streams.
const CHANNEL: u8 = 4;

/// Divider for a bit rate, sixteenths in the lowest four bits: rounded to the nearest.
pub const fn divider(clock_hz: u32, bits_per_second: u32) -> u32 {
    (clock_hz + bits_per_second / 2) / bits_per_second
}

/// Character on the line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Character {
    /// 8 bits, even parity, one stop bit.
    Even,
    /// 8 bits, odd parity, one stop bit.
    Odd,
    /// 8 bits, no parity, two stop bits.
    TwoStop,
    /// 8 bits, no parity, one stop bit.
    OneStop,
}

/// Sets another rate and character, while nothing is being sent. Reception goes on; a character under way is lost.
pub fn set_format(usart: &usart1::RegisterBlock, bits_per_second: u32, character: Character) {
    usart.cr1().modify(|_, w| w.ue().disabled());
    let divider = divider(APB2_HZ, bits_per_second.max(1)).clamp(16, u32::from(u16::MAX)) as u16;
    // SAFETY: every divider from 16 on is a rate.
    usart.brr().write(|w| unsafe { w.bits(divider) });
    usart.cr2().write(|w| match character {
        Character::TwoStop => w.stop().stop2(),
        _ => w.stop().stop1(),
    });
    // The parity is the ninth bit of a word; the DMA takes the lower eight.
    usart.cr1().write(|w| {
        let w = match character {
            Character::Even => w.m().m9().pce().enabled().ps().even(),
            Character::Odd => w.m().m9().pce().enabled().ps().odd(),
            Character::TwoStop | Character::OneStop => w.m().m8(),
        };
        w.ue().enabled().te().enabled().re().enabled()
    });
}

/// Forgets that what was sent before has ended; to be called before sending what [`announce_end`] is to tell the end
/// of.
pub fn forget_end(usart: &usart1::RegisterBlock) {
    // SAFETY: zero clears the end of transmission, ones leave the other flags alone.
    usart.sr().write(|w| unsafe { w.bits(0x03ff).tc().clear() });
}

/// Lets the end of what is being sent, its last stop bit, raise the interrupt.
pub fn announce_end(usart: &usart1::RegisterBlock) {
    usart.cr1().modify(|_, w| w.tcie().enabled());
}

/// In the interrupt: whether everything has been sent. Raises no other.
pub fn take_end(usart: &usart1::RegisterBlock) -> bool {
    let ended = usart.sr().read().tc().bit_is_set();
    if ended {
        usart.cr1().modify(|_, w| w.tcie().disabled());
    }
    ended
}

/// Sets the UART up: 8 bits, no parity, one stop bit, DMA both ways.
pub fn start(usart: &usart1::RegisterBlock) {
    // SAFETY: the divider of 84 MHz by the bit rate is 91, above the least of 16.
    usart.brr().write(|w| unsafe { w.bits(divider(APB2_HZ, BITS_PER_SECOND) as u16) });
    usart.cr3().write(|w| w.dmar().enabled().dmat().enabled());
    usart.cr1().write(|w| w.ue().enabled().te().enabled().re().enabled());
}

/// Starts reception into a circle of `length` bytes.
///
/// # Safety
/// `data_register` must be USART1's; `buffer` must be writable memory of `length` bytes that DMA2 reaches, and is only
/// read by others.
pub unsafe fn start_reception(dma2: &dma::RegisterBlock, data_register: u32, buffer: u32, length: u16) {
    // SAFETY: passed on to the caller.
    let stream = unsafe { dma::prepare(dma2, RECEIVE_STREAM, data_register, buffer, length) };
    stream.cr().write(|w| {
        let w = w.chsel().set(CHANNEL).pl().medium().circ().enabled();
        w.dir().peripheral_to_memory().minc().incremented().psize().bits8().msize().bits8()
    });
    stream.cr().modify(|_, w| w.en().enabled());
}

/// Position in the circle where the next byte will be written.
pub fn write_position(dma2: &dma::RegisterBlock, length: u16) -> u16 {
    length.wrapping_sub(dma2.st(RECEIVE_STREAM).ndtr().read().ndt().bits()).min(length.wrapping_sub(1))
}

/// Starts sending `length` bytes. The main loop sees the end by [`is_sending`]; no interrupt.
///
/// # Safety
/// `data_register` must be USART1's; `buffer` must stay unchanged memory of `length` bytes that DMA2 reaches until the
/// stream is idle.
pub unsafe fn start_sending(dma2: &dma::RegisterBlock, data_register: u32, buffer: u32, length: u16) {
    // SAFETY: passed on to the caller.
    let stream = unsafe { dma::prepare(dma2, SEND_STREAM, data_register, buffer, length) };
    stream.cr().write(|w| {
        let w = w.chsel().set(CHANNEL).pl().low();
        w.dir().memory_to_peripheral().minc().incremented().psize().bits8().msize().bits8()
    });
    // The bytes are in memory before the controller looks.
    fence(Ordering::Release);
    stream.cr().modify(|_, w| w.en().enabled());
}

/// Whether a transfer is under way.
pub fn is_sending(dma2: &dma::RegisterBlock) -> bool {
    dma2.st(SEND_STREAM).cr().read().en().is_enabled()
}
