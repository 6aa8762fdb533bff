//! The emulated board as a virtual board: a record at its converter's pin, the host on what its devices made of it.

use super::reference;
use super::run::{Emulated, Feed, Heard, TICKS_PER_SECOND};
use crate::virtual_node::analogue::Interpolator;
use crate::virtual_node::board::{Clock, Played, VirtualBoard};
use crate::virtual_node::signal::Signal;
use crate::virtual_node::trial::check_version;
use crate::{Error, Result};
use meshband::board::Timing;
use meshband::config::Configuration;
use meshband::events::EventKind;
use meshband::frame::{Decoder, Packet};
use meshband::message::Message;
use meshband::units::Acceleration;
use meshband_emulator::world::Analogue;
use std::sync::Arc;

/// Share of the converter's range that the samples' peak takes; what lies between them may be higher.
const PEAK_SHARE: f64 = 0.85;
/// Codes from the middle of the range to its end, left-aligned to 16 bits.
const HALF_RANGE: f64 = 32_768.0;
/// Cycles of the core per microsecond.
const CORE_MEGAHERTZ: f64 = 168.0;

impl VirtualBoard for Emulated {
    fn play(&self, signal: &Signal, config: &Configuration, runs: usize) -> Result<Played> {
        let full_scale = full_scale_of(&signal.samples)?;
        let mut config = config.clone();
        let second = signal.second.as_ref().map(|second| Ok((second, full_scale_of(&second.samples)?))).transpose()?;
        config.sensor.acceleration_per_code = Acceleration((full_scale / HALF_RANGE) as f32);
        config.sensor.zero_code = 0x8000;
        if let (Some((_, full_scale)), Some(sensor)) = (&second, &mut config.second) {
            sensor.acceleration_per_code = Acceleration((full_scale / HALF_RANGE) as f32);
            sensor.zero_code = 0x8000;
        }
        config.validate(Timing::STM32F405).map_err(|error| Error::invalid("the node's configuration", error))?;
        let duration_s = signal.duration_s();
        let edges_s: Vec<f64> = signal.edges_s.iter().copied().filter(|t| (0.0..duration_s).contains(t)).collect();
        let feed = Feed {
            analogue: analogue(&signal.samples, signal.rate_hz, full_scale),
            second: second.map(|(second, full_scale)| analogue(&second.samples, signal.rate_hz, full_scale)),
            edges_s: &edges_s,
            duration_s,
            config: Some(&config),
        };
        let heard = self.run(&feed)?;
        check_version(&heard.link)?;
        let comparison = reference::compare(&heard, &config)?;
        let mut identical_runs = None;
        for _ in 1..runs {
            identical_runs = Some(identical_runs.unwrap_or(true) && self.run(&feed)?.link == heard.link);
        }
        let clock = clock(&heard);
        let seconds =
            |tick: u32| (f64::from(tick.wrapping_sub(first_tick(&heard))) + lead(&heard)) / clock.ticks_per_second;
        Ok(Played {
            clock,
            signal_rate_hz: signal.rate_hz,
            duration_s,
            identical_to_host: comparison.is_equal() && heard.resets == 0,
            on_schedule: heard.broken == 0 && heard.resets == 0,
            identical_codes: heard.broken == 0,
            identical_runs,
            blocks: heard.blocks.len() as u32,
            blocks_lost: heard.broken as u32,
            edges_lost: (edges_s.len() as u32).saturating_sub(heard.edges.len() as u32),
            rate_changes: heard.blocks.windows(2).filter(|w| w[0].period != w[1].period).count() as u32,
            mips: CORE_MEGAHERTZ / self.cycles_per_instruction,
            wall_time_s: heard.wall_time.as_secs_f64(),
            rates: rates(&heard),
            samples: heard.blocks.last().map_or_else(Vec::new, |block| {
                let value = |code: u16| (f64::from(code) - HALF_RANGE) / HALF_RANGE * full_scale;
                let start = seconds(block.first_tick);
                let step = f64::from(block.period) / clock.ticks_per_second;
                block.codes.iter().enumerate().map(|(n, &code)| (start + n as f64 * step, value(code))).collect()
            }),
            link: heard.link,
        })
    }
}

/// Acceleration at the end of the converter's range, m/s2.
fn full_scale_of(samples: &[f64]) -> Result<f64> {
    let refuse = |what: &str| Err(Error::invalid("signal for the node", what));
    if samples.len() < 2 || samples.iter().any(|x| !x.is_finite()) {
        return refuse("needs at least two samples, all finite");
    }
    let peak = samples.iter().fold(0.0, |peak: f64, x| peak.max(x.abs()));
    if peak == 0.0 { refuse("is zero throughout") } else { Ok(peak / PEAK_SHARE) }
}

/// The signal between its samples, mirrored before its start: the board wakes up to a machine that runs.
fn analogue(samples: &[f64], rate_hz: f64, full_scale: f64) -> Analogue {
    let samples = samples.to_vec();
    let between = Interpolator::new();
    Arc::new(move |time_s| 0.5 + 0.5 * between.value(&samples, time_s.abs() * rate_hz) / full_scale)
}

/// First sample of the first block, ticks.
fn first_tick(heard: &Heard) -> u32 {
    heard.blocks.first().map_or(0, |block| block.first_tick)
}

/// Ticks from the signal's start to the first block: negative, because the board starts before.
fn lead(heard: &Heard) -> f64 {
    f64::from(first_tick(heard)) - heard.start_tick
}

/// The node's clock: its first event carries what it counts from.
fn clock(heard: &Heard) -> Clock {
    let mut decoder = Decoder::new();
    let origin = heard.link.iter().find_map(|&byte| match decoder.push(byte)?.ok()?.packet {
        Packet::Message(Message::Event(event)) if event.kind == EventKind::Started => Some(event.first_tick),
        _ => None,
    });
    Clock { ticks_per_second: f64::from(TICKS_PER_SECOND), start: origin.unwrap_or(0) as f64 + heard.start_tick }
}

/// Converter rate over time. Blocks follow each other without a gap, so that lengths add up beyond the counter's wrap.
fn rates(heard: &Heard) -> Vec<(f64, f64)> {
    let clock = f64::from(TICKS_PER_SECOND);
    let mut at = lead(heard);
    let mut rows = Vec::with_capacity(heard.blocks.len());
    for block in &heard.blocks {
        rows.push((at / clock, clock / f64::from(block.period)));
        at += f64::from(block.period) * block.codes.len() as f64;
    }
    rows
}
