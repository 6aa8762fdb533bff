//! Effects of the measuring path: a structural or sensor mode, gain, delay, drift of the gain, curvature of the sensor.
//!
//! They act on whatever is measured, so their templates are made from the model's bins (linear paths) or from the measured signal itself
//! (drift and curvature, whose products with noise average out).

use super::Bench;
use crate::closed_loop::candidate::{Candidate, Claim, Parameter, Template};
use crate::closed_loop::least_squares::Data;
use crate::closed_loop::spectrum::{Bins, sparse};
use rayon::prelude::*;
use rustfft::num_complex::Complex64 as C;
use std::f64::consts::TAU;

fn path(
    name: &str,
    claim: Claim,
    family: &'static str,
    parameters: Vec<Parameter>,
    templates: Vec<Template>,
    exponents: [f64; 2],
) -> Candidate {
    Candidate {
        name: name.into(),
        claim,
        family,
        shaft: "none",
        order: None,
        frequency_hz: None,
        parameters,
        templates,
        searched: 2.0,
        exponents,
        phase_free: false,
    }
}

fn parameter(name: &str, unit: &'static str) -> Vec<Parameter> {
    vec![Parameter { name: name.into(), unit, first: 0, complex: false }]
}

/// All path candidates, per channel.
pub fn candidates(bench: &Bench<'_>, data: &Data, fit: &[usize]) -> Vec<Candidate> {
    let duration = bench.base.analyser.duration_s();
    let filtered = |channel: usize, h: &(dyn Fn(f64) -> C + Sync)| Template {
        runs: bench
            .base
            .runs
            .iter()
            .map(|run| {
                let mut parts = [Vec::new(), Vec::new()];
                let bins: Bins =
                    run.model[channel].iter().enumerate().map(|(b, x)| x * h(b as f64 / duration)).collect();
                parts[channel] = sparse(&bins);
                parts
            })
            .collect(),
    };
    let made = |channel: usize, f: &dyn Fn(usize, f64) -> f64| Template {
        runs: bench
            .record
            .runs
            .iter()
            .map(|run| {
                let mut parts = [Vec::new(), Vec::new()];
                let n = bench.base.analyser.samples;
                let signal: Vec<f64> =
                    run.channels[channel].iter().take(n).enumerate().map(|(i, &x)| f(i, x)).collect();
                parts[channel] = sparse(&bench.base.analyser.bins_of(&signal));
                parts
            })
            .collect(),
    };
    let mut list = Vec::new();
    let samples = bench.base.analyser.samples as f64;
    for channel in 0..2 {
        let who = ["pinion channel", "gear channel"][channel];
        let gain = filtered(channel, &|_| C::ONE);
        list.push(path(
            &format!("gain error of the {who}"),
            Claim::Generic,
            "path",
            parameter("gain_error", "1"),
            vec![gain],
            [0.0, 1.0],
        ));
        let delay = filtered(channel, &|f| C::new(0.0, -TAU * f));
        list.push(path(
            &format!("delay of the {who}"),
            Claim::Generic,
            "path",
            parameter("delay", "s"),
            vec![delay],
            [0.0, 1.0],
        ));
        let drift = made(channel, &|i, x| x * (i as f64 / samples - 0.5));
        list.push(path(
            "thermal-drift",
            Claim::Named,
            "non-stationary",
            parameter("gain_change_over_run", "1"),
            vec![drift],
            [0.0, 1.0],
        ));
        let square = made(channel, &|_, x| x * x);
        list.push(path(
            "sensor-nonlinearity",
            Claim::Named,
            "path",
            parameter("quadratic", "s2/m"),
            vec![square],
            [0.0, 2.0],
        ));
    }
    list.extend(modes(bench, data, fit));
    list
}

/// Best parallel mode per channel (and one common to both) over a grid of frequencies and damping ratios.
fn modes(bench: &Bench<'_>, data: &Data, fit: &[usize]) -> Vec<Candidate> {
    let duration = bench.base.analyser.duration_s();
    let response = |f: f64, f0: f64, zeta: f64| C::new(f0 * f0, 0.0) / C::new(f0 * f0 - f * f, 2.0 * zeta * f0 * f);
    // Bins that carry the model, so that scanning touches only those.
    let active: Vec<[Vec<(u32, C)>; 2]> = bench
        .base
        .runs
        .iter()
        .enumerate()
        .map(|(r, run)| {
            [0, 1].map(|c| {
                let weight = &data.weight[r][c];
                run.model[c]
                    .iter()
                    .enumerate()
                    .filter(|(b, x)| x.norm_sqr() * weight[*b] > 1.0)
                    .map(|(b, x)| (b as u32, *x))
                    .collect()
            })
        })
        .collect();
    let grid: Vec<(f64, f64)> = (0..180)
        .flat_map(|i| {
            let f0 = 250.0 * (f64::from(i) * 0.0225).exp();
            [0.005, 0.01, 0.02, 0.04, 0.08].map(|zeta| (f0, zeta))
        })
        .collect();
    let mut list = Vec::new();
    for channel in 0..2 {
        let gain = |f0: f64, zeta: f64| {
            let (mut dot, mut energy) = (0.0, 1e-30);
            for &r in fit {
                for &(b, x) in &active[r][channel] {
                    let t = x * response(f64::from(b) / duration, f0, zeta);
                    let w = data.weight[r][channel][b as usize];
                    dot += (t.conj() * data.residual[r][channel][b as usize]).re * w;
                    energy += t.norm_sqr() * w;
                }
            }
            dot * dot / energy
        };
        let best = |points: &[(f64, f64)]| {
            points
                .par_iter()
                .map(|&(f0, zeta)| (gain(f0, zeta), f0, zeta))
                .max_by(|a, b| a.0.total_cmp(&b.0))
                .map_or((1000.0, 0.02), |(_, f0, zeta)| (f0, zeta))
        };
        let (mut f0, mut zeta) = best(&grid);
        for scale in [0.01, 0.003, 0.001] {
            let near: Vec<(f64, f64)> = (-4..=4)
                .flat_map(|i| {
                    (-3..=3).map(move |j| {
                        (f0 * (1.0 + scale * f64::from(i)), (zeta * (1.0 + 15.0 * scale * f64::from(j))).max(0.001))
                    })
                })
                .collect();
            (f0, zeta) = best(&near);
        }
        let templates: Vec<Template> = [C::ONE, C::I]
            .iter()
            .map(|factor| Template {
                runs: bench
                    .base
                    .runs
                    .iter()
                    .map(|run| {
                        let mut parts = [Vec::new(), Vec::new()];
                        parts[channel] = run.model[channel]
                            .iter()
                            .enumerate()
                            .filter(|(_, x)| x.norm_sqr() > 0.0)
                            .map(|(b, x)| (b as u32, x * factor * response(b as f64 / duration, f0, zeta)))
                            .collect();
                        parts
                    })
                    .collect(),
            })
            .collect();
        list.push(Candidate {
            frequency_hz: Some(f0),
            searched: 900.0,
            parameters: vec![Parameter { name: "gain".into(), unit: "1", first: 0, complex: true }],
            ..path("transfer-path-resonance", Claim::Named, "path", Vec::new(), templates, [0.0, 1.0])
        });
    }
    list
}
