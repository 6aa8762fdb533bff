//! What distorts every line of a record, found and mended before the library is searched: clipped channels, a speed that moves.
//!
//! Each is judged on the machine as calibrated so far, the record is mended by it, and the declared parameters are fitted anew, since what they were fitted to was distorted. What
//! mending leaves is within its own form error: further terms must gain their share of it ([`accept`](super::accept)).

use super::base_fit::Base;
use super::clipping::{self, filled};
use super::judge::Split;
use super::least_squares::chi_square;
use super::moving_speed::{Moving, moving};
use super::outcome::Effect;
use crate::observation::input::Record;

/// Times that clipped samples are filled by a machine fitted to the fill before.
const FILLS: usize = 2;

/// A record mended.
pub struct Mended {
    /// The record without what was found.
    pub record: Record,
    /// The machine fitted to it.
    pub base: Base,
    /// Verdicts.
    pub effects: Vec<Effect>,
    /// The largest gain in chi-square by a verdict.
    pub gain: f64,
}

/// Machine fitted to the runs to fit; as declared where no parameters within tolerance explain them.
pub fn fitted(record: &Record, split: &Split) -> (Base, bool) {
    let mut base = Base::new(record);
    let fitted = base.fit(&split.fit, 2);
    if fitted { (base, true) } else { (Base::new(record), false) }
}

/// Mends the record of `base`; none where nothing distorts it.
pub fn mended(record: &Record, base: &Base, split: &Split) -> Option<Mended> {
    let limits = clipping::limits(record);
    let mut found = clipping::verdict(limits).map(|effect| {
        let mut whole = (filled(record, base, limits), fitted(record, split).0);
        for _ in 0..FILLS {
            whole.1 = fitted(&whole.0, split).0;
            whole.0 = filled(record, &whole.1, limits);
        }
        let all: Vec<usize> = (0..base.runs.len()).collect();
        let gain = chi_square(&base.data(), &all);
        let (record, _) = whole;
        Mended { base: fitted(&record, split).0, record, effects: vec![effect], gain }
    });
    let record = found.as_ref().map_or(record, |m| &m.record).clone();
    let own = |base: &Base| moving(base, &record, &base.data(), &split.held_out);
    // Smeared lines may have led the declared parameters astray: the declaration itself may do better.
    let declared = Base::new(&record);
    let with_fit = own(found.as_ref().map_or(base, |m| &m.base)).map(|m| (m, false));
    let better = |a: (Moving, bool), b: (Moving, bool)| if b.0.gain > a.0.gain { b } else { a };
    let without = own(&declared).map(|m| (m, true));
    let best = match (with_fit, without) {
        (Some(a), Some(b)) => Some(better(a, b)),
        (a, b) => a.or(b),
    };
    if let Some((moving, as_declared)) = best {
        let base = if as_declared { &declared } else { found.as_ref().map_or(base, |m| &m.base) };
        let record = moving.straightened(&record, base);
        let mut effects = found.map_or_else(Vec::new, |m| m.effects);
        effects.push(moving.effect);
        found = Some(Mended { base: fitted(&record, split).0, record, effects, gain: moving.gain });
    }
    found
}
