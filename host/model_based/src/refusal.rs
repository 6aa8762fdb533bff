//! Why the gate refused an explanation, as data and in words. Refusals are made by the gate alone
//! ([`accept`](super::accept)).

use super::candidate::Candidate;
use super::probability::Probability;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt;

/// Why a term is not adopted, or not kept.
#[derive(Debug, Clone, PartialEq)]
pub enum Refusal {
    /// Its score is too low: what it is, and the least.
    Unpaid([f64; 2]),
    /// Chance may give as much.
    Chance(Probability),
    /// The selection runs want other values: share of the gain that these add.
    OtherValues(f64),
    /// It does not predict the selection runs: gain there.
    NotPredicted(f64),
    /// Its gain as a share of the strongest term's is within that one's form error.
    FormError(f64),
    /// A swing of the shaft that the tachometer would have seen.
    Tachometer,
    /// Its strength would be negative, which it cannot.
    Negative,
    /// Another explanation was adopted in its place.
    Outranked(String),
    /// Next to a newer term it no longer pays.
    Superseded(f64),
    /// It does not lower the error of the held-out runs: chi-square without and with it.
    HeldOut([f64; 2]),
    /// It leaves this share of the power at its own lines.
    LeavesItsLines(f64),
    /// It is a line of impacts at this order.
    LineOfImpacts(f64),
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unpaid([score, least]) => write!(f, "does not pay for its unknowns: score {score:.1} of {least}"),
            Self::Chance(p) => write!(f, "chance gives as much with probability {p}"),
            Self::OtherValues(share) => {
                write!(f, "the selection runs want other values, which gain {:.0} % more", 100.0 * share)
            }
            Self::NotPredicted(gain) => write!(f, "does not predict the selection runs: gain {gain:.1}"),
            Self::FormError(share) => {
                write!(f, "gains {:.2} % of what the strongest does, within that one's form error", 100.0 * share)
            }
            Self::Tachometer => write!(f, "the tachometer would have seen such a swing"),
            Self::Negative => write!(f, "its strength would be negative"),
            Self::Outranked(name) => write!(f, "{name} explains more"),
            Self::Superseded(score) => write!(f, "no longer pays next to the other terms: score {score:.1}"),
            Self::HeldOut([without, with]) => {
                write!(
                    f,
                    "does not lower the error of the held-out runs: chi-square {without:.0} without, {with:.0} with it"
                )
            }
            Self::LeavesItsLines(share) => write!(f, "leaves {:.0} % of the power at its own lines", 100.0 * share),
            Self::LineOfImpacts(order) => write!(f, "is a line of impacts at order {order:.4}"),
        }
    }
}

/// An explanation considered and refused.
#[derive(Debug, Clone, Serialize)]
pub struct Refused {
    /// Name or plain description.
    pub name: String,
    /// Its best score.
    pub score: f64,
    /// Why not.
    pub reason: String,
}

/// Best score and reason by name.
#[derive(Debug, Clone, Default)]
pub struct Refusals(BTreeMap<String, (f64, Refusal)>);

impl Refusals {
    /// Notes a refusal; of several of one name the one with the best score stays.
    pub fn note(&mut self, name: &str, score: f64, refusal: Refusal) {
        if self.0.get(name).is_none_or(|(best, _)| *best < score) {
            self.0.insert(name.into(), (score, refusal));
        }
    }

    /// Takes over what others noted.
    pub fn extend(&mut self, others: Self) {
        others.0.into_iter().for_each(|(name, (score, why))| self.note(&name, score, why));
    }

    /// Notes why a term that had been adopted went again, whatever its score had been.
    pub fn dropped(&mut self, name: &str, refusal: Refusal) {
        let score = self.0.get(name).map_or(0.0, |(score, _)| *score);
        self.0.insert(name.into(), (score, refusal));
    }

    /// All but those adopted in the end.
    pub fn list(&self, adopted: &[Candidate]) -> Vec<Refused> {
        let not_adopted = self.0.iter().filter(|(name, _)| adopted.iter().all(|t| t.name != **name));
        not_adopted
            .map(|(name, (score, why))| Refused { name: name.clone(), score: *score, reason: why.to_string() })
            .collect()
    }
}
