//! The board in QEMU as a virtual board: a replay image in its memory, the host on the same image.

use super::board::{Clock, Played, VirtualBoard};
use super::image::{Image, TICKS_PER_SECOND};
use super::signal::Signal;
use super::simulation::{self, Simulated, TakenBlock};
use crate::virtual_node::qemu::Qemu;
use crate::{Error, Result};
use meshband::config::Configuration;
use meshband::replay::{BLOCK_SAMPLES, Replay, START_TICK};
use rayon::prelude::*;

impl VirtualBoard for Qemu {
    fn play(&self, signal: &Signal, config: &Configuration, runs: usize) -> Result<Played> {
        let image = signal.image(config)?;
        let planned = simulation::run(&image.bytes)?;
        let mut finished =
            (0..runs.max(1)).into_par_iter().map(|_| self.run(&image.bytes)).collect::<Result<Vec<_>>>()?;
        let first = finished.swap_remove(0);
        // Before frames are compared: an image of another version sends other ones.
        super::trial::check_version(&first.link)?;
        let blocks = first.blocks()?;
        let on_schedule = blocks == planned.blocks;
        let simulated = if on_schedule { planned } else { simulation::follow(&image.bytes, &blocks)? };
        Ok(Played {
            clock: Clock { ticks_per_second: f64::from(TICKS_PER_SECOND), start: f64::from(START_TICK) },
            signal_rate_hz: image.signal_rate_hz,
            duration_s: image.duration_s,
            identical_to_host: simulated.link == first.link,
            on_schedule,
            identical_codes: first.statistic("codes_crc") == Some(&format!("{:08x}", simulated.codes_crc)),
            identical_runs: (runs > 1).then(|| finished.iter().all(|other| other.link == first.link)),
            blocks: first.count("blocks"),
            blocks_lost: first.count("lost") + first.count("missed"),
            edges_lost: first.count("edges_lost"),
            rate_changes: simulated.blocks.windows(2).filter(|w| w[0].period != w[1].period).count() as u32,
            mips: 1000.0 / f64::from(1u32 << self.icount_shift),
            wall_time_s: first.wall_time.as_secs_f64(),
            rates: block_rates(&simulated),
            samples: last_block(&image, &simulated)?,
            link: first.link,
        })
    }
}

/// What the converter gave in the last block, m/s2.
fn last_block(image: &Image, simulated: &Simulated) -> Result<Vec<(f64, f64)>> {
    let replay = Replay::parse(&image.bytes).map_err(|e| Error::invalid("replay image", format!("{e:?}")))?;
    let Some(&TakenBlock { first_tick, period, .. }) = simulated.blocks.last() else { return Ok(Vec::new()) };
    let mut codes = [0; BLOCK_SAMPLES];
    replay.sample(first_tick, period, &mut codes);
    let value = |code: u16| (f64::from(code) - 32_768.0) / 32_767.0 * image.full_scale_m_s2;
    let time = |n: usize| (f64::from(first_tick) + f64::from(period) * n as f64) / f64::from(TICKS_PER_SECOND);
    Ok(codes.iter().enumerate().map(|(n, &code)| (time(n), value(code))).collect())
}

fn block_rates(simulated: &Simulated) -> Vec<(f64, f64)> {
    let clock = f64::from(TICKS_PER_SECOND);
    let row =
        |block: &TakenBlock| (f64::from(block.first_tick - block.period) / clock, clock / f64::from(block.period));
    simulated.blocks.iter().map(row).collect()
}
