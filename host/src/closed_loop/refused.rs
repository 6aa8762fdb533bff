//! What was considered and refused, by name, with the gate's reason.

use super::accept::Refusal;
use super::candidate::Candidate;
use serde::Serialize;
use std::collections::BTreeMap;

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
