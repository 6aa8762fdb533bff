//! A run of the emulated board: signal and edges in, bytes, codes and captures out.

use super::{flashed, store};
use crate::virtual_node::qemu::built_firmware;
use crate::{Error, Result};
use meshband::config::Configuration;
use meshband::pipeline::Channels;
use meshband_emulator::board::{Board, CYCLES_PER_INSTRUCTION};
use meshband_emulator::flash::{DATA_START, START};
use meshband_emulator::unicorn;
use meshband_emulator::world::{Analogue, Sampled};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Rate of the board's time base, Hz.
pub const TICKS_PER_SECOND: u32 = 84_000_000;
/// Ticks of the time base between two units of the emulator's time.
const UNITS_PER_TICK: u64 = 4;
/// Seconds for the board to start in, before the signal begins.
pub const START_S: f64 = 0.25;
/// Seconds of a slice, after which what was seen is taken over.
const SLICE_S: f64 = 0.05;

/// An emulated board, not yet switched on.
#[derive(Clone, Debug)]
pub struct Emulated {
    /// The firmware's ELF image.
    pub firmware: PathBuf,
    /// Cycles that the core needs for an instruction.
    pub cycles_per_instruction: f64,
}

/// What a board is fed with.
pub struct Feed<'a> {
    /// Share of the converter's range, 0 to 1, at seconds from the signal's start.
    pub analogue: Analogue,
    /// The same at the second converter; half the range where absent.
    pub second: Option<Analogue>,
    /// Rising edges of the tach, s from the signal's start, ascending.
    pub edges_s: &'a [f64],
    /// Length, s.
    pub duration_s: f64,
    /// Stored in the board's flash before it starts; the board's default where absent.
    pub config: Option<&'a Configuration>,
}

/// A block as the converter and the DMA made it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SampledBlock {
    /// Instant of the first sample, ticks of the board.
    pub first_tick: u32,
    /// Sample period, ticks.
    pub period: u32,
    /// The codes.
    pub codes: Vec<u16>,
    /// Those of the second converter; empty where it is not in use.
    pub second: Vec<u16>,
}

/// What a run gave.
#[derive(Clone, Debug, Default)]
pub struct Heard {
    /// Every byte the board sent.
    pub link: Vec<u8>,
    /// Complete blocks, in order.
    pub blocks: Vec<SampledBlock>,
    /// Blocks that lacked samples.
    pub broken: usize,
    /// Edges as the board's input gives them, ticks.
    pub edges: Vec<u32>,
    /// Resets while it ran.
    pub resets: usize,
    /// Tick of the board at which the signal began, not wrapped; for times in frames.
    pub start_tick: f64,
    /// Instructions executed.
    pub instructions: u64,
    /// Wall-clock time.
    pub wall_time: Duration,
}

impl Emulated {
    /// With this image.
    pub fn new(firmware: impl Into<PathBuf>) -> Self {
        Self { firmware: firmware.into(), cycles_per_instruction: CYCLES_PER_INSTRUCTION }
    }

    /// With the built image of the released board; `None` where it or Unicorn is absent.
    pub fn of_board() -> Option<Self> {
        let firmware = built_firmware("stm32f405");
        (unicorn::is_installed() && firmware.is_file()).then(|| Self::new(firmware))
    }

    /// A board with power, at its first instruction.
    ///
    /// # Errors
    /// [`Error::Tool`] where image or Unicorn is absent, [`Error::Invalid`] for a configuration that does not fit.
    pub fn power_up(&self, config: Option<&Configuration>) -> Result<Board> {
        if !self.firmware.is_file() {
            let what = format!(
                "no image at {}: in a checkout `cargo xtask node-build` builds it, elsewhere name one with --firmware",
                self.firmware.display()
            );
            return Err(Error::tool("firmware", what));
        }
        let image = flashed::read(&self.firmware)?;
        let mut board = Board::new(&image).map_err(as_tool)?;
        board.cpu().set_pace(self.cycles_per_instruction);
        if let Some(config) = config {
            let at = (DATA_START - START) as usize;
            store::save(&mut board.chip_mut().cells[at..at + store::BYTES], config)?;
        }
        Ok(board)
    }

    /// Runs the board on a feed to its end.
    ///
    /// # Errors
    /// As [`Emulated::power_up`]; [`Error::Tool`] where the board did what the chip does not serve.
    pub fn run(&self, feed: &Feed<'_>) -> Result<Heard> {
        let begin = Instant::now();
        let mut board = self.power_up(feed.config)?;
        let (analogue, end_s) = (feed.analogue.clone(), START_S + feed.duration_s);
        board.set_analogue(std::sync::Arc::new(move |time_s| analogue(time_s - START_S)));
        board.add_tach_edges(&feed.edges_s.iter().map(|edge| edge + START_S).collect::<Vec<_>>());
        board.seen().keep_conversions = true;
        let mut heard = Heard::default();
        if let Some(second) = feed.second.clone() {
            board.set_second(std::sync::Arc::new(move |time_s| second(time_s - START_S)));
        }
        let mut open = [Vec::new(), Vec::new()];
        let mut time_s = 0.0;
        while time_s < end_s {
            time_s = f64::min(time_s + SLICE_S, end_s);
            board.run_until(time_s).map_err(as_tool)?;
            heard.take(&mut board, &mut open);
        }
        heard.resets = board.seen().resets.len();
        heard.instructions = board.cpu().instructions();
        heard.wall_time = begin.elapsed();
        Ok(heard)
    }
}

fn as_tool(error: meshband_emulator::error::Error) -> Error {
    Error::tool("node in emulation", error)
}

impl Heard {
    /// Takes over what a board has done; `open` are samples of both converters that no block has taken yet.
    fn take(&mut self, board: &mut Board, [open, second]: &mut [Vec<Sampled>; 2]) {
        self.link.extend(board.take_sent());
        let seen = board.seen();
        open.append(&mut seen.conversions);
        second.append(&mut seen.second);
        let edges = std::mem::take(&mut seen.captured);
        self.edges.extend(edges.iter().map(|edge| edge.tick.wrapping_sub(edge.filter_ticks)));
        // A border is its last sample's trigger; the conversion ends later, perhaps in the next slice.
        let converted = open.last().map_or(0, |sample| sample.trigger);
        let complete = seen.borders.iter().take_while(|border| border.at <= converted).count();
        let borders: Vec<_> = seen.borders.drain(..complete).collect();
        for border in borders {
            let until = |open: &mut Vec<Sampled>| -> Vec<Sampled> {
                let count = open.iter().take_while(|sample| sample.trigger <= border.at).count();
                open.drain(..count).collect()
            };
            let (samples, of_second) = (until(open), until(second));
            // A border before sampling has begun is none.
            if samples.is_empty() {
                continue;
            }
            match block(&samples, &of_second, border.tick) {
                Some(block) => self.blocks.push(block),
                None => self.broken += 1,
            }
            if self.blocks.len() == 1 {
                let start = board.chip().time_at(START_S) as f64;
                self.start_tick = f64::from(border.tick) - (border.at as f64 - start) / UNITS_PER_TICK as f64;
            }
        }
    }
}

/// A block of equally spaced samples, whose last one was captured at `last_tick`, with those of the second converter
/// at the same triggers.
fn block(samples: &[Sampled], of_second: &[Sampled], last_tick: u32) -> Option<SampledBlock> {
    let (first, next) = (samples.first()?, samples.get(1)?);
    let spacing = next.trigger - first.trigger;
    let even = samples.windows(2).all(|pair| pair[1].trigger - pair[0].trigger == spacing);
    let channels = if of_second.is_empty() { Channels::One } else { Channels::Two };
    let together = of_second.is_empty() || samples.iter().map(|s| s.trigger).eq(of_second.iter().map(|s| s.trigger));
    if samples.len() != channels.instants() || !even || !together {
        return None;
    }
    let period = (spacing / UNITS_PER_TICK) as u32;
    let first_tick = last_tick.wrapping_sub(period * (samples.len() as u32 - 1));
    let codes = |samples: &[Sampled]| samples.iter().map(|sample| sample.code).collect();
    Some(SampledBlock { first_tick, period, codes: codes(samples), second: codes(of_second) })
}
