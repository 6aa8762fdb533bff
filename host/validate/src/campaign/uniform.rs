//! Whether the records' own probabilities are uniform where nothing is hidden: the Kolmogorov-Smirnov test on the
//! grid of a bootstrap.
//!
//! Probabilities by `N` bootstrap records stand at `1 / (N + 1), ..., 1`, where the test's usual probability errs on
//! the safe side. The distance is therefore compared with those of drawings from the grid itself. Source: Conover, A
//! Kolmogorov goodness-of-fit test for discontinuous distributions, JASA 67 (1972).

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::Serialize;

/// Drawings that the distance is compared with.
const DRAWINGS: usize = 10_000;
/// Their seed.
const SEED: u64 = 1;

/// The test's figures.
#[derive(Debug, Clone, Serialize)]
pub struct Uniform {
    /// Records whose own probability was asked.
    pub records: usize,
    /// Bootstrap records of each.
    pub bootstrap: usize,
    /// Share of them at each probability, from the smallest.
    pub shares: Vec<f64>,
    /// Largest distance between the distributions.
    pub distance: f64,
    /// Probability of at least that distance where the probabilities are uniform.
    pub chance: f64,
}

impl Uniform {
    /// Of counts at least as high, of `bootstrap` each; none where there are no records.
    pub fn of(at_least: &[usize], bootstrap: usize) -> Option<Self> {
        if at_least.is_empty() || bootstrap == 0 {
            return None;
        }
        let cells = bootstrap + 1;
        let mut counts = vec![0; cells];
        at_least.iter().for_each(|k| counts[(*k).min(bootstrap)] += 1);
        let all = at_least.len();
        let own = distance(&counts, all);
        let mut random = ChaCha8Rng::seed_from_u64(SEED);
        let as_far = (0..DRAWINGS).filter(|_| {
            let mut counts = vec![0; cells];
            (0..all).for_each(|_| counts[random.random_range(0..cells)] += 1);
            distance(&counts, all) >= own - 1e-12
        });
        let chance = (as_far.count() + 1) as f64 / (DRAWINGS + 1) as f64;
        let shares = counts.iter().map(|n| *n as f64 / all as f64).collect();
        Some(Self { records: all, bootstrap, shares, distance: own, chance })
    }
}

/// Largest distance of the counts' distribution from the uniform one.
fn distance(counts: &[usize], all: usize) -> f64 {
    let cells = counts.len() as f64;
    let below = counts.iter().scan(0, |sum, n| {
        *sum += n;
        Some(*sum as f64 / all as f64)
    });
    below.enumerate().map(|(i, share)| (share - (i + 1) as f64 / cells).abs()).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kolmogorov_smirnov_on_a_grid_tells_uniform_probabilities_from_small_ones() {
        let even: Vec<usize> = (0..100).map(|i| i % 10).collect();
        let even = Uniform::of(&even, 9).unwrap();
        assert!(even.distance < 1e-12 && even.chance > 0.99, "{even:?}");
        let low: Vec<usize> = (0..100).map(|i| i % 10 / 2).collect();
        let low = Uniform::of(&low, 9).unwrap();
        assert!((low.distance - 0.5).abs() < 1e-12 && low.chance < 1e-3, "{low:?}");
    }

    /// One of twenty uniform samples falls below 5 %, which a continuous test's probability does less often on a grid.
    #[test]
    fn kolmogorov_smirnov_on_a_grid_rejects_uniform_probabilities_as_often_as_it_says() {
        let mut random = ChaCha8Rng::seed_from_u64(2);
        let rejected = (0..200).filter(|_| {
            let drawn: Vec<usize> = (0..40).map(|_| random.random_range(0..10)).collect();
            Uniform::of(&drawn, 9).is_some_and(|u| u.chance <= 0.05)
        });
        let rejected = rejected.count();
        assert!((3..=18).contains(&rejected), "{rejected} of 200");
    }
}
