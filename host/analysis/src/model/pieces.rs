//! A stiffness table as the smooth curve that it was printed from.
//!
//! Simulator and harmonic balance take the same pieces, so that they differ by their methods alone. Limit: a table
//! that scatters from row to row is no smooth curve; then the harmonic balance takes its rows as they are.

use crate::piecewise::PiecewisePolynomial;
use crate::stiffness::pair_curve::PairCurve;
use crate::stiffness::{TABLE_TOLERANCE, Table};

/// Most pieces that stand for a stiffness table: every pair on the path breaks a step at each end of them.
const MOST_PIECES: usize = 16;
/// Deviations from a table's rows, relative to its largest value, that are tried; the last is what printed tables
/// scatter by from row to row.
const TOLERANCES: [f64; 5] = [TABLE_TOLERANCE, 1e-5, 1e-4, 3e-4, 1e-3];

/// Deviation from a table's rows up to which its pieces stand for it.
const MAX_ROW_DEVIATION: f64 = 1e-5;

/// Most pieces where the table itself is what matters, as for a record that is generated: rows that are smooth but for
/// a few kinks fit into them.
const MOST_EXACT_PIECES: usize = 128;

/// Rows for one of a table's own.
const ROW_SUBDIVISIONS: u32 = 16;

/// A stiffness table as few smooth pieces, as near to its rows as that allows, and whether that is near enough to
/// stand for it.
pub fn smooth(curve: &PairCurve) -> (PiecewisePolynomial, bool) {
    pieces(curve, MOST_PIECES)
}

/// The same with as many pieces as the rows ask for: several times the cost of a run where these are many.
pub fn exact(curve: &PairCurve) -> PiecewisePolynomial {
    pieces(curve, MOST_EXACT_PIECES).0
}

/// The table that its pieces give where they stand for it, with 16 rows for each of its own: straight lines
/// between the rows of a smooth ramp take a per cent of the 70th harmonic. Else the table itself.
pub fn finer(curve: &PairCurve) -> PairCurve {
    let (pieces, is_close) = smooth(curve);
    if !is_close {
        return curve.clone();
    }
    let end = curve.u.len() - 1;
    let between = |i: usize| {
        let (from, to) = (curve.u[i], curve.u[i + 1]);
        (0..ROW_SUBDIVISIONS).map(move |part| from + (to - from) * f64::from(part) / f64::from(ROW_SUBDIVISIONS))
    };
    let mut u: Vec<f64> = (0..end).flat_map(between).collect();
    let mut k: Vec<f64> = u.iter().map(|&u| pieces.value(u)).collect();
    u.push(curve.u[end]);
    k.push(curve.k[end]);
    PairCurve { u, k }
}

fn pieces(curve: &PairCurve, most: usize) -> (PiecewisePolynomial, bool) {
    let table = Table { position: curve.u.clone(), stiffness_n_per_m: curve.k.clone() };
    let mut fits = TOLERANCES.into_iter().map(|tolerance| (table.fit(tolerance), tolerance <= MAX_ROW_DEVIATION));
    let few = |(fit, _): &(PiecewisePolynomial, bool)| fit.knots().len() <= most + 1;
    fits.find(few).unwrap_or_else(|| (table.fit(TOLERANCES[TOLERANCES.len() - 1]), false))
}
