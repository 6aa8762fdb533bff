//! Single teeth before a table of all teeth.
//!
//! A cracked tooth beside a displaced one on the same gear is like neither at first: a table of all teeth, with dozens of unknowns, explains more than each alone. Taken
//! strongest first the table would win, and the two causes would never be told. So where a table would be taken, the best single teeth of its gear are each tried together
//! with the best second one that they leave, at its own strength; where such a pair scores higher than the table, its first tooth is taken, and the next round finds the second. Cost: for each of two
//! teeth, one round of the single teeth alone. Limits: three teeth at once stay a table; a run whose start the first tooth got wrong
//! for the second's sake keeps it, and then the two are not fitted together.
//!
//! A single tooth that explains nearly all that the table does goes first without a second: what the table has beyond it may be no more than how far strong effects, not yet fitted together,
//! are off in form. A table that is more than that is found next to the tooth.

use super::base_fit::Base;
use super::candidate::Candidate;
use super::judge::{Judge, Judged, Split, corrected, joint};
use super::least_squares::Data;
use super::library::Bench;
use super::library::finite::Company;
use super::strength::{Strengths, at_their_strength};
use super::together::unknowns;
use std::cell::Cell;

/// First teeth tried.
const MOST_FIRST: usize = 2;

/// Share of the table's gain from which a single tooth explains nearly all of it.
const NEARLY_ALL: f64 = 0.9;

/// Whether it describes a tooth of its own for every tooth of a gear.
pub fn is_table(candidate: &Candidate) -> bool {
    candidate.tooth.is_none() && candidate.pair_orders.len() > 1
}

/// Single teeth next to the terms there are.
pub struct Next<'a> {
    bench: &'a Bench<'a>,
    data: &'a Data,
    split: &'a Split,
    terms: Vec<&'a Candidate>,
    judge: Judge<'a>,
    /// Residual beside the terms.
    rest: Data,
    company: Company,
    /// Scores given beside pairs.
    tried: Cell<usize>,
}

impl<'a> Next<'a> {
    /// The accepted `terms` and what they leave.
    pub fn to(bench: &'a Bench<'a>, data: &'a Data, split: &'a Split, terms: &[&'a Candidate]) -> Self {
        let base: &Base = bench.base;
        let fitted = joint(base, data, &split.seen(), terms).x;
        let all: Vec<Candidate> = terms.iter().map(|c| (*c).clone()).collect();
        Self {
            bench,
            data,
            split,
            terms: terms.to_vec(),
            judge: Judge::new(base, data, split, terms),
            rest: corrected(base, data, &fitted, terms),
            company: Company::new(&all, &unknowns(base, &all, &fitted)),
            tried: Cell::new(0),
        }
    }

    /// Number of scores given so far: trials of the record's search.
    pub fn tried(&self) -> usize {
        self.judge.tried() + self.tried.get()
    }

    /// Which of the `judged`, best first, goes before a `table`, and that one at its own strength: a tooth that explains nearly all of it, or the first of a pair that
    /// scores higher. `passes`: whether the gate lets one in.
    pub fn tooth_before(
        &self,
        table: &Judged,
        judged: &[Judged],
        passes: impl Fn(&Judged) -> bool,
    ) -> Option<(usize, Judged)> {
        let is_first = |j: &Judged| {
            let candidate = &j.candidate;
            candidate.tooth.is_some() && candidate.shaft == table.candidate.shaft && passes(j)
        };
        let first = |(index, j): (usize, &Judged)| (index, self.at_its_strength(j.clone()));
        let firsts: Vec<(usize, Judged)> =
            judged.iter().enumerate().filter(|(_, j)| is_first(j)).take(MOST_FIRST).map(first).collect();
        if let Some(alone) = firsts.iter().find(|(_, j)| j.gain > NEARLY_ALL * table.gain) {
            return Some(alone.clone());
        }
        let with_second = |(index, first): (usize, Judged)| {
            let second = self.second(&first)?;
            Some((first.score + second, (index, first)))
        };
        let pairs = firsts.into_iter().filter_map(with_second).filter(|(score, _)| *score > table.score);
        pairs.max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, first)| first)
    }

    /// The same tooth with its response at its own strength, where that explains more.
    fn at_its_strength(&self, judged: Judged) -> Judged {
        let mut own = [judged];
        at_their_strength(self.bench, &self.judge, self.data, &self.company, &mut Strengths::new(), &mut own);
        let [own] = own;
        own
    }

    /// Score of the best single tooth next to these and `first`, with the runs started as for the first.
    fn second(&self, first: &Judged) -> Option<f64> {
        let with: Vec<&Candidate> = self.terms.iter().copied().chain([&first.candidate]).collect();
        let next = Next::to(self.bench, self.data, self.split, &with);
        let turns = first.candidate.start.turns();
        let mut seconds: Vec<Judged> = self
            .bench
            .teeth
            .singles(self.bench, &next.rest, self.split, turns)
            .into_iter()
            .filter(|c| c.body() == 0 || c.start.turns() == turns)
            .map(|c| next.judge.judge(c))
            .collect();
        at_their_strength(self.bench, &next.judge, self.data, &next.company, &mut Strengths::new(), &mut seconds);
        self.tried.set(self.tried.get() + next.tried());
        seconds.iter().map(|j| j.score).reduce(f64::max)
    }
}
