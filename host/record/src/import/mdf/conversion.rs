//! From stored numbers to the channel's unit.

use super::blocks::Blocks;
use crate::Result;

/// Numbers of a table; more are damage.
const MAX_TABLE_NUMBERS: usize = 1 << 20;

/// What is done to a stored number.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Conversion {
    /// Nothing.
    Same,
    /// `a + b x`.
    Linear(f64, f64),
    /// `(p1 x^2 + p2 x + p3) / (p4 x^2 + p5 x + p6)`.
    Rational([f64; 6]),
    /// Keys and values, ascending; between them a straight line, or the nearer one.
    Table { rows: Vec<(f64, f64)>, straight: bool },
}

impl Conversion {
    /// Of a conversion block; `None` for texts and formulas.
    pub fn of(blocks: &Blocks, at: u64) -> Result<Option<Self>> {
        if at == 0 {
            return Ok(Some(Self::Same));
        }
        let block = blocks.at(at, b"CC")?;
        let broken = || blocks.refuse("a conversion's block is too short");
        let kind = block.u8(0).ok_or_else(broken)?;
        let count = usize::from(block.u16(6).ok_or_else(broken)?).min(MAX_TABLE_NUMBERS);
        let numbers: Option<Vec<f64>> = (0..count).map(|i| block.f64(24 + 8 * i)).collect();
        let numbers = numbers.ok_or_else(broken)?;
        Ok(match (kind, numbers.as_slice()) {
            (0, _) => Some(Self::Same),
            (1, [a, b]) => Some(Self::Linear(*a, *b)),
            (2, [p1, p2, p3, p4, p5, p6]) => Some(Self::Rational([*p1, *p2, *p3, *p4, *p5, *p6])),
            (4 | 5, [_, ..]) => {
                let rows: Vec<(f64, f64)> = numbers.chunks_exact(2).map(|row| (row[0], row[1])).collect();
                let ascends = rows.windows(2).all(|w| w[0].0 < w[1].0);
                ascends.then_some(Self::Table { rows, straight: kind == 4 })
            }
            _ => None,
        })
    }

    pub fn of_raw(&self, x: f64) -> f64 {
        match self {
            Self::Same => x,
            Self::Linear(a, b) => a + b * x,
            Self::Rational([p1, p2, p3, p4, p5, p6]) => ((p1 * x + p2) * x + p3) / ((p4 * x + p5) * x + p6),
            Self::Table { rows, straight } => looked_up(rows, *straight, x),
        }
    }
}

/// Beyond the ends the table's own ends hold.
fn looked_up(rows: &[(f64, f64)], straight: bool, x: f64) -> f64 {
    let after = rows.partition_point(|row| row.0 <= x);
    match (after.checked_sub(1).and_then(|i| rows.get(i)), rows.get(after)) {
        (Some(low), Some(high)) if straight => low.1 + (high.1 - low.1) * (x - low.0) / (high.0 - low.0),
        (Some(low), Some(high)) if x - low.0 <= high.0 - x => low.1,
        (_, Some(high)) => high.1,
        (Some(low), None) => low.1,
        (None, None) => f64::NAN,
    }
}
