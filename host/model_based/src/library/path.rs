//! Effects of the measuring path: a structural or sensor mode, gain, delay, drift of the gain, curvature of the sensor.
//!
//! They act on whatever is measured, so their templates are made from the model's bins (linear paths) or from the
//! measured signal itself (drift and curvature, whose products with noise average out).

use super::{Bench, on_path};
use crate::candidate::{Candidate, Claim, Parameter, Template, Tuning};
use crate::effects::hypothesis::Path;
use crate::least_squares::Data;
use crate::model::forward::Line;
use crate::observation::spectrum::{BAND_HZ, Bins, REACH, Sparse};
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
        parameters,
        templates,
        searched: 2.0,
        exponents,
        ..Candidate::default()
    }
}

/// The effect of the registry that changes a path so, with one real strength.
fn named(
    change: Path,
    channel: Option<usize>,
    family: &'static str,
    template: Template,
    exponents: [f64; 2],
) -> Candidate {
    let hypothesis = on_path(change);
    let parameters = parameter(hypothesis.quantity, hypothesis.unit);
    Candidate {
        channel,
        plain: (!hypothesis.plain.is_empty()).then(|| hypothesis.plain.into()),
        hypothesis: Some(hypothesis),
        ..path(hypothesis.name, Claim::Named, family, parameters, vec![template], exponents)
    }
}

fn parameter(name: &str, unit: &'static str) -> Vec<Parameter> {
    vec![Parameter { name: name.into(), unit, first: 0, complex: false }]
}

fn parameters(list: &[(&str, &'static str)]) -> Vec<Parameter> {
    let one = |(first, &(name, unit)): (usize, &(&str, &'static str))| Parameter {
        name: name.into(),
        unit,
        first,
        complex: false,
    };
    list.iter().enumerate().map(one).collect()
}

/// Places between which a channel's free gain is linear, Hz.
const KNOTS_HZ: [f64; 8] = [0.0, 800.0, 1800.0, 3200.0, 5000.0, 7500.0, 11_000.0, BAND_HZ];

/// 1 at its knot, linear to 0 at both neighbours.
fn hat(knot: usize, f: f64) -> f64 {
    let rise = if knot == 0 { 1.0 } else { (f - KNOTS_HZ[knot - 1]) / (KNOTS_HZ[knot] - KNOTS_HZ[knot - 1]) };
    let fall = KNOTS_HZ.get(knot + 1).map_or(1.0, |next| (next - f) / (next - KNOTS_HZ[knot]));
    rise.min(fall).max(0.0)
}

/// The prediction of one channel behind a filter.
fn filtered(bench: &Bench<'_>, channel: usize, h: &dyn Fn(f64) -> C) -> Template {
    let duration = bench.base.analyser.duration_s();
    Template::new(bench.prediction.iter().map(|run| {
        let mut parts = <[Sparse; 2]>::default();
        let bins: Bins = run[channel].iter().enumerate().map(|(b, x)| x * h(b as f64 / duration)).collect();
        parts[channel] = Sparse::of(&bins);
        parts
    }))
}

/// A channel behind a delay, s; its strength is the share of that delay, which must come out near 1.
pub fn delayed(bench: &Bench<'_>, channel: usize, delay_s: f64) -> Candidate {
    let shifted = filtered(bench, channel, &|f| C::cis(-TAU * f * delay_s) - 1.0);
    let quantity = format!("{}_of_{:.2}_us", on_path(Path::Delay).quantity, 1e6 * delay_s);
    let found = named(Path::Delay, Some(channel), "path", shifted, [0.0, 1.0]);
    let tuning = Some(Tuning::Delay { delay_s });
    Candidate { searched: 100.0, parameters: parameter(&quantity, "1"), tuning, ..found }
}

/// All path candidates, per channel.
pub fn candidates(bench: &Bench<'_>, data: &Data, fit: &[usize]) -> Vec<Candidate> {
    let filtered = |channel: usize, h: &(dyn Fn(f64) -> C + Sync)| filtered(bench, channel, h);
    // From the prediction, not the measured signal: powers of measured noise would explain the noise itself.
    let made = |channel: usize, f: &dyn Fn(usize, f64) -> f64| {
        Template::new(bench.waveforms.iter().map(|run| {
            let mut parts = <[Sparse; 2]>::default();
            let signal: Vec<f64> = run[channel].iter().enumerate().map(|(i, &x)| f(i, x)).collect();
            parts[channel] = Sparse::of(&bench.base.analyser.bins_of(&signal));
            parts
        }))
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
        list.push(delayed(bench, channel, best_delay(bench, data, fit, channel)));
        let drift = made(channel, &|i, x| x * (i as f64 / samples - 0.5));
        list.push(named(Path::Drift, Some(channel), "non-stationary", drift.clone(), [0.0, 1.0]));
        let bow = made(channel, &|i, x| x * ((i as f64 / samples - 0.5).powi(2) - 1.0 / 12.0));
        let name = format!("gain of the {who} changing within the runs");
        let two = parameters(&[("linear", "1"), ("quadratic", "1")]);
        list.push(path(&name, Claim::Generic, "non-stationary", two, vec![drift, bow], [0.0, 1.0]));
        let square = made(channel, &|_, x| x * x);
        list.push(named(Path::Square, Some(channel), "path", square.clone(), [0.0, 2.0]));
        let cube = made(channel, &|_, x| x * x * x);
        list.push(named(Path::Cube, Some(channel), "path", cube.clone(), [0.0, 3.0]));
        let name = format!("response of the {who} not in proportion to the signal");
        let two = parameters(&[("quadratic", "s2/m"), ("cubic", "s4/m2")]);
        list.push(path(&name, Claim::Generic, "path", two, vec![square, cube], [0.0, 2.0]));
        let hats: Vec<Template> = (0..KNOTS_HZ.len())
            .flat_map(|knot| [C::ONE, C::I].map(|factor| filtered(channel, &|f| factor * hat(knot, f))))
            .collect();
        let values = KNOTS_HZ
            .iter()
            .enumerate()
            .map(|(i, hz)| Parameter { name: format!("gain_at_{hz}_hz"), unit: "1", first: 2 * i, complex: true })
            .collect();
        let name = format!("gain of the {who} depending on frequency");
        list.push(path(&name, Claim::Generic, "path", values, hats, [0.0, 1.0]));
    }
    list.push(folded(bench));
    list.extend([Some(0), Some(1), None].map(|channel| echo(bench, channel, best_echo(bench, data, fit, channel))));
    list.extend(modes(bench, data, fit));
    list
}

/// Lines above half the sampling rate that a missing anti-alias filter would fold into the band, up to the rate.
fn folded(bench: &Bench<'_>) -> Candidate {
    let machine = &bench.base.machine;
    let analyser = &bench.base.analyser;
    let rate = analyser.rate_hz;
    let z = f64::from(machine.teeth[0]);
    let runs = bench.base.runs.iter().map(|run| {
        let f = run.angle.shaft_hz;
        let first = (0.5 * rate / (f * z)).ceil() as i64;
        let last = ((rate + BAND_HZ) / (f * z)) as i64;
        let own = &run.own;
        let inner = own.lines.iter().filter(|line| (first as f64 - 0.5) * z < line.order).cloned();
        let lines: Vec<Line> = inner
            .chain(machine.beyond(own, f, first..=last))
            .map(|whole| {
                let order = whole.order - rate / f;
                // The phase belongs to the true order, not to the folded one.
                let turn = C::cis(run.angle.offset_rad * rate / f);
                // Twice: the negative order folds onto the same place.
                Line { order, amplitude: whole.amplitude.map(|a| a * turn * 2.0) }
            })
            .collect();
        analyser.templates_of_lines(&lines, run.angle.offset_rad, f, REACH)
    });
    named(Path::Folding, None, "path", Template::new(runs), [0.0, 1.0])
}

/// Delay (s, within 200 us) of a channel that explains the residual best.
fn best_delay(bench: &Bench<'_>, data: &Data, fit: &[usize], channel: usize) -> f64 {
    let duration = bench.base.analyser.duration_s();
    // Sum over bins of w |x|^2 |exp(-i w d) - 1|^2 and of the product with the residual, by frequency band.
    let bands = 1500;
    let mut table = vec![(0.0, C::ZERO); bands];
    for &r in fit {
        for (b, x) in bench.prediction[r][channel].iter().enumerate() {
            let w = data.weight[r][channel][b];
            if x.norm_sqr() * w > 1.0 {
                let cell = &mut table[(b as f64 / duration / 10.0) as usize % bands];
                cell.0 += x.norm_sqr() * w;
                cell.1 += x.conj() * data.residual[r][channel][b] * w;
            }
        }
    }
    let gain = |d: f64| {
        let (mut dot, mut energy) = (0.0, 1e-30);
        for (i, (power, product)) in table.iter().enumerate() {
            let h = C::cis(-TAU * (10.0 * i as f64 + 5.0) * d) - 1.0;
            dot += (h.conj() * product).re;
            energy += h.norm_sqr() * power;
        }
        // A delay is no free gain: the fit must stand at a share of 1.
        2.0 * dot - energy
    };
    let best =
        |points: &mut dyn Iterator<Item = f64>| points.max_by(|a, b| gain(*a).total_cmp(&gain(*b))).unwrap_or(1e-6);
    let coarse = best(&mut (-400..=400).filter(|i| *i != 0).map(|i| 0.5e-6 * f64::from(i)));
    best(&mut (-50..=50).map(|i| coarse + 0.01e-6 * f64::from(i)).filter(|d| d.abs() > 1e-9))
}

/// Delays of a second path that are tried, s.
const ECHOES_S: [f64; 2] = [1.5e-4, 1e-2];

/// A channel, or both, with the signal once more after a delay, s.
pub fn echo(bench: &Bench<'_>, channel: Option<usize>, delay_s: f64) -> Candidate {
    let later = |f: f64| C::cis(-TAU * f * delay_s);
    let [first, second] = [0, 1].map(|c| filtered(bench, c, &later));
    let template = match channel {
        Some(0) => first,
        Some(_) => second,
        None => first.mixed(1.0, &second, 1.0),
    };
    let found = named(Path::Echo, channel, "path", template, [0.0, 1.0]);
    Candidate { searched: 500.0, tuning: Some(Tuning::Echo { delay_s }), ..found }
}

/// Delay (s) of the second path that explains the residual best.
fn best_echo(bench: &Bench<'_>, data: &Data, fit: &[usize], channel: Option<usize>) -> f64 {
    let duration = bench.base.analyser.duration_s();
    let mut lines: Vec<(f64, C)> = Vec::new();
    for (&r, c) in fit.iter().flat_map(|r| [0, 1].map(|c| (r, c))) {
        if channel.is_some_and(|own| own != c) {
            continue;
        }
        for (b, x) in bench.prediction[r][c].iter().enumerate() {
            let w = data.weight[r][c][b];
            if x.norm_sqr() * w > 1.0 {
                lines.push((b as f64 / duration, x.conj() * data.residual[r][c][b] * w));
            }
        }
    }
    let product = |d: f64| lines.iter().map(|(f, p)| (C::cis(TAU * f * d) * p).re).sum::<f64>().abs();
    let step = 0.1 / BAND_HZ;
    let steps = ((ECHOES_S[1] - ECHOES_S[0]) / step) as usize;
    let best = |points: Vec<f64>| {
        let all: Vec<(f64, f64)> = points.into_par_iter().map(|d| (product(d), d)).collect();
        all.into_iter().max_by(|a, b| a.0.total_cmp(&b.0)).map_or(1e-3, |(_, d)| d)
    };
    let coarse = best((0..=steps).map(|i| ECHOES_S[0] + i as f64 * step).collect());
    best((-50..=50).map(|i| coarse + 0.02 * f64::from(i) * step).collect())
}

/// Best parallel mode per channel (and one common to both) over a grid of frequencies and damping ratios.
fn modes(bench: &Bench<'_>, data: &Data, fit: &[usize]) -> Vec<Candidate> {
    let duration = bench.base.analyser.duration_s();
    let response = |f: f64, f0: f64, zeta: f64| C::new(f0 * f0, 0.0) / C::new(f0 * f0 - f * f, 2.0 * zeta * f0 * f);
    // Bins that carry the model, so that scanning touches only those.
    let active: Vec<[Vec<(usize, C)>; 2]> = bench
        .prediction
        .iter()
        .enumerate()
        .map(|(r, run)| {
            [0, 1].map(|c| {
                let weight = &data.weight[r][c];
                run[c]
                    .iter()
                    .enumerate()
                    .filter(|(b, x)| x.norm_sqr() * weight[*b] > 1.0)
                    .map(|(b, x)| (b, *x))
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
                    let t = x * response(b as f64 / duration, f0, zeta);
                    let w = data.weight[r][channel][b];
                    dot += (t.conj() * data.residual[r][channel][b]).re * w;
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
        list.push(mode(bench, channel, f0, zeta));
    }
    list
}

/// Parallel mode at `f0` with damping ratio `zeta` in one channel, complex gain free.
pub fn mode(bench: &Bench<'_>, channel: usize, f0: f64, zeta: f64) -> Candidate {
    let duration = bench.base.analyser.duration_s();
    let response = |f: f64| C::new(f0 * f0, 0.0) / C::new(f0 * f0 - f * f, 2.0 * zeta * f0 * f);
    let [in_phase, quadrature] = [C::ONE, C::I].map(|factor| {
        Template::new(bench.prediction.iter().map(|run| {
            let mut parts = <[Sparse; 2]>::default();
            let path = |(b, x): (usize, &C)| x * factor * response(b as f64 / duration);
            parts[channel] = Sparse::of(&run[channel].iter().enumerate().map(path).collect::<Bins>());
            parts
        }))
    });
    let hypothesis = on_path(Path::Mode);
    Candidate {
        frequency_hz: Some(f0),
        searched: 900.0,
        templates: vec![in_phase.clone(), quadrature],
        tuning: Some(Tuning::Mode { channel, f0, zeta }),
        parameters: vec![Parameter {
            name: hypothesis.quantity.into(),
            unit: hypothesis.unit,
            first: 0,
            complex: true,
        }],
        ..named(Path::Mode, Some(channel), "path", in_phase, [0.0, 1.0])
    }
}

/// Improves frequency and damping ratio of a mode by pattern search on `score`.
pub fn refine_mode(bench: &Bench<'_>, start: (usize, f64, f64), score: impl Fn(Candidate) -> f64 + Sync) -> Candidate {
    let (channel, f0, zeta) = start;
    let mut best = (score(mode(bench, channel, f0, zeta)), f0, zeta);
    let mut scale = 0.03;
    while scale > 2e-4 {
        let (_, f0, zeta) = best;
        let points = [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)];
        let next = points
            .par_iter()
            .map(|(a, b)| {
                let (f, z) = (f0 * (1.0 + scale * a), (zeta * (1.0 + 10.0 * scale * b)).max(1e-3));
                (score(mode(bench, channel, f, z)), f, z)
            })
            .max_by(|a, b| a.0.total_cmp(&b.0))
            .unwrap_or(best);
        if next.0 > best.0 {
            best = next;
        } else {
            scale *= 0.4;
        }
    }
    mode(bench, channel, best.1, best.2)
}
