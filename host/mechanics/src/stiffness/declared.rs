//! From a declaration to the stiffness curves that the equations of motion use.

use super::pair::PairModel;
use super::ramp::engage;
use super::table::{TABLE_TOLERANCE, Table};
use crate::Result;
use crate::machine::{EngagementKind, Geometry, Machine, Side};
use crate::piecewise::PiecewisePolynomial;

/// The curve of the pair that holds the cracked tooth, and which tooth it is.
#[derive(Debug, Clone, PartialEq)]
pub struct CrackedPair {
    /// Which gear is cracked.
    pub side: Side,
    /// Which of its teeth, counted from the pair that enters contact at shaft angle zero.
    pub tooth: u32,
    /// Stiffness of its pair, N/m, over base pitches from the start of contact.
    pub curve: PiecewisePolynomial,
}

impl Machine {
    /// Stiffness of one healthy tooth pair, N/m, over base pitches from the start of contact.
    ///
    /// From the declared table where there is one, else from the geometry; then the declared engagement. A table of
    /// the *total* stiffness comes out as one pair that is in contact for exactly one base pitch, so that the sum
    /// over pairs is the table. The support is 0 to the contact ratio, and more on both sides for `loaded`.
    pub fn pair_stiffness(&self) -> Result<PiecewisePolynomial> {
        self.pair_stiffness_within(TABLE_TOLERANCE)
    }

    /// The same with a table followed only to `tolerance` of its largest value: fewer zones, less detail.
    pub fn pair_stiffness_within(&self, tolerance: f64) -> Result<PiecewisePolynomial> {
        self.pair_stiffness_at(None, tolerance)
    }

    /// The same with load-dependent engagement evaluated at the pinion torque given, N m, instead of the declared.
    pub fn pair_stiffness_at(&self, torque_n_m: Option<f64>, tolerance: f64) -> Result<PiecewisePolynomial> {
        let curve = match self.pair.pair_stiffness.as_ref().or(self.pair.total_stiffness.as_ref()) {
            Some(table) => Table::read(&self.folder.join(table))?.fit(tolerance),
            None => PairModel::new(&self.pair)?.curve(),
        };
        self.engaged(curve, torque_n_m)
    }

    /// The pair with the cracked tooth, where the machine declares one.
    pub fn cracked_pair(&self) -> Result<Option<CrackedPair>> {
        let Some(crack) = &self.crack else { return Ok(None) };
        let curve = self.engaged(PairModel::new(&self.pair)?.cracked_curve(crack)?, None)?;
        Ok(Some(CrackedPair { side: crack.side, tooth: crack.tooth, curve }))
    }

    fn engaged(&self, curve: PiecewisePolynomial, torque_n_m: Option<f64>) -> Result<PiecewisePolynomial> {
        let Some(mut engagement) = self.engagement.filter(|e| e.kind != EngagementKind::None) else {
            return Ok(curve);
        };
        engagement.torque_n_m = torque_n_m.or(engagement.torque_n_m).or(self.nominal.map(|n| n.torque_n_m));
        engage(&curve, &Geometry::new(&self.pair)?, &engagement)
    }
}
