//! An effect at the limit that the loop itself states for a record.
//!
//! The record without it is made and looped, one of the limits is drawn, and its effect is put into the same scene (machine, layout, noise and starts) at that strength, times a
//! level, at another phase, tooth or order. A limit is a promise on a further look at such a record, not on the one it was read from.

use crate::Result;
use crate::closed_loop::generate::{self, Scenario};
use crate::closed_loop::{Options, close_loop};
use crate::effects;
use crate::effects::hypothesis::{Draw, Hidden};
use crate::observation::input::Record;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// Adds an effect at `level` times a stated limit to the scenario; none where no limit is stated.
///
/// # Errors
/// Those of the generator and the loop.
pub fn at_limit(
    declared: &Record,
    scenario: &mut Scenario,
    options: &Options,
    level: f64,
    random: &mut ChaCha8Rng,
) -> Result<Option<(&'static Hidden, f64)>> {
    let plain = generate::record(&declared.pair, &declared.shafts, &declared.curve, scenario)?;
    let outcome = close_loop(&plain, &Options { limits: true, ..options.clone() })?;
    let of = |hidden: &'static Hidden| {
        let stated = |l: &&crate::closed_loop::limits::Limit| {
            hidden.has_floor
                && !hidden.parameter.is_empty()
                && hidden.right_names.first().is_some_and(|name| *name == l.family)
                && l.quantity().starts_with(hidden.parameter)
        };
        outcome.limits.iter().find(stated).and_then(|l| l.found_in_half).map(|strength| (hidden, strength))
    };
    let all: Vec<(&'static Hidden, f64)> = effects::hidden().filter_map(of).collect();
    if all.is_empty() {
        return Ok(None);
    }
    let (hidden, limit) = all[random.random::<u32>() as usize % all.len()];
    let peak = |c: usize| plain.runs.iter().flat_map(|r| &r.channels[c]).fold(0.0_f64, |m, x| m.max(x.abs()));
    let mut draw = Draw { teeth: declared.pair.teeth, peak_m_s2: [0, 1].map(peak), random };
    scenario.effects.extend((hidden.draw)(level * limit, &mut draw));
    // Another noise and other starts of the same kind.
    scenario.seed = scenario.seed.wrapping_add(1);
    Ok(Some((hidden, level * limit)))
}
