//! The search of the library: effects added strongest first, each judged next to those already there.
//!
//! The residual's weights are renewed after every adopted term. Whether a term is adopted, and what keeps its place
//! next to a newer one, is the gate's to decide ([`accept`]).

use super::accept::{self, Adopted};
use super::base_fit::{Base, TOLERANCES};
use super::candidate::{Candidate, Claim};
use super::combs::combs;
use super::detect;
use super::held_out::restart;
use super::judge::{Judge, Judged, Split, corrected, joint};
use super::least_squares::Data;
use super::library::Bench;
use super::library::finite::Company;
use super::lookahead::{Next, is_table};
use super::one_start::one_start;
use super::options::Options;
use super::refusal::Refusals;
use super::remainder::power_and_noise;
use super::start::Start;
use super::strength::{STRONG_SCORE, Strengths, at_their_strength, may_win, refuted, tune};
use super::together::{together, unknowns};
use crate::observation::spectrum::Bins;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Most times that the declared parameters are centred again with effects in the fit.
const MOST_CENTRED: usize = 2;
/// Second-order error of a move of the declared parameters from which it pays to centre again.
const LEAST_DEPARTURE: f64 = 3.0;
/// Share of the power beyond noise that a strong term leaves from which another strong effect is looked for before
/// parameters move.
const MUCH: f64 = 0.2;
/// Candidates of every round that a term's name is later compared with.
const MOST_RIVALS: usize = 60;
/// Candidates of every round whose responses are kept for what follows their first score: rivals, and some that may
/// become one.
const MOST_KEPT: usize = MOST_RIVALS + 20;
/// Of these, candidates of one name, and of the rivals: places of an effect far behind its best explain nothing.
const MOST_OF_A_NAME: usize = 4;
const MOST_RIVALS_OF_A_NAME: usize = 2;
/// Candidates of every round whose refusal is noted.
const MOST_NOTED: usize = 30;

/// What a search found.
pub struct Found {
    /// Terms, strongest first, and what was refused.
    pub accepted: Adopted,
    /// The best of everything that scored: rivals of the terms.
    pub pool: Vec<Candidate>,
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
    /// Best score of the first round of the first attempt, nats; 0 where nothing was scored.
    pub first_score: f64,
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
    let mut accepted = Adopted::default();
    let mut pool: Vec<Candidate> = Vec::new();
    let mut strongest = None;
    let mut turns: Option<Vec<u32>> = None;
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
        let judge = Judge::new(base, &data, split, &terms);
        let mut judged: Vec<Judged> = Vec::new();
        bench.candidates(&rest, split, &orders, &frequencies, turns.as_deref(), |mut candidates| {
            withhold(&mut candidates, &options.withheld);
            candidates.retain(|c| accepted.iter().all(|a| !same(a, c)));
            judged.par_extend(candidates.into_par_iter().map(|c| judge.judge_started(c, turns.as_deref())));
            judged.sort_by(|a, b| b.score.total_cmp(&a.score));
            forget_responses(bench, &mut judged);
        });
        tune(bench, &judge, &mut judged);
        let company = Company::new(&accepted, &unknowns(base, &accepted, &fitted.x));
        at_their_strength(bench, &judge, &data, &company, &mut memory.strengths, &mut judged);
        memory.tried += judge.tried();
        // As large as the next one.
        drop(judge);
        judged.retain(|j| match refuted(base, j) {
            Ok(()) => true,
            Err(why) => {
                accepted.refusals.note(&j.candidate.name, j.score, why);
                false
            }
        });
        judged.sort_by(|a, b| b.score.total_cmp(&a.score));
        for j in judged.iter().take(6) {
            say(&format!(
                "  {} at {}, {}: score {:.1}, gain {:.1}, selection runs {:.1} of {:.1}, apart {:.1}",
                j.candidate.name,
                place(j.candidate.order, j.candidate.frequency_hz),
                if j.candidate.start == Start::Counted { "as counted" } else { "started by fit" },
                j.score,
                j.gain,
                j.select_gain,
                j.select_promise,
                j.apart_gain
            ));
        }
        let tests = memory.tried as f64;
        if round == 0 {
            if memory.attempt == 0 {
                memory.first_score = judged.first().map_or(0.0, |j| j.score);
            }
            let significant = judged.iter().filter(|j| accept::significant(&j.figures(tests)).is_ok());
            strongest = significant.max_by(|a, b| a.score.total_cmp(&b.score)).map(|j| j.candidate.clone());
        }
        let best = winner(&judged, &accepted, tests);
        let tooth = best.map(|best| &judged[best]).filter(|best| is_table(&best.candidate)).and_then(|table| {
            let passes = |j: &Judged| is_adoptable(j, &accepted, tests);
            let next = Next::to(bench, &data, split, &accepted.iter().collect::<Vec<_>>());
            let tooth = next.tooth_before(table, &judged, passes);
            memory.tried += next.tried();
            tooth
        });
        let winner = tooth.or_else(|| best.map(|i| (Some(i), judged[i].clone())));
        note_refused(&judged, &mut accepted, winner.as_ref().map(|(i, w)| (*i, w.candidate.name.as_str())), tests);
        let rivals = judged.into_iter().filter(|j| j.score > 0.0 && !j.candidate.templates.is_empty());
        keep_rivals(&mut pool, rivals.take(MOST_RIVALS).map(|j| j.candidate));
        let Some((_, winner)) = winner else { break };
        let (strong, figures) = (winner.gain > STRONG_SCORE, winner.figures(tests));
        let winner = winner.candidate;
        if turns.is_none() {
            turns = winner.start.turns().map(<[u32]>::to_vec);
        }
        if accepted.adopt(winner, &figures).is_err() {
            break;
        }
        accepted.supersede(|term, others| Judge::new(base, &data, split, others).judge(term.clone()).score);
        if strong && let Some(one) = one_start(bench, &data, &seen, accepted.refine()) {
            say("teeth of one gear fitted with one start of every run");
            turns = Some(one);
        }
        let joined = strong && together(bench, &mut data, &raw, &seen, accepted.refine());
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
    restart(bench, &data, split, accepted.refine());
    Search::Done(Box::new(Found { accepted, pool, strongest, data }))
}

/// The candidate to adopt: the best that passes, or a name that passes and comes near enough.
fn winner(judged: &[Judged], accepted: &Adopted, tests: f64) -> Option<usize> {
    let passes = |j: &Judged| is_adoptable(j, accepted, tests);
    let best = judged.iter().position(passes)?;
    let top = judged[best].figures(tests);
    let named = |j: &Judged| j.candidate.claim == Claim::Named && accept::name_is_near(&top, &j.figures(tests));
    Some(judged.iter().position(|j| named(j) && passes(j)).unwrap_or(best))
}

/// Whether it has its responses (one far down the list, whose are forgotten, is no explanation of anything), and the
/// gate lets it in.
fn is_adoptable(judged: &Judged, accepted: &Adopted, tests: f64) -> bool {
    !judged.candidate.templates.is_empty() && accepted.weigh(&judged.figures(tests)).is_ok()
}

/// Adds a round's rivals, at few places of a name; of tables of all teeth, most of the memory, the newest alone stay.
fn keep_rivals(pool: &mut Vec<Candidate>, rivals: impl Iterator<Item = Candidate>) {
    let mut of_name: BTreeMap<String, usize> = BTreeMap::new();
    for rival in rivals {
        let own = of_name.entry(rival.name.clone()).or_default();
        *own += 1;
        if *own > MOST_RIVALS_OF_A_NAME {
            continue;
        }
        if is_table(&rival) {
            pool.retain(|older| !is_table(older) || older.name != rival.name);
        }
        pool.push(rival);
    }
}

/// Notes why the best of those not taken were refused.
fn note_refused(judged: &[Judged], accepted: &mut Adopted, winner: Option<(Option<usize>, &str)>, tests: f64) {
    let (winner, taken) = winner.unwrap_or_default();
    let mut refusals = Refusals::default();
    for (i, j) in judged.iter().enumerate().take(MOST_NOTED) {
        if Some(i) != winner {
            let why = accepted.weigh(&j.figures(tests)).err().unwrap_or_else(|| accept::outranked(taken));
            refusals.note(&j.candidate.name, j.score, why);
        }
    }
    accepted.refusals.extend(refusals);
}

/// Drops the responses, most of the loop's memory, of candidates (best first) that nothing more will be asked of but
/// their score.
fn forget_responses(bench: &Bench<'_>, judged: &mut [Judged]) {
    let best = judged.first().map_or(0.0, |j| j.score);
    let mut of_name: BTreeMap<String, usize> = BTreeMap::new();
    for (rank, j) in judged.iter_mut().enumerate() {
        let own = of_name.entry(j.candidate.name.clone()).or_default();
        *own += 1;
        let is_kept = *own <= MOST_OF_A_NAME && rank < MOST_KEPT && j.score > 0.0;
        if !is_kept && !may_win(bench, best, j) {
            j.candidate.templates = Vec::new();
        }
    }
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

/// Takes names out of the library. Plain order-locked excitations, fixed-frequency forcing and modes are no part of
/// it and stay under their description; what has none goes.
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

/// Where a candidate's line lies, for a line of progress.
fn place(order: Option<f64>, frequency_hz: Option<f64>) -> String {
    match (order, frequency_hz) {
        (Some(order), _) => format!("order {order:.4}"),
        (None, Some(hz)) => format!("{hz:.2} Hz"),
        (None, None) => "no order of its own".into(),
    }
}
