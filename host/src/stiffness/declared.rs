//! From a declaration to the stiffness curve that the equations of motion use.

use super::pair::PairModel;
use super::table::{TABLE_TOLERANCE, Table};
use crate::Result;
use crate::machine::Machine;
use crate::piecewise::PiecewisePolynomial;

impl Machine {
    /// Stiffness of one healthy tooth pair, N/m, over base pitches from the start of contact.
    ///
    /// From the declared table where there is one, else from the geometry. A table of the *total* stiffness
    /// comes out as one pair that is in contact for exactly one base pitch, so that the sum over pairs is the table.
    pub fn pair_stiffness(&self) -> Result<PiecewisePolynomial> {
        if let Some(table) = self.pair.pair_stiffness.as_ref().or(self.pair.total_stiffness.as_ref()) {
            return Ok(Table::read(&self.folder.join(table))?.fit(TABLE_TOLERANCE));
        }
        Ok(PairModel::new(&self.pair)?.curve())
    }
}
