//! What else could stand in the place of an effect found: every candidate of the search in its place, next to the
//! other effects.
//!
//! Cost: a score per effect and candidate kept. Limit: what the search scored low before the effect's own round is
//! not among them.

use super::base_fit::Base;
use super::candidate::{Candidate, Claim};
use super::judge::{Judge, Judged, Split};
use super::least_squares::Data;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Rivals named in a verdict at most.
const MOST_NAMED: usize = 6;

/// An effect found, and what stands against it.
pub struct Rivals {
    /// The effect next to the others.
    pub judged: Judged,
    /// Other names and descriptions, the nearest first, and by how many nats each is behind.
    pub nearest: Vec<(String, f64)>,
    /// By how much the nearest other name is.
    pub next_name: Option<f64>,
}

/// Rivals of every accepted term among the candidates of the search.
pub fn rivals(base: &Base, data: &Data, split: &Split, accepted: &[Candidate], pool: &[Candidate]) -> Vec<Rivals> {
    let of = |(index, term): (usize, &Candidate)| {
        let others: Vec<&Candidate> =
            accepted.iter().enumerate().filter(|(j, _)| *j != index).map(|(_, c)| c).collect();
        let judge = Judge::new(base, data, split, &others);
        let own = judge.judge(term.clone());
        let mut best: BTreeMap<&str, (f64, bool)> = BTreeMap::new();
        let in_its_place: Vec<(&Candidate, f64)> =
            pool.par_iter().filter(|c| c.name != term.name).map(|c| (c, judge.judge(c.clone()).score)).collect();
        for (candidate, score) in in_its_place {
            let (most, named) = best.entry(&candidate.name).or_insert((f64::NEG_INFINITY, false));
            *most = most.max(score);
            *named |= candidate.claim == Claim::Named;
        }
        let mut nearest: Vec<(&str, f64, bool)> =
            best.into_iter().map(|(name, (score, named))| (name, 0.5 * (own.score - score), named)).collect();
        nearest.sort_by(|a, b| a.1.total_cmp(&b.1));
        nearest.truncate(MOST_NAMED);
        Rivals {
            next_name: nearest.iter().find(|r| r.2).map(|r| r.1),
            nearest: nearest.into_iter().map(|(name, behind, _)| (name.into(), behind)).collect(),
            judged: own,
        }
    };
    accepted.iter().enumerate().map(of).collect()
}
