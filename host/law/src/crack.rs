//! The cracked tooth as it enters the law's studies: its pair's stiffness replaces the healthy one.
//!
//! Only the passages of the one cracked tooth differ; every other pair keeps the healthy curve. The tooth
//! enters the path at shaft angle zero here, whichever tooth the declaration names, so that the studies know
//! where to look. With a load-dependent engagement the cracked pair is used on the healthy pair's support.

use crate::dynamics::excitation::{Moment, PairOnPath};
use crate::dynamics::{Effect, Facts, Series};
use crate::machine::Side;
use crate::piecewise::PiecewisePolynomial;
use crate::stiffness::CrackedPair;

/// Position ahead of the contact, base pitches, by which a piece is chosen at a knot (as the mesh does).
const LOOKAHEAD_PITCHES: f64 = 1e-9;

/// One cracked tooth, number 0 of its gear.
#[derive(Debug, Clone)]
pub struct CrackedTooth {
    side: Side,
    curve: PiecewisePolynomial,
}

impl CrackedTooth {
    /// From the declaration's cracked pair.
    pub fn new(pair: CrackedPair) -> Self {
        Self { side: pair.side, curve: pair.curve }
    }

    /// Which gear is cracked.
    pub fn side(&self) -> Side {
        self.side
    }
}

impl Effect for CrackedTooth {
    fn pair_stiffness(&self, _moment: &Moment, pair: &PairOnPath, stiffness: &mut Series) {
        if pair.tooth[self.side.index()] != 0 {
            return;
        }
        let ahead = if pair.position.coefficient(1) >= 0.0 { LOOKAHEAD_PITCHES } else { -LOOKAHEAD_PITCHES };
        let Some(piece) = self.curve.locate(pair.position.coefficient(0) + ahead) else { return };
        let mut local = pair.position;
        local.add_constant(-self.curve.knots()[piece]);
        *stiffness = local.compose(self.curve.piece(piece));
    }

    fn path_knots(&self, _facts: &Facts) -> Vec<f64> {
        self.curve.knots().to_vec()
    }
}

/// Keeps every pair but two away from contact: one engagement without its neighbours.
#[derive(Debug, Clone, Copy)]
pub struct OnlyPairs(pub [i64; 2]);

impl Effect for OnlyPairs {
    fn pair_stiffness(&self, _moment: &Moment, pair: &PairOnPath, stiffness: &mut Series) {
        if !self.0.contains(&pair.number) {
            *stiffness = Series::ZERO;
        }
    }
}
