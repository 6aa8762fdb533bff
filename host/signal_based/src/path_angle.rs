//! The angle of a run-up without pulses, once the path is known.
//!
//! Without a tachometer the angle is that of the mesh lines, and in a run-up the path turns these: the angle wriggles
//! where a strong line passes a resonance, and all others wriggle against it. The calibrated model has the path as
//! resonances that all lines share, each at its own speed, so what it leaves of all lines together, each turned by
//! its order times the same angle, is the angle's error and no path. It is taken out and the model fitted anew, in
//! turns, as long as the model leaves less of the fitted turns (alternating least squares). Read over two turns of
//! the slower shaft, as `mesh_phase` does, so that shaft's sidebands stay. Cost: a fit of the model per round.
//! Limit: what turns all lines alike as a smooth function of the speed, a delay, is left to the path, which is free
//! in it.

use super::baseline::{Baseline, mesh_orders};
use super::errors::shares;
use super::scene::Scene;
use crate::analysis::mesh_phase::{self as phase, Departure};
use rayon::prelude::*;
use rustfft::num_complex::Complex64;
use std::f64::consts::TAU;

/// Rounds at most.
const ROUNDS: usize = 8;
/// Share of what the model leaves that must go in each.
const GAIN: f64 = 0.02;
/// Least noise of a line's phase, as a share of its amplitude: no model is better than that.
const LEAST_NOISE: f64 = 1e-2;
/// Windows on either side over which what is left of a line is its noise.
const NOISE_WINDOWS: usize = 16;

/// Fits the model and, where no pulses give the angle of a run-up, the angle with it.
pub fn fitted(scene: &mut Scene) -> Baseline {
    let mut baseline = Baseline::of(scene);
    if !scene.runs.iter().any(|run| run.runs_up() && !run.has_pulses) || scene.teeth[0] == 1 || scene.gearing.is_some()
    {
        return baseline;
    }
    for _ in 0..ROUNDS {
        let mut trial = scene.clone();
        let departures: Vec<Option<Departure>> =
            (0..scene.runs.len()).map(|r| departure(scene, &baseline, r)).collect();
        for (run, departure) in trial.runs.iter_mut().zip(departures) {
            if let Some(map) = departure.and_then(|departure| departure.taken_out(&run.angle)) {
                run.turn(map, scene.highest_order);
            }
        }
        let with = Baseline::of(&trial);
        if left(&trial, &with) > (1.0 - GAIN) * left(scene, &baseline) {
            break;
        }
        (*scene, baseline) = (trial, with);
    }
    baseline
}

/// What the model leaves of the fitted turns of run-ups without pulses: shares of the channels' power, summed.
fn left(scene: &Scene, baseline: &Baseline) -> f64 {
    let shares = shares(scene, &baseline.calibrated, |split| &split.fit);
    let own = scene.runs.iter().zip(shares).filter(|(run, _)| run.runs_up() && !run.has_pulses);
    own.flat_map(|(_, shares)| shares).sum()
}

/// What all lines of a run together say that the angle is off.
fn departure(scene: &Scene, baseline: &Baseline, r: usize) -> Option<Departure> {
    let run = &scene.runs[r];
    if !run.runs_up() || run.has_pulses {
        return None;
    }
    let windows = phase::Windows::of(&run.angle)?;
    let orders = mesh_orders(scene);
    let lines: Vec<(usize, f64)> =
        (0..run.samples.len()).flat_map(|channel| orders.iter().map(move |order| (channel, *order))).collect();
    let of_line = |&(channel, order): &(usize, f64)| {
        let [all, left] = [&run.samples[channel], &baseline.calibrated[r][channel]]
            .map(|samples| windows.read(samples, run.angle.per_turn[0], order));
        weighted(order, &all, &left)
    };
    let (mut sums, mut totals) = (vec![0.0; windows.count], vec![f64::MIN_POSITIVE; windows.count]);
    for line in lines.par_iter().map(of_line).collect::<Vec<_>>() {
        for (i, [sum, total]) in line.into_iter().enumerate() {
            sums[i] += sum;
            totals[i] += total;
        }
    }
    Some(windows.departure(sums.iter().zip(&totals).map(|(sum, total)| sum / total).collect()))
}

/// A line's departure from the model, turns, window by window, times its weight, and the weight.
fn weighted(order: f64, all: &[Complex64], left: &[Complex64]) -> Vec<[f64; 2]> {
    let of = |((all, left), power): ((&Complex64, &Complex64), f64)| {
        let own = all - left;
        let noise = power + LEAST_NOISE.powi(2) * own.norm_sqr();
        let weight = (TAU * order).powi(2) * own.norm_sqr() / noise.max(f64::MIN_POSITIVE);
        [weight * (all * own.conj()).arg() / (TAU * order), weight]
    };
    all.iter().zip(left).zip(phase::running_power(left, NOISE_WINDOWS)).map(of).collect()
}
