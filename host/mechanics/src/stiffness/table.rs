//! Stiffness tables: CSV of one pair along its path, or of the whole mesh over one base pitch.
//!
//! Header `base_pitches_from_contact_start,pair_stiffness_n_per_m` (the names may differ, the two columns may
//! not), then ascending rows. The curve goes through every row to `tolerance` of the largest value with as few
//! polynomial pieces as that allows: each piece is the longest stretch, found by bisection, that a constrained
//! least-squares polynomial reproduces. Pieces join continuously, at rows; real kinks and steps in the data
//! therefore become knots by themselves.

use crate::budget::{self, TABLE_ROWS};
use crate::piecewise::PiecewisePolynomial;
use crate::{Error, Result, text};
use nalgebra::{DMatrix, DVector};
use std::path::Path;

/// Deviation from the rows, relative to the largest value, that a curve read for simulation may have.
pub const TABLE_TOLERANCE: f64 = 1e-6;
/// Highest degree of a piece.
const DEGREE: usize = 9;
/// Longest piece in rows; bounds the cost of the search.
const MAX_PIECE_ROWS: usize = 400;

/// Longest path of contact, base pitches: a spur pair with high contact ratio has below three.
const LONGEST_PATH: f64 = 10.0;
/// Stiffest pair, N/m: a metre of steel face has about 1e10.
const MAX_STIFFNESS_N_PER_M: f64 = 1e13;

/// Rows of a stiffness table.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    /// Path position, base pitches from the start of contact, ascending from 0.
    pub position: Vec<f64>,
    /// Stiffness, N/m.
    pub stiffness_n_per_m: Vec<f64>,
}

impl Table {
    /// Reads a table file.
    ///
    /// # Errors
    /// Names file and line of the first row that is not two finite numbers, descends, is negative, or is beyond any
    /// gear; too many rows.
    pub fn read(path: &Path) -> Result<Self> {
        let content = budget::read_text(path)?;
        Self::parse(&content, &path.display().to_string())
    }

    /// Reads a table from CSV text; `place` names it in errors.
    pub fn parse(content: &str, place: &str) -> Result<Self> {
        let mut table = Self { position: Vec::new(), stiffness_n_per_m: Vec::new() };
        for (i, line) in content.lines().enumerate() {
            let line = line.trim();
            if line.is_empty() || line.starts_with('#') {
                continue;
            }
            let refuse = |what: String| Err(Error::invalid(place, format!("line {}: {what}", i + 1)));
            let cells: Vec<&str> = line.split(',').map(str::trim).collect();
            let numbers: Vec<f64> = cells.iter().filter_map(|c| c.parse().ok()).collect();
            if numbers.is_empty() && table.position.is_empty() && i == 0 {
                continue;
            }
            let &[s, k] = numbers.as_slice() else {
                return refuse(format!("expected two numbers (base pitches, N/m), found {}", text::quoted(line)));
            };
            if cells.len() != 2 || !s.is_finite() || !k.is_finite() {
                return refuse(format!("expected two finite numbers, found {}", text::quoted(line)));
            }
            if k < 0.0 {
                return refuse(format!("a stiffness of {k} N/m is negative"));
            }
            match table.position.last() {
                None if s != 0.0 => return refuse(format!("the first position is {s}, the start of contact is 0")),
                Some(&before) if s <= before => return refuse(format!("position {s} does not come after {before}")),
                _ => {}
            }
            if s > LONGEST_PATH {
                return refuse(format!("position {s}: no path of contact is longer than {LONGEST_PATH} base pitches"));
            }
            if k > MAX_STIFFNESS_N_PER_M {
                return refuse(format!(
                    "a stiffness of {k:e} N/m is beyond that of any gear ({MAX_STIFFNESS_N_PER_M:e} N/m)"
                ));
            }
            table.position.push(s);
            table.stiffness_n_per_m.push(k);
            TABLE_ROWS.check(place, table.position.len() as f64, "take every n-th row")?;
        }
        if table.position.len() < 4 {
            return Err(Error::invalid(
                place,
                format!("{} rows: a stiffness curve needs at least 4", table.position.len()),
            ));
        }
        if table.stiffness_n_per_m.iter().all(|&k| k == 0.0) {
            return Err(Error::invalid(place, "every stiffness is zero"));
        }
        Ok(table)
    }

    /// Length of the path covered, base pitches.
    pub fn length(&self) -> f64 {
        *self.position.last().expect("at least four rows")
    }

    /// Straight lines between the rows: exact, one zone per row.
    pub fn linear(&self) -> PiecewisePolynomial {
        let (s, k) = (&self.position, &self.stiffness_n_per_m);
        let pieces = (1..s.len()).map(|i| vec![k[i - 1], (k[i] - k[i - 1]) / (s[i] - s[i - 1])]).collect();
        PiecewisePolynomial::new(s.clone(), pieces)
    }

    /// Few smooth pieces through the rows, each within `tolerance` of the largest value.
    pub fn fit(&self, tolerance: f64) -> PiecewisePolynomial {
        let last = self.position.len() - 1;
        let allowed = tolerance * self.stiffness_n_per_m.iter().copied().fold(0.0, f64::max);
        let (mut knots, mut pieces, mut from) = (vec![self.position[0]], Vec::new(), 0);
        while from < last {
            let farthest = last.min(from + MAX_PIECE_ROWS);
            let (mut good, mut bad) = (from + 1, farthest + 1);
            let mut best = self.piece(from, good, allowed).expect("a line passes through two rows");
            let mut stride = 4;
            while bad > good + 1 {
                let middle = if good + stride < bad { good + stride } else { good + (bad - good) / 2 };
                stride *= 2;
                match self.piece(from, middle, allowed) {
                    Some(piece) => (good, best) = (middle, piece),
                    None => bad = middle,
                }
            }
            knots.push(self.position[good]);
            pieces.push(best);
            from = good;
        }
        PiecewisePolynomial::new(knots, pieces)
    }

    /// Polynomial through rows `from` and `to` exactly and the rows between within `allowed`, if there is one.
    fn piece(&self, from: usize, to: usize, allowed: f64) -> Option<Vec<f64>> {
        let (s0, k0) = (self.position[from], self.stiffness_n_per_m[from]);
        let length = self.position[to] - s0;
        let rise = self.stiffness_n_per_m[to] - k0;
        let inner: Vec<usize> = (from + 1..to).collect();
        // Half as many unknowns as rows at most: the curve must not wander between rows.
        let unknowns = (DEGREE - 1).min(inner.len() / 2).max(usize::from(!inner.is_empty()));
        if unknowns == 0 {
            return Some(vec![k0, rise / length]);
        }
        let unit = |i: usize| (self.position[i] - s0) / length;
        let bubble = |u: f64| u * (1.0 - u);
        let basis = |u: f64, n: usize| bubble(u) * (2.0 * u - 1.0).powi(n as i32);
        let design = DMatrix::from_fn(inner.len(), unknowns, |r, n| basis(unit(inner[r]), n));
        let line = |i: usize| k0 + rise * unit(i);
        let wanted = DVector::from_fn(inner.len(), |r, _| self.stiffness_n_per_m[inner[r]] - line(inner[r]));
        let solution = design.clone().svd(true, true).solve(&wanted, 1e-13).ok()?;
        if (&design * &solution - &wanted).amax() > allowed {
            return None;
        }
        // Powers of u: line + u (1 - u) q(2u - 1), then of s by scaling.
        let q = crate::piecewise::shift_scale(solution.as_slice(), -1.0, 2.0);
        let mut c = vec![0.0; unknowns + 2];
        c[0] = k0;
        c[1] = rise;
        for (n, v) in q.iter().enumerate() {
            c[n + 1] += v;
            c[n + 2] -= v;
        }
        Some(crate::piecewise::shift_scale(&c, 0.0, 1.0 / length))
    }
}
