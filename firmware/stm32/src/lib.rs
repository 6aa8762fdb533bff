//! How the node samples on an STM32, and what it programs into an STM32F405, one file per role.
//!
//! [`block_stamp`], [`filter`], [`period`] and [`reset`] know no register and serve every family whose timers are
//! wired alike. The rest, behind the feature `f405`, are drivers: every driver takes a reference to a register block
//! and does nothing but read and write it: no interrupt, no queue, no fixed address. The image hands in the chip's
//! blocks, the tests (`tests/tests/board/stm32_registers.rs`, `stm32_timing.rs`) blocks of plain memory, and assert
//! bit by bit what the reference manual asks for. That stands in for a board until one is at hand; it proves what is
//! written, not what silicon makes of it.
//!
//! How the parts work together, all on one clock of 84 MHz:
//!
//! ```text
//! TIM2 (32 bit) --update = TRGO--> ADC3 --DMA2 stream 0, double buffer--> blocks of 512 codes (256 with two sensors),
//!   |   |                     +--> ADC2 --DMA2 stream 3, double buffer--> and its 256 codes behind them
//!   ^   |
//!   |   +--ITR1--> TIM3 counts a block's samples --update--> DMA1 stream 2 writes TIM2's preloaded reload
//!   +--------------------------------------------------+       (the next block's period)
//!                  TIM3 --TRGO, ITR1--> TIM5 channel 2 captures the instant of the block's last sample
//! tach, PA0 --filter--> TIM5 channel 1 captures the edge            (TIM5, 32 bit, free: the time base)
//! pulse per second, PA3 --filter--> TIM5 channel 4
//! internal reference, temperature sensor --> ADC1, started by software
//! ```
//!
//! No software has a part in when a rate changes or what a block's instant is: an interrupt may come anywhere within
//! the next block and loses nothing; later still, the over-capture flag of TIM5 channel 2 says so, and one block is
//! given up.
//!
//! Source of all numbers: reference manual RM0090 and data sheet DS8626 (STM32F405).
#![no_std]

#[cfg(feature = "f405")]
pub mod adc;
pub mod block_stamp;
#[cfg(feature = "f405")]
pub mod clock;
pub mod design_parameters;
#[cfg(feature = "f405")]
pub mod dma;
pub mod filter;
#[cfg(feature = "f405")]
pub mod flash;
#[cfg(feature = "f405")]
pub mod housekeeping;
#[cfg(feature = "f405")]
pub mod output;
pub mod period;
#[cfg(feature = "f405")]
pub mod pins;
pub mod reset;
#[cfg(feature = "f405")]
pub mod sample_clock;
#[cfg(feature = "f405")]
pub mod spi;
#[cfg(feature = "f405")]
pub mod time_base;
#[cfg(feature = "f405")]
pub mod uart;
#[cfg(feature = "f405")]
pub mod unique_id;
#[cfg(feature = "f405")]
pub mod watchdog;

#[cfg(feature = "f405")]
pub use stm32f4::stm32f405 as pac;

pub use design_parameters::BLOCK_SAMPLES;
