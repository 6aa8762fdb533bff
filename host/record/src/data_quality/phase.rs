//! The mesh line over all turns: mixed down with the angle that the pulses give, frame by frame.
//!
//! A line that stands where pulses and teeth put it keeps its phase. A steady turn of the phase is a speed or clock
//! that is off by that much, a jump is an angle that is wrong from there on. The floor is what frames hold beside
//! the line, where no order of either shaft lies. Cost: one pass over each channel; the angle is read every sixteen
//! samples and is straight between.

use super::pulsed::Pulsed;
use crate::spectral::{AngleMap, Window};
use rayon::prelude::*;
use rustfft::num_complex::Complex64 as C;
use std::f64::consts::TAU;

/// Samples between which the angle is straight.
const BLOCK: usize = 16;
/// Blocks after which a phase is computed anew.
const RENEWAL_BLOCKS: usize = 64;
/// Turns of the slower shaft in a frame, shortest frame, s, and fewest frames that say anything.
const FRAME_TURNS: f64 = 12.0;
const LEAST_FRAME_S: f64 = 0.2;
const LEAST_FRAMES: usize = 8;
/// Power of a line over its floor in a frame in which it stands.
const MIN_FLOOR_POWER_RATIO: f64 = 12.0;
/// Harmonics that are followed.
const HARMONICS: usize = 3;
/// Frames before and behind a jump, how well their phases must agree, and how far apart they must lie, cycles.
const SIDE: usize = 4;
const MIN_PHASE_AGREEMENT: f64 = 0.9;
const JUMP: f64 = 0.12;
/// Change of speed above which the phase may turn by itself: the paths' resonances.
const MAX_SPEED_CHANGE_SHARE: f64 = 0.1;

/// What following the line gave.
pub(super) struct Followed {
    /// Share of the frames in which the line stands at its place.
    pub share: f64,
    /// Mean place over the implied one, where it stands; and the error of that.
    pub ratio: Option<f64>,
    pub error: f64,
    /// Time of the largest jump of the phase, s, and its size in teeth.
    pub jump: Option<(f64, f64)>,
}

/// One line of one channel: its frames, and the floor's power.
struct Line {
    harmonic: usize,
    frames: Vec<C>,
    floor: Vec<f64>,
}

impl Line {
    fn stands(&self, m: usize) -> bool {
        self.frames[m].norm_sqr() > MIN_FLOOR_POWER_RATIO * self.floor[m]
    }
}

/// Follows the mesh of `pulsed` along `map`; `None` where the run is too short.
pub(super) fn follow(pulsed: &Pulsed<'_>, map: &AngleMap) -> Option<Followed> {
    let gear = f64::from(pulsed.teeth[0]) / f64::from(pulsed.teeth[1]);
    let pinion_hz = pulsed.edges_s.len() as f64 - 1.0;
    let span_s = pulsed.edges_s[pulsed.edges_s.len() - 1] - pulsed.edges_s[0];
    let pinion_hz = pinion_hz / f64::from(pulsed.pulses) / span_s / pulsed.ratio;
    let frame_s = (FRAME_TURNS / (pinion_hz * gear.min(1.0))).max(LEAST_FRAME_S);
    let samples = pulsed.channels.first()?.len();
    let from = (pulsed.edges_s[0].max(0.0) * pulsed.rate_hz) as usize;
    let to = ((pulsed.edges_s[pulsed.edges_s.len() - 1] * pulsed.rate_hz) as usize).min(samples);
    let blocks = to.checked_sub(from)? / BLOCK;
    let half = ((0.5 * frame_s * pulsed.rate_hz) as usize / BLOCK).max(1);
    let frames = (blocks / half).checked_sub(1)?;
    if frames < LEAST_FRAMES {
        return None;
    }
    // Turns of the pinion at the blocks' ends.
    let turns: Vec<f64> =
        (0..=blocks).map(|b| map.turns_at((from + b * BLOCK) as f64 / pulsed.rate_hz) / pulsed.ratio).collect();
    let grid = Grid { turns, from, half, frames };
    let teeth = f64::from(pulsed.teeth[0]);
    let top = 0.45 * pulsed.rate_hz / (pinion_hz * teeth);
    let beside = beside(gear);
    let all: Vec<(&Vec<f64>, usize)> = pulsed
        .channels
        .iter()
        .flat_map(|channel| (1..=HARMONICS).map(move |h| (channel, h)))
        .filter(|(_, h)| *h as f64 <= top)
        .collect();
    let lines: Vec<Line> = all
        .into_par_iter()
        .map(|(channel, harmonic)| {
            let order = harmonic as f64 * teeth;
            let at = |order: f64| grid.mixed(channel, order);
            let around: Vec<Vec<C>> = beside.iter().map(|offset| at(order + offset)).collect();
            let floor = |m: usize| {
                let mut powers: Vec<f64> = around.iter().map(|line| line[m].norm_sqr()).collect();
                powers.sort_by(f64::total_cmp);
                powers[powers.len() / 2]
            };
            Line { harmonic, frames: at(order), floor: (0..frames).map(floor).collect() }
        })
        .collect();
    let hop_turns = (grid.turns[blocks] - grid.turns[0]) / blocks as f64 * half as f64;
    let hop_s = half as f64 * BLOCK as f64 / pulsed.rate_hz;
    let stands = |m: usize| lines.iter().any(|line| line.stands(m));
    let (ratio, error) = place(&lines, teeth, hop_turns);
    let speed = |m: usize| grid.turns[(m + 1) * half] - grid.turns[m * half];
    let (slow, fast) = (0..=frames).map(speed).fold((f64::INFINITY, 0.0_f64), |(l, h), s| (l.min(s), h.max(s)));
    let jump = if fast > (1.0 + MAX_SPEED_CHANGE_SHARE) * slow { None } else { jump(&lines) };
    Some(Followed {
        share: (0..frames).filter(|m| stands(*m)).count() as f64 / frames as f64,
        ratio,
        error,
        jump: jump.map(|(m, cycles)| ((from as f64 / pulsed.rate_hz) + (m as f64 + 0.5) * hop_s, cycles)),
    })
}

/// Offsets from the line, orders, as far as possible from all orders of both shafts.
fn beside(gear: f64) -> [f64; 3] {
    let distance = |offset: f64| {
        let near = |a: i32| {
            let b = (offset - f64::from(a)) / gear;
            (b - b.round()).abs() * gear
        };
        let pinion = (offset - offset.round()).abs();
        (-2..=2).map(near).fold(pinion, f64::min)
    };
    let mut all: Vec<(f64, f64)> = (10..60).map(|i| f64::from(i) / 60.0).map(|x| (distance(x), x)).collect();
    all.sort_by(|a, b| b.0.total_cmp(&a.0));
    [all[0].1, -all[0].1, all[1].1]
}

/// Blocks and frames of a run.
struct Grid {
    /// Turns of the pinion at the ends of the blocks.
    turns: Vec<f64>,
    /// First sample.
    from: usize,
    /// Blocks in half a frame.
    half: usize,
    frames: usize,
}

impl Grid {
    /// The channel mixed down at an order of the pinion: Hann-weighted sums, frames half over each other.
    fn mixed(&self, channel: &[f64], order: f64) -> Vec<C> {
        let blocks = self.turns.len() - 1;
        let mut phasor = C::ONE;
        let sums: Vec<C> = (0..blocks)
            .map(|b| {
                let samples = &channel[self.from + b * BLOCK..self.from + (b + 1) * BLOCK];
                let turn = C::cis(-TAU * order * (self.turns[b + 1] - self.turns[b]) / BLOCK as f64);
                // The phase goes on from block to block, but for rounding.
                if b.is_multiple_of(RENEWAL_BLOCKS) {
                    phasor = C::cis(-TAU * (order * self.turns[b]).fract());
                }
                rotated(samples, &mut phasor, turn)
            })
            .collect();
        let weights = Window::Hann.weights(2 * self.half);
        let frame = |m: usize| {
            let part = &sums[m * self.half..(m + 2) * self.half];
            part.iter().zip(&weights).map(|(sum, weight)| sum * weight).sum()
        };
        (0..self.frames).map(frame).collect()
    }
}

/// Sum of samples times phasors that turn from one to the next, in lanes that need not wait for each other.
fn rotated(samples: &[f64], phasor: &mut C, turn: C) -> C {
    const LANES: usize = 4;
    let mut phasors = [*phasor; LANES];
    for lane in 1..LANES {
        phasors[lane] = phasors[lane - 1] * turn;
    }
    let turn = (turn * turn) * (turn * turn);
    let mut sums = [C::ZERO; LANES];
    for samples in samples.chunks_exact(LANES) {
        for lane in 0..LANES {
            sums[lane] += phasors[lane] * samples[lane];
            phasors[lane] *= turn;
        }
    }
    *phasor = phasors[0];
    sums.iter().sum()
}

/// Mean place of the lines over the implied one, and its error, from the turn of the phase between frames.
fn place(lines: &[Line], teeth: f64, hop_turns: f64) -> (Option<f64>, f64) {
    let mut best: Option<(f64, f64, f64)> = None;
    for line in lines {
        let pairs = (1..line.frames.len()).filter(|&m| line.stands(m) && line.stands(m - 1));
        let steps: Vec<C> = pairs.map(|m| line.frames[m] * line.frames[m - 1].conj()).collect();
        let sum: C = steps.iter().sum();
        let power: f64 = steps.iter().map(|step| step.norm()).sum();
        if steps.len() * 2 < line.frames.len() || sum.norm() < 0.5 * power {
            continue;
        }
        let noise: f64 = line.floor.iter().sum::<f64>() / line.frames.iter().map(|z| z.norm_sqr()).sum::<f64>();
        let orders = TAU * line.harmonic as f64 * teeth * hop_turns;
        // From end to end the errors of the steps between cancel.
        let error = noise.sqrt() / orders / steps.len() as f64 * 3.0;
        if best.is_none_or(|(_, before, _)| error < before) {
            best = Some((1.0 + sum.arg() / orders, error, power));
        }
    }
    best.map_or((None, f64::INFINITY), |(ratio, error, _)| (Some(ratio), error))
}

/// The largest jump of the phase between steady frames, as frame and teeth.
fn jump(lines: &[Line]) -> Option<(usize, f64)> {
    let mut best: Option<(usize, f64)> = None;
    for line in lines.iter().filter(|line| line.harmonic == 1) {
        // A steady turn is a speed that is off, no jump.
        let steps: C = line.frames.windows(2).map(|w| w[1] * w[0].conj()).sum();
        let turn = if steps.norm() > 0.0 { steps / steps.norm() } else { C::ONE };
        let mut phasor = C::ONE;
        let mut steady = Vec::new();
        for (m, z) in line.frames.iter().enumerate() {
            steady.push(if line.stands(m) { z * phasor / z.norm() } else { C::ZERO });
            phasor *= turn.conj();
        }
        for m in SIDE..steady.len().saturating_sub(SIDE + 2) {
            let before: C = steady[m - SIDE..m].iter().sum::<C>() / SIDE as f64;
            let behind: C = steady[m + 2..m + 2 + SIDE].iter().sum::<C>() / SIDE as f64;
            if before.norm() < MIN_PHASE_AGREEMENT || behind.norm() < MIN_PHASE_AGREEMENT {
                continue;
            }
            let cycles = (behind * before.conj()).arg() / TAU;
            if cycles.abs() > JUMP && best.is_none_or(|(_, size)| cycles.abs() > size.abs()) {
                best = Some((m, cycles));
            }
        }
    }
    best
}
