//! What a caller may choose about the loop.

/// Options of the loop.
#[derive(Debug, Clone)]
pub struct Options {
    /// Seed of the split.
    pub seed: u64,
    /// Most effects looked for.
    pub most: usize,
    /// Progress on stderr.
    pub progress: bool,
    /// Whether to say what would have been found of every effect that was not.
    pub limits: bool,
    /// Records without any effect that the strongest explanation is compared with ([`bootstrap`](super::bootstrap)).
    pub null_records: usize,
    /// Library names withheld (for leave-one-out proof).
    pub withheld: Vec<String>,
}

impl Default for Options {
    fn default() -> Self {
        Self { seed: 1, most: 5, progress: false, limits: false, null_records: 0, withheld: Vec::new() }
    }
}
