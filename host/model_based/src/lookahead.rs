//! Single teeth before a table of all teeth.
//!
//! A cracked tooth beside a displaced one on the same gear is like neither at first: a table of all teeth, with
//! dozens of unknowns, explains more than each alone. Taken strongest first the table would win, and the two causes
//! would never be told. So where a table would be taken, the best single teeth of its gear are each tried together
//! with the best second one that they leave, at its own strength; where such a pair scores higher than the table, its
//! first tooth is taken, and the next round finds the second.
//!
//! A tooth that finds the starts of the runs alone takes the other one for itself in some of them; the table, which
//! has both, does not. So each kind is also tried on its best tooth with the runs started as for the table. Cost: for
//! each of at most four teeth, one round of the single teeth alone. Limit: three teeth at once stay a table.
//!
//! A single tooth that explains nearly all that the table does goes first without a second: what the table has beyond
//! it may be no more than how far strong effects, not yet fitted together, are off in form. A table that is more than
//! that is found next to the tooth.

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
const MAX_FIRST_TEETH: usize = 2;

/// Share of the table's gain from which a single tooth explains nearly all of it.
const MIN_SINGLE_GAIN_SHARE: f64 = 0.9;

/// Whether it describes a tooth of its own for every tooth of a gear.
pub fn is_table(candidate: &Candidate) -> bool {
    candidate.tooth.is_none() && candidate.pair_orders.len() > 1
}

/// Whether two are the same on the same tooth, with the same starts.
fn is_same(a: &Judged, b: &Judged) -> bool {
    let of = |j: &Judged| (j.candidate.name.clone(), j.candidate.tooth);
    of(a) == of(b) && a.candidate.start.turns() == b.candidate.start.turns()
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

    /// Which of the `judged`, best first, goes before a `table`, and that one at its own strength: a tooth that
    /// explains nearly all of it, or the first of a pair that scores higher. No place in the list: one of them on the
    /// table's starts. `passes`: whether the gate lets one in.
    pub fn tooth_before(
        &self,
        table: &Judged,
        judged: &[Judged],
        passes: impl Fn(&Judged) -> bool,
    ) -> Option<(Option<usize>, Judged)> {
        let is_first = |j: &Judged| {
            let candidate = &j.candidate;
            candidate.tooth.is_some() && candidate.shaft == table.candidate.shaft && passes(j)
        };
        let first = |(index, j): (usize, &Judged)| (Some(index), self.at_its_strength(j.clone()));
        let mut firsts: Vec<(Option<usize>, Judged)> =
            judged.iter().enumerate().filter(|(_, j)| is_first(j)).take(MAX_FIRST_TEETH).map(first).collect();
        if let Some(alone) = firsts.iter().find(|(_, j)| j.gain > MIN_SINGLE_GAIN_SHARE * table.gain) {
            return Some(alone.clone());
        }
        let on_its_starts = self.started_as(table).into_iter().filter(is_first);
        let new: Vec<Judged> = on_its_starts.filter(|j| firsts.iter().all(|(_, f)| !is_same(f, j))).collect();
        firsts.extend(new.into_iter().map(|j| (None, self.at_its_strength(j))));
        let with_second = |(index, first): (Option<usize>, Judged)| {
            let second = self.second(&first)?;
            Some((first.score + second, (index, first)))
        };
        let pairs = firsts.into_iter().filter_map(with_second).filter(|(score, _)| *score > table.score);
        pairs.max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, first)| first)
    }

    /// Best single tooth of each kind on the gear of a `table`, with the runs started as the table found them.
    fn started_as(&self, table: &Judged) -> Vec<Judged> {
        let start = &table.candidate.start;
        let Some(turns) = start.turns() else { return Vec::new() };
        let teeth = self.bench.teeth.singles(self.bench, &self.rest, self.split, Some(turns)).into_iter();
        let mut own: Vec<Candidate> =
            teeth.filter(|c| c.body() == table.candidate.body() && c.start.turns() == Some(turns)).collect();
        // Starts that the table had to find are found by the tooth as well, at the same price.
        own.iter_mut().for_each(|c| c.start.clone_from(start));
        own.into_iter().map(|c| self.judge.judge(c)).collect()
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
