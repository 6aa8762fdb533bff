//! Link: USART1 on PA9 and PA10, both directions by DMA2.
//!
//! USART1 because it runs from 84 MHz: 921 600 bit/s is met within 0.16 %, where USART2's 42 MHz gives 0.9 %; and because
//! the chip's own boot loader listens there. Reception is a circle that the main loop reads behind the DMA's
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
