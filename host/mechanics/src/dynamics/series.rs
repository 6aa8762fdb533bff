//! Truncated Taylor series over one integration step: the arithmetic of everything time-varying.
//!
//! A [`Series`] holds coefficients in the normalised time `tau = (t - t0) / h` of a step, so that all of
//! them are of the size of the quantity itself and the step may be shortened by evaluating at `tau < 1`.
//! The highest power in use is tracked: angle at constant speed is linear, stiffness of low degree, a shaft's sine
//! over a short step needs ten powers, and products of short series stay cheap. Sine, cosine and square root follow
//! the usual recurrences (Griewank and Walther, Evaluating Derivatives, table 13.2). Cost: O(degree^2) per product.

/// Highest power kept in a step.
pub const ORDER: usize = 48;
/// Number of coefficients of a full series.
pub const LENGTH: usize = ORDER + 1;
/// Share of a series' largest coefficient below which its highest powers are dropped: a thousandth of rounding.
const NEGLIGIBLE_TERM_SHARE: f64 = 1e-19;

/// A polynomial in the normalised time of a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Series {
    coefficients: [f64; LENGTH],
    degree: usize,
}

impl Default for Series {
    fn default() -> Self {
        Self::ZERO
    }
}

impl Series {
    /// The series that is zero.
    pub const ZERO: Self = Self { coefficients: [0.0; LENGTH], degree: 0 };

    /// A constant.
    #[inline]
    pub fn constant(value: f64) -> Self {
        let mut s = Self::ZERO;
        s.coefficients[0] = value;
        s
    }

    /// `value + slope tau`.
    pub fn linear(value: f64, slope: f64) -> Self {
        let mut s = Self::constant(value);
        s.coefficients[1] = slope;
        s.degree = 1;
        s
    }

    /// From coefficients, lowest power first; what exceeds [`ORDER`] is dropped.
    #[inline]
    pub fn from_slice(coefficients: &[f64]) -> Self {
        let mut s = Self::ZERO;
        let n = coefficients.len().min(LENGTH);
        s.coefficients[..n].copy_from_slice(&coefficients[..n]);
        s.degree = n.saturating_sub(1);
        s
    }

    /// Highest power that may differ from zero.
    #[inline]
    pub fn degree(&self) -> usize {
        self.degree
    }

    /// The coefficients in use, lowest power first.
    #[inline]
    pub fn coefficients(&self) -> &[f64] {
        &self.coefficients[..=self.degree]
    }

    /// Coefficient of `tau^n`, zero above the degree.
    #[inline]
    pub fn coefficient(&self, n: usize) -> f64 {
        self.coefficients[n]
    }

    /// Whether the series is the constant zero.
    pub fn is_zero(&self) -> bool {
        self.coefficients().iter().all(|&c| c == 0.0)
    }

    /// Value at `tau`.
    pub fn value(&self, tau: f64) -> f64 {
        self.coefficients().iter().rev().fold(0.0, |sum, c| sum * tau + c)
    }

    /// Without the highest powers that no sum in double precision would see.
    fn trimmed(mut self) -> Self {
        let largest = self.coefficients().iter().fold(0.0_f64, |m, c| m.max(c.abs()));
        while self.degree > 0 && self.coefficients[self.degree].abs() <= NEGLIGIBLE_TERM_SHARE * largest {
            self.coefficients[self.degree] = 0.0;
            self.degree -= 1;
        }
        self
    }

    /// Derivative with respect to `tau`.
    pub fn derivative(&self) -> Self {
        let mut d = Self::ZERO;
        for n in 1..=self.degree {
            d.coefficients[n - 1] = n as f64 * self.coefficients[n];
        }
        d.degree = self.degree.saturating_sub(1);
        d
    }

    /// The same function of a time normalised by `ratio h` instead of `h`.
    pub fn rescaled(mut self, ratio: f64) -> Self {
        let mut power = 1.0;
        for c in &mut self.coefficients[..=self.degree] {
            *c *= power;
            power *= ratio;
        }
        self
    }

    /// Adds `factor * other`.
    #[inline]
    pub fn add_scaled(&mut self, other: &Self, factor: f64) {
        for n in 0..=other.degree {
            self.coefficients[n] += factor * other.coefficients[n];
        }
        self.degree = self.degree.max(other.degree);
    }

    /// Adds a constant.
    #[inline]
    pub fn add_constant(&mut self, value: f64) {
        self.coefficients[0] += value;
    }

    /// The series times a number.
    #[inline]
    pub fn scaled(mut self, factor: f64) -> Self {
        self.coefficients[..=self.degree].iter_mut().for_each(|c| *c *= factor);
        self
    }

    /// Product, truncated at [`ORDER`].
    pub fn product(&self, other: &Self) -> Self {
        let mut p = Self::ZERO;
        p.degree = (self.degree + other.degree).min(ORDER);
        for (i, a) in self.coefficients().iter().enumerate() {
            for (c, b) in p.coefficients[i..].iter_mut().zip(other.coefficients()) {
                *c += a * b;
            }
        }
        p.trimmed()
    }

    /// Sine and cosine of the series (radians).
    pub fn sin_cos(&self) -> (Self, Self) {
        let (sin, cos) = self.coefficients[0].sin_cos();
        let (mut s, mut c) = (Self::constant(sin), Self::constant(cos));
        if self.degree == 0 {
            return (s, c);
        }
        for n in 1..=ORDER {
            let (mut ds, mut dc) = (0.0, 0.0);
            for j in 1..=n.min(self.degree) {
                let weight = j as f64 * self.coefficients[j];
                ds += weight * c.coefficients[n - j];
                dc -= weight * s.coefficients[n - j];
            }
            s.coefficients[n] = ds / n as f64;
            c.coefficients[n] = dc / n as f64;
            (s.degree, c.degree) = (n, n);
            // Every further power is a sum of as many before it as the angle has.
            let before = n.saturating_sub(self.degree)..=n;
            if n > self.degree
                && before.clone().all(|i| s.coefficients[i].abs() + c.coefficients[i].abs() < NEGLIGIBLE_TERM_SHARE)
            {
                break;
            }
        }
        (s.trimmed(), c.trimmed())
    }

    /// Exponential function of the series.
    pub fn exp(&self) -> Self {
        let mut e = Self::constant(self.coefficients[0].exp());
        if self.degree == 0 {
            return e;
        }
        for n in 1..=ORDER {
            let sum: f64 =
                (1..=n.min(self.degree)).map(|j| j as f64 * self.coefficients[j] * e.coefficients[n - j]).sum();
            e.coefficients[n] = sum / n as f64;
        }
        e.degree = ORDER;
        e.trimmed()
    }

    /// Square root; the value at the step's start must be positive.
    pub fn sqrt(&self) -> Self {
        let mut r = Self::constant(self.coefficients[0].sqrt());
        if self.degree == 0 {
            return r;
        }
        for n in 1..=ORDER {
            let cross: f64 = (1..n).map(|j| r.coefficients[j] * r.coefficients[n - j]).sum();
            r.coefficients[n] = (self.coefficients[n] - cross) / (2.0 * r.coefficients[0]);
        }
        r.degree = ORDER;
        r.trimmed()
    }

    /// Quotient; the divisor's value at the step's start must not be zero.
    pub fn quotient(&self, divisor: &Self) -> Self {
        let mut q = Self::ZERO;
        for n in 0..=ORDER {
            let known: f64 = (1..=n.min(divisor.degree)).map(|j| divisor.coefficients[j] * q.coefficients[n - j]).sum();
            q.coefficients[n] = (self.coefficients[n] - known) / divisor.coefficients[0];
        }
        q.degree = if divisor.degree == 0 { self.degree } else { ORDER };
        q.trimmed()
    }

    /// The polynomial with coefficients `p` (lowest power first) of this series.
    pub fn compose(&self, p: &[f64]) -> Self {
        if self.degree <= 1 {
            return self.compose_linear(p);
        }
        p.iter().rev().fold(Self::ZERO, |sum, &c| {
            let mut next = sum.product(self);
            next.add_constant(c);
            next
        })
    }

    fn compose_linear(&self, p: &[f64]) -> Self {
        let mut s = Self::from_slice(p);
        let (offset, scale) = (self.coefficients[0], self.coefficients[1]);
        let n = s.degree;
        for i in 0..n {
            for j in (i..n).rev() {
                s.coefficients[j] += offset * s.coefficients[j + 1];
            }
        }
        s.rescaled(scale)
    }
}
