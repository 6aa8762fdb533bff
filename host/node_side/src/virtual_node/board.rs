//! What a virtual board is to a trial: it plays a signal and says what came of it.
//!
//! Two boards: [`crate::virtual_node::qemu::Qemu`] runs the image `an386`, whose converter is an interrupt that reads
//! the signal from memory;
//! [`super::emulated::run::Emulated`] runs the very image that is flashed into an STM32F405.

use super::signal::Signal;
use crate::Result;
use meshband::config::Configuration;

/// A board that exists only here.
pub trait VirtualBoard {
    /// Plays a signal from a fresh start, `runs` times, and compares with the node's own code on the host.
    ///
    /// # Errors
    /// A signal or configuration that the node refuses; the image or what runs it absent, or a failed run.
    fn play(&self, signal: &Signal, config: &Configuration, runs: usize) -> Result<Played>;
}

/// The board's clock against the signal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Clock {
    /// Rate of the time base, Hz.
    pub ticks_per_second: f64,
    /// Tick, extended to 64 bits as the node does, at the signal's start.
    pub start: f64,
}

impl Clock {
    /// Seconds from the signal's start.
    pub fn seconds(&self, tick: u64) -> f64 {
        (tick as f64 - self.start) / self.ticks_per_second
    }
}

/// What a board made of a signal.
#[derive(Debug, Clone)]
pub struct Played {
    /// Every byte of the first run.
    pub link: Vec<u8>,
    /// For the instants in frames.
    pub clock: Clock,
    /// Rate of the signal at the converter's pin, Hz.
    pub signal_rate_hz: f64,
    /// Length played, s.
    pub duration_s: f64,
    /// Frames are the host's, byte for byte.
    pub identical_to_host: bool,
    /// Blocks are those of a processor that is never late.
    pub on_schedule: bool,
    /// Codes are those that the host took.
    pub identical_codes: bool,
    /// All runs sent the same bytes; `None` after a single run.
    pub identical_runs: Option<bool>,
    /// Blocks processed.
    pub blocks: u32,
    /// Blocks missed by the board.
    pub blocks_lost: u32,
    /// Tach edges lost.
    pub edges_lost: u32,
    /// Rate changes.
    pub rate_changes: u32,
    /// Million instructions per second.
    pub mips: f64,
    /// Wall-clock time of the first run, s.
    pub wall_time_s: f64,
    /// Converter rate of every block: start, s, and rate, Hz.
    pub rates: Vec<(f64, f64)>,
    /// Codes of the last block as accelerations, m/s2, over time, s.
    pub samples: Vec<(f64, f64)>,
}
