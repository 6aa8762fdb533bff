//! What else could stand in the place of an effect found: every candidate of the search in its place, next to the
//! other effects.
//!
//! Those that come near by their templates are refined on the simulator in the effect's place, as it was itself,
//! before they are refused. Cost: a score per effect and candidate kept, and a refinement for each that comes near.
//! Limit: what the search scored low before the effect's own round is not among them.

use super::base_fit::Base;
use super::candidate::{Candidate, Claim};
use super::judge::{Judge, Judged, Split};
use super::least_squares::Data;
use super::refinement::objective;
use super::simulation::has_counterpart;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Rivals named in a verdict at most.
const MAX_NAMED_RIVALS: usize = 6;

/// Nats, and the share of the effect's gain, within which a rival's templates may be what keeps it behind: their
/// error of form.
const NEAR_RIVAL_NATS: f64 = 10.0;
const NEAR_SHARE: f64 = 2e-2;
/// Rivals refined at most.
const MAX_REFINED_RIVALS: usize = 2;

/// An effect found, and what stands against it.
pub struct Rivals {
    /// The effect next to the others.
    pub judged: Judged,
    /// Other names and descriptions, the nearest first, and by how many nats each is behind.
    pub nearest: Vec<(String, f64)>,
    /// By how much the nearest other name is.
    pub next_name: Option<f64>,
}

/// Refines the rivals that come near the term `index` by their templates in its place, and says by how much they are
/// behind then.
fn contest(
    base: &Base,
    data: &Data,
    split: &Split,
    accepted: &[Candidate],
    index: usize,
    (own, scored): (&Judged, &[Judged]),
    nearest: &mut [(&str, f64, bool)],
) {
    let near = |behind: f64| behind < NEAR_RIVAL_NATS.max(NEAR_SHARE * own.gain);
    let seen = split.seen();
    let mut best = None;
    for (name, behind, _) in nearest.iter_mut().filter(|r| near(r.1)).take(MAX_REFINED_RIVALS) {
        let of_name = scored.iter().filter(|j| j.candidate.name == *name);
        let Some(rival) = of_name.max_by(|a, b| a.score.total_cmp(&b.score)) else { continue };
        if !has_counterpart(base, &rival.candidate, &rival.x) {
            continue;
        }
        let Some(mine) = *best.get_or_insert_with(|| objective(base, data, &seen, accepted, false)) else { return };
        let mut others = accepted.to_vec();
        others[index] = rival.candidate.clone();
        if let Some(theirs) = objective(base, data, &seen, &others, true) {
            let penalty = |j: &Judged| j.gain - j.score;
            *behind = 0.5 * (theirs + penalty(rival) - mine - penalty(own));
        }
    }
}

/// Rivals of every accepted term among the candidates of the search.
pub fn rivals(base: &Base, data: &Data, split: &Split, accepted: &[Candidate], pool: &[Candidate]) -> Vec<Rivals> {
    let of = |(index, term): (usize, &Candidate)| {
        let others: Vec<&Candidate> =
            accepted.iter().enumerate().filter(|(j, _)| *j != index).map(|(_, c)| c).collect();
        let judge = Judge::new(base, data, split, &others);
        let own = judge.judge(term.clone());
        let mut best: BTreeMap<&str, (f64, bool)> = BTreeMap::new();
        let scored: Vec<Judged> =
            pool.par_iter().filter(|c| c.name != term.name).map(|c| judge.judge(c.clone())).collect();
        for judged in &scored {
            let (most, named) = best.entry(&judged.candidate.name).or_insert((f64::NEG_INFINITY, false));
            *most = most.max(judged.score);
            *named |= judged.candidate.claim == Claim::Named;
        }
        let mut nearest: Vec<(&str, f64, bool)> =
            best.into_iter().map(|(name, (score, named))| (name, 0.5 * (own.score - score), named)).collect();
        nearest.sort_by(|a, b| a.1.total_cmp(&b.1));
        nearest.truncate(MAX_NAMED_RIVALS);
        contest(base, data, split, accepted, index, (&own, &scored), &mut nearest);
        nearest.sort_by(|a, b| a.1.total_cmp(&b.1));
        Rivals {
            next_name: nearest.iter().find(|r| r.2).map(|r| r.1),
            nearest: nearest.into_iter().map(|(name, behind, _)| (name.into(), behind)).collect(),
            judged: own,
        }
    };
    accepted.iter().enumerate().map(of).collect()
}
