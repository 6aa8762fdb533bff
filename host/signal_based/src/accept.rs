//! The one gate: whether a family may be adopted, and why not.
//!
//! Three conditions. *Evidence*: the Bayes factor with the prior of `evidence`, divided by the number of alternatives
//! it was chosen from, exceeds exp(5).
//! *Rank*: it also stands out of the same search with the family's spacing moved by 1 to 6 % either way (farther
//! where no copy finds a place so near) in this very record, where skirts, swings and everything else that no model
//! foresees raise both alike; beyond the highest of them the tail is exponential with the slope of their upper half,
//! and the probability so found, times the families of the library, must be below 1 %; and it is three times the
//! highest (set on generated run-ups, where weaker ones were false). *Held out* (`holdout_test`): the part not used
//! must gain. A family that stands out of every copy, but not so far, may be adopted last and must then pass this whole
//! gate on the held-out turns as well: to be the highest of 49 by chance and to pass there are unlikely together.
//! Limit: 48 surrogates say nothing themselves about one in a hundred; the tail's form is an assumption.

use super::candidate::{Candidate, Field, Kind, Score, WIDEST_MOVE, score};
use serde::Serialize;

/// Least logarithm of the Bayes factor after the choice.
const MIN_LN_BAYES: f64 = 5.0;
/// The same of one line alone on turns on which nothing was chosen, which only have to agree.
const MIN_HELD_OUT_LN_BAYES: f64 = 1.0;
/// Surrogates.
pub const COPIES: usize = 48;
/// Times the best copy's score: where a background is no noise but swings and other lines, all scores grow with its
/// power, and only their ratio means anything.
const SCORE_RATIO: f64 = 3.0;
/// Copies that must have found a place.
pub const FEWEST_COPIES: usize = 40;
/// Range of their displacement, share of the spacing.
const COPY_SHIFT_SHARES: (f64, f64) = (0.01, WIDEST_MOVE);
/// Families of the library: trials of the whole search.
pub const FAMILIES: f64 = 15.0;
/// Largest probability of a false family in the search.
pub const FALSE_ALARM: f64 = 0.01;

/// Least probability stated; smaller ones are this.
pub const LEAST_CHANCE: f64 = 1e-300;

/// What the surrogates say.
#[derive(Debug, Clone, Serialize)]
pub struct Surrogates {
    /// Copies scored.
    pub copies: usize,
    /// Copies that score as high.
    pub as_high: usize,
    /// Highest of them.
    pub highest: f64,
    /// Their median.
    pub median: f64,
    /// Mean excess of the upper half over it.
    pub slope: f64,
    /// Probability of such a score by chance, times the families of the library.
    pub false_alarm: f64,
}

impl Surrogates {
    /// From the scores of surrogates and that of the family itself.
    pub fn of(mut copies: Vec<f64>, own: f64) -> Self {
        copies.retain(|score| score.is_finite());
        copies.sort_by(f64::total_cmp);
        let median = copies.get(copies.len() / 2).copied().unwrap_or(0.0);
        let upper = &copies[copies.len() / 2..];
        let slope = (upper.iter().map(|s| s - median).sum::<f64>() / upper.len().max(1) as f64).max(1.0);
        let mut result = Self {
            copies: copies.len(),
            as_high: copies.iter().filter(|s| **s >= own).count(),
            highest: copies.last().copied().unwrap_or(f64::NEG_INFINITY),
            median,
            slope,
            false_alarm: 1.0,
        };
        result.false_alarm = result.chance(own);
        result
    }

    fn chance(&self, own: f64) -> f64 {
        let tail = 0.5 * (-(own - self.median) / self.slope).exp();
        let counted = self.as_high as f64 / self.copies.max(1) as f64;
        (FAMILIES * tail.max(counted)).clamp(LEAST_CHANCE, 1.0)
    }

    /// Least score that passes this condition.
    pub fn needed(&self) -> f64 {
        (SCORE_RATIO * self.highest).max(self.median + self.slope * (0.5 * FAMILIES / FALSE_ALARM).ln())
    }
}

/// The gate's answer.
#[derive(Debug, Clone)]
pub struct Verdict {
    /// Score of the family itself.
    pub score: Score,
    /// The same less the logarithm of the alternatives.
    pub ln_bayes: f64,
    /// What the surrogates say.
    pub surrogates: Surrogates,
    /// Why it is refused.
    pub refused: Option<String>,
    /// It stands out of every surrogate, and the highest comes too near it, or it is one line alone that says too
    /// little: the held-out turns decide (`second_pass::search_marginal`).
    pub is_close: bool,
}

impl Verdict {
    /// Lets a family pass that is close, where other turns alone do; the chance that both are false is that of the two.
    pub fn passed_by(&mut self, alone: &Self) {
        if self.is_close && alone.refused.is_none() {
            self.refused = None;
            let both = self.surrogates.false_alarm * alone.surrogates.false_alarm;
            self.surrogates.false_alarm = both.max(LEAST_CHANCE);
        }
    }
}

/// Judges a candidate on turns on which nothing was chosen: it is the one alternative there.
pub fn judge_alone(candidate: &Candidate, field: &Field) -> Verdict {
    judge(&Candidate { alternatives: 1.0, ..candidate.clone() }, field)
}

/// Judges one line alone, of which the fitted turns say enough for a family, on turns on which nothing was chosen: it
/// has to agree there and to be the highest of all its copies. How far copies fall off cannot be asked of a line that
/// short turns show faintly.
pub fn agrees_alone(candidate: &Candidate, field: &Field) -> Verdict {
    let mut verdict = judge_alone(candidate, field);
    let Surrogates { copies, as_high, .. } = verdict.surrogates;
    if verdict.ln_bayes > MIN_HELD_OUT_LN_BAYES && copies >= FEWEST_COPIES && as_high == 0 {
        verdict.refused = None;
    }
    verdict
}

/// Displacements of the copies: both ways, 1 to 6 % of the spacing.
pub fn displacements() -> impl Iterator<Item = f64> {
    (0..COPIES).map(displacement)
}

fn displacement(i: usize) -> f64 {
    let share =
        COPY_SHIFT_SHARES.0 + (COPY_SHIFT_SHARES.1 - COPY_SHIFT_SHARES.0) * (i / 2) as f64 / (COPIES / 2 - 1) as f64;
    if i.is_multiple_of(2) { share } else { -share }
}

/// How often as far copies may be moved where few of the nearest find a place: of a line at a frequency, which stands
/// between the frequencies that mesh lines sweep, and of an order of neither shaft, where the shafts' own orders are
/// dense. (One whole order of a shaft stays near: beside another shaft's line it may be that line's skirt, which only
/// the nearest copies show.)
const FAR_COPY_DISTANCE_FACTOR: usize = 6;

/// Scores of the copies of a candidate that find a place.
pub fn copies(candidate: &Candidate, field: &Field) -> Vec<f64> {
    let of = |moved: f64| score(candidate, field, moved).ln_bayes;
    let farther =
        if candidate.kind == Kind::FixedFrequency || candidate.is_base() { FAR_COPY_DISTANCE_FACTOR } else { 1 };
    (0..farther * COPIES).map(displacement).map(of).filter(|score| score.is_finite()).take(COPIES).collect()
}

/// Least score of a candidate with so many alternatives.
pub fn needed(surrogates: &Surrogates, alternatives: f64) -> f64 {
    surrogates.needed().max(MIN_LN_BAYES + alternatives.max(1.0).ln())
}

/// Judges a candidate on the fitted part.
pub fn judge(candidate: &Candidate, field: &Field) -> Verdict {
    let own = score(candidate, field, 0.0);
    let surrogates = Surrogates::of(copies(candidate, field), own.ln_bayes);
    let ln_bayes = own.ln_bayes - candidate.alternatives.max(1.0).ln();
    let refused = if ln_bayes <= MIN_LN_BAYES {
        Some(format!(
            "evidence {ln_bayes:.1} nats of {MIN_LN_BAYES:.0} after {:.0} alternatives",
            candidate.alternatives
        ))
    } else if surrogates.copies < FEWEST_COPIES {
        Some(format!("only {} surrogates find a place to compare with", surrogates.copies))
    } else if surrogates.as_high > 0 {
        Some(format!("{} of {} surrogates are as strong", surrogates.as_high, surrogates.copies))
    } else if own.ln_bayes < SCORE_RATIO * surrogates.highest {
        let (own, highest) = (own.ln_bayes, surrogates.highest);
        Some(format!(
            "{own:.0} nats (no alternative counted) are not {SCORE_RATIO:.0} times the best surrogate's {highest:.0}"
        ))
    } else if surrogates.false_alarm > FALSE_ALARM {
        Some(format!("surrogates come near it: false-alarm rate {:.1e}", surrogates.false_alarm))
    } else {
        None
    };
    let is_highest = ln_bayes > MIN_LN_BAYES && surrogates.copies >= FEWEST_COPIES && surrogates.as_high == 0;
    let is_close = is_highest && refused.is_some();
    Verdict { score: own, ln_bayes, surrogates, refused, is_close }
}
