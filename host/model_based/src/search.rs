//! The search of the library: effects added strongest first, each judged next to those already there.
//!
//! The residual's weights are renewed after every adopted term. Whether a term is adopted, and what keeps its place
//! next to a newer one, is the gate's to decide ([`accept`]).

use super::accept::{self, Adopted};
use super::base_fit::Base;
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
use super::refinement::refine;
use super::refusal::Refusals;
use super::remainder::power_and_noise;
use super::simulation::find_roughness;
use super::start::Start;
use super::strength::{STRONG_SCORE, Strengths, at_their_strength, may_win, refuted, tune};
use super::together::unknowns;
use crate::observation::spectrum::Bins;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Most times that the machine is linearised anew about the parameters found with the same terms.
const MAX_LINEARISATIONS: usize = 3;
/// Share of the power left before, above which that no longer pays.
const STALL_POWER_SHARE: f64 = 0.8;
/// Candidates of every round that a term's name is later compared with.
const MOST_RIVALS: usize = 60;
/// Candidates of every round whose responses are kept for what follows their first score: rivals, and some that may
/// become one.
const MAX_KEPT_CANDIDATES: usize = MOST_RIVALS + 20;
/// Of these, candidates of one name, and of the rivals: places of an effect far behind its best explain nothing.
const MAX_NAME_CANDIDATES: usize = 4;
const MAX_NAME_RIVALS: usize = 2;
/// Candidates of every round whose refusal is noted.
const MAX_NOTED_REFUSALS: usize = 30;

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

/// What searches of one record share.
#[derive(Default)]
pub struct Memory {
    /// Scores given by all of them: trials of the record's search.
    pub tried: usize,
    /// Best score of the first round of the first, nats; 0 where nothing was scored.
    pub first_score: f64,
    /// Whether one came before.
    pub began: bool,
}

/// Adds effects strongest first: each round proposes one by its templates, and the simulator decides on its numbers
/// next to those of the others.
pub fn search(
    base: &mut Base,
    split: &Split,
    options: &Options,
    rounds: usize,
    memory: &mut Memory,
    say: &dyn Fn(&str),
) -> Found {
    let seen = split.seen();
    say("machine alone on the simulator");
    find_roughness(base);
    let mut data = base.data();
    if let Some(residual) = refine(base, &data, &seen, &mut []) {
        base.estimate_discrepancy(&residual, &seen);
        data = Data { weight: base.weights(&residual, &residual), residual };
    }
    let mut found = Found { accepted: Adopted::default(), pool: Vec::new(), strongest: None, data };
    let mut turns: Option<Vec<u32>> = None;
    for round in 0..rounds {
        say("responses of the library");
        let progress = Round { split, options, seen: &seen, number: round, say };
        if !progress.propose(&Bench::new(base), &mut found, &mut turns, memory) {
            break;
        }
        say("terms and machine fitted together on the simulator");
        let Found { accepted, data, .. } = &mut found;
        for _ in 0..MAX_LINEARISATIONS {
            let before = power_and_noise(base, &left(base, data, &seen, accepted), &seen).0;
            find_roughness(base);
            if let Some(residual) = refine(base, data, &seen, accepted.refine()) {
                data.residual = residual;
            }
            let rest = left(base, data, &seen, accepted);
            base.estimate_discrepancy(&rest, &seen);
            data.weight = base.weights(&rest, &rest);
            let (power, noise) = power_and_noise(base, &rest, &seen);
            if !accept::much_is_there(power, noise) || power > STALL_POWER_SHARE * before {
                break;
            }
        }
        accepted.supersede(|term, others| Judge::new(base, data, split, others).judge(term.clone()).score);
    }
    memory.began = true;
    let Found { accepted, data, .. } = &mut found;
    restart(&Bench::new(base), data, split, accepted.refine());
    found
}

/// One round of the search.
struct Round<'r> {
    split: &'r Split,
    options: &'r Options,
    seen: &'r [usize],
    number: usize,
    say: &'r dyn Fn(&str),
}

impl Round<'_> {
    /// Adopts the best of all candidates, if one passes the gate; `turns`: starts of the runs, once an effect has
    /// told them.
    fn propose(&self, bench: &Bench<'_>, found: &mut Found, turns: &mut Option<Vec<u32>>, memory: &mut Memory) -> bool {
        let Found { accepted, pool, strongest, data } = found;
        let base = bench.base;
        let judged = self.judged(bench, data, accepted, turns.as_deref(), memory);
        let tests = memory.tried as f64;
        if self.number == 0 {
            if !memory.began {
                memory.first_score = judged.first().map_or(0.0, |j| j.score);
            }
            let significant = judged.iter().filter(|j| accept::significant(&j.figures(tests)).is_ok());
            *strongest = significant.max_by(|a, b| a.score.total_cmp(&b.score)).map(|j| j.candidate.clone());
        }
        let best = winner(&judged, accepted, tests);
        let tooth = best.map(|best| &judged[best]).filter(|best| is_table(&best.candidate)).and_then(|table| {
            let passes = |j: &Judged| is_adoptable(j, accepted, tests);
            let next = Next::to(bench, data, self.split, &accepted.iter().collect::<Vec<_>>());
            let tooth = next.tooth_before(table, &judged, passes);
            memory.tried += next.tried();
            tooth
        });
        let winner = tooth.or_else(|| best.map(|i| (Some(i), judged[i].clone())));
        note_refused(&judged, accepted, winner.as_ref().map(|(i, w)| (*i, w.candidate.name.as_str())), tests);
        let rivals = judged.into_iter().filter(|j| j.score > 0.0 && !j.candidate.templates.is_empty());
        keep_rivals(pool, rivals.take(MOST_RIVALS).map(|j| j.candidate));
        let Some((_, winner)) = winner else { return false };
        let (strong, figures) = (winner.gain > STRONG_SCORE, winner.figures(tests));
        let winner = winner.candidate;
        if turns.is_none() {
            *turns = winner.start.turns().map(<[u32]>::to_vec);
        }
        if accepted.adopt(winner, &figures).is_err() {
            return false;
        }
        accepted.supersede(|term, others| Judge::new(base, data, self.split, others).judge(term.clone()).score);
        if strong && let Some(one) = one_start(bench, data, self.seen, accepted.refine()) {
            (self.say)("teeth of one gear fitted with one start of every run");
            *turns = Some(one);
        }
        true
    }

    /// All candidates for what the terms leave, best first.
    fn judged(
        &self,
        bench: &Bench<'_>,
        data: &mut Data,
        accepted: &mut Adopted,
        turns: Option<&[u32]>,
        memory: &mut Memory,
    ) -> Vec<Judged> {
        let (base, seen) = (bench.base, self.seen);
        let terms: Vec<&Candidate> = accepted.iter().collect();
        let fitted = joint(base, data, seen, &terms);
        let rest = corrected(base, data, &fitted.x, &terms);
        data.weight = base.weights(&rest.residual, &rest.residual);
        let rest = Data { residual: rest.residual, weight: data.weight.clone() };
        let mut orders = detect::orders(base, &rest, seen, 2);
        orders.extend(combs(base, &rest, seen, 1));
        let mut frequencies = detect::frequencies(base, &rest, seen, 2);
        frequencies.extend(detect::modulations(base, &rest, seen, 1));
        let lines = format!("{} order lines, {} fixed lines", orders.len(), frequencies.len());
        (self.say)(&format!("round {}: {lines}", self.number + 1));
        let judge = Judge::new(base, data, self.split, &terms);
        let mut judged: Vec<Judged> = Vec::new();
        bench.candidates(&rest, self.split, &orders, &frequencies, turns, |mut candidates| {
            withhold(&mut candidates, &self.options.withheld);
            candidates.retain(|c| accepted.iter().all(|a| !same(a, c)));
            judged.par_extend(candidates.into_par_iter().map(|c| judge.judge_started(c, turns)));
            judged.sort_by(|a, b| b.score.total_cmp(&a.score));
            forget_responses(bench, &mut judged);
        });
        tune(bench, &judge, &mut judged);
        let company = Company::new(accepted, &unknowns(base, accepted, &fitted.x));
        at_their_strength(bench, &judge, data, &company, &mut Strengths::new(), &mut judged);
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
        judged.iter().take(6).for_each(|j| (self.say)(&described(j)));
        judged
    }
}

/// A candidate's scores, for a line of progress.
fn described(j: &Judged) -> String {
    let start = if j.candidate.start == Start::Counted { "as counted" } else { "started by fit" };
    format!(
        "  {} at {}, {start}: score {:.1}, gain {:.1}, selection runs {:.1} of {:.1}, apart {:.1}",
        j.candidate.name,
        place(j.candidate.order, j.candidate.frequency_hz),
        j.score,
        j.gain,
        j.select_gain,
        j.select_promise,
        j.apart_gain
    )
}

/// What the accepted terms leave of the runs.
fn left(base: &Base, data: &Data, seen: &[usize], accepted: &[Candidate]) -> Vec<[Bins; 2]> {
    let terms: Vec<&Candidate> = accepted.iter().collect();
    corrected(base, data, &joint(base, data, seen, &terms).x, &terms).residual
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
        if *own > MAX_NAME_RIVALS {
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
    for (i, j) in judged.iter().enumerate().take(MAX_NOTED_REFUSALS) {
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
        let is_kept = *own <= MAX_NAME_CANDIDATES && rank < MAX_KEPT_CANDIDATES && j.score > 0.0;
        if !is_kept && !may_win(bench, best, j) {
            j.candidate.templates = Vec::new();
        }
    }
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
