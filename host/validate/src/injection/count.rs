//! How often an effect was found, named, or taken for another, by strength and background, and the strength at which
//! it is half.

use super::background::{Answer, Background};
use serde::Serialize;

/// Multiples of the printed limit that are injected.
pub const STRENGTHS: [f64; 5] = [0.4, 0.63, 1.0, 1.6, 2.5];

/// One strength of one effect.
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub struct Count {
    /// Times the printed limit.
    pub of_limit: f64,
    /// Positions tried.
    pub tried: usize,
    /// Adopted as the lines that they are.
    pub found: usize,
    /// And named as the effect that it is.
    pub named: usize,
    /// Something else adopted.
    pub wrong: usize,
}

impl Count {
    fn add(&mut self, answer: Answer) {
        self.tried += 1;
        self.found += usize::from(answer.found);
        self.named += usize::from(answer.named);
        self.wrong += usize::from(answer.wrong);
    }
}

/// An effect in one background.
#[derive(Debug, Clone, Serialize)]
pub struct Part {
    /// Record.
    pub record: String,
    /// Limits printed: found in half, in nine of ten.
    pub limits: [Option<f64>; 2],
    /// By strength.
    pub counts: Vec<Count>,
    #[serde(skip)]
    background: usize,
    #[serde(skip)]
    half: f64,
}

/// One effect.
#[derive(Debug, Clone, Serialize)]
pub struct Effect {
    /// Family, as the limits call it.
    pub family: String,
    /// What the strength is.
    pub unit: String,
    /// By strength, all backgrounds.
    pub counts: Vec<Count>,
    /// Strength found in half of the positions, times the printed limit; none where that was not reached or always
    /// exceeded.
    pub half_over_limit: Option<f64>,
    /// By background.
    pub parts: Vec<Part>,
}

fn nothing() -> Vec<Count> {
    STRENGTHS.iter().map(|&of_limit| Count { of_limit, ..Count::default() }).collect()
}

impl Effect {
    /// Every family with a limit in some background, with the backgrounds that can have it.
    pub(super) fn planned(backgrounds: &[Background], only: &[String]) -> Vec<Self> {
        let mut all: Vec<Self> = Vec::new();
        for (background, own) in backgrounds.iter().enumerate() {
            for (limit, half) in own.limits() {
                if !only.is_empty() && !only.iter().any(|part| limit.family.contains(part)) {
                    continue;
                }
                let limits = [limit.found_in_half, limit.found_in_90_percent];
                let part = Part { record: own.scene.title.clone(), limits, counts: nothing(), background, half };
                match all.iter_mut().find(|effect| effect.family == limit.family) {
                    Some(effect) => effect.parts.push(part),
                    None => all.push(Self {
                        family: limit.family.clone(),
                        unit: limit.unit.clone(),
                        counts: nothing(),
                        half_over_limit: None,
                        parts: vec![part],
                    }),
                }
            }
        }
        all
    }

    /// Whether a record can have it.
    pub(super) fn is_of(&self, record: &str) -> bool {
        self.parts.iter().any(|part| part.record == record)
    }

    /// Index of the background that a position is in: each in turn.
    pub(super) fn background(&self, position: usize) -> usize {
        self.parts[position % self.parts.len()].background
    }

    fn part(&self, background: usize) -> usize {
        self.parts.iter().position(|part| part.background == background).unwrap_or(0)
    }

    /// The limit printed in a background.
    pub(super) fn limit(&self, background: usize) -> f64 {
        self.parts[self.part(background)].half
    }

    /// Counts an answer at one of the strengths.
    pub(super) fn count(&mut self, background: usize, strength: usize, answer: Answer) {
        let part = self.part(background);
        self.parts[part].counts[strength].add(answer);
        self.counts[strength].add(answer);
    }

    /// Works out the strength found in half of the positions, between the two that it lies between.
    pub(super) fn conclude(&mut self) {
        self.half_over_limit = half(&self.counts);
    }
}

fn half(counts: &[Count]) -> Option<f64> {
    let share = |count: &Count| count.found as f64 / count.tried.max(1) as f64;
    let crossing = counts.windows(2).find(|w| share(&w[0]) < 0.5 && share(&w[1]) >= 0.5)?;
    let (low, high) = (share(&crossing[0]), share(&crossing[1]));
    let part = (0.5 - low) / (high - low);
    Some(crossing[0].of_limit * (crossing[1].of_limit / crossing[0].of_limit).powf(part))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn theory_half_is_between_the_strengths_about_it() {
        let counts = |found: [usize; 5]| -> Vec<Count> {
            nothing().into_iter().zip(found).map(|(c, found)| Count { tried: 20, found, ..c }).collect()
        };
        let at = |found| half(&counts(found));
        assert_eq!(at([0, 2, 10, 18, 20]), Some(1.0));
        let between = at([0, 5, 15, 20, 20]).expect("a crossing");
        assert!((between - 0.63_f64.sqrt()).abs() < 1e-12, "{between}");
        assert_eq!([at([0, 1, 2, 3, 4]), at([20, 20, 20, 20, 20])], [None, None]);
    }
}
