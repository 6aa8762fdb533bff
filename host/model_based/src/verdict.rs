//! Verdicts: named, ambiguous or generic, with evidence.
//!
//! A name is given only if what it leaves at its own lines is small, its strength does not depend on the run, and no
//! other name comes near its score; else the verdict is ambiguous or generic. By how much is the gate's ([`accept`]).

use super::accept::{self, NameFigures, Naming};
use super::base_fit::Base;
use super::candidate::{Candidate, Claim, Tuning};
use super::judge::{Judge, Split, corrected, joint};
use super::least_squares::{Column, Data, subtract};
use super::outcome::{Effect, Evidence, Value};
use super::rivals::{Rivals, rivals};
use super::shapes;
use super::start::Start;
use super::uncertainty::standard_errors;
use crate::spectral::noise_power;
use rayon::prelude::*;
use rustfft::num_complex::Complex64 as C;
use std::collections::BTreeMap;

/// Share of the path from which on a relief is no matter of the tips any more, and no other shape can be excluded.
const WIDEST_RELIEF: f64 = 0.35;

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
            let noise = noise_power(&rest.residual[r][c]);
            for b in 0..noise.len() {
                let p = predicted.residual[r][c][b].norm_sqr();
                if p > 6.0 * noise[b] && data.weight[r][c][b] > 0.0 {
                    // Whitened, so that one strong line does not decide alone; each line counts up to its tempered
                    // weight.
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

/// Largest gain, beyond chance, of a description of the same family with more unknowns next to everything accepted:
/// what the shape of `term` is off by.
fn freer_gain(next_to_all: &Judge<'_>, pool: &[Candidate], term: &Candidate) -> f64 {
    let freer = |c: &&Candidate| {
        c.claim == Claim::Generic
            && c.family == term.family
            && c.templates.len() > term.templates.len()
            && !c.phase_free
    };
    pool.par_iter()
        .filter(freer)
        .map(|c| {
            let unknowns = c.templates.len() as f64;
            next_to_all.judge(c.clone()).gain - unknowns - 5.0 * (2.0 * unknowns).sqrt()
        })
        .reduce(|| 0.0, f64::max)
}

/// Verdicts of the accepted terms, which stand against these rivals of a search that scored `tried` candidates.
pub fn verdicts(
    base: &Base,
    data: &Data,
    split: &Split,
    accepted: &[Candidate],
    rivals: Vec<Rivals>,
    pool: &[Candidate],
    tried: usize,
) -> Vec<Effect> {
    let seen = split.seen();
    let terms: Vec<&Candidate> = accepted.iter().collect();
    let mut all = joint(base, data, &seen, &terms);
    let errors = standard_errors(base, data, &seen, &terms, &all.x);
    let mut at = base.nuisances.len();
    for term in &terms {
        let own = at..at + term.templates.len();
        at = own.end;
        // A free phase per run has no value in a run that is left out.
        if !term.phase_free {
            all.sigma[own.clone()].copy_from_slice(&errors[own]);
        }
    }
    let mut effects = Vec::new();
    let next_to_all = Judge::new(base, data, split, &terms);
    for (index, (term, own)) in accepted.iter().zip(rivals).enumerate() {
        let left = left_at_lines(base, data, &seen, &terms, index, &all.x);
        let exponents = departure(base, data, &seen, &terms, index, &all.x);
        let mut near: Vec<&str> = own.nearest.iter().filter(|r| accept::is_rival(r.1)).map(|r| r.0.as_str()).collect();
        if matches!(term.tuning, Some(Tuning::Relief { share, .. }) if share > WIDEST_RELIEF) {
            near.push("another displacement error repeating with every tooth pair");
        }
        let at: usize = base.nuisances.len() + terms[..index].iter().map(|t| t.templates.len()).sum::<usize>();
        let naming = accept::naming(&NameFigures {
            claims_name: term.claim == Claim::Named,
            left,
            departures: exponents,
            possible: term.is_possible(&all.x[at..]),
            freer_gain: freer_gain(&next_to_all, pool, term),
            gain: own.judged.gain,
            at_mesh_orders: term.family == "mesh-order",
            has_rivals: !near.is_empty(),
        });
        let (verdict, name) = worded(term, naming, near);
        let company: Vec<&Candidate> = terms.iter().enumerate().filter(|(i, _)| *i != index).map(|(_, t)| *t).collect();
        let range = shapes::others(base, data, split, &company, term);
        effects.push(Effect {
            withheld_because: None,
            verdict: verdict.into(),
            name,
            family: term.family.into(),
            shaft: term.shaft.into(),
            order_of_pinion: term.order,
            frequency_hz: term.frequency_hz,
            parameters: values(term, &all.x[at..], &all.sigma[at..], &seen, range),
            evidence: Evidence {
                speed_exponent: exponents.map(|e| e[0][0] + term.exponents[0]),
                speed_exponent_ci95: exponents.map(|e| interval(e[0][0] + term.exponents[0], e[0][1])),
                torque_exponent: exponents.map(|e| e[1][0] + term.exponents[1]),
                torque_exponent_ci95: exponents.map(|e| interval(e[1][0] + term.exponents[1], e[1][1])),
                held_out_gain: 0.0,
                chance: Some(own.judged.chance(tried as f64)),
                score_over_next: own.next_name,
                left_at_its_lines: left,
                next: own.nearest,
            },
            deciding_experiment: None,
            next_measurement: None,
            pinion_turns_of_runs: term.start.turns().map(<[u32]>::to_vec),
            phase_of_runs_rad: match &term.start {
                Start::Phases(phases) => Some(phases.clone()),
                _ => None,
            },
        });
    }
    effects
}

/// Verdict and name in words; `near`: what cannot be told from the term.
fn worded(term: &Candidate, naming: Naming, near: Vec<&str>) -> (&'static str, String) {
    match naming {
        Naming::Generic if term.claim == Claim::Generic => ("generic", format!("{} ({})", term.name, place(term))),
        Naming::Generic => ("generic", format!("{}; resembles {} but does not follow its law", seat(term), term.name)),
        Naming::Ambiguous => {
            let mut names = vec![term.name.as_str()];
            names.extend(near);
            if names.len() == 1 {
                names.push(if term.name == "profile-error" { "tip-relief" } else { "profile-error" });
            }
            ("ambiguous", names.join(" or "))
        }
        Naming::Named => ("named", term.name.clone()),
    }
}

/// Plain verdict on what is in the record where no term predicts the runs that it was not fitted to: family and place
/// of the description that comes closest, which takes no part in the prediction.
pub fn undetermined(
    base: &Base,
    data: &Data,
    split: &Split,
    closest: &Candidate,
    pool: &[Candidate],
    tried: usize,
) -> Option<Effect> {
    let alone = std::slice::from_ref(closest);
    let mut effect = verdicts(base, data, split, alone, rivals(base, data, split, alone, pool), pool, tried).pop()?;
    effect.verdict = "generic".into();
    effect.name = format!("{} of no law that holds from run to run; closest: {}", seat(closest), closest.name);
    effect.deciding_experiment = Some("runs at more speeds and torques, and with the sensor at a second place".into());
    Some(effect)
}

/// Where a term acts, in words.
fn seat(term: &Candidate) -> String {
    format!("excitation at {}", place(term))
}

/// Order or frequency of a term.
fn place(term: &Candidate) -> String {
    term.order
        .map(|o| format!("order {o:.4} of the pinion"))
        .or(term.frequency_hz.map(|f| format!("{f:.2} Hz")))
        .unwrap_or_else(|| "all orders".into())
}

fn interval(value: f64, half: f64) -> [f64; 2] {
    [value - half, value + half]
}

/// Parameters in words; `range`: what a real one is with other shapes as likely.
fn values(
    term: &Candidate,
    x: &[f64],
    sigma: &[f64],
    seen: &[usize],
    range: Option<[f64; 2]>,
) -> BTreeMap<String, Value> {
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
            let (mut v, mut half) = (x[p.first], 1.96 * sigma[p.first]);
            if p.name.starts_with("stiffness_loss") && v > 0.0 && !term.bent {
                // The template is of first order; a softer tooth deflects more, which the finite loss shares in as 1
                // / (1 - loss).
                half /= (1.0 + v) * (1.0 + v);
                v /= 1.0 + v;
            }
            let [low, high] = range.unwrap_or([v; 2]);
            let ci95 = [v.min(low) - half, v.max(high) + half];
            map.insert(p.name.clone(), Value { value: v, ci95, unit: p.unit.into() });
        }
    }
    map
}
