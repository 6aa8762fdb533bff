//! How fast the processor must be: the same record at falling instruction rates, until blocks are lost.
//!
//! QEMU's instruction counter gives every instruction the same time, a power of two of nanoseconds. A Cortex-M4F needs
//! 1.2 to 1.6 cycles per instruction on code like this, and the QEMU board spends some 100 instructions per sample on
//! imitating converter and DMA, which hardware does by itself: the figures bound the need from above.

use super::signal::Signal;
use super::simulation;
use crate::Result;
use crate::virtual_node::qemu::Qemu;
use meshband::config::Configuration;
use rayon::prelude::*;
use serde::Serialize;

/// Slowest and fastest instruction rate tried, as powers of two of nanoseconds per instruction.
const SHIFTS: std::ops::RangeInclusive<u8> = 0..=4;

/// One instruction rate.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Pace {
    /// Million instructions per second.
    pub mips: f64,
    /// Blocks processed.
    pub blocks: u32,
    /// Blocks lost because the main loop did not keep up.
    pub lost: u32,
    /// Frames are those of the host, byte for byte: no block was even late.
    pub identical_to_host: bool,
}

/// Runs the record at every instruction rate.
///
/// # Errors
/// As [`super::trial::run`].
pub fn run(signal: &Signal, config: &Configuration, qemu: &Qemu) -> Result<Vec<Pace>> {
    let image = signal.image(config)?;
    let link = simulation::run(&image.bytes)?.link;
    let pace = |shift: u8| {
        let finished = Qemu { icount_shift: shift, ..qemu.clone() }.run(&image.bytes)?;
        Ok(Pace {
            mips: 1000.0 / f64::from(1u32 << shift),
            blocks: finished.count("blocks"),
            lost: finished.count("lost") + finished.count("missed"),
            identical_to_host: finished.link == link,
        })
    };
    SHIFTS.collect::<Vec<_>>().into_par_iter().map(pace).collect()
}
