//! Stiffness of one tooth pair along the path of contact and its Fourier transforms.
//!
//! Position `u` counts base pitches from the start of contact. The table is taken piecewise linear, for which the
//! transform `K(nu) = int k(u) exp(-2 pi i nu u) du` is summed exactly segment by segment. By Poisson's sum the total
//! mesh stiffness of pairs one base pitch apart has Fourier coefficients `K(n)`; one tooth of a gear of `z` teeth,
//! recurring every `z` base pitches, has coefficients `K(k / z) / z` at shaft order `k`.

use crate::Result;
use crate::piecewise::PiecewisePolynomial;
use crate::stiffness::Table;
use rustfft::num_complex::Complex64;
use std::f64::consts::TAU;
use std::path::Path;

/// Steps that stand for a curve by formulas: a ramp of a hundredth of a base pitch still has a dozen.
const STEPS: u32 = 2000;

/// Piecewise linear curve over the path of contact; zero outside.
#[derive(Debug, Clone)]
pub struct PairCurve {
    /// Positions, base pitches from the start of contact, increasing.
    pub u: Vec<f64>,
    /// Values there: N/m for a stiffness.
    pub k: Vec<f64>,
}

impl PairCurve {
    /// Reads a stiffness table, as strictly as everything that reads one: see [`Table::read`].
    ///
    /// # Errors
    /// Those of [`Table::read`].
    pub fn read(path: &Path) -> Result<Self> {
        let Table { position, stiffness_n_per_m } = Table::read(path)?;
        Ok(Self { u: position, k: stiffness_n_per_m })
    }

    /// A curve by formulas, at even positions.
    pub fn sampled(curve: &PiecewisePolynomial) -> Self {
        let (from, to) = (curve.knots()[0], curve.knots()[curve.knots().len() - 1]);
        let u: Vec<f64> = (0..=STEPS).map(|i| from + (to - from) * f64::from(i) / f64::from(STEPS)).collect();
        // The end itself lies outside the last piece.
        let inside = to - 1e-9 * (to - from);
        let k = u.iter().map(|&u| curve.value(u.min(inside))).collect();
        Self { u, k }
    }

    /// Contact ratio: length of the path in base pitches.
    pub fn contact_ratio(&self) -> f64 {
        self.u[self.u.len() - 1]
    }

    /// Value at `u` (zero outside the path).
    pub fn at(&self, u: f64) -> f64 {
        let last = self.u.len() - 1;
        if !(u >= self.u[0] && u < self.u[last]) {
            return 0.0;
        }
        // Tables are close to uniform: start from the proportional index.
        let mut i = (((u - self.u[0]) / (self.u[last] - self.u[0]) * last as f64) as usize).min(last - 1);
        while i > 0 && self.u[i] > u {
            i -= 1;
        }
        while i + 1 < last && self.u[i + 1] <= u {
            i += 1;
        }
        let x = (u - self.u[i]) / (self.u[i + 1] - self.u[i]);
        self.k[i] + x * (self.k[i + 1] - self.k[i])
    }

    /// The curve multiplied by a function of position.
    pub fn times(&self, shape: impl Fn(f64) -> f64) -> Self {
        Self { u: self.u.clone(), k: self.u.iter().zip(&self.k).map(|(&u, &k)| k * shape(u)).collect() }
    }

    /// `K(nu)`, the transform at `nu` cycles per base pitch.
    pub fn transform(&self, nu: f64) -> Complex64 {
        let w = TAU * nu;
        if w.abs() < 1e-9 {
            let area: f64 =
                (1..self.u.len()).map(|i| 0.5 * (self.k[i] + self.k[i - 1]) * (self.u[i] - self.u[i - 1])).sum();
            return Complex64::new(area, 0.0);
        }
        // Integration by parts: end values over i w, slope changes over w^2.
        let mut sum = Complex64::ZERO;
        let (mut slope_before, last) = (0.0, self.u.len() - 1);
        // Tables are as a rule uniform to the last printed digit: one phasor then serves all steps.
        let even = (self.u[last] - self.u[0]) / last as f64;
        let (mut turn, factor) = (Complex64::cis(-w * self.u[0]), Complex64::cis(-w * even));
        for i in 0..=last {
            let slope = if i < last { (self.k[i + 1] - self.k[i]) / (self.u[i + 1] - self.u[i]) } else { 0.0 };
            let on_grid = (self.u[i] - self.u[0] - i as f64 * even).abs() < 3e-9;
            sum += if on_grid { turn } else { Complex64::cis(-w * self.u[i]) } * (slope_before - slope);
            slope_before = slope;
            turn *= factor;
        }
        let ends = Complex64::cis(-w * self.u[0]) * self.k[0] - Complex64::cis(-w * self.u[last]) * self.k[last];
        sum / (w * w) + ends * Complex64::new(0.0, -1.0 / w)
    }
}
