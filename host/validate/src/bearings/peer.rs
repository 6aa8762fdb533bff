//! A textbook peer: the band with the highest kurtosis, its squared envelope spectrum, and the declared bearing's
//! orders in it.
//!
//! Per channel the first three harmonics of each part are read over the spectrum's own floor, within 2 % of the
//! order; the part with the highest mean logarithm over all channels is named where that is above a threshold
//! (Randall, Antoni 2011, without the separation of deterministic lines).

use super::{Damage, Labelled, Score};
use crate::analysis::angle::Angle;
use crate::analysis::envelope::envelope;
use crate::analysis::search::Level;
use crate::{Error, Result};

/// Mean logarithm of power over the floor from which a part is named: a factor of 10, twice what the highest of some
/// fifty bins of noise has.
const MIN_MEAN_LN_POWER: f64 = 2.303;
/// Slip looked through, share of the order.
const MAX_SLIP_SHARE: f64 = 0.02;

/// What the peer says of a record.
///
/// # Errors
/// A record without a usable tach.
pub fn look(labelled: &Labelled) -> Result<Score> {
    let record = &labelled.record;
    let orders = labelled.bearing.orders()?;
    let run = record.runs.first().ok_or_else(|| Error::invalid(&labelled.name, "has no run"))?;
    let angle = Angle::of(run, record.require_tach()?, [1, 1], &labelled.name)?;
    let mut best = (0.0, Damage::Sound);
    for channel in 0..record.declaration.acquisition.channels.len() {
        let own = envelope(&run.signal_m_s2(channel), run.sample_rate_hz(), &angle).0;
        let Some(level) = own.levels.first() else { continue };
        for damage in [Damage::Outer, Damage::Inner, Damage::Element] {
            let order = damage.order(&orders).unwrap_or(f64::NAN);
            let height = (1..=3).map(|h| highest(level, f64::from(h) * order).max(1.0).ln()).sum::<f64>() / 3.0;
            if height > best.0 {
                best = (height, damage);
            }
        }
    }
    let (height, damage) = if best.0 >= MIN_MEAN_LN_POWER { best } else { (best.0, Damage::Sound) };
    Ok(Score {
        right: damage == labelled.damage && damage != Damage::Sound,
        ring: damage == labelled.damage && damage != Damage::Sound,
        wrong: damage != labelled.damage && damage != Damage::Sound,
        said: format!("{} ({height:.1})", damage.word().unwrap_or("nothing")),
    })
}

/// Highest power over the floor within the slip of an order.
fn highest(level: &Level, order: f64) -> f64 {
    let at = |share: f64| (order * share / level.density.bin).round() as usize;
    let bins = at(1.0 - MAX_SLIP_SHARE)..=at(1.0 + MAX_SLIP_SHARE).min(level.floor.len().saturating_sub(1));
    bins.map(|i| level.density.values[i] / level.floor[i].max(f64::MIN_POSITIVE)).fold(0.0, f64::max)
}
