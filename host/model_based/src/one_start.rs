//! One start of the runs for single teeth of one gear.
//!
//! The first of two teeth finds the start of every run alone, and in some runs takes the second for itself; the
//! second then finds starts of its own beside it. But a run starts once. So where two differ, each start is tried for
//! both, run by run, with the strengths fitted anew; what is kept must explain more, at the teeth's own strengths,
//! than the two starts did. Cost: one joint fit for each run in which they differ, and a simulation of all runs for
//! each tooth. Limit: where both are wrong in a run, it stays wrong.

use super::candidate::Candidate;
use super::judge::{corrected, joint};
use super::least_squares::{Data, chi_square};
use super::library::Bench;
use super::library::finite::Company;
use super::start::Start;
use super::strength::first_guess;
use super::together::fitted;
use crate::machine::Hunting;
use std::collections::BTreeMap;

/// Gives the single teeth of the gear in `accepted` one start of every run, where the newest has another than the
/// first and one start explains more of the runs `seen`; the turns taken.
pub fn one_start(bench: &Bench<'_>, data: &Data, seen: &[usize], accepted: &mut [Candidate]) -> Option<Vec<u32>> {
    let is_started = |c: &Candidate| c.tooth.is_some() && c.body() == 1 && c.start.turns().is_some();
    let teeth: Vec<usize> = (0..accepted.len()).filter(|&i| is_started(&accepted[i])).collect();
    let (&first, &newest) = (teeth.first()?, teeth.last()?);
    let own = accepted[first].start.turns()?.to_vec();
    let (other, later) = counted_alike(bench, &own, accepted[newest].start.turns()?);
    if own == other && later == 0 {
        return None;
    }
    let started = |turns: &[u32]| -> Option<Vec<Candidate>> {
        let mut terms = accepted.to_vec();
        for &i in &teeth {
            let start = if i == first { Start::Turns(turns.to_vec()) } else { Start::Given(turns.to_vec()) };
            terms[i] = on_its_tooth(bench, &accepted[i], if i == newest { later } else { 0 }, start)?;
        }
        Some(terms)
    };
    let all: Vec<usize> = (0..own.len()).collect();
    // Against each other starts are told by first-order responses: a wrong one leaves far more than their form error.
    let left = |turns: &[u32]| started(turns).map(|terms| left_over(bench, data, seen, &all, &terms));
    let mut turns = own.clone();
    let mut least = left(&turns)?;
    for run in (0..own.len()).filter(|&run| own[run] != other[run]) {
        let mut tried = turns.clone();
        tried[run] = other[run];
        let left = left(&tried)?;
        if left < least {
            (turns, least) = (tried, left);
        }
    }
    let terms = at_their_strengths(bench, data, seen, started(&turns)?, &teeth);
    if left_over(bench, data, seen, seen, &terms) >= left_over(bench, data, seen, seen, accepted) {
        return None;
    }
    accepted.clone_from_slice(&terms);
    Some(turns)
}

/// `other` turns as they are where both starts mean the same first turn, and by how many turns they were later:
/// starts are relative to the first run, whose own may be the one that differs.
fn counted_alike(bench: &Bench<'_>, own: &[u32], other: &[u32]) -> (Vec<u32>, u32) {
    let period = Hunting::of(bench.base.machine.teeth).turns;
    let mut times = BTreeMap::<u32, usize>::new();
    for (a, b) in own.iter().zip(other) {
        *times.entry((b + period - a) % period).or_default() += 1;
    }
    let later = times.into_iter().max_by_key(|&(later, times)| (times, later == 0)).map_or(0, |(later, _)| later);
    (other.iter().map(|k| (k + period - later) % period).collect(), later)
}

/// A term of a single tooth of the gear with the runs started anew; its own start was `later` turns later than that.
fn on_its_tooth(bench: &Bench<'_>, term: &Candidate, later: u32, start: Start) -> Option<Candidate> {
    let [z1, z2] = bench.base.machine.teeth;
    let tooth = (term.tooth? + z2 - z1 * later % z2) % z2;
    bench.teeth.at(bench, 1, tooth, &start).into_iter().find(|c| c.name == term.name)
}

/// What the terms, fitted over the runs `seen`, leave of `runs`.
fn left_over(bench: &Bench<'_>, data: &Data, seen: &[usize], runs: &[usize], terms: &[Candidate]) -> f64 {
    let terms: Vec<&Candidate> = terms.iter().collect();
    chi_square(&corrected(bench.base, data, &joint(bench.base, data, seen, &terms).x, &terms), runs)
}

/// The terms with the responses of `teeth` at their own strengths, each beside those before it.
fn at_their_strengths(
    bench: &Bench<'_>,
    data: &Data,
    seen: &[usize],
    mut terms: Vec<Candidate>,
    teeth: &[usize],
) -> Vec<Candidate> {
    for &i in teeth {
        let x = fitted(bench.base, data, seen, &terms);
        let company = Company::new(&terms, &x);
        if let Some(bent) = bench.at_strength(&terms[i], &first_guess(&terms[i], &x[i]), data, &company) {
            terms[i] = bent;
        }
    }
    terms
}
