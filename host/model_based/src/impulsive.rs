//! Impacts at an order that is not locked to the teeth: squared-envelope spectrum of the residual, band by band.
//!
//! Deterministic lines are removed first (subtraction, then bins far above local noise are silenced). Each band's
//! analytic signal gives a squared envelope; in stationary noise its spectrum's bins, over their local mean, are
//! exponential with mean 1. An order scan sums fundamental and second harmonic over the fit runs (capped), with
//! Bonferroni over orders, bands and channels, and the winner must stand alone in the selection runs. Source: Randall
//! and Antoni's envelope analysis; limits: order from 0.2 to 40.

use super::accept;
use super::base_fit::Base;
use super::judge::Split;
use super::least_squares::Data;
use super::outcome::{Effect, Evidence, Value};
use super::probability::Probability;
use crate::spectral::noise_power;
use rayon::prelude::*;
use rustfft::{FftPlanner, num_complex::Complex64 as C};
use std::collections::BTreeMap;

const BAND_WIDTH_HZ: f64 = 2000.0;
const CAP: f64 = 14.0;
/// Noise power that a local estimate gives of nothing at all.
const NO_NOISE: f64 = 1e-24;

/// Squared-envelope spectrum of one band over its local mean.
fn envelope(bins: &[C], noise: &[f64], first: usize, count: usize) -> Vec<f64> {
    let mut band: Vec<C> = (first..first + count)
        .map(|b| {
            let x = bins[b] / noise[b].sqrt();
            if x.norm_sqr() > 12.0 { C::ZERO } else { x }
        })
        .collect();
    let mut planner = FftPlanner::new();
    planner.plan_fft_inverse(count).process(&mut band);
    let mut square: Vec<C> = band.iter().map(|z| C::new(z.norm_sqr(), 0.0)).collect();
    planner.plan_fft_forward(count).process(&mut square);
    let power: Vec<f64> = square[..count / 2].iter().map(|z| z.norm_sqr()).collect();
    let hop = 100;
    let level: Vec<f64> = (0..power.len().div_ceil(hop))
        .map(|i| {
            let from = (i * hop).saturating_sub(hop).max(10);
            let mut near = power[from..((i + 2) * hop).min(power.len())].to_vec();
            near.sort_by(f64::total_cmp);
            near[near.len() / 2] / std::f64::consts::LN_2
        })
        .collect();
    power.iter().enumerate().map(|(i, p)| p / level[i / hop].max(1e-300)).collect()
}

fn summed(base: &Base, spectra: &[Vec<f64>], runs: &[usize], order: f64) -> f64 {
    let duration = base.analyser.duration_s();
    let mut sum = 0.0;
    for &r in runs {
        for harmonic in [1.0, 2.0] {
            let b = (harmonic * order * base.runs[r].angle.shaft_hz * duration).round() as usize;
            let power = spectra[r].get(b).copied().unwrap_or(1.0);
            // Strong impacts reach the cap in every band and at neighbouring orders: a trace of the uncapped size
            // decides between those.
            sum += power.min(CAP) + 1e-3 * (1.0 + power).ln();
        }
    }
    sum
}

/// The lowest part of `order` whose own line stands in the envelope spectra: the harmonics of impacts are nearly as
/// strong as their fundamental, and the scan may have locked onto one of them.
fn fundamental(base: &Base, spectra: &[Vec<f64>], runs: &[usize], order: f64) -> Option<(f64, f64)> {
    let duration = base.analyser.duration_s();
    let fastest = runs.iter().map(|&r| base.runs[r].angle.shaft_hz).fold(0.0, f64::max);
    let slowest = runs.iter().map(|&r| base.runs[r].angle.shaft_hz).fold(f64::INFINITY, f64::min);
    let lowest = 12.0 / (duration * slowest);
    let line = |at: f64| {
        runs.iter()
            .map(|&r| {
                let b = (at * base.runs[r].angle.shaft_hz * duration).round() as usize;
                spectra[r].get(b).copied().unwrap_or(1.0).min(CAP)
            })
            .sum::<f64>()
    };
    [5.0, 4.0, 3.0, 2.0].iter().map(|k| order / k).filter(|o| *o > lowest).find_map(|o| {
        let step = 0.25 / (duration * fastest);
        let near = (-4..=4).map(|i| o + f64::from(i) * step);
        let (at, sum) = near.map(|o| (o, line(o))).max_by(|a, b| a.1.total_cmp(&b.1))?;
        (Probability::gamma_above(sum, runs.len() as f64).value() < 1e-5).then(|| (at, summed(base, spectra, runs, at)))
    })
}

/// Looks for impacts in the residual `rest`.
pub fn impacts(base: &Base, rest: &Data, split: &Split) -> Option<Effect> {
    let duration = base.analyser.duration_s();
    let count = (BAND_WIDTH_HZ * duration) as usize;
    let bands = base.analyser.bins / count;
    let fastest = base.runs.iter().map(|r| r.angle.shaft_hz).fold(0.0, f64::max);
    let slowest = base.runs.iter().map(|r| r.angle.shaft_hz).fold(f64::INFINITY, f64::min);
    let ratio = f64::from(base.machine.teeth[0]) / f64::from(base.machine.teeth[1]);
    let step = 0.4 / (duration * fastest);
    let lowest = 12.0 / (duration * slowest);
    // An order is known to about a bin at the fastest run.
    let guard = 1.0 / (duration * fastest);
    // What calibration leaves of the mesh lines beats at the mesh frequency: no impacts there, nor at half of it,
    // whose second harmonic it is.
    let half_mesh = 0.5 * f64::from(base.machine.teeth[0]);
    let of_mesh = |o: f64| (o - half_mesh * (o / half_mesh).round().max(1.0)).abs() < 1.5 * guard;
    let orders = (0..((40.0 - lowest) / step) as usize).map(|i| lowest + i as f64 * step);
    let orders: Vec<f64> = orders.filter(|o| !of_mesh(*o)).collect();
    let locked = |o: f64| (o - o.round()).abs() < guard || (o / ratio - (o / ratio).round()).abs() * ratio < guard;
    let tests = orders.len() as f64 * 0.5 * 2.0 * bands as f64;
    let noise: Vec<[Vec<f64>; 2]> =
        rest.residual.par_iter().map(|run| [noise_power(&run[0]), noise_power(&run[1])]).collect();
    // A channel without noise has no envelope: its bins are zero or rounding.
    let silent = |channel: usize| noise.iter().any(|run| run[channel].iter().all(|n| *n <= NO_NOISE));
    let heard: Vec<usize> = (0..2 * bands).filter(|index| !silent(index % 2)).collect();
    let best = heard
        .into_par_iter()
        .map(|index| {
            let (channel, band) = (index % 2, index / 2);
            let spectra: Vec<Vec<f64>> = (0..base.runs.len())
                .map(|r| envelope(&rest.residual[r][channel], &noise[r][channel], band * count, count))
                .collect();
            let (order, sum) = orders
                .iter()
                .map(|&o| (o, summed(base, &spectra, &split.fit, o)))
                .max_by(|a, b| a.1.total_cmp(&b.1))
                .unwrap_or((1.0, 0.0));
            let (order, sum) = fundamental(base, &spectra, &split.fit, order).unwrap_or((order, sum));
            let alone = summed(base, &spectra, &split.select, order);
            (sum, alone, order, channel, band)
        })
        .max_by(|a, b| a.0.total_cmp(&b.0))?;
    let (sum, alone, order, channel, band) = best;
    let chance = Probability::gamma_above(sum, 2.0 * split.fit.len() as f64).among(tests.ln());
    let confirmed = Probability::gamma_above(alone, 2.0 * split.select.len() as f64);
    if !accept::impacts_are_there(chance, confirmed) {
        return None;
    }
    // Resolution of the scan, or the wander of a slipping order.
    let half = (0.6 / (duration * fastest)).max(0.005 * order);
    let carrier = (band as f64 + 0.5) * BAND_WIDTH_HZ;
    let mut parameters = BTreeMap::new();
    let value =
        |value: f64, half: f64, unit: &str| Value { value, ci95: [value - half, value + half], unit: unit.into() };
    parameters.insert("order".to_string(), value(order, half, "per pinion turn"));
    parameters.insert("carrier_band".to_string(), value(carrier, 0.5 * BAND_WIDTH_HZ, "Hz"));
    let (verdict, name) = if locked(order) {
        ("generic", format!("noise or impacts repeating at order {order:.3} of the pinion, a whole order of a shaft"))
    } else {
        ("named", "bearing-impacts".to_string())
    };
    Some(Effect {
        verdict: verdict.into(),
        name,
        family: "impulsive".into(),
        shaft: ["pinion", "gear"][channel].into(),
        order_of_pinion: Some(order),
        frequency_hz: Some(carrier),
        parameters,
        evidence: Evidence { chance: Some(chance), ..Evidence::default() },
        ..Effect::default()
    })
}
