//! Exact orders: fractions of whole numbers, every operation checked for overflow.
//!
//! Eight stages of three-digit tooth counts stay within 128 bits; what does not is refused with the remedy, never
//! rounded.

use crate::{Error, Result};
use num_rational::Ratio;
use num_traits::{CheckedAdd, CheckedDiv, CheckedMul, CheckedSub, Signed};
use std::fmt;

/// A fraction in lowest terms.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Fraction(Ratio<i128>);

/// What overflow is told as.
fn too_large() -> Error {
    Error::invalid("[[stage]]", "the ratios of these stages exceed 128 bits; declare fewer stages")
}

impl Fraction {
    /// Nought.
    pub const ZERO: Self = Self(Ratio::new_raw(0, 1));
    /// One.
    pub const ONE: Self = Self(Ratio::new_raw(1, 1));

    /// `over / under` in lowest terms.
    ///
    /// # Panics
    /// If `under` is nought.
    pub fn new(over: i64, under: i64) -> Self {
        Self(Ratio::new(i128::from(over), i128::from(under)))
    }

    /// A whole number.
    pub fn whole(value: i64) -> Self {
        Self::new(value, 1)
    }

    /// Sum.
    ///
    /// # Errors
    /// Beyond 128 bits.
    pub fn plus(self, other: Self) -> Result<Self> {
        self.0.checked_add(&other.0).map(Self).ok_or_else(too_large)
    }

    /// Difference.
    ///
    /// # Errors
    /// Beyond 128 bits.
    pub fn minus(self, other: Self) -> Result<Self> {
        self.0.checked_sub(&other.0).map(Self).ok_or_else(too_large)
    }

    /// Product.
    ///
    /// # Errors
    /// Beyond 128 bits.
    pub fn times(self, other: Self) -> Result<Self> {
        self.0.checked_mul(&other.0).map(Self).ok_or_else(too_large)
    }

    /// Quotient.
    ///
    /// # Errors
    /// Beyond 128 bits, and a division by nought.
    pub fn over(self, other: Self) -> Result<Self> {
        if other == Self::ZERO {
            return Err(Error::invalid("[[stage]]", "a shaft that stands still drives nothing; check fixed and input"));
        }
        self.0.checked_div(&other.0).map(Self).ok_or_else(too_large)
    }

    /// Multiple by a whole number.
    ///
    /// # Errors
    /// Beyond 128 bits.
    pub fn multiple(self, count: i64) -> Result<Self> {
        self.times(Self::whole(count))
    }

    /// Without its sign.
    pub fn magnitude(self) -> Self {
        Self(self.0.abs())
    }

    /// -1, 0 or 1.
    pub fn sign(self) -> i64 {
        self.0.numer().signum() as i64
    }

    /// Numerator.
    pub fn numerator(self) -> i128 {
        *self.0.numer()
    }

    /// Denominator, positive.
    pub fn denominator(self) -> i128 {
        *self.0.denom()
    }

    /// Nearest double.
    pub fn value(self) -> f64 {
        *self.0.numer() as f64 / *self.0.denom() as f64
    }
}

impl fmt::Display for Fraction {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        fmt::Display::fmt(&self.0, f)
    }
}

impl serde::Serialize for Fraction {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn theory_sums_and_products_are_exact_and_overflow_is_an_error() {
        let (a, b) = (Fraction::new(23, 61), Fraction::new(19, 77));
        assert_eq!(a.times(b).unwrap(), Fraction::new(437, 4697));
        assert_eq!(a.plus(b).unwrap().to_string(), "2930/4697");
        assert_eq!(a.minus(a).unwrap(), Fraction::ZERO);
        assert!(a.over(Fraction::ZERO).unwrap_err().to_string().contains("stands still"));
        let mut product = Fraction::ONE;
        let overflow = (0..40).find_map(|i| {
            let next = product.times(Fraction::new(997, 991 - i % 7));
            match next {
                Ok(next) => {
                    product = next;
                    None
                }
                Err(error) => Some(error),
            }
        });
        assert!(overflow.expect("beyond 128 bits").to_string().contains("128 bits"));
    }

    #[test]
    fn theory_the_nearest_double_of_a_fraction_of_small_numbers_is_the_quotient() {
        for (over, under) in [(23, 61), (437, 4697), (31, 126), (95 * 31, 126 * 32)] {
            assert_eq!(Fraction::new(over, under).value(), over as f64 / under as f64);
        }
    }
}
