//! Synchronous averages of both shafts, what they leave, and the node's own indicators of them.
//!
//! The average that is shown and judged goes over whole hunting periods where the run holds one (then the other
//! gear's pattern is gone exactly: McFadden 1987), else over all whole turns. What is locked to either shaft is
//! removed for envelope and search by fitting both averages alternately over all turns. Indicators are computed by
//! the node's code ([`meshband::gear_condition`]) on the average, brought to a power of two of samples exactly (it is
//! periodic). Limits: orders from half of 4096 on are left out of the indicators; what swells and fades over the run
//! is removed in the mean only.

use super::angle::Angle;
use crate::machine::Hunting;
use meshband::gear_condition;
use meshband::indicators::{Moments, RunEnsemble};
use meshband::tsa::{RegularLines, difference};
use realfft::RealFftPlanner;
use serde::Serialize;

/// Most samples of an average that the node's transforms take.
const MOST_POINTS: usize = 4096;
/// Rounds in which the two shafts' averages are fitted.
const ROUNDS: usize = 3;
/// What the node counts as regular ([`meshband::gear_condition`]).
const SHAFT_ORDERS: u16 = 2;

/// A synchronous average with its indicators. Amplitudes in the record's unit.
#[derive(Debug, Clone, Serialize)]
pub struct Average {
    /// "pinion" or "gear".
    pub shaft: &'static str,
    /// Turns of that shaft averaged.
    pub turns: usize,
    /// Whether they are whole hunting periods.
    pub whole_hunting_periods: bool,
    /// Indicators of the average.
    pub indicators: Indicators,
    /// Tooth pitch in which the difference signal has most energy, counted from angle 0.
    pub strongest_tooth: usize,
    /// Its energy over that of the median pitch; about 2 in noise.
    pub strongest_tooth_over_median: f64,
    /// The average over one turn from angle 0.
    pub samples: Vec<f32>,
    /// Average less mesh harmonics, their first sidebands and shaft orders 1 and 2.
    #[serde(skip)]
    pub difference: Vec<f32>,
}

/// The node's indicators of an average.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Indicators {
    /// Root mean square about the mean.
    pub rms: f32,
    /// Largest distance from the mean.
    pub peak: f32,
    /// Peak over RMS.
    pub crest: f32,
    /// Fourth moment over squared variance.
    pub kurtosis: f32,
    /// RMS of what is locked to the mesh.
    pub regular_rms: f32,
    /// RMS of the residual.
    pub residual_rms: f32,
    /// RMS of the difference signal.
    pub difference_rms: f32,
    /// FM0 (Stewart 1977).
    pub fm0: f32,
    /// FM4 (Stewart 1977).
    pub fm4: f32,
    /// M6A (Martin 1989).
    pub m6a: f32,
    /// NA4 against this channel's runs so far (Zakrajsek 1993); the residual's kurtosis in the first.
    pub na4: f32,
}

/// One turn's mean of samples whose first stands `offset` samples after angle 0.
fn mean_turn(samples: &[f64], per_turn: usize, offset: usize) -> (Vec<f64>, usize) {
    let turns = samples.len() / per_turn;
    let mut mean = vec![0.0; per_turn];
    // Summed from the first sample on, turned to angle 0 at the end.
    for turn in samples.chunks_exact(per_turn) {
        mean.iter_mut().zip(turn).for_each(|(mean, x)| *mean += x);
    }
    mean.iter_mut().for_each(|mean| *mean /= turns.max(1) as f64);
    mean.rotate_right(offset);
    (mean, turns)
}

/// Samples after the gear's angle 0 at which the grid begins.
fn gear_offset(angle: &Angle) -> usize {
    let samples = (angle.from_turn * angle.per_turn[0] as f64).round() as i64;
    samples.rem_euclid(angle.per_turn[1] as i64) as usize
}

/// What repeats with a turn of either shaft, over all of `samples`.
pub fn locked_part(samples: &[f64], angle: &Angle) -> Vec<f64> {
    let mut locked = not_locked_part(samples, angle);
    locked.iter_mut().zip(samples).for_each(|(rest, x)| *rest = x - *rest);
    locked
}

/// The samples without what repeats with a turn of either shaft.
pub fn not_locked_part(samples: &[f64], angle: &Angle) -> Vec<f64> {
    let mut rest = samples.to_vec();
    for _ in 0..ROUNDS {
        for per_turn in angle.per_turn {
            let (mean, _) = mean_turn(&rest, per_turn, 0);
            for turn in rest.chunks_mut(per_turn) {
                turn.iter_mut().zip(&mean).for_each(|(rest, value)| *rest -= value);
            }
        }
    }
    rest
}

/// The averages of pinion and gear; `ensembles` of earlier runs take this one in.
pub fn averages(samples: &[f64], angle: &Angle, teeth: [u32; 2], ensembles: &mut [RunEnsemble; 2]) -> [Average; 2] {
    let hunting = Hunting::of(teeth).turns as usize;
    let whole_hunting_periods = angle.turns >= hunting;
    let turns = if whole_hunting_periods { angle.turns / hunting * hunting } else { angle.turns };
    let used = &samples[..turns * angle.per_turn[0]];
    let offsets = [0, gear_offset(angle)];
    std::array::from_fn(|shaft| {
        let (mean, turns) = mean_turn(used, angle.per_turn[shaft], offsets[shaft]);
        let points = power_of_two(&mean);
        judged(["pinion", "gear"][shaft], turns, whole_hunting_periods, points, teeth[shaft], &mut ensembles[shaft])
    })
}

/// An average with its indicators: `samples` are a power of two.
pub fn judged(
    shaft: &'static str,
    turns: usize,
    whole_hunting_periods: bool,
    samples: Vec<f32>,
    teeth: u32,
    ensemble: &mut RunEnsemble,
) -> Average {
    let (mut work, mut split) = (vec![0.0; samples.len()], vec![0.0; samples.len()]);
    let short = teeth as u16;
    let node = gear_condition::of_average(&samples, short, |run| ensemble.add(run), &mut work, &mut split)
        .expect("a power of two of samples that the node's transform takes");
    let regular = RegularLines { teeth: short, shaft_orders: SHAFT_ORDERS, sidebands: 1 };
    difference(&samples, &regular, &mut work, &mut split).expect("the same lengths");
    let (strongest_tooth, strongest_tooth_over_median) = strongest_pitch(&split, teeth as usize);
    let indicators = Indicators {
        rms: node.rms,
        peak: Moments::of(&samples).peak(),
        crest: node.crest,
        kurtosis: node.kurtosis,
        regular_rms: node.regular_rms,
        residual_rms: node.residual_rms,
        difference_rms: node.difference_rms,
        fm0: node.fm0,
        fm4: node.fm4,
        m6a: node.m6a,
        na4: node.na4,
    };
    Average {
        shaft,
        turns,
        whole_hunting_periods,
        indicators,
        strongest_tooth,
        strongest_tooth_over_median,
        samples,
        difference: split,
    }
}

/// Index of the tooth pitch with most energy, and that energy over the median one's.
fn strongest_pitch(samples: &[f32], teeth: usize) -> (usize, f64) {
    let mut energy = vec![0.0; teeth];
    for (i, &x) in samples.iter().enumerate() {
        energy[i * teeth / samples.len()] += f64::from(x) * f64::from(x);
    }
    let mut sorted = energy.clone();
    sorted.sort_by(f64::total_cmp);
    let strongest = (0..teeth).max_by(|&a, &b| energy[a].total_cmp(&energy[b])).unwrap_or(0);
    (strongest, energy[strongest] / sorted[teeth / 2].max(f64::MIN_POSITIVE))
}

/// A periodic signal read at the next power of two of points, no more than [`MOST_POINTS`], by its Fourier series.
fn power_of_two(turn: &[f64]) -> Vec<f32> {
    let points = turn.len().next_power_of_two().clamp(32, MOST_POINTS);
    let mut planner = RealFftPlanner::new();
    let forward = planner.plan_fft_forward(turn.len());
    let (mut input, mut bins) = (turn.to_vec(), forward.make_output_vec());
    forward.process(&mut input, &mut bins).expect("buffers have the planned lengths");
    let inverse = planner.plan_fft_inverse(points);
    let mut kept = inverse.make_input_vec();
    // The Nyquist lines stay out: half a line each, and beyond what is looked at.
    let count = (turn.len().div_ceil(2)).min(points / 2);
    kept[..count].copy_from_slice(&bins[..count]);
    kept[0].im = 0.0;
    let mut out = inverse.make_output_vec();
    inverse.process(&mut kept, &mut out).expect("buffers have the planned lengths");
    out.into_iter().map(|x| (x / turn.len() as f64) as f32).collect()
}
