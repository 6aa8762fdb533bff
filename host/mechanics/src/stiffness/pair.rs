//! Stiffness of one tooth pair along the true path of contact, as a piecewise polynomial in base pitches.
//!
//! `1/k = 1/kh + sum over both teeth (1/kb + 1/ks + 1/ka + 1/kf)`, evaluated where the contact really is:
//! from the gear's tip to the pinion's. Knots lie where pairs enter or leave contact, so that the sum over
//! pairs has as few zones as there are physical events; each zone is split only if a polynomial of modest
//! degree misses 1e-9 of the largest value.

use super::body::{BodyCompliance, body_compliance};
use super::hertz::hertz_stiffness;
use super::tooth::Tooth;
use crate::Result;
use crate::machine::{Geometry, Pair};
use crate::piecewise::PiecewisePolynomial;

/// Degree of each piece: high enough for a whole contact zone, low enough for a well-conditioned power basis.
pub const DEGREE: usize = 12;
/// Largest deviation of a fitted curve relative to its largest value.
pub const FIT_TOLERANCE: f64 = 1e-9;

/// Both teeth, both bodies and the contact between them.
#[derive(Debug, Clone, PartialEq)]
pub struct PairModel {
    /// Geometry of the pair.
    pub geometry: Geometry,
    /// The teeth.
    pub teeth: [Tooth; 2],
    /// The bodies.
    pub bodies: [BodyCompliance; 2],
    /// Contact stiffness, N/m.
    pub hertz_n_per_m: f64,
    /// Whether the bodies count.
    pub with_body: bool,
}

impl PairModel {
    /// Builds the model of a pair from its geometry.
    pub fn new(pair: &Pair) -> Result<Self> {
        let geometry = Geometry::new(pair)?;
        let teeth = [Tooth::new(pair, &geometry, 0)?, Tooth::new(pair, &geometry, 1)?];
        let bodies = [body_compliance(pair, &geometry, 0), body_compliance(pair, &geometry, 1)];
        let hertz_n_per_m = hertz_stiffness(pair.youngs_modulus_pa, pair.poisson, pair.face_width_m);
        Ok(Self { geometry, teeth, bodies, hertz_n_per_m, with_body: pair.body })
    }

    /// Stiffness of the pair, N/m, with its contact `s` base pitches after the start of contact.
    ///
    /// Valid from 0 to the contact ratio, and continued smoothly a little beyond.
    pub fn at(&self, s: f64) -> f64 {
        1.0 / self.compliance(s)
    }

    /// Compliance of the pair, m/N.
    pub fn compliance(&self, s: f64) -> f64 {
        let angles = self.geometry.load_angle(s);
        1.0 / self.hertz_n_per_m
            + (0..2).map(|i| self.teeth[i].compliance(angles[i]).total() + self.body(i, angles[i])).sum::<f64>()
    }

    /// Compliance of body `index` at a load angle, m/N; zero where bodies are left out.
    pub fn body(&self, index: usize, load_angle: f64) -> f64 {
        if self.with_body { self.bodies[index].at(load_angle) } else { 0.0 }
    }

    /// The pair's stiffness over the theoretical path as a piecewise polynomial, hard at both ends.
    pub fn curve(&self) -> PiecewisePolynomial {
        fit_adaptive(event_knots(self.geometry.contact_ratio, &[]), FIT_TOLERANCE, |s| self.at(s))
    }
}

/// Knots 0 to the contact ratio at every place where another pair enters or leaves, plus `extra` and what it
/// does to the other pairs is left to them: few zones in the sum.
pub fn event_knots(contact_ratio: f64, extra: &[f64]) -> Vec<f64> {
    let mut knots = vec![0.0, contact_ratio];
    let mut n = 1.0;
    while n < contact_ratio {
        knots.extend([n, contact_ratio - n]);
        n += 1.0;
    }
    knots.extend(extra.iter().copied().filter(|&x| x > 0.0 && x < contact_ratio));
    knots.sort_by(f64::total_cmp);
    knots.dedup_by(|b, a| *b - *a < 1e-9);
    knots
}

/// Fits `f` between `knots`, halving every interval in which the fit misses `tolerance` of the largest value.
pub fn fit_adaptive(knots: Vec<f64>, tolerance: f64, f: impl Fn(f64) -> f64) -> PiecewisePolynomial {
    let scale = knots.windows(2).map(|w| f(0.5 * (w[0] + w[1])).abs()).fold(0.0, f64::max);
    let (mut fine, mut pieces) = (vec![knots[0]], Vec::new());
    let mut open: Vec<(f64, f64, u32)> = knots.windows(2).rev().map(|w| (w[0], w[1], 0)).collect();
    while let Some((from, to, depth)) = open.pop() {
        let fit = PiecewisePolynomial::fit(vec![from, to], DEGREE, &f);
        let error = (1..2 * DEGREE)
            .map(|i| from + (to - from) * i as f64 / (2 * DEGREE) as f64)
            .map(|s| (fit.value(s) - f(s)).abs())
            .fold(0.0, f64::max);
        if error <= tolerance * scale || depth >= 12 {
            fine.push(to);
            pieces.push(fit.piece(0).to_vec());
        } else {
            let middle = 0.5 * (from + to);
            open.push((middle, to, depth + 1));
            open.push((from, middle, depth + 1));
        }
    }
    PiecewisePolynomial::new(fine, pieces)
}
