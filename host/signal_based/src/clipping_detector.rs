//! Samples that stand at a limit: how many of them each extreme of a channel has.
//!
//! A signal that is not limited has one or two samples at its extreme, and more and more beside it. One that is has
//! neighbours of one value there, or, where its peaks are one sample wide, a pile of single ones with hardly any
//! before it. A signal of few codes has a pile at every code: the value next to the extreme counts in any case.
//! Limit: what is cut off so seldom that fewer stand there is not seen.

/// Pairs of neighbours, or samples of a pile, at an extreme from which a channel is limited.
pub const MIN_PILE_COUNT: usize = 8;
/// Width of the range before an extreme that a pile leaves nearly empty, share of the range.
pub const EMPTY_MARGIN_SHARE: f64 = 2e-3;
/// Times as many samples that the pile has.
pub const TIMES: usize = 3;

/// Samples that stand at a limit, at both extremes of a channel: pairs of neighbours that are alike there, or those
/// of a pile.
pub fn at_limit<T: PartialOrd + Copy + Into<f64>>(samples: &[T]) -> usize {
    let Some(&first) = samples.first() else { return 0 };
    let (mut low, mut high) = (first, first);
    for &x in samples {
        (low, high) = (if x < low { x } else { low }, if x > high { x } else { high });
    }
    let before = EMPTY_MARGIN_SHARE * (high.into() - low.into());
    let of_end = |end: T| {
        let pairs = samples.windows(2).filter(|w| w[0] == w[1] && w[0] == end).count();
        let at = samples.iter().filter(|x| **x == end).count();
        let from_end = |x: &T| ((*x).into() - end.into()).abs();
        let others = || samples.iter().filter(|x| **x != end);
        let next = others().map(from_end).fold(f64::INFINITY, f64::min);
        let beside = others().filter(|x| from_end(x) <= before.max(next)).count();
        if at >= MIN_PILE_COUNT && at > TIMES * beside { pairs.max(at) } else { pairs }
    };
    if low < high { of_end(low) + of_end(high) } else { 0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sine(limit: f64) -> Vec<f64> {
        // Peaks of unequal height, as wide as a sample.
        let x = |i: usize| (1.0 + 0.2 * (0.37 * i as f64).sin()) * if i.is_multiple_of(5) { 1.0 } else { 0.3 };
        (0..2000).map(|i| x(i).min(limit)).collect()
    }

    /// About normal, unit variance.
    fn noise(i: i32) -> f64 {
        let mut state = i as u64 + 1;
        let mut uniform = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        uniform();
        (0..12).map(|_| uniform()).sum::<f64>() - 6.0
    }

    #[test]
    fn theory_a_limit_is_seen_by_pairs_and_by_piles_and_nothing_else_is() {
        assert_eq!(at_limit::<f64>(&[]), 0);
        assert!(at_limit(&sine(10.0)) < MIN_PILE_COUNT);
        assert!(at_limit(&sine(1.1)) >= 100);
        let few: Vec<f64> = (0..20_000).map(|i: i32| (4.0 * noise(i)).round()).collect();
        assert!(at_limit(&few) < MIN_PILE_COUNT, "noise of few codes: {}", at_limit(&few));
        let wide: Vec<f64> = (0..2000).map(|i| (0.01 * f64::from(i)).sin().min(0.9)).collect();
        assert!(at_limit(&wide) > 100);
        let codes: Vec<i16> = (0..20_000).map(|i| (3000.0 * (0.013 * f64::from(i)).sin()) as i16).collect();
        // A clean sine of many turns has pairs at its highest code: it is limited as far as anyone can see.
        assert!(at_limit(&codes) >= MIN_PILE_COUNT);
        let swinging =
            |i: i32| (3000.0 * (1.0 + 0.1 * (1e-3 * f64::from(i)).sin()) * (0.7 * f64::from(i)).sin()) as i16;
        assert!(at_limit(&(0..20_000).map(swinging).collect::<Vec<i16>>()) < MIN_PILE_COUNT);
    }
}
