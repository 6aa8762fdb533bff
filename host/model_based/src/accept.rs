//! The gate: the only place that decides whether a term is adopted or kept, and whether it keeps a name.
//!
//! What is adopted is a list that nobody else can lengthen or shorten ([`Adopted`]); every refusal is data
//! ([`Refusal`]) and goes into the outcome. The thresholds are private to this file. Unless said otherwise they were
//! set on generated records: on records with nothing hidden so that none is adopted (`meshband prove --null`), then
//! as low as that allows (`--power`). Detectors (lines, combs, impacts) propose and adopt nothing.
//! `host/tests/architecture.rs` holds that refusals are made nowhere else.

use super::candidate::{Candidate, Claim};
use super::probability::Probability;
use super::refusal::{Refusal, Refusals};

/// Penalty per real unknown, in units of chi-square: near the logarithm of the number of values of a record (BIC: 10
/// at 22 000).
const PER_UNKNOWN: f64 = 10.0;
/// Least score of an adopted effect: with the penalties above no record of 200 with nothing hidden reached it.
const LEAST_SCORE: f64 = 15.0;
/// Largest probability of a term's gain by chance, after correction for the search.
const LARGEST_P: f64 = 1e-3;
/// Least gain on the selection runs with values from the fit runs.
const LEAST_SELECT_GAIN: f64 = 6.0;
/// Least share of its predicted power that a term must explain on the selection runs.
const LEAST_SELECT_SHARE: f64 = 0.4;
/// Largest share of its gain that a term may still gain with other values on the selection runs.
const MAX_APART_GAIN_SHARE: f64 = 0.35;
/// Share of the largest gain so far that a further term must gain next to a plain description: of an effect that the
/// library lacks this leaves more, which must not get the name of another.
const LEAST_SHARE: f64 = 0.01;
/// Score by which a plain description must beat a name that passes (twice the logarithm of a likelihood ratio of 10
/// beyond the penalties).
const NAME_MARGIN: f64 = 4.6;
/// Share of its gain by which a description with more unknowns must beat a name: the form error of a first-order
/// template.
const TABLE_MARGIN: f64 = 0.03;
/// A term that leaves more of the power at its own lines than this explains nothing.
const MAX_LINE_REMNANT_SHARE: f64 = 0.5;
/// Largest power left at its own lines, beyond noise, of a named effect.
const MAX_NAMED_REMNANT_SHARE: f64 = 0.04;
/// Largest exponent of speed or torque, beyond its 95 % half width, by which a named effect may depart from its law.
const LARGEST_DEPARTURE: f64 = 0.12;
/// Share of a name's gain that a freer description of the same family may add: form error of templates and declared
/// parameters.
const FORM_SHARE: f64 = 0.01;
/// Half the difference of scores, nats, within which another description is not told apart from a name: beyond the
/// penalties, the record is then 11 times as likely with the name.
const MIN_LEAD_NATS: f64 = 2.4;
/// Gain from which the shape of a deviation that all teeth share can be told from another shape, next to declared
/// parameters that move the same lines.
const LEAST_MESH_GAIN: f64 = 400.0;
/// Power over local noise from which much is there, or left: records with nothing hidden leave 0.98 to 1.03 times
/// their noise.
const MAX_NOISE_POWER_RATIO: f64 = 1.3;
/// Power left as a share of what the declaration leaves from which it pays to search again.
const MAX_REST_SHARE: f64 = 0.1;
/// Residual power over noise from which a remainder is said although nothing fits: far outside the 0.98 to 1.03 of
/// nothing hidden.
const LEAST_REMAINDER: f64 = 1.15;
/// Largest probability of impacts by chance, on the runs to fit and on those to select.
const LARGEST_P_IMPACTS: [f64; 2] = [1e-4, 1e-3];
/// Share by which the order of impacts wanders.
const SLIP: f64 = 0.005;
/// Least fall of chi-square by a moving speed: on the held-out runs, on all.
const MIN_CHI_SQUARE_FALLS: [f64; 2] = [30.0, 60.0];

/// What is known of a candidate when it is judged.
#[derive(Debug, Clone, Copy)]
pub struct Figures {
    /// Penalised gain ([`score`]).
    pub score: f64,
    /// Gain over fit and selection runs.
    pub gain: f64,
    /// Gain on the selection runs with values from the fit runs.
    pub select_gain: f64,
    /// Gain there if the law holds.
    pub select_promise: f64,
    /// What values of its own for the selection runs would gain on top.
    pub apart_gain: f64,
    /// Number of templates.
    pub templates: usize,
    /// Whether every run has a phase of its own.
    pub phase_free: bool,
    /// Probability of the gain by chance, after correction for the search.
    pub chance: Probability,
}

/// Terms adopted so far, in the order of their adoption, and what was refused. Only this file lengthens or shortens
/// the list.
#[derive(Debug, Clone, Default)]
pub struct Adopted {
    terms: Vec<Candidate>,
    /// Largest gain of a term adopted.
    largest_gain: f64,
    /// What was refused.
    pub refusals: Refusals,
}

impl std::ops::Deref for Adopted {
    type Target = [Candidate];

    fn deref(&self) -> &[Candidate] {
        &self.terms
    }
}

impl Adopted {
    /// Whether a candidate with these figures would be adopted next to the terms there are.
    ///
    /// # Errors
    /// Why not.
    pub fn weigh(&self, figures: &Figures) -> Result<(), Refusal> {
        let f = figures;
        let further = !self.terms.is_empty();
        significant(f)?;
        let unknowns = f.templates as f64;
        let chance_apart = unknowns + 4.0 * (2.0 * unknowns).sqrt();
        if !f.phase_free && f.apart_gain >= MAX_APART_GAIN_SHARE * f.gain + chance_apart {
            return Err(Refusal::OtherValues(f.apart_gain / f.gain));
        }
        // A further term must predict the selection runs as well: what the others' templates leave would pass for it.
        let predicts =
            f.select_gain > LEAST_SELECT_GAIN && f.select_gain > LEAST_SELECT_SHARE * f.select_promise.min(f.gain);
        if (f.phase_free || further) && !predicts {
            return Err(Refusal::NotPredicted(f.select_gain));
        }
        let plain = self.terms.iter().any(|t| t.claim == Claim::Generic);
        if plain && f.gain <= LEAST_SHARE * self.largest_gain {
            return Err(Refusal::FormError(f.gain / self.largest_gain));
        }
        Ok(())
    }

    /// Adopts a candidate.
    ///
    /// # Errors
    /// As [`Adopted::weigh`].
    pub fn adopt(&mut self, candidate: Candidate, figures: &Figures) -> Result<(), Refusal> {
        self.weigh(figures)?;
        self.largest_gain = self.largest_gain.max(figures.gain);
        self.terms.push(candidate);
        Ok(())
    }

    /// The terms' templates, to be replaced by better ones of the same terms.
    pub fn refine(&mut self) -> &mut [Candidate] {
        &mut self.terms
    }

    /// Keeps what still pays next to the newest term; `score` gives the score of a term next to the others.
    pub fn supersede(&mut self, score: impl Fn(&Candidate, &[&Candidate]) -> f64) {
        let mut i = 0;
        while self.terms.len() > 1 && i + 1 < self.terms.len() {
            let score = score(&self.terms[i], &self.others(i));
            if score < LEAST_SCORE { self.remove(i, Refusal::Superseded(score)) } else { i += 1 }
        }
    }

    /// The held-out runs' veto: keeps terms that lower their error; `error` gives it for a list of terms.
    pub fn confirm(&mut self, error: impl Fn(&[&Candidate]) -> f64) {
        let mut i = 0;
        while i < self.terms.len() {
            let all: Vec<&Candidate> = self.terms.iter().collect();
            let [without, with] = [error(&self.others(i)), error(&all)];
            if confirmed([without, with]) { i += 1 } else { self.remove(i, Refusal::HeldOut([without, with])) }
        }
    }

    /// Keeps terms that still stand with the final weights: by what each leaves at its own lines and the chance of
    /// its gain. Says which stay.
    pub fn stand(&mut self, figures: &[(f64, Option<Probability>)]) -> Vec<bool> {
        let verdict = |&(left, chance): &(f64, Option<Probability>)| match chance {
            _ if left >= MAX_LINE_REMNANT_SHARE => Some(Refusal::LeavesItsLines(left)),
            Some(p) if p.value() < LARGEST_P => None,
            chance => Some(Refusal::Chance(chance.unwrap_or(Probability::of(1.0)))),
        };
        self.keep(&figures.iter().map(verdict).collect::<Vec<_>>())
    }

    /// Drops terms that are single lines of named impacts at `order`: they have one at every multiple of it. Says
    /// which stay.
    pub fn give_to_impacts(&mut self, order: f64, slips: impl Fn(&Candidate) -> bool) -> Vec<bool> {
        let is_line = |t: &Candidate| {
            let near = |o: f64| (o - (o / order).round() * order).abs() < SLIP * o;
            slips(t) && t.order.is_some_and(near)
        };
        let verdicts: Vec<Option<Refusal>> =
            self.terms.iter().map(|t| is_line(t).then_some(Refusal::LineOfImpacts(order))).collect();
        self.keep(&verdicts)
    }

    fn keep(&mut self, verdicts: &[Option<Refusal>]) -> Vec<bool> {
        for (i, verdict) in verdicts.iter().enumerate().rev() {
            if let Some(refusal) = verdict {
                self.remove(i, refusal.clone());
            }
        }
        verdicts.iter().map(Option::is_none).collect()
    }

    fn remove(&mut self, i: usize, refusal: Refusal) {
        let gone = self.terms.remove(i);
        self.refusals.dropped(&gone.name, refusal);
    }

    fn others(&self, i: usize) -> Vec<&Candidate> {
        self.terms.iter().enumerate().filter(|(j, _)| *j != i).map(|(_, c)| c).collect()
    }
}

/// Penalised gain of a term with so many unknowns; `nats`: logarithm of the alternatives searched.
pub fn score(gain: f64, unknowns: f64, nats: f64) -> f64 {
    gain - PER_UNKNOWN * unknowns - 2.0 * nats
}

/// Whether something is there, whatever law it follows.
///
/// # Errors
/// Why not.
pub fn significant(figures: &Figures) -> Result<(), Refusal> {
    match figures {
        f if f.score.is_nan() || f.score <= LEAST_SCORE => Err(Refusal::Unpaid([f.score, LEAST_SCORE])),
        f if f.chance.value() >= LARGEST_P => Err(Refusal::Chance(f.chance)),
        _ => Ok(()),
    }
}

/// Whether a swing of the shaft that a candidate claims is refuted by the tachometer, in more than half of `runs`.
///
/// # Errors
/// The refusal.
pub fn seen_by_tachometer(refuting: usize, runs: usize) -> Result<(), Refusal> {
    if 2 * refuting > runs { Err(Refusal::Tachometer) } else { Ok(()) }
}

/// Whether a candidate's values make physical sense.
///
/// # Errors
/// The refusal.
pub fn makes_sense(possible: bool) -> Result<(), Refusal> {
    if possible { Ok(()) } else { Err(Refusal::Negative) }
}

/// Whether the held-out runs confirm a term, by their error without it and with it.
pub fn confirmed([without, with]: [f64; 2]) -> bool {
    without > with
}

/// What is said of a candidate in whose place `winner` was adopted.
pub fn outranked(winner: &str) -> Refusal {
    Refusal::Outranked(winner.into())
}

/// Whether a name comes near enough to the best explanation `top` to be taken in its place.
pub fn name_is_near(top: &Figures, name: &Figures) -> bool {
    let freer = top.templates > name.templates;
    name.score > top.score - if freer { NAME_MARGIN.max(TABLE_MARGIN * top.gain) } else { NAME_MARGIN }
}

/// What is known of an adopted term when its name is judged.
#[derive(Debug, Clone, Copy)]
pub struct NameFigures {
    /// Whether it claims a cause at all.
    pub claims_name: bool,
    /// Share of the power left at its own lines beyond noise.
    pub left: f64,
    /// Departures of the exponents of speed and torque from its law, with 95 % half widths.
    pub departures: Option<[[f64; 2]; 2]>,
    /// Whether its values are physically possible.
    pub possible: bool,
    /// What a freer description of the same family would gain on top.
    pub freer_gain: f64,
    /// Its gain.
    pub gain: f64,
    /// Whether it shares its lines with the mesh itself.
    pub at_mesh_orders: bool,
    /// Whether something else could not be told from it.
    pub has_rivals: bool,
}

/// How much of a name an adopted term keeps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Naming {
    /// Its own.
    Named,
    /// Its own or another.
    Ambiguous,
    /// A plain description.
    Generic,
}

/// The name that a term keeps.
pub fn naming(f: &NameFigures) -> Naming {
    let steady = f.departures.is_none_or(|e| e.iter().all(|[p, half]| p.abs() < LARGEST_DEPARTURE + half));
    let lawful = f.left <= MAX_NAMED_REMNANT_SHARE && steady && f.possible && f.freer_gain <= FORM_SHARE * f.gain;
    if !f.claims_name || !lawful {
        Naming::Generic
    } else if f.has_rivals || (f.at_mesh_orders && f.gain < LEAST_MESH_GAIN) {
        Naming::Ambiguous
    } else {
        Naming::Named
    }
}

/// Whether an explanation whose penalised log likelihood is `below` (nats) a name's cannot be told from it.
pub fn is_rival(below: f64) -> bool {
    below < MIN_LEAD_NATS
}

/// Whether a residual's power is much beyond its noise.
pub fn much_is_there(power: f64, noise: f64) -> bool {
    power > MAX_NOISE_POWER_RATIO * noise
}

/// Whether so much is left of what the declaration leaves, `at_first`, that it pays to search again.
pub fn search_again(power: f64, noise: f64, at_first: f64) -> bool {
    power > (MAX_NOISE_POWER_RATIO * noise).max(MAX_REST_SHARE * at_first)
}

/// Whether a remainder that nothing fits is to be said, by its power over the noise's.
pub fn remainder_is_there(over: f64) -> bool {
    over >= LEAST_REMAINDER
}

/// Whether impacts are there, by the chance of their lines on the runs to fit and on those to select.
pub fn impacts_are_there(fit: Probability, select: Probability) -> bool {
    fit.value() <= LARGEST_P_IMPACTS[0] && select.value() <= LARGEST_P_IMPACTS[1]
}

/// Whether a moving speed is there, by what it takes off chi-square on the held-out runs and on all.
pub fn speed_moves(held_out: f64, all: f64) -> bool {
    held_out >= MIN_CHI_SQUARE_FALLS[0] && all >= MIN_CHI_SQUARE_FALLS[1]
}
