//! A drill on QEMU's `mps2-an386`: panic, stack overflow, fault and hang, each of which must end in a restart that
//! knows why.
//!
//! The same crash page, fault entry and panic handler as in the released image, on a core that really resets. The stage
//! lies in memory that a reset leaves alone, as the crash page does; the hang is ended by the board's watchdog.
#![no_std]
#![no_main]

use core::cell::UnsafeCell;
use cortex_m_rt::{entry, exception};
use defmt_semihosting as _;
use meshband_node::crash::{self, Cause};
use semihosting::{eprintln, process};

meshband_node::restart_on_failure!();

/// How many restarts lie behind; zero after power-up, which QEMU's memory is all of.
#[repr(transparent)]
struct Stage(UnsafeCell<u32>);

// SAFETY: only `main` touches it, and no interrupt is unmasked.
unsafe impl Sync for Stage {}

#[unsafe(link_section = ".uninit.stage")]
static STAGE: Stage = Stage(UnsafeCell::new(0));

#[entry]
fn main() -> ! {
    // SAFETY: the only access; volatile, because the value comes from before the reset.
    let stage = unsafe {
        let stage = STAGE.0.get().read_volatile();
        STAGE.0.get().write_volatile(stage + 1);
        stage
    };
    match crash::last() {
        Some(crash) => {
            eprintln!("node: stage={stage} crashes={} place={} file={}", crash.count, crash.place, crash.file())
        }
        None => eprintln!("node: stage={stage} crashes=0"),
    }
    match stage {
        0 => panic!("staged"),
        1 => eprintln!("node: {} levels survived", overflow(1)),
        2 => cortex_m::asm::udf(),
        3 => hang(),
        4 => {
            eprintln!("node: finished");
            process::exit(0)
        }
        _ => {}
    }
    eprintln!("node: stage {stage} did not end in a restart");
    process::exit(1)
}

/// The watchdog's warning; a hanging node would not heed it.
#[exception]
unsafe fn NonMaskableInt() {}

/// Recurses without end, with a frame the compiler cannot remove.
#[inline(never)]
fn overflow(depth: u32) -> u32 {
    let frame = core::hint::black_box([depth; 256]);
    if core::hint::black_box(true) { overflow(depth + 1) + frame[depth as usize % 256] } else { depth }
}

/// Starts the watchdog (CMSDK, 25 MHz; 40 ms to its interrupt and 40 ms more to the reset) and never feeds it.
fn hang() -> ! {
    const LOAD: *mut u32 = 0x4000_8000 as *mut u32;
    const CONTROL: *mut u32 = 0x4000_8008 as *mut u32;
    const INTERRUPT_AND_RESET: u32 = 0b11;
    // SAFETY: AN386 has its watchdog there; it is unlocked after a reset.
    unsafe {
        LOAD.write_volatile(1_000_000);
        CONTROL.write_volatile(INTERRUPT_AND_RESET);
    }
    loop {
        cortex_m::asm::nop();
    }
}

const _: () = assert!(Cause::StackOverflow as u32 == 4, "see reference/node.md of the book and qemu_runner.rs");
