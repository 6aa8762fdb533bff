//! Spectra of what the calibrated model leaves: over orders, over frequency, and of what is folded in it.
//!
//! Three views of the same stretches, and two of all turns, fitted, held out and between: nearly three times as long
//! in one piece, so that a slow order stands apart from a mesh line, and a slow swing from a wander. A quarter of the
//! turns alone would not tell the two; that turns held out take part is the price. Squared envelopes are the impacts'
//! own ([`super::impacts`]).

use super::baseline::Grids;
use super::candidate::{Domain, Field, TakenOf};
use super::mesh_amplitude_demodulation::Strength;
use super::mesh_line_tracking::followed_in_run_ups;
use super::scene::{Scene, SceneRun};
use super::spectra::{Spectra, evened, follow_everywhere, mean, without_the_highest};
use super::split::{Split, Stretch};
use crate::analysis::envelope::not_locked;
use crate::analysis::search::{self, Level, Range};
use crate::spectral::resample_by_angle;
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Lowest frequency looked at, Hz: below it sensors drift.
const LOWEST_HZ: f64 = 5.0;
/// Part of a second of which a spectrum over frequency has a whole number.
const PART_S: f64 = 0.25;
/// Share of the sampling rate up to which frequencies are looked at.
const PASS_SHARE: f64 = 0.4;

/// Shares of the sampling rate between which folded harmonics are looked for: nearer to half of it, what a filter of
/// usual steepness lets through folds.
const FOLD_RATE_SHARES: [f64; 2] = [0.62, 0.97];

/// The views.
pub struct Views {
    /// Over orders.
    pub orders: Spectra,
    /// Over frequency.
    pub frequency: Spectra,
    /// Over orders, what lies beyond half the rate and is folded below it.
    pub folded: Spectra,
    /// Over orders, all turns.
    pub all_turns: Spectra,
    /// How strongly the gears mesh, all turns.
    pub strength: Strength,
}

impl Views {
    /// One of them with what is taken there, as a family is read.
    pub fn field<'a>(&'a self, taken: &'a TakenOf, domain: Domain, channels: std::ops::Range<usize>) -> Field<'a> {
        Field { spectra: self.of(domain), taken: &taken[domain as usize], channels }
    }

    /// The view of a domain.
    pub fn of(&self, domain: Domain) -> &Spectra {
        match domain {
            Domain::Orders => &self.orders,
            Domain::Frequency => &self.frequency,
            Domain::Folded => &self.folded,
            Domain::Strength => &self.strength.spectra,
        }
    }
}

/// Views of the stretches that `stretches` chooses, from what the calibrated model leaves (`left`); all turns are
/// those of an `earlier` view of the same, if there is one.
pub fn views(
    scene: &Scene,
    left: &Grids,
    stretches: impl Fn(&Split) -> &[Stretch] + Sync,
    earlier: Option<&Views>,
) -> Views {
    let calibrated = &followed_in_run_ups(scene, left);
    let orders = Spectra::searched(scene, calibrated, |r| stretches(&scene.runs[r].split).to_vec());
    let whole = |r: usize| vec![Stretch { from: 0, turns: scene.runs[r].angle.turns }];
    let all_turns =
        earlier.map_or_else(|| Spectra::searched(scene, calibrated, whole), |earlier| earlier.all_turns.clone());
    let of_channel = |r: usize, c: usize| {
        let run = &scene.runs[r];
        let lowest_mesh_hz = scene.meshes().into_iter().fold(f64::INFINITY, f64::min) * run.angle.speed.slowest_hz;
        of_channel(run, c, (&calibrated[r][c], lowest_mesh_hz), stretches(&run.split))
    };
    let all: Vec<Vec<ChannelViews>> = (0..scene.runs.len())
        .map(|r| (0..scene.channels.len()).into_par_iter().map(|c| of_channel(r, c)).collect())
        .collect();
    let slowest = scene.runs.iter().map(|run| run.rate_hz).fold(f64::INFINITY, f64::min);
    let folded = folded_orders(scene);
    let split = |of: fn(&ChannelViews) -> &Vec<Level>| -> Vec<Vec<Vec<Level>>> {
        all.iter().map(|run| run.iter().map(|v| of(v).clone()).collect()).collect()
    };
    Views {
        frequency: Spectra { levels: split(|v| &v.frequency), lowest: LOWEST_HZ, highest: PASS_SHARE * slowest },
        folded: Spectra { levels: split(|v| &v.folded), lowest: folded[0], highest: folded[1] },
        orders,
        all_turns,
        strength: earlier.map_or_else(|| Strength::of(scene, left), |earlier| earlier.strength.clone()),
    }
}

struct ChannelViews {
    frequency: Vec<Level>,
    folded: Vec<Level>,
}

fn of_channel(
    run: &SceneRun,
    channel: usize,
    (calibrated, lowest_mesh_hz): (&[f64], f64),
    stretches: &[Stretch],
) -> ChannelViews {
    let known: Vec<f64> = run.samples[channel].iter().zip(calibrated).map(|(x, rest)| x - rest).collect();
    let over_time = not_locked(&run.signals[channel], run.rate_hz, &known, &run.angle);
    ChannelViews {
        frequency: over_frequency(run, &over_time, stretches, lowest_mesh_hz),
        folded: folded_levels(run, &over_time, stretches),
    }
}

/// Orders at which folded harmonics are looked for: those of every run; of a run-up, those of any of its stretches.
fn folded_orders(scene: &Scene) -> [f64; 2] {
    let of = |run: &SceneRun| {
        let speed = run.angle.speed;
        if run.runs_up() {
            let [low, _] = folded_between(run, [speed.fastest_hz; 2]);
            let [_, high] = folded_between(run, [speed.slowest_hz; 2]);
            return [low, high];
        }
        folded_between(run, [speed.slowest_hz, speed.fastest_hz])
    };
    scene.runs.iter().map(of).fold([0.0, f64::INFINITY], |[low, high], [l, h]| [low.max(l), high.min(h)])
}

/// Orders that are folded at all speeds between two and not next to half the rate.
fn folded_between(run: &SceneRun, [slowest_hz, fastest_hz]: [f64; 2]) -> [f64; 2] {
    [FOLD_RATE_SHARES[0] * run.rate_hz / slowest_hz, FOLD_RATE_SHARES[1] * run.rate_hz / fastest_hz]
}

/// Spectra of what is folded on the stretches, as one. In a run-up each stretch says something of the orders that are
/// folded at its own speeds, and nothing of the rest.
fn folded_levels(run: &SceneRun, rest: &[f64], stretches: &[Stretch]) -> Vec<Level> {
    let speed = run.angle.speed;
    if !run.runs_up() {
        let range = folded_between(run, [speed.slowest_hz, speed.fastest_hz]);
        return mean(stretches.iter().map(|stretch| unfolded(run, rest, *stretch, range)));
    }
    let of_stretch = |stretch: &Stretch| {
        let speeds = || run.states[stretch.from..stretch.from + stretch.turns].iter().map(|state| state.speed_hz);
        let slowest = speeds().fold(f64::INFINITY, f64::min);
        let range = folded_between(run, [slowest, speeds().fold(0.0, f64::max)]);
        let mut levels = unfolded(run, rest, *stretch, range);
        for level in &mut levels {
            for (i, (value, floor)) in level.density.values.iter_mut().zip(&level.floor).enumerate() {
                if !(range[0]..range[1]).contains(&(i as f64 * level.density.bin)) {
                    *value = *floor;
                }
            }
        }
        levels
    };
    evened(stretches.iter().map(of_stretch))
}

/// Spectra of what is folded, at its own orders: the residual times twice the cosine of the rate's phase, read at
/// equal angles.
fn unfolded(run: &SceneRun, rest: &[f64], stretch: Stretch, [lowest, highest]: [f64; 2]) -> Vec<Level> {
    let most = 2.0 * FOLD_RATE_SHARES[1] * run.rate_hz / run.angle.speed.slowest_hz;
    let per_turn = (2 * run.angle.per_turn[0]).max(most.ceil() as usize);
    let from = run.angle.from_turn + stretch.from as f64;
    let mut samples = resample_by_angle(rest, run.rate_hz, &run.angle.map, from, stretch.turns, per_turn);
    for (i, x) in samples.iter_mut().enumerate() {
        let time = run.angle.map.time_at(from + i as f64 / per_turn as f64);
        *x *= 2.0 * (TAU * (run.rate_hz * time).fract()).cos();
    }
    search::levels(&samples, per_turn, run.angle.slower_order(), &Range { lowest, highest, known: &|_, _| false })
}

fn over_frequency(run: &SceneRun, rest: &[f64], stretches: &[Stretch], lowest_mesh_hz: f64) -> Vec<Level> {
    let first = |s: &Stretch| {
        let time = run.angle.map.time_at(run.angle.from_turn + s.from as f64);
        ((time * run.rate_hz).max(0.0) as usize).min(rest.len())
    };
    let length = |s: &Stretch| {
        let end = Stretch { from: s.from + s.turns, turns: 0 };
        first(&end) - first(s)
    };
    // As many whole parts of a second as the shortest stretch has; such a part is the "turn" of the search.
    let part = ((PART_S * run.rate_hz).round() as usize).max(1);
    let samples = stretches.iter().map(length).min().unwrap_or(0);
    let per_turn = if samples >= part { part } else { samples.max(1) };
    let scale = run.rate_hz / per_turn as f64;
    let range = Range { lowest: LOWEST_HZ / scale, highest: PASS_SHARE * run.rate_hz / scale, known: &|_, _| false };
    let slowest = run.angle.speed.slowest_hz / scale;
    let levels = |s: &Stretch| {
        let part = &rest[first(s)..(first(s) + samples).min(rest.len())];
        let mut levels = search::levels(part, per_turn, slowest, &range);
        for level in &mut levels {
            level.density.bin *= scale;
            level.density.values.iter_mut().chain(&mut level.floor).for_each(|density| *density /= scale);
            follow_everywhere(level);
        }
        levels
    };
    let levels: Vec<Vec<Level>> = stretches.iter().map(levels).collect();
    if run.runs_up() { without_the_highest(levels, lowest_mesh_hz) } else { mean(levels.into_iter()) }
}
