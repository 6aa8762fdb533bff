//! An emulated STM32F405 board that runs the released image, unmodified: the very ELF that is flashed.
//!
//! Of the processor the instructions are executed by Unicorn's shared library, an external tool as QEMU is
//! ([`unicorn`]). Everything else is modelled here after the reference manual RM0090 and the Armv7-M manual:
//! exceptions, priorities, sleep and faults ([`cpu`],
//! [`nvic`]), clocks ([`rcc`]), flash with its data cache, programming and erasure ([`flash`]), timers with triggers
//! and filtered captures ([`timer`]), converters ([`adc`]), DMA ([`dma`]), line ([`usart`]), bus to the amplifier
//! ([`spi`]), ports ([`gpio`]), watchdog ([`watchdog`]). [`chip`] wires them, [`bus`] is their addresses, [`world`]
//! what is around them and what was seen of them. Depends on nothing of the project, so that it cannot share its
//! mistakes.
//!
//! **Strict.** A register or bit that is not modelled, a device whose clock is off, memory that is not there, what
//! the manual forbids: each ends the run with [`error::Violation`], address, program counter and time. The alias of
//! flash at address zero serves vectors only: a null pointer is found.
//!
//! **Time** is exact ([`time`]): every clock is a whole number of units of 1/336 MHz, and everything happens in the
//! order of its instants. Only the core is approximate: so many cycles per instruction (2.0 unless told otherwise;
//! the core's manual gives 1 to 2.5), interrupts at the borders of blocks of instructions. Two runs are alike to the
//! last bit.
//!
//! # Use
//!
//! ```no_run
//! use meshband_emulator::{board::Board, elf::Image};
//! use std::sync::Arc;
//!
//! # fn main() -> meshband_emulator::error::Result<()> {
//! // Its vectors at the first address of flash, as the loader's are; segments of several images may be joined.
//! let mut board = Board::new(&Image::read("loader".as_ref())?)?;
//! board.set_analogue(Arc::new(|time_s| 0.5 + 0.3 * (3000.0 * time_s).sin()));
//! board.add_tach_edges(&[0.30, 0.34, 0.38]);
//! board.run_until(1.0)?;
//! let frames = board.take_sent();
//! let (resets, lights) = (board.seen().resets.len(), board.seen().pins.len());
//!
//! // From one place in several ways: a power cut at 1000 instants of what comes next.
//! let before = board.snapshot();
//! for n in 0..1000 {
//!     board.restore(&before)?;
//!     board.run_until(1.0 + 1e-5 * f64::from(n))?;
//!     board.cycle_power();
//!     board.run_until(2.0)?;
//! }
//! # Ok(())
//! # }
//! ```
//!
//! What goes wrong at will:
//!
//! | what | how |
//! | --- | --- |
//! | power cut, torn word or sector | [`board::Board::cycle_power`] at any instant; `chip().flash` counts |
//! | no crystal, PLL that never locks | `chip_mut().rcc.oscillators` before the start |
//! | crystal lost while running | [`chip::Chip::lose_crystal`] |
//! | internal oscillator off by a per cent | `chip_mut().internal_fast` |
//! | watchdog's oscillator at its limits | `chip_mut().watchdog.cycle` |
//! | bus to the amplifier that hangs | `chip_mut().spi2.dead` |
//! | bounces, glitches, storms at the tach | [`board::Board::add_tach_levels`] |
//! | bytes from the host | [`board::Board::send`], at another rate [`board::Board::set_line`] |
//! | supply and temperature of the chip | `chip_mut().inputs`, what the factory measured in `chip_mut().factory` |
//! | pulses per second | [`board::Board::add_second_pulses`] |
//! | slow or fast core | [`cpu::Cpu::set_pace`] |
//! | wild program, stack overflow | `set_program_counter`, `set_register`, `take_faults` of [`cpu::Cpu`] |
//! | memory of the program | [`chip::Chip::peek`] and [`chip::Chip::poke`] at an address of [`elf::Image::symbols`] |
//!
//! Not modelled: bus contention, FIFO mode of the DMA, interrupts inside a block of instructions, lazy stacking,
//! debug and trace units, analogue errors of the converter, wear of the flash.
//!
//! Cost: 40 to 50 million instructions per second on a free core; the node executes about 20 million per second of
//! signal.

pub mod adc;
pub mod board;
pub mod bus;
pub mod chip;
pub mod cpu;
pub mod dma;
pub mod elf;
pub mod error;
pub mod flash;
mod frame;
pub mod gpio;
pub mod memory;
pub mod nvic;
pub mod rcc;
pub mod spi;
pub mod time;
pub mod timer;
pub mod unicorn;
pub mod usart;
pub mod watchdog;
pub mod world;
