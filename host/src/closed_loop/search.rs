//! The search of the library: effects added strongest first, each judged next to those already there.
//!
//! The residual's weights are renewed after every accepted term. Each further term must bring a stated share of what the strongest
//! one brought: a template that is right to a few percent leaves a few percent, which is no second effect.

use super::base_fit::{Base, TOLERANCES};
use super::candidate::{Candidate, Claim};
use super::combs::combs;
use super::criteria::{LARGEST_P, LEAST_SCORE};
use super::detect;
use super::judge::{Judge, Judged, Split, corrected, joint};
use super::least_squares::Data;
use super::library::Bench;
use super::library::finite::Company;
use super::options::Options;
use super::remainder::power_and_noise;
use super::start::Start;
use super::strength::{STRONG_SCORE, Strengths, at_their_strength, refuted_by_tachometer, tune};
use super::together::{together, unknowns};
use crate::observation::spectrum::Bins;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// A further term must gain this share of the largest gain so far.
const LEAST_SHARE: f64 = 0.01;
/// Most times that the declared parameters are centred again with effects in the fit.
const MOST_CENTRED: usize = 2;
/// Second-order error of a move of the declared parameters from which it pays to centre again.
const LEAST_DEPARTURE: f64 = 3.0;
/// Share of the power beyond noise that a strong term leaves from which another strong effect is looked for before parameters move.
const MUCH: f64 = 0.2;
/// Score by which a plain description must beat a name that passes (twice the logarithm of a likelihood ratio of 10 beyond the penalties).
const NAME_MARGIN: f64 = 4.6;
/// Share of its gain by which a description with more unknowns must beat a name: the form error of a first-order template.
const TABLE_MARGIN: f64 = 0.03;

/// What a search found.
pub struct Found {
    /// Terms, strongest first.
    pub accepted: Vec<Candidate>,
    /// The best of everything that scored: rivals of the terms.
    pub pool: Vec<Candidate>,
    /// Best score of every name considered.
    pub refused: BTreeMap<String, f64>,
    /// The significant candidate of the best score before anything was accepted, whether it follows its law or not.
    pub strongest: Option<Candidate>,
    /// Residual with the final weights.
    pub data: Data,
}

/// What a search came to.
pub enum Search {
    /// Its end.
    Done(Box<Found>),
    /// An effect took the declared parameters along before it was known: they move by this much with it in the fit.
    Recentre(Vec<f64>),
}

/// What a search that begins again, on moved parameters, keeps.
#[derive(Default)]
pub struct Memory {
    /// Times that it began again.
    pub attempt: usize,
    /// Scores given by all attempts: trials of the record's search.
    pub tried: usize,
    /// Strengths found.
    pub strengths: Strengths,
}

/// Adds effects strongest first.
pub fn search(
    bench: &Bench<'_>,
    split: &Split,
    options: &Options,
    rounds: usize,
    memory: &mut Memory,
    say: &dyn Fn(&str),
) -> Search {
    let base = bench.base;
    let seen = split.seen();
    say("responses of the library");
    let mut data = base.data();
    let raw = data.residual.clone();
    let mut accepted: Vec<Candidate> = Vec::new();
    let mut pool: Vec<Candidate> = Vec::new();
    let mut refused: BTreeMap<String, f64> = BTreeMap::new();
    let mut strongest = None;
    let mut turns: Option<Vec<u32>> = None;
    let mut largest_gain = 0.0_f64;
    for round in 0..rounds {
        let terms: Vec<&Candidate> = accepted.iter().collect();
        // Noise from the residual after everything accepted; the form slack stays tied to the raw residual.
        let fitted = joint(base, &data, &seen, &terms);
        let rest = corrected(base, &data, &fitted.x, &terms);
        data.weight = base.weights(&rest.residual, &raw);
        let rest = Data { residual: rest.residual, weight: data.weight.clone() };
        let mut orders = detect::orders(base, &rest, &seen, 2);
        orders.extend(combs(base, &rest, &seen, 1));
        let mut frequencies = detect::frequencies(base, &rest, &seen, 2);
        frequencies.extend(detect::modulations(base, &rest, &seen, 1));
        say(&format!("round {}: {} order lines, {} fixed lines", round + 1, orders.len(), frequencies.len()));
        let mut candidates = bench.candidates(&rest, split, &orders, &frequencies, turns.as_deref());
        withhold(&mut candidates, &options.withheld);
        candidates.retain(|c| accepted.iter().all(|a| !same(a, c)));
        let judge = Judge::new(base, &data, split, &terms);
        let mut judged: Vec<Judged> =
            candidates.into_par_iter().map(|c| judge.judge_started(c, turns.as_deref())).collect();
        judged.sort_by(|a, b| b.score.total_cmp(&a.score));
        tune(bench, &judge, &mut judged);
        let company = Company::new(&accepted, &unknowns(base, &accepted, &fitted.x));
        at_their_strength(bench, &judge, &data, &company, &mut memory.strengths, &mut judged);
        memory.tried += judge.tried();
        judged.retain(|j| !refuted_by_tachometer(base, j));
        judged.sort_by(|a, b| b.score.total_cmp(&a.score));
        for j in judged.iter().take(6) {
            say(&format!(
                "  {} at {:?}/{:?}, {}: score {:.1}, gain {:.1}, selection runs {:.1} of {:.1}, apart {:.1}",
                j.candidate.name,
                j.candidate.order,
                j.candidate.frequency_hz,
                if j.candidate.start == Start::Counted { "as counted" } else { "started by fit" },
                j.score,
                j.gain,
                j.select_gain,
                j.select_promise,
                j.apart_gain
            ));
        }
        let tests = memory.tried as f64;
        let passes = |j: &Judged| j.passes(tests, !accepted.is_empty()) && j.gain > LEAST_SHARE * largest_gain;
        let best = judged.iter().position(passes);
        for j in judged.iter().take(30) {
            let worst = refused.entry(j.candidate.name.clone()).or_insert(f64::NEG_INFINITY);
            *worst = worst.max(j.score);
        }
        if round == 0 {
            let significant = judged.iter().filter(|j| j.score > LEAST_SCORE && j.chance(tests).value() < LARGEST_P);
            strongest = significant.max_by(|a, b| a.score.total_cmp(&b.score)).map(|j| j.candidate.clone());
        }
        let Some(best) = best else {
            pool.extend(judged.into_iter().filter(|j| j.score > 0.0).take(60).map(|j| j.candidate));
            break;
        };
        let top = &judged[best];
        let near = |j: &Judged| {
            let freer = top.candidate.templates.len() > j.candidate.templates.len();
            let margin = if freer { NAME_MARGIN.max(TABLE_MARGIN * top.gain) } else { NAME_MARGIN };
            j.score > top.score - margin
        };
        let name = judged.iter().position(|j| j.candidate.claim == Claim::Named && near(j) && passes(j));
        let winner = &judged[name.unwrap_or(best)];
        largest_gain = largest_gain.max(winner.gain);
        let strong = winner.gain > STRONG_SCORE;
        let winner = winner.candidate.clone();
        pool.extend(judged.into_iter().filter(|j| j.score > 0.0).take(60).map(|j| j.candidate));
        if turns.is_none() {
            turns = winner.start.turns().map(<[u32]>::to_vec);
        }
        accepted.push(winner);
        prune(base, &data, split, &mut accepted);
        let joined = strong && together(bench, &mut data, &raw, &seen, &mut accepted);
        if joined {
            say("strong terms fitted together on the machine that has all of them");
        }
        let terms: Vec<&Candidate> = accepted.iter().collect();
        let move_to = joint(base, &data, &seen, &terms).x[..TOLERANCES.len()].to_vec();
        // Next to one of two strong effects the parameters move for the other's sake: both come first.
        let alone = corrected(base, &data, &joint(base, &data, &seen, &terms).x, &terms);
        if strong
            && round + 1 < rounds
            && beyond_noise(base, &alone.residual, &seen) > MUCH * beyond_noise(base, &raw, &seen)
        {
            continue;
        }
        if memory.attempt < MOST_CENTRED + usize::from(joined)
            && base.departure(&data, &seen, &move_to) > LEAST_DEPARTURE
        {
            return Search::Recentre(move_to);
        }
    }
    Search::Done(Box::new(Found { accepted, pool, refused, strongest, data }))
}

/// Power of a residual beyond its local noise.
fn beyond_noise(base: &Base, residual: &[[Bins; 2]], runs: &[usize]) -> f64 {
    let (power, noise) = power_and_noise(base, residual, runs);
    power - noise
}

/// Whether two candidates are the same effect in the same place: a second helping of a term is never a second effect.
fn same(a: &Candidate, b: &Candidate) -> bool {
    let near = |a: Option<f64>, b: Option<f64>| match (a, b) {
        (Some(a), Some(b)) => (a - b).abs() < 0.01 * (1.0 + a.abs()),
        (None, None) => true,
        _ => false,
    };
    a.name == b.name
        && near(a.order, b.order)
        && near(a.frequency_hz, b.frequency_hz)
        && a.parameters.first().map(|p| &p.name) == b.parameters.first().map(|p| &p.name)
}

/// Takes names out of the library. Plain order-locked excitations, fixed-frequency forcing and modes are no part of it and stay under
/// their description; what has none goes.
fn withhold(candidates: &mut Vec<Candidate>, names: &[String]) {
    candidates.retain_mut(|c| {
        if c.claim == Claim::Generic || !names.contains(&c.name) {
            return true;
        }
        let plain = c.plain.take();
        c.claim = Claim::Generic;
        plain.map(|text| c.name = text).is_some()
    });
}

/// Drops terms that no longer earn their place next to the newest.
fn prune(base: &Base, data: &Data, split: &Split, accepted: &mut Vec<Candidate>) {
    let mut i = 0;
    while accepted.len() > 1 && i + 1 < accepted.len() {
        let others: Vec<&Candidate> = accepted.iter().enumerate().filter(|(j, _)| *j != i).map(|(_, c)| c).collect();
        let again = Judge::new(base, data, split, &others).judge(accepted[i].clone());
        if again.score < LEAST_SCORE {
            accepted.remove(i);
        } else {
            i += 1;
        }
    }
}
