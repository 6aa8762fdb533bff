//! The node on an STM32F405: tachometer and link.
#![no_std]
#![no_main]

use cortex_m_rt::{ExceptionFrame, entry, exception};
use defmt_rtt as _;
use meshband_node::stm32f405::{Board, crash};

#[entry]
fn main() -> ! {
    let last_crash = crash::last();
    let mut board = Board::start();
    if let Some(crash) = last_crash {
        defmt::error!("restarted after crash {=u32} at {=u32:x}", crash.count, crash.place);
    }
    defmt::info!("crystal: {=bool}", board.crystal);
    loop {
        board.feed_watchdog();
        while let Some(edge) = board.edges.dequeue() {
            defmt::trace!("edge {=u32}", edge);
        }
        board.wait();
    }
}

/// Only ends the main loop's sleep.
#[exception]
fn SysTick() {}

#[exception]
unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
    crash::record_and_reset(frame.pc())
}

#[panic_handler]
fn panic(info: &core::panic::PanicInfo) -> ! {
    crash::record_and_reset(info.location().map_or(0, |place| place.line()))
}
