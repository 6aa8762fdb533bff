//! What else the search has before it: which families are judged at all, and which bases are proposed.
//!
//! A round judges three candidates of a kind and thirty in all, and takes eight bases of a channel, the most powerful
//! ones. On a machine with much that is unexplained a weak effect is behind them, however well it stands over its
//! floor. Limits must know it (`limits`). From the last round of the search, in which everything judged was refused.

use super::candidate::{Candidate, Domain, Kind};
use super::families::{Context, passage};
use super::search::{MAX_CANDIDATES, MAX_CANDIDATES_OF_KIND, of_every_kind};
use crate::analysis::families::Family;
use crate::analysis::search::{self, Range};
use std::collections::BTreeMap;

/// Scores that keep a candidate from being judged.
pub struct Rivals {
    of_kind: BTreeMap<(Kind, Domain), f64>,
    of_all: f64,
}

impl Rivals {
    /// From the candidates of the last round, strongest first.
    pub fn of(ranked: &[(f64, Candidate)]) -> Self {
        let mut counts: BTreeMap<(Kind, Domain), usize> = BTreeMap::new();
        let mut of_kind = BTreeMap::new();
        for (strength, candidate) in ranked {
            let own = (candidate.kind, candidate.domain);
            let count = counts.entry(own).or_default();
            *count += 1;
            if *count == MAX_CANDIDATES_OF_KIND {
                of_kind.insert(own, *strength);
            }
        }
        Self { of_kind, of_all: of_every_kind(ranked).nth(MAX_CANDIDATES - 1).map_or(0.0, |(strength, _)| *strength) }
    }

    /// Score after the choice from which a candidate is judged.
    pub fn least(&self, candidate: &Candidate) -> f64 {
        self.of_kind.get(&(candidate.kind, candidate.domain)).copied().unwrap_or(0.0).max(self.of_all)
    }
}

/// What a base of neither shaft needs to be tried: lines in the spectrum of one channel that together have more power
/// than the eighth family there.
pub struct Proposals {
    /// By run and channel: root mean square of the weakest family that is tried where there are as many, and power
    /// over the floor of a line.
    channels: Vec<Vec<(f64, f64)>>,
}

impl Proposals {
    /// Of the order spectra.
    pub fn of(context: &Context) -> Self {
        let spectra = context.orders;
        let of_run = |(r, channels): (usize, Vec<Vec<Family>>)| {
            let known = passage::known(context, r);
            let range = Range { lowest: spectra.lowest, highest: spectra.highest, known: &known };
            let of_channel = |(c, families): (usize, &Vec<Family>)| {
                let weakest = families.get(passage::FAMILIES - 1).map_or(0.0, |family| family.rms);
                (weakest, search::least_ratio(&spectra.levels[r][c], &range))
            };
            channels.iter().enumerate().map(of_channel).collect()
        };
        Self { channels: passage::grouped(context).into_iter().enumerate().map(of_run).collect() }
    }

    /// Whether lines of an amplitude (by run, channel and place) make a candidate's base one that is tried.
    pub fn propose(
        &self,
        context: &Context,
        candidate: &Candidate,
        amplitude: &dyn Fn(usize, usize, usize) -> f64,
    ) -> bool {
        (0..self.channels.len()).any(|run| {
            let known = passage::known(context, run);
            let half = 1.5 * context.orders.bin(0);
            let free: Vec<usize> = (0..candidate.places.len())
                .filter(|i| candidate.places[*i].label.ends_with(" o") && !known(candidate.places[*i].order, half))
                .collect();
            let in_channel = |channel: usize| {
                let (weakest, least) = self.channels[run][channel];
                let level = &context.orders.levels[run][channel][0];
                let raised = 1.0 + 2.0 * level.floor_error;
                let over =
                    |i: usize| (amplitude(run, channel, i) / level.floor_amplitude(candidate.places[i].order)).powi(2);
                let seen: Vec<usize> = free.iter().copied().filter(|i| 1.0 + over(*i) > least * raised).collect();
                let power: f64 = seen.iter().map(|i| 0.5 * amplitude(run, channel, *i).powi(2)).sum();
                let number = |i: usize| (candidate.places[i].spacing / candidate.base).round() as usize;
                let gives_the_base = seen.len() > 1 || seen.iter().any(|i| number(*i) <= passage::MULTIPLES);
                gives_the_base && power.sqrt() > weakest
            };
            (0..self.channels[run].len()).any(in_channel)
        })
    }
}
