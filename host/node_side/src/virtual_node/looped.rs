//! A signal without an end, made of one that has an end: cut at tach edges where all angles come back, blended over the
//! seam.
//!
//! The cut holds whole hunting periods where the signal has them, so that both shafts and the mesh go on; else the
//! whole turns of the tach's shaft after which the other shaft is nearest to where it began, and how far it jumps is
//! known ([`Loop::jump_deg`]). Over the last quarter of a turn the signal passes into what came before the first edge,
//! so samples do not jump either. Values are interpolated from the record's own samples at any instant
//! ([`super::analogue`]): no length is too long for a memory, and nothing is silent. Cost: 64 multiply-adds per value,
//! 128 within the seam.

use super::analogue::{HALF, Interpolator};
use super::image::TICKS_PER_SECOND;
use super::signal::Signal;
use crate::{Error, Result};
use meshband::units::Acceleration;

/// Share of the range of codes that the signal's peak takes.
const PEAK_SHARE: f64 = 0.9;
/// Codes from the middle of the range to its end.
const HALF_RANGE: f64 = 32_767.0;
/// Code of zero.
pub const ZERO_CODE: u16 = 0x8000;
/// Length of the blend, turns of the tach's shaft.
const BLEND_TURNS: f64 = 0.25;
/// A jump of a shaft below this is none, turns: a degree.
const NO_JUMP: f64 = 1.0 / 360.0;

/// One loop of a signal with its tach.
pub struct Loop {
    /// Edges of one loop, ticks from its start; the first is 0.
    edges: Vec<u32>,
    /// Its length, ticks.
    length: u64,
    /// First sample instant, samples of the record.
    from: f64,
    /// Samples of the record per tick.
    per_tick: f64,
    /// Length of the blend before the end, ticks.
    blend: f64,
    jump_deg: f64,
    speeds: [f64; 2],
    between: Interpolator,
}

/// A channel of a loop as the converter has it.
pub struct Channel<'a> {
    samples: &'a [f64],
    /// Acceleration of the largest code, m/s2.
    full_scale: f64,
}

impl<'a> Channel<'a> {
    /// Scaled so that its peak fits.
    ///
    /// # Errors
    /// Samples that are not finite, or all zero.
    pub fn new(samples: &'a [f64], place: &str) -> Result<Self> {
        let peak = samples.iter().fold(0.0, |peak: f64, x| peak.max(x.abs()));
        if !(peak > 0.0 && samples.iter().all(|x| x.is_finite())) {
            return Err(Error::invalid(place, "is zero throughout, or not finite"));
        }
        Ok(Self { samples, full_scale: peak / PEAK_SHARE })
    }

    /// What a code means, m/s2.
    pub fn acceleration_per_code(&self) -> Acceleration {
        Acceleration((self.full_scale / HALF_RANGE) as f32)
    }
}

impl Loop {
    /// The longest loop that a signal gives.
    ///
    /// # Errors
    /// A signal that holds no whole turn behind the first quarter of one.
    pub fn new(signal: &Signal) -> Result<Self> {
        let per_turn = signal.pulses_per_turn.max(1) as usize;
        let end_s = signal.duration_s();
        let all: Vec<f64> = signal.edges_s.iter().copied().filter(|t| (0.0..end_s).contains(t)).collect();
        let too_short = || {
            let what = format!("{} tach edges hold no whole turn to be looped: lengthen the signal", all.len());
            Error::invalid(&signal.place, what)
        };
        let turn_s = all.get(per_turn).ok_or_else(too_short)? - all[0];
        let lead_s = BLEND_TURNS * turn_s + HALF as f64 / signal.rate_hz;
        let first = all.iter().position(|&t| t >= lead_s).ok_or_else(too_short)?;
        let whole = (all.len() - 1 - first) / per_turn;
        let (used, jump) = cut(signal, whole).ok_or_else(too_short)?;
        let last = first + used * per_turn;
        let clock = f64::from(TICKS_PER_SECOND);
        let ticks = |t: f64| ((t - all[first]) * clock).round() as u32;
        let speed = |from: usize| {
            let turn_s = all[from + per_turn] - all[from];
            signal.pinion_per_tach / turn_s
        };
        Ok(Self {
            edges: all[first..last].iter().map(|&t| ticks(t)).collect(),
            length: u64::from(ticks(all[last])),
            from: all[first] * signal.rate_hz,
            per_tick: signal.rate_hz / clock,
            blend: BLEND_TURNS * turn_s * clock,
            jump_deg: if jump < NO_JUMP { 0.0 } else { 360.0 * jump },
            speeds: [speed(last - per_turn), speed(first)],
            between: Interpolator::new(),
        })
    }

    /// Length, s.
    pub fn seconds(&self) -> f64 {
        self.length as f64 / f64::from(TICKS_PER_SECOND)
    }

    /// By how much the shaft without a tach jumps at the seam, degrees; 0 where all angles come back.
    pub fn jump_deg(&self) -> f64 {
        self.jump_deg
    }

    /// Pinion speed of the loop's last and first turn, Hz.
    pub fn speeds_hz(&self) -> [f64; 2] {
        self.speeds
    }

    /// Tick of the edge `index`, loops counted on.
    pub fn edge_tick(&self, index: u64) -> u64 {
        let count = self.edges.len() as u64;
        index / count * self.length + u64::from(self.edges[(index % count) as usize])
    }

    /// Acceleration at a tick, m/s2.
    pub fn value(&self, channel: &Channel<'_>, tick: u64) -> f64 {
        let within = (tick % self.length) as f64;
        let at = |tick: f64| self.between.value(channel.samples, self.from + tick * self.per_tick);
        let rest = self.length as f64 - within;
        if rest >= self.blend {
            return at(within);
        }
        let old = rest / self.blend;
        old * at(within) + (1.0 - old) * at(-rest)
    }

    /// What the converter gives at a tick of a signal that is `factor` times as strong: offset binary of 16 bits.
    pub fn code(&self, channel: &Channel<'_>, tick: u64, factor: f64) -> u16 {
        let code = factor * self.value(channel, tick) / channel.full_scale * HALF_RANGE;
        (code + f64::from(ZERO_CODE)).round().clamp(0.0, f64::from(u16::MAX)) as u16
    }
}

/// Whole turns of the tach's shaft to use of so many, and the jump of the other shaft, turns.
fn cut(signal: &Signal, whole: usize) -> Option<(usize, f64)> {
    let hunting = f64::from(crate::machine::Hunting::of(signal.teeth).turns) / signal.pinion_per_tach;
    let hunting = (hunting.round() as usize).max(1);
    if whole >= hunting {
        return Some((whole / hunting * hunting, 0.0));
    }
    let [pinion, gear] = signal.teeth.map(f64::from);
    let apart = |turns: f64| (turns - turns.round()).abs();
    let jump = |turns: usize| {
        let of_pinion = turns as f64 * signal.pinion_per_tach;
        apart(of_pinion).max(apart(of_pinion * pinion / gear))
    };
    // Not from the shortest on: a loop of a few turns is hardly the machine.
    let candidates = (whole.div_ceil(2).max(1)..=whole).map(|turns| (turns, jump(turns)));
    candidates.min_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0)))
}
