//! The loop itself: split by run, centre the declared machine, add effects strongest first, judge each, read the held-out runs once.
//!
//! A candidate is scored by the whitened likelihood gain over fit and selection runs, less 10 per unknown and twice the logarithm of the
//! search, and must also predict the selection runs with values from the fit runs alone. A name is given only if what it
//! leaves at its own lines is small, its strength does not depend on the run, and no other name comes within a Bayes
//! factor of 10; else the verdict is ambiguous or generic.

use super::base_fit::{Base, TOLERANCES};
use super::candidate::{Candidate, Claim};
use super::detect;
use super::input::Record;
use super::least_squares::{Column, Data, chi_square, normal, solve, subtract};
use super::library::Bench;
use super::outcome::{Effect, ErrorPair, ErrorTable, Evidence, Outcome, Unexplained, Value};
use crate::{Error, Result};
use rand::{RngExt, SeedableRng};
use rayon::prelude::*;
use rustfft::num_complex::Complex64 as C;
use statrs::distribution::{ChiSquared, ContinuousCDF};
use std::collections::BTreeMap;

/// Options of the loop.
#[derive(Debug, Clone)]
pub struct Options {
    /// Seed of the split.
    pub seed: u64,
    /// Most effects looked for.
    pub most: usize,
    /// Progress on stderr.
    pub progress: bool,
    /// Library names withheld (for leave-one-out proof).
    pub withheld: Vec<String>,
}

impl Default for Options {
    fn default() -> Self {
        Self { seed: 1, most: 5, progress: false, withheld: Vec::new() }
    }
}

/// Penalty per real unknown.
const PER_UNKNOWN: f64 = 10.0;
/// Least score of an accepted effect.
const LEAST_SCORE: f64 = 15.0;
/// Least gain on the selection runs.
const LEAST_SELECT_GAIN: f64 = 15.0;
/// Least share of the whole gain that the selection runs must show when predicted from the fit runs.
const LEAST_SELECT_SHARE: f64 = 0.1;
/// Largest power left at its own lines, beyond noise, of a named effect.
const LARGEST_LEFT: f64 = 0.04;

struct Split {
    fit: Vec<usize>,
    select: Vec<usize>,
    held_out: Vec<usize>,
}

/// Groups runs by speed; one inner speed is held out, another selects, the rest fit.
fn split(base: &Base, seed: u64) -> Result<Split> {
    let mut by_speed: Vec<usize> = (0..base.runs.len()).collect();
    by_speed.sort_by(|&a, &b| base.runs[a].angle.shaft_hz.total_cmp(&base.runs[b].angle.shaft_hz));
    let mut groups: Vec<Vec<usize>> = Vec::new();
    for r in by_speed {
        let speed = base.runs[r].angle.shaft_hz;
        match groups.last_mut() {
            Some(group) if (speed / base.runs[group[0]].angle.shaft_hz - 1.0).abs() < 0.02 => group.push(r),
            _ => groups.push(vec![r]),
        }
    }
    if groups.len() < 3 {
        return Err(Error::invalid("record.toml: run", "the closed loop needs runs at three or more speeds"));
    }
    let mut inner: Vec<usize> = (1..groups.len() - 1).collect();
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
    let held = inner.swap_remove((rng.random::<u32>() as usize) % inner.len());
    let select = if inner.is_empty() { groups.len() - 1 } else { inner[(rng.random::<u32>() as usize) % inner.len()] };
    let sorted = |pick: &dyn Fn(usize) -> bool| {
        let mut runs: Vec<usize> =
            groups.iter().enumerate().filter(|(g, _)| pick(*g)).flat_map(|(_, runs)| runs.clone()).collect();
        runs.sort_unstable();
        runs
    };
    Ok(Split {
        fit: sorted(&|g| g != held && g != select),
        select: sorted(&|g| g == select),
        held_out: sorted(&|g| g == held),
    })
}

struct Judged {
    candidate: Candidate,
    score: f64,
    gain: f64,
    select_gain: f64,
}

struct Joint {
    /// All unknowns: nuisances first, then every term's.
    x: Vec<f64>,
    sigma: Vec<f64>,
    gain: f64,
}

fn columns<'a>(base: &'a Base, terms: &[&'a Candidate]) -> Vec<Column<'a>> {
    let mut all = base.columns();
    for term in terms {
        all.extend(term.templates.iter().map(|template| Column { template, prior: (0.0, 0.0) }));
    }
    all
}

fn joint(base: &Base, data: &Data, runs: &[usize], terms: &[&Candidate]) -> Joint {
    let all = columns(base, terms);
    let estimate = solve(&normal(data, runs, &all));
    let mut x: Vec<f64> = estimate.x.iter().copied().collect();
    let sigma = (0..x.len()).map(|i| estimate.covariance[(i, i)].max(0.0).sqrt()).collect();
    let mut at = base.nuisances.len();
    for term in terms {
        if term.phase_free {
            tie_phase_free(data, runs, term, &mut x[at..at + term.templates.len()]);
        }
        at += term.templates.len();
    }
    Joint { x, sigma, gain: estimate.gain }
}

/// One amplitude for all runs, taken from `runs`; each run keeps its own phase.
fn tie_phase_free(data: &Data, runs: &[usize], term: &Candidate, x: &mut [f64]) {
    let (mut sum, mut total) = (0.0, 1e-300);
    let mut own = vec![(C::ZERO, 0.0); x.len() / 2];
    for (r, own) in own.iter_mut().enumerate() {
        let pair = [2 * r, 2 * r + 1].map(|i| Column { template: &term.templates[i], prior: (0.0, 0.0) });
        let n = normal(data, &[r], &pair);
        let energy = n.gram[(0, 0)];
        let value = if runs.contains(&r) {
            C::new(x[2 * r], x[2 * r + 1])
        } else {
            C::new(n.right[0], n.right[1]) / energy.max(1e-300)
        };
        if runs.contains(&r) {
            sum += energy * value.norm();
            total += energy;
        }
        *own = (value, energy);
    }
    let amplitude = sum / total;
    for (r, (value, _)) in own.iter().enumerate() {
        let unit = if value.norm() > 0.0 { value / value.norm() } else { C::ONE };
        x[2 * r] = amplitude * unit.re;
        x[2 * r + 1] = amplitude * unit.im;
    }
}

fn copy(data: &Data) -> Data {
    Data { residual: data.residual.clone(), weight: data.weight.clone() }
}

/// Residual with the joint estimate of `fit` removed everywhere.
fn corrected(base: &Base, data: &Data, x: &[f64], terms: &[&Candidate]) -> Data {
    let mut rest = copy(data);
    subtract(&mut rest, &columns(base, terms), x);
    rest
}

/// Effective number of unknowns: a free phase per run costs like an unknown, one amplitude for all.
fn unknowns(candidate: &Candidate, runs: usize) -> f64 {
    if candidate.phase_free { 1.0 + runs as f64 } else { candidate.templates.len() as f64 }
}

fn judge(
    base: &Base,
    data: &Data,
    split: &Split,
    terms: &[&Candidate],
    before: &Before,
    candidate: Candidate,
) -> Judged {
    let mut with: Vec<&Candidate> = terms.to_vec();
    with.push(&candidate);
    let fitted = joint(base, data, &split.fit, &with);
    let rest = corrected(base, data, &fitted.x, &with);
    let select_gain = before.select - chi_square(&rest, &split.select);
    let seen: Vec<usize> = split.fit.iter().chain(&split.select).copied().collect();
    let gain = if candidate.phase_free {
        let all = joint(base, data, &seen, &with);
        before.seen - chi_square(&corrected(base, data, &all.x, &with), &seen)
    } else {
        joint(base, data, &seen, &with).gain - before.gain
    };
    let score = gain - PER_UNKNOWN * unknowns(&candidate, seen.len()) - 2.0 * candidate.searched.ln();
    Judged { candidate, score, gain, select_gain }
}

struct Before {
    select: f64,
    seen: f64,
    gain: f64,
}

fn before(base: &Base, data: &Data, split: &Split, terms: &[&Candidate]) -> Before {
    let fitted = joint(base, data, &split.fit, terms);
    let select = chi_square(&corrected(base, data, &fitted.x, terms), &split.select);
    let seen: Vec<usize> = split.fit.iter().chain(&split.select).copied().collect();
    let all = joint(base, data, &seen, terms);
    let seen = chi_square(&corrected(base, data, &all.x, terms), &seen);
    Before { select, seen, gain: all.gain }
}

/// Finds what the declared machine of `record` lacks.
///
/// # Errors
/// Fewer than three speeds, or runs shorter than half a second.
pub fn close_loop(record: &Record, options: &Options) -> Result<Outcome> {
    let say = |what: &str| {
        if options.progress {
            eprintln!("{what}");
        }
    };
    if record.runs.iter().any(|r| (r.channels[0].len() as f64) < 0.5 * record.sample_rate_hz) {
        return Err(Error::invalid("record.toml: run", "every run must last at least half a second"));
    }
    say("predicting the declared machine");
    let declared = Base::new(record);
    let mut base = Base::new(record);
    let split = split(&base, options.seed)?;
    let seen: Vec<usize> = split.fit.iter().chain(&split.select).copied().collect();
    base.fit(&split.fit, 2);
    say("responses of the library");
    let bench = Bench::new(&base, record);
    let mut data = base.data();
    let raw = data.residual.clone();
    let mut accepted: Vec<Candidate> = Vec::new();
    let mut pool: Vec<Candidate> = Vec::new();
    let mut refused: BTreeMap<String, f64> = BTreeMap::new();
    for round in 0..options.most {
        let terms: Vec<&Candidate> = accepted.iter().collect();
        // Noise from the residual after everything accepted; the form slack stays tied to the raw residual.
        let fitted = joint(&base, &data, &seen, &terms);
        let rest = corrected(&base, &data, &fitted.x, &terms);
        data.weight = base.weights(&rest.residual, &raw);
        let rest = Data { residual: rest.residual, weight: data.weight.clone() };
        let orders = detect::orders(&base, &rest, &split.fit, 2);
        let frequencies = detect::frequencies(&base, &rest, &split.fit, 2);
        say(&format!("round {}: {} order lines, {} fixed lines", round + 1, orders.len(), frequencies.len()));
        let mut candidates = bench.candidates(&rest, &split.fit, &orders, &frequencies);
        candidates.retain(|c| c.claim == Claim::Generic || !options.withheld.contains(&c.name));
        let reference = before(&base, &data, &split, &terms);
        let mut judged: Vec<Judged> =
            candidates.into_par_iter().map(|c| judge(&base, &data, &split, &terms, &reference, c)).collect();
        judged.sort_by(|a, b| b.score.total_cmp(&a.score));
        if options.progress {
            for j in judged.iter().take(4) {
                eprintln!(
                    "    {} at {:?}/{:?}: score {:.1}, gain {:.1}, on selection runs {:.1}",
                    j.candidate.name, j.candidate.order, j.candidate.frequency_hz, j.score, j.gain, j.select_gain
                );
            }
        }
        let tests = judged.len() as f64;
        let best = judged.iter().position(|j| {
            j.score > LEAST_SCORE
                && j.select_gain > LEAST_SELECT_GAIN.max(LEAST_SELECT_SHARE * j.gain)
                && significance(j, tests) < 1e-3
        });
        for j in judged.iter().take(30) {
            let worst = refused.entry(j.candidate.name.clone()).or_insert(f64::NEG_INFINITY);
            *worst = worst.max(j.score);
        }
        let Some(best) = best else { break };
        let winner = judged[best].candidate.clone();
        pool.extend(judged.into_iter().filter(|j| j.score > 0.0).take(60).map(|j| j.candidate));
        accepted.push(winner);
        prune(&base, &data, &split, &mut accepted);
    }
    for term in &accepted {
        refused.remove(&term.name);
    }
    say("verdicts");
    let effects = verdicts(&base, &data, &split, &accepted, &pool);
    Ok(report(record, &declared, &base, &data, &split, &seen, &accepted, effects, refused))
}

/// Drops terms that no longer earn their place next to the newest.
fn prune(base: &Base, data: &Data, split: &Split, accepted: &mut Vec<Candidate>) {
    let mut i = 0;
    while accepted.len() > 1 && i + 1 < accepted.len() {
        let others: Vec<&Candidate> = accepted.iter().enumerate().filter(|(j, _)| *j != i).map(|(_, c)| c).collect();
        let reference = before(base, data, split, &others);
        let again = judge(base, data, split, &others, &reference, accepted[i].clone());
        if again.score < LEAST_SCORE || again.select_gain < 0.0 {
            accepted.remove(i);
        } else {
            i += 1;
        }
    }
}

fn significance(j: &Judged, tests: f64) -> f64 {
    let k = unknowns(&j.candidate, 6);
    let null = ChiSquared::new(k).expect("positive");
    ((1.0 - null.cdf(j.gain.max(0.0))) * j.candidate.searched * tests).min(1.0)
}

/// Bins where the prediction stands above noise, power left there beyond noise, and power before.
fn left_at_lines(base: &Base, data: &Data, runs: &[usize], terms: &[&Candidate], index: usize, x: &[f64]) -> f64 {
    let rest = corrected(base, data, x, terms);
    let at: usize = base.nuisances.len() + terms[..index].iter().map(|t| t.templates.len()).sum::<usize>();
    let own: Vec<Column<'_>> =
        terms[index].templates.iter().map(|template| Column { template, prior: (0.0, 0.0) }).collect();
    let zero = |r: &[Vec<C>; 2]| [vec![C::ZERO; r[0].len()], vec![C::ZERO; r[1].len()]];
    let mut predicted = Data { residual: data.residual.iter().map(zero).collect(), weight: Vec::new() };
    subtract(&mut predicted, &own, &x[at..at + own.len()]);
    let (mut left, mut whole) = (0.0, 1e-300);
    for &r in runs {
        for c in 0..2 {
            let noise = super::spectrum::noise_power(&rest.residual[r][c]);
            for b in 0..noise.len() {
                let p = predicted.residual[r][c][b].norm_sqr();
                if p > 6.0 * noise[b] && data.weight[r][c][b] > 0.0 {
                    // Whitened, so that one strong line does not decide alone; each line counts up to its tempered weight.
                    let w = data.weight[r][c][b];
                    left += (rest.residual[r][c][b].norm_sqr() - noise[b]) * w;
                    whole += p * w;
                }
            }
        }
    }
    (left / whole).max(0.0)
}

/// Exponents by which the strength of a term departs from its own law, with 95 % half widths.
fn departure(
    base: &Base,
    data: &Data,
    runs: &[usize],
    terms: &[&Candidate],
    index: usize,
    x: &[f64],
) -> Option<[[f64; 2]; 2]> {
    let at: usize = base.nuisances.len() + terms[..index].iter().map(|t| t.templates.len()).sum::<usize>();
    let count = terms[index].templates.len();
    let mut others = x.to_vec();
    others[at..at + count].fill(0.0);
    let rest = corrected(base, data, &others, terms);
    let own: Vec<Column<'_>> =
        terms[index].templates.iter().map(|template| Column { template, prior: (0.0, 0.0) }).collect();
    let zero = |r: &[Vec<C>; 2]| [vec![C::ZERO; r[0].len()], vec![C::ZERO; r[1].len()]];
    let mut predicted = Data { residual: data.residual.iter().map(zero).collect(), weight: Vec::new() };
    let minus: Vec<f64> = x[at..at + count].iter().map(|v| -v).collect();
    subtract(&mut predicted, &own, &minus);
    let (mut rows, mut values, mut weights) = (Vec::new(), Vec::new(), Vec::new());
    for &r in runs {
        let (mut dot, mut energy) = (0.0, 1e-300);
        for c in 0..2 {
            for (b, w) in data.weight[r][c].iter().enumerate() {
                let p = predicted.residual[r][c][b];
                dot += (p.conj() * rest.residual[r][c][b]).re * w;
                energy += p.norm_sqr() * w;
            }
        }
        let g = dot / energy;
        if energy > 9.0 && g > 0.05 {
            rows.push([1.0, (base.runs[r].angle.shaft_hz / 15.0).ln(), (base.runs[r].torque_n_m / 12.0).ln()]);
            values.push(g.ln());
            weights.push(g * g * energy);
        }
    }
    if rows.len() < 4 {
        return None;
    }
    let n = nalgebra::DMatrix::from_fn(3, 3, |i, j| {
        rows.iter().zip(&weights).map(|(row, w)| row[i] * row[j] * w).sum::<f64>() + if i == j { 1e-9 } else { 0.0 }
    });
    let b = nalgebra::DVector::from_fn(3, |i, _| {
        rows.iter().zip(&weights).zip(&values).map(|((row, w), v)| row[i] * w * v).sum::<f64>()
    });
    let inverse = n.try_inverse()?;
    let e = &inverse * b;
    let half = |i: usize| 1.96 * inverse[(i, i)].max(0.0).sqrt();
    Some([[e[1], half(1)], [e[2], half(2)]])
}

fn verdicts(base: &Base, data: &Data, split: &Split, accepted: &[Candidate], pool: &[Candidate]) -> Vec<Effect> {
    let seen: Vec<usize> = split.fit.iter().chain(&split.select).copied().collect();
    let terms: Vec<&Candidate> = accepted.iter().collect();
    let all = joint(base, data, &seen, &terms);
    let mut effects = Vec::new();
    for (index, term) in accepted.iter().enumerate() {
        let others: Vec<&Candidate> =
            accepted.iter().enumerate().filter(|(j, _)| *j != index).map(|(_, c)| c).collect();
        let reference = before(base, data, split, &others);
        let own = judge(base, data, split, &others, &reference, term.clone());
        let mut rivals: BTreeMap<String, f64> = BTreeMap::new();
        let judged: Vec<Judged> = pool
            .par_iter()
            .filter(|c| c.name != term.name)
            .map(|c| judge(base, data, split, &others, &reference, c.clone()))
            .collect();
        for j in &judged {
            let best = rivals.entry(j.candidate.name.clone()).or_insert(f64::NEG_INFINITY);
            *best = best.max(j.score);
        }
        let mut rivals: Vec<(String, f64)> = rivals.into_iter().map(|(n, s)| (n, 0.5 * (own.score - s))).collect();
        rivals.sort_by(|a, b| a.1.total_cmp(&b.1));
        rivals.truncate(4);
        let left = left_at_lines(base, data, &seen, &terms, index, &all.x);
        let exponents = departure(base, data, &seen, &terms, index, &all.x);
        let steady = exponents.is_none_or(|e| e.iter().all(|[p, half]| p.abs() < 0.12 + half));
        let next = rivals.first().map_or(f64::INFINITY, |r| r.1);
        let near: Vec<&str> = rivals.iter().filter(|r| r.1 < 2.4).map(|r| r.0.as_str()).collect();
        let (verdict, name, experiment) = if term.claim == Claim::Generic || left > LARGEST_LEFT || !steady {
            let seat = term
                .order
                .map(|o| format!("order {o:.4} of the pinion"))
                .or(term.frequency_hz.map(|f| format!("{f:.2} Hz")))
                .unwrap_or_else(|| "all orders".into());
            let text = if term.claim == Claim::Generic {
                format!("{} ({seat})", term.name)
            } else {
                format!("excitation at {seat}; resembles {} but does not follow its law", term.name)
            };
            ("generic", text, None)
        } else if !near.is_empty() {
            let mut names = vec![term.name.as_str()];
            names.extend(near);
            let text = "runs at a third torque and at a higher speed separate these laws".to_string();
            ("ambiguous", names.join(" or "), Some(text))
        } else {
            ("named", term.name.clone(), None)
        };
        let at: usize = base.nuisances.len() + terms[..index].iter().map(|t| t.templates.len()).sum::<usize>();
        effects.push(Effect {
            verdict: verdict.into(),
            name,
            family: term.family.into(),
            shaft: term.shaft.into(),
            order_of_pinion: term.order,
            frequency_hz: term.frequency_hz,
            parameters: values(term, &all.x[at..], &all.sigma[at..], &seen),
            evidence: Evidence {
                speed_exponent: exponents.map(|e| e[0][0] + term.exponents[0]),
                speed_exponent_ci95: exponents.map(|e| interval(e[0][0] + term.exponents[0], e[0][1])),
                torque_exponent: exponents.map(|e| e[1][0] + term.exponents[1]),
                torque_exponent_ci95: exponents.map(|e| interval(e[1][0] + term.exponents[1], e[1][1])),
                held_out_gain: 0.0,
                p_value: significance(&own, 150.0),
                bayes_factor_over_next: next.is_finite().then(|| next.min(13.8).exp()),
                left_at_its_lines: left,
                next: rivals,
            },
            deciding_experiment: experiment,
        });
    }
    effects
}

fn interval(value: f64, half: f64) -> [f64; 2] {
    [value - half, value + half]
}

fn values(term: &Candidate, x: &[f64], sigma: &[f64], seen: &[usize]) -> BTreeMap<String, Value> {
    let mut map = BTreeMap::new();
    let value = |v: f64, half: f64, unit: &str| Value { value: v, ci95: interval(v, half), unit: unit.into() };
    for p in &term.parameters {
        if p.complex {
            let i = if term.phase_free { 2 * seen[0] } else { p.first };
            let (a, b) = (x[i], x[i + 1]);
            let r = a.hypot(b).max(1e-300);
            let half = 1.96 * ((a * sigma[i]).powi(2) + (b * sigma[i + 1]).powi(2)).sqrt() / r;
            let half = if term.phase_free { half / (seen.len() as f64).sqrt() } else { half };
            map.insert(p.name.clone(), value(r, half, p.unit));
            if !term.phase_free {
                let turn = 1.96 * ((b * sigma[i]).powi(2) + (a * sigma[i + 1]).powi(2)).sqrt() / (r * r);
                map.insert(format!("{}_phase", p.name), value(b.atan2(a), turn, "rad"));
            }
        } else {
            map.insert(p.name.clone(), value(x[p.first], 1.96 * sigma[p.first], p.unit));
        }
    }
    map
}

/// Bins within one bin of an order of pinion or gear.
fn synchronous(base: &Base, run: usize) -> Vec<bool> {
    let duration = base.analyser.duration_s();
    let mut mask = vec![false; base.analyser.bins];
    let f = base.runs[run].angle.shaft_hz;
    let ratio = f64::from(base.machine.teeth[0]) / f64::from(base.machine.teeth[1]);
    for step in [f, f * ratio] {
        let mut k = 1.0;
        while (k * step * duration + 1.0) < mask.len() as f64 {
            let b = (k * step * duration).round() as usize;
            mask[b.saturating_sub(1)..=(b + 1).min(base.analyser.bins - 1)].fill(true);
            k += 1.0;
        }
    }
    mask
}

fn errors(declared: &Data, after: &Data, base: &Base, runs: &[usize]) -> ErrorPair {
    let mut sync = [0.0; 4];
    let mut whole = [[0.0; 4]; 2];
    for &r in runs {
        let mask = synchronous(base, r);
        for c in 0..2 {
            let noise = super::spectrum::noise_power(&after.residual[r][c]);
            let lowest = (3.0 * base.analyser.duration_s()) as usize;
            for b in lowest..mask.len() {
                let four = [
                    declared.residual[r][c][b].norm_sqr(),
                    after.residual[r][c][b].norm_sqr(),
                    noise[b],
                    base.runs[r].measured[c][b].norm_sqr(),
                ];
                for i in 0..4 {
                    whole[c][i] += four[i];
                    if mask[b] {
                        sync[i] += four[i];
                    }
                }
            }
        }
    }
    let share = |x: &[f64; 4]| [0, 1, 2].map(|i| (x[i] / x[3].max(1e-300)).sqrt());
    let pooled: [f64; 4] = [0, 1, 2, 3].map(|i| whole[0][i] + whole[1][i]);
    let [before, after, noise_floor] = share(&sync);
    ErrorPair {
        before,
        after,
        noise_floor,
        whole_signal: share(&pooled),
        per_channel: [share(&whole[0]), share(&whole[1])],
    }
}

#[allow(clippy::too_many_arguments, reason = "assembly of the final report from the parts of one function")]
fn report(
    record: &Record,
    declared: &Base,
    base: &Base,
    data: &Data,
    split: &Split,
    seen: &[usize],
    accepted: &[Candidate],
    mut effects: Vec<Effect>,
    refused: BTreeMap<String, f64>,
) -> Outcome {
    let terms: Vec<&Candidate> = accepted.iter().collect();
    let after_of = |terms: &[&Candidate]| {
        let mut x = joint(base, data, seen, terms).x;
        // Angle offsets of runs come from the tachometer alone in any prediction.
        x[TOLERANCES.len()..base.nuisances.len()].fill(0.0);
        corrected(base, data, &x, terms)
    };
    let plain = declared.data();
    let after = after_of(&terms);
    let held = errors(&plain, &after, base, &split.held_out);
    for (i, effect) in effects.iter_mut().enumerate() {
        let others: Vec<&Candidate> = accepted.iter().enumerate().filter(|(j, _)| *j != i).map(|(_, c)| c).collect();
        let without = errors(&plain, &after_of(&others), base, &split.held_out);
        effect.evidence.held_out_gain = if effect.family == "fixed-frequency" {
            without.whole_signal[1] - held.whole_signal[1]
        } else {
            without.after - held.after
        };
    }
    let pooled = &held.whole_signal;
    let mut unexplained = Vec::new();
    let rest = pooled[1].powi(2) - pooled[2].powi(2);
    if rest > 0.0 {
        let orders = detect::orders(base, &after, seen, 1);
        let hint = orders.first().map_or(String::new(), |o| format!("; strongest line at order {:.3}", o.at));
        let description = format!("remainder above the local noise floor{hint}");
        unexplained.push(Unexplained { description, variance_share: rest });
    }
    let noise = Unexplained { description: "noise floor".into(), variance_share: pooled[2].powi(2) };
    unexplained.push(noise);
    let clipped = record.runs.iter().map(|r| r.clipped_share).fold(0.0, f64::max);
    if clipped > 1e-4 {
        let description = format!("up to {:.2} % of a run's samples at the end of the code range", 100.0 * clipped);
        unexplained.push(Unexplained { description, variance_share: 0.0 });
    }
    Outcome {
        record: record.title.clone(),
        error: ErrorTable {
            metric: "nrmse of the shaft-synchronous part, and of the whole signal, per channel and pooled".into(),
            fit_runs: errors(&plain, &after, base, seen),
            held_out_runs: held,
        },
        effects,
        unexplained,
        declared_parameter_changes: TOLERANCES
            .iter()
            .zip(&base.change)
            .map(|((name, _), change)| ((*name).to_string(), *change))
            .collect(),
        split: [split.fit.clone(), split.select.clone(), split.held_out.clone()],
        refused: refused.into_iter().collect(),
    }
}
