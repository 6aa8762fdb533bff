//! Probabilities by chance as logarithms: upper tails far beyond what a number of double precision can hold.
//!
//! `1 - cdf` is rounding from 1e-16 on and zero soon after; the survival function is right to 1e-300, and beyond it
//! the tail's continued fraction gives its logarithm. Source: Abramowitz, Stegun 6.5.31; statrs for what is not so
//! far out.

use serde::ser::{Serialize, SerializeStruct, Serializer};
use statrs::distribution::{ContinuousCDF, Gamma};
use statrs::function::gamma::ln_gamma;
use std::fmt;

/// Least probability that is given as a number; its logarithm goes on.
const MIN_PROBABILITY: f64 = 1e-300;

/// A probability, kept as its natural logarithm; never zero.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd)]
pub struct Probability {
    ln: f64,
}

impl Probability {
    /// Of a value between 0 (excluded) and 1.
    pub fn of(value: f64) -> Self {
        Self { ln: value.clamp(f64::MIN_POSITIVE, 1.0).ln() }
    }

    /// That a chi-square variable with this many degrees of freedom (above 0) exceeds `x`.
    pub fn chi_square_above(x: f64, degrees: f64) -> Self {
        Self::gamma_above(0.5 * x, 0.5 * degrees)
    }

    /// That a Gamma variable of this shape (above 0) and scale 1 exceeds `x`: the sum of `shape` exponential ones.
    pub fn gamma_above(x: f64, shape: f64) -> Self {
        let tail = Gamma::new(shape, 1.0).map_or(1.0, |gamma| gamma.sf(x));
        Self { ln: if tail > MIN_PROBABILITY { tail.ln() } else { ln_far_tail(x, shape) } }
    }

    /// Bonferroni's bound over so many tests, at most 1; `ln_tests` their natural logarithm.
    #[must_use]
    pub fn among(self, ln_tests: f64) -> Self {
        Self { ln: (self.ln + ln_tests).min(0.0) }
    }

    /// Its value, not below 1e-300.
    pub fn value(self) -> f64 {
        self.ln.exp().max(MIN_PROBABILITY)
    }

    /// Decimal logarithm.
    pub fn log10(self) -> f64 {
        self.ln / std::f64::consts::LN_10
    }
}

impl fmt::Display for Probability {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.log10() < MIN_PROBABILITY.log10() {
            write!(f, "< {MIN_PROBABILITY:.0e}")
        } else {
            write!(f, "{:.1e}", self.value())
        }
    }
}

/// Two fields: `p_value`, not below 1e-300, and `log10_p`.
impl Serialize for Probability {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut fields = serializer.serialize_struct("Probability", 2)?;
        fields.serialize_field("p_value", &self.value())?;
        fields.serialize_field("log10_p", &self.log10())?;
        fields.end()
    }
}

/// Logarithm of the regularised upper incomplete gamma function for `x` far above `shape`, by Legendre's continued
/// fraction from its end.
fn ln_far_tail(x: f64, shape: f64) -> f64 {
    const TERMS: i32 = 200;
    let fraction =
        (1..=TERMS).rev().map(f64::from).fold(0.0, |rest, n| n * (n - shape) / (x + 2.0 * n + 1.0 - shape - rest));
    shape * x.ln() - x - ln_gamma(shape) - (x + 1.0 - shape - fraction).ln()
}
