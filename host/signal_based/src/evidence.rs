//! Evidence of a family of lines: every free amplitude pays for itself.
//!
//! A place of a family is a line of unknown complex amplitude or no line. Power over floor there, `y`, is the mean of
//! `K` spectra: Gamma(K) about 1 without a line, about `1 + s` with one whose complex amplitude is normal with `s`
//! times the floor's variance. Prior, written down: `s` is log-uniform on
//! 0.3 to 3e5 (steps of a factor of 10^0.5); a share `q` of the family's places carries a line, `q` one of 1, 1/2,
//! 1/4, ... 1/64 with equal weight. Both are summed over, so the logarithm of the Bayes factor against "no line
//! anywhere" is exact for this prior (what Laplace's method would approximate): a place without a line costs, a
//! family of many places pays for all. Limit: places and channels are counted as independent, and the floor as known;
//! that is why a family must also stand out of its own shifted copies (`accept`).
//!
//! The same prior says how much of a fitted amplitude to believe ([`Shares::trust`]): the chance that there is a
//! line, times the share of the estimate that is line and not noise. Amplitudes shrunk by it are posterior means, so
//! lines of a true family that are noise themselves cost nothing on average.

/// Logarithms of the signal-to-noise ratios summed over: steps of half a decade.
const STEPS: usize = 13;
/// Lowest ratio.
const MIN_RATIO: f64 = 0.3;
/// Halvings of the share of places that carry a line.
const HALVINGS: i32 = 6;

/// Power over the floor at one place, mean of so many spectra.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    /// Power over the floor.
    pub ratio: f64,
    /// Spectra averaged.
    pub averages: f64,
}

impl Reading {
    /// Logarithm of the Bayes factor of a line here against none.
    pub fn ln_bayes(self) -> f64 {
        ln_sum(self.terms().into_iter()) - (STEPS as f64).ln()
    }

    fn terms(self) -> [f64; STEPS] {
        std::array::from_fn(|i| self.ln_likelihood_ratio(step(i)))
    }

    /// Share of an amplitude fitted to all averaged spectra together that is the line's, should there be one:
    /// posterior mean of `K s / (1 + K s)`, 0 to 1.
    pub fn line_share(self) -> f64 {
        let terms = self.terms();
        let all = ln_sum(terms.into_iter());
        let of = |(i, ln): (usize, &f64)| {
            let signal = self.averages * step(i);
            (ln - all).exp() * signal / (1.0 + signal)
        };
        terms.iter().enumerate().map(of).sum()
    }

    /// Logarithm of the likelihood ratio of another part's readings against no line, should there be one here: each
    /// of `others` is as likely to be its place; a spectrum there has `length` times the length of one here.
    pub fn ln_predictive(self, others: &[Self], length: f64) -> f64 {
        let terms = self.terms();
        let all = ln_sum(terms.into_iter());
        let of = |other: &Self| {
            let with = terms.iter().enumerate().map(|(i, ln)| ln - all + other.ln_likelihood_ratio(length * step(i)));
            ln_sum(with)
        };
        ln_sum(others.iter().map(of)) - (others.len() as f64).ln()
    }

    /// Of a line with so many times the floor's variance against none.
    fn ln_likelihood_ratio(self, signal: f64) -> f64 {
        self.averages * (self.ratio * signal / (1.0 + signal) - signal.ln_1p())
    }
}

/// Ratio of a step.
fn step(i: usize) -> f64 {
    MIN_RATIO * 10.0_f64.powf(0.5 * i as f64)
}

/// What a family's places say of the share of them that carry a line: posterior probability of each share.
#[derive(Debug, Clone)]
pub struct Shares([f64; HALVINGS as usize + 1]);

impl Shares {
    /// From the logarithms of the places' Bayes factors.
    pub fn of(places: &[f64]) -> Self {
        let ln: [f64; HALVINGS as usize + 1] = std::array::from_fn(|halvings| with_share(places, halvings as i32));
        let all = ln_sum(ln.into_iter());
        Self(ln.map(|ln| (ln - all).exp()))
    }

    /// Factor to the amplitude fitted at a place of the family that makes it the posterior mean, 0 to 1.
    pub fn trust(&self, reading: Reading) -> f64 {
        self.chance(reading.ln_bayes()) * reading.line_share()
    }

    /// Probability that a place whose Bayes factor has this logarithm carries a line.
    pub fn chance(&self, ln: f64) -> f64 {
        let chance = |halvings: usize| {
            let share = 0.5_f64.powi(halvings as i32);
            (share.ln() + ln - mixed(share, ln)).exp()
        };
        self.0.iter().enumerate().map(|(halvings, p)| p * chance(halvings)).sum::<f64>().min(1.0)
    }
}

/// Logarithm of a sum of exponentials.
pub fn ln_sum(terms: impl Iterator<Item = f64> + Clone) -> f64 {
    let highest = terms.clone().fold(f64::NEG_INFINITY, f64::max);
    if highest == f64::NEG_INFINITY { highest } else { highest + terms.map(|t| (t - highest).exp()).sum::<f64>().ln() }
}

/// Logarithm of the Bayes factor of a family from those of its places.
pub fn of_family(places: &[f64]) -> f64 {
    ln_sum((0..=HALVINGS).map(|halvings| with_share(places, halvings))) - f64::from(HALVINGS + 1).ln()
}

fn with_share(places: &[f64], halvings: i32) -> f64 {
    let share = 0.5_f64.powi(halvings);
    places.iter().map(|ln| mixed(share, *ln)).sum::<f64>()
}

/// Logarithm of `1 - share + share * exp(ln)`.
fn mixed(share: f64, ln: f64) -> f64 {
    if share >= 1.0 {
        return ln;
    }
    let (a, b) = ((1.0 - share).ln(), share.ln() + ln);
    a.max(b) + (-(a - b).abs()).exp().ln_1p()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;
    use rand_distr::{Distribution, Exp1, StandardNormal};

    #[test]
    fn theory_noise_hardly_ever_makes_a_family() {
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let mut draw = || Reading { ratio: Exp1.sample(&mut random), averages: 1.0 }.ln_bayes();
        // Its mean is one, so it exceeds exp(3) at most once in exp(3) draws.
        let count = 100_000;
        let high = (0..count).filter(|_| draw() > 3.0).count() as f64 / f64::from(count);
        assert!(high < (-3.0_f64).exp(), "{high}");
        let mut wrong = 0;
        for _ in 0..2000 {
            let places: Vec<f64> = (0..60).map(|_| draw()).collect();
            wrong += i32::from(of_family(&places) > 5.0);
        }
        // A Bayes factor of exp(5) by chance: less than exp(-5) of the families.
        assert!(wrong <= 16, "{wrong} of 2000");
    }

    #[test]
    fn theory_trusted_amplitudes_are_nearer_the_truth_than_fitted_ones_and_than_none() {
        let mut random = ChaCha8Rng::seed_from_u64(2);
        let mut error = [0.0; 3];
        for _ in 0..400 {
            // Five of forty places carry a line of twice the noise's standard deviation.
            let places: Vec<(f64, f64)> = (0..40)
                .map(|i| {
                    let line = if i % 8 == 0 { 2.0 } else { 0.0 };
                    let [re, im]: [f64; 2] = std::array::from_fn(|_| StandardNormal.sample(&mut random));
                    (line + re * 0.5_f64.sqrt(), im * 0.5_f64.sqrt())
                })
                .collect();
            let readings: Vec<Reading> =
                places.iter().map(|(re, im)| Reading { ratio: re * re + im * im, averages: 1.0 }).collect();
            let shares = Shares::of(&readings.iter().map(|r| r.ln_bayes()).collect::<Vec<_>>());
            for (i, ((re, im), reading)) in places.iter().zip(&readings).enumerate() {
                let line = if i % 8 == 0 { 2.0 } else { 0.0 };
                let trust = shares.trust(*reading);
                assert!((0.0..=1.0).contains(&trust), "{trust}");
                for (error, factor) in error.iter_mut().zip([0.0, 1.0, trust]) {
                    *error += (factor * re - line).powi(2) + (factor * im).powi(2);
                }
            }
        }
        let [none, fitted, trusted] = error;
        assert!(trusted < 0.9 * none && trusted < 0.5 * fitted, "{error:?}");
    }

    #[test]
    fn theory_what_is_foretold_is_exact_for_the_prior_and_refuses_chance() {
        // Over readings of the floor alone, which are exponential, the likelihood ratio has a mean of one, whatever
        // was read before.
        let before = Reading { ratio: 6.0, averages: 2.0 };
        let of = |ratio: f64| [ratio, 0.3, 2.0].map(|ratio| Reading { ratio, averages: 1.0 });
        let alone = |reading: Reading| before.ln_predictive(&[reading], 0.7);
        let step = 1e-2;
        let draw = |r: f64| (alone(of(r)[0]) - r).exp() * step;
        let mean = (0..100_000).map(|i| draw(step * (f64::from(i) + 0.5))).sum::<f64>();
        assert!((mean - 1.0).abs() < 1e-2, "{mean}");
        // Of several places that it may have each has its share.
        let shares = of(5.0).map(alone).iter().map(|ln| ln.exp()).sum::<f64>() / 3.0;
        assert!((before.ln_predictive(&of(5.0), 0.7).exp() / shares - 1.0).abs() < 1e-12);
        let read = |ratio| before.ln_predictive(&[Reading { ratio, averages: 1.0 }], 0.7);
        assert!(read(0.5) < -0.5 && read(5.0) > 1.0, "{} {}", read(0.5), read(5.0));
        // A place that is sure is no surer than that.
        let sure = [1e4, 2e4, 400.0];
        let shares = Shares::of(&sure);
        assert!(sure.iter().all(|ln| (0.99..=1.0).contains(&shares.chance(*ln))));
        // Both parts together say what the prior says of them as one.
        let together = Reading { ratio: 6.0, averages: 3.0 }.ln_bayes();
        let apart = before.ln_bayes() + before.ln_predictive(&[Reading { ratio: 6.0, averages: 1.0 }], 1.0);
        assert!((together - apart).abs() < 1e-9);
    }

    #[test]
    fn theory_a_line_of_known_strength_wins_and_many_empty_places_cost() {
        let strong = Reading { ratio: 40.0, averages: 1.0 }.ln_bayes();
        assert!((30.0..40.0).contains(&strong), "{strong}");
        let empty = Reading { ratio: 0.7, averages: 1.0 }.ln_bayes();
        let few = of_family(&[strong, strong]);
        let many = of_family(&[vec![strong, strong], vec![empty; 400]].concat());
        assert!(few > many + 5.0 && many > 20.0, "{few} {many}");
    }
}
