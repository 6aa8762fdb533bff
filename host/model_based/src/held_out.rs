//! What the held-out runs say of terms: their error, and that a term's runs were not counted from one turn.
//!
//! Held-out runs are predicted from the others. Their own angle offsets and speeds, with the tachometer's uncertainty
//! as prior, are fitted last: they are no part of a term. Their own start is, where a term has starts
//! ([`start`](super::start)). A term taken as counted has none: where it was counted wrongly, and one of few runs
//! seen has nearly all of the effect, any start of the others will do, and the held-out runs then speak against the
//! effect instead of against the start.

use super::base_fit::{Base, TOLERANCES};
use super::candidate::Candidate;
use super::judge::{Judge, Split, corrected, joint};
use super::least_squares::{Data, chi_square, normal, solve};
use super::library::Bench;
use super::library::finite::Company;
use super::start::Start;
use super::together::fitted;
use crate::machine::Hunting;

/// Whitened error of the held-out runs with the terms, fitted on the others.
pub fn error(base: &Base, data: &Data, split: &Split, terms: &[&Candidate]) -> f64 {
    let own = base.columns().split_off(TOLERANCES.len());
    let mut x = joint(base, data, &split.seen(), terms).x;
    x[TOLERANCES.len()..base.nuisances.len()].fill(0.0);
    let rest = corrected(base, data, &x, terms);
    chi_square(&rest, &split.held_out) - solve(&normal(&rest, &split.held_out, &own)).gain
}

/// Starts the runs anew of each of the `accepted` terms that was taken as counted, where that lowers the error of the
/// held-out runs by more than what their starts cost and what the others lose.
pub fn restart(bench: &Bench<'_>, data: &Data, split: &Split, accepted: &mut [Candidate]) {
    let base = bench.base;
    let nats = f64::from(Hunting::of(base.machine.teeth).turns).ln() * split.held_out.len() as f64;
    for i in 0..accepted.len() {
        if accepted[i].start != Start::Counted {
            continue;
        }
        let others: Vec<&Candidate> = accepted.iter().enumerate().filter(|(j, _)| *j != i).map(|(_, t)| t).collect();
        let judge = Judge::new(base, data, split, &others);
        let Some(mut turned) = judge.judge_turned(&accepted[i]) else { continue };
        if accepted[i].bent {
            let terms: Vec<Candidate> = others.iter().map(|c| (*c).clone()).collect();
            let company = Company::new(&terms, &fitted(base, data, &split.seen(), &terms));
            if let Some(bent) = bench.at_strength(&turned.candidate, &turned.x, data, &company) {
                turned = judge.judge(bent);
            }
        }
        let costs = judge.judge(accepted[i].clone()).score - turned.score + 2.0 * nats;
        let with = |term| error(base, data, split, &others.iter().copied().chain([term]).collect::<Vec<_>>());
        if with(&accepted[i]) - with(&turned.candidate) > costs.max(0.0) {
            accepted[i] = turned.candidate;
        }
    }
}
