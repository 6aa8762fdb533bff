//! What a bootstrap says of a record ([`bootstrap`](super::bootstrap)): its own probability of a false alarm.

use serde::Serialize;

/// What the bootstrap says.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct NullRecords {
    /// Records without any effect.
    pub records: usize,
    /// Those whose best score was at least this record's.
    pub at_least: usize,
    /// Best score of any explanation of this record in the first round of the search, nats.
    pub score: f64,
    /// Probability that a record without any effect shows as much.
    pub probability: f64,
}

impl NullRecords {
    /// Of the record's best score and those of records without any effect.
    pub fn of(score: f64, others: &[f64]) -> Self {
        let at_least = others.iter().filter(|other| **other >= score).count();
        let probability = (at_least + 1) as f64 / (others.len() + 1) as f64;
        Self { records: others.len(), at_least, score, probability }
    }

    /// In a line.
    pub fn in_words(&self) -> String {
        let Self { records, at_least, score, probability } = self;
        format!(
            "bootstrap: {at_least} of {records} records without any effect reach this one's best score of {score:.1} \
             nats; probability of a false alarm {probability:.3}\n"
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bootstrap_counts_the_record_itself_among_those_without_effect() {
        assert_eq!(NullRecords::of(5.0, &[1.0, 2.0, 3.0]).probability, 0.25);
        assert_eq!(NullRecords::of(2.0, &[1.0, 2.0, 3.0]).at_least, 2);
        assert_eq!(NullRecords::of(0.0, &[1.0, 2.0, 3.0]).probability, 1.0);
    }
}
