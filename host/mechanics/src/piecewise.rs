//! Piecewise polynomials: the common currency of stiffness curves and the Taylor solver.
//!
//! Each piece is a polynomial in the *local* coordinate `x - knot`, so that a piece can be moved along
//! the axis exactly and a Taylor series can be taken from it without cancellation. Outside the knots the
//! function is zero: a tooth pair that is not in contact has no stiffness.

/// A function given by polynomials between ascending knots, zero outside.
#[derive(Debug, Clone, PartialEq)]
pub struct PiecewisePolynomial {
    knots: Vec<f64>,
    /// `pieces[i][n]` multiplies `(x - knots[i])^n` on `[knots[i], knots[i + 1])`.
    pieces: Vec<Vec<f64>>,
}

impl PiecewisePolynomial {
    /// Builds the function from `n + 1` ascending finite knots and `n` coefficient lists (lowest power first).
    ///
    /// # Panics
    /// If the counts do not match or the knots do not ascend: a programming error of the caller.
    pub fn new(knots: Vec<f64>, pieces: Vec<Vec<f64>>) -> Self {
        assert_eq!(knots.len(), pieces.len() + 1, "one more knot than pieces");
        assert!(knots.windows(2).all(|w| w[0] < w[1]), "knots ascend");
        Self { knots, pieces }
    }

    /// Fits each interval between `knots` with the polynomial through `degree + 1` Chebyshev points of `f`.
    ///
    /// Near-minimax for smooth `f`; the caller chooses the knots at every kink.
    pub fn fit(knots: Vec<f64>, degree: usize, f: impl Fn(f64) -> f64) -> Self {
        let pieces = knots.windows(2).map(|w| chebyshev_piece(w[0], w[1], degree, &f)).collect();
        Self::new(knots, pieces)
    }

    /// The knots, ascending.
    pub fn knots(&self) -> &[f64] {
        &self.knots
    }

    /// Coefficients of piece `i` in powers of `x - knots()[i]`.
    pub fn piece(&self, i: usize) -> &[f64] {
        &self.pieces[i]
    }

    /// Index of the piece that holds `x`, `None` outside.
    pub fn locate(&self, x: f64) -> Option<usize> {
        if x < self.knots[0] || x >= *self.knots.last().expect("at least one knot") {
            return None;
        }
        Some(self.knots.partition_point(|&k| k <= x) - 1)
    }

    /// Value at `x`; zero outside the knots.
    pub fn value(&self, x: f64) -> f64 {
        self.locate(x).map_or(0.0, |i| horner(&self.pieces[i], x - self.knots[i]))
    }

    /// First derivative at `x`; zero outside the knots, the right-hand one at a knot.
    pub fn derivative(&self, x: f64) -> f64 {
        self.locate(x).map_or(0.0, |i| {
            let u = x - self.knots[i];
            self.pieces[i].iter().enumerate().skip(1).rev().fold(0.0, |sum, (n, c)| sum * u + n as f64 * c)
        })
    }

    /// Integral over the whole support.
    pub fn integral(&self) -> f64 {
        self.knots
            .windows(2)
            .zip(&self.pieces)
            .map(|(w, c)| {
                let u = w[1] - w[0];
                u * c.iter().enumerate().rev().fold(0.0, |sum, (n, c)| sum * u + c / (n + 1) as f64)
            })
            .sum()
    }

    /// The same function with every value multiplied by `factor`.
    pub fn scaled(&self, factor: f64) -> Self {
        let pieces = self.pieces.iter().map(|p| p.iter().map(|c| c * factor).collect()).collect();
        Self { knots: self.knots.clone(), pieces }
    }
}

/// Value of the polynomial `c[0] + c[1] u + ...`.
pub fn horner(c: &[f64], u: f64) -> f64 {
    c.iter().rev().fold(0.0, |sum, &c| sum * u + c)
}

/// Coefficients in powers of `x - from` of the interpolant of `f` at Chebyshev points of `[from, to]`.
fn chebyshev_piece(from: f64, to: f64, degree: usize, f: &impl Fn(f64) -> f64) -> Vec<f64> {
    let n = degree + 1;
    let half = 0.5 * (to - from);
    let samples: Vec<f64> =
        (0..n).map(|k| f(from + half * (1.0 + (std::f64::consts::PI * (k as f64 + 0.5) / n as f64).cos()))).collect();
    let cheb: Vec<f64> = (0..n)
        .map(|j| {
            let sum: f64 = samples
                .iter()
                .enumerate()
                .map(|(k, s)| s * (std::f64::consts::PI * j as f64 * (k as f64 + 0.5) / n as f64).cos())
                .sum();
            sum * if j == 0 { 1.0 } else { 2.0 } / n as f64
        })
        .collect();
    // Powers of z in [-1, 1] by the three-term recurrence, then z = u / half - 1.
    let mut powers = vec![0.0; n];
    let (mut before, mut now) = (vec![0.0; n], vec![0.0; n]);
    before[0] = 1.0;
    powers[0] += cheb[0];
    if n > 1 {
        now[1] = 1.0;
        powers[1] += cheb[1];
    }
    for c in cheb.iter().skip(2) {
        let mut next = vec![0.0; n];
        for i in 0..n {
            next[i] -= before[i];
            if i > 0 {
                next[i] += 2.0 * now[i - 1];
            }
        }
        for i in 0..n {
            powers[i] += c * next[i];
        }
        before = now;
        now = next;
    }
    shift_scale(&powers, -1.0, 1.0 / half)
}

/// Coefficients of `p(offset + scale u)` in powers of `u`.
pub fn shift_scale(p: &[f64], offset: f64, scale: f64) -> Vec<f64> {
    let mut c = p.to_vec();
    let n = c.len();
    for i in 0..n {
        for j in (i..n.saturating_sub(1)).rev() {
            c[j] += offset * c[j + 1];
        }
    }
    let mut s = 1.0;
    for c in &mut c {
        *c *= s;
        s *= scale;
    }
    c
}
