//! Effects at the limit that the loop itself states for a record.
//!
//! The record without any is made and looped, one of its limits is drawn, and its effect is put into the same scene
//! (machine, layout, kind of noise) at that strength and at twice it, each with another noise, other starts, and
//! another phase, tooth or order. A limit is a promise on a further record of the kind, not on the one it was read
//! from.

use super::{Item, Made, Scored};
use crate::Result;
use crate::effects;
use crate::effects::hypothesis::{Draw, Hidden};
use crate::model_based::Options;
use crate::model_based::limits::Limit;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// Part of the campaign.
pub const PART: &str = "limit";
/// Parts of the records made, with their levels over the limit of the half, and of records for which no limit of any
/// effect that a campaign can hide is stated.
const LEVELS: [(&str, f64); 2] = [("limit-1", 1.0), ("limit-2", 2.0)];
const NONE_STATED: &str = "limit-none";
/// Parts of the last record of a number.
pub const LAST_PARTS: [&str; 2] = [LEVELS[1].0, NONE_STATED];
/// Draws of an effect until one sits where the limit does.
const MOST_DRAWS: usize = 200;

/// Both records of a number; `only`: effects to be hidden, all where empty.
pub fn at_limits(
    made: &Made<'_>,
    number: usize,
    options: &Options,
    only: &[String],
    random: &mut ChaCha8Rng,
) -> Result<Vec<Scored>> {
    let plain = Item { part: NONE_STATED, number, hidden: vec![], level: 0.0 };
    let looped = made.scored(&plain, &[], &Options { limits: true, ..options.clone() })?;
    let Some((scored, outcome)) = looped else { return Ok(Vec::new()) };
    let wanted = |h: &&Hidden| h.has_floor && (only.is_empty() || only.iter().any(|n| n == h.name));
    let mut stated: Vec<(&'static Hidden, &Limit)> = Vec::new();
    for hidden in effects::hidden().filter(wanted) {
        let own = outcome.limits.iter().filter(|l| l.found_in_half.is_some());
        let own = own.filter(|l| hidden.right_names.contains(&l.family.as_str()));
        stated.extend(own.filter(|l| is_possible(made, hidden, l, random)).map(|l| (hidden, l)));
    }
    // Every effect as likely as any other, on whatever it can sit.
    let mut names: Vec<&str> = stated.iter().map(|(h, _)| h.name).collect();
    names.dedup();
    if names.is_empty() {
        return Ok(vec![scored]);
    }
    let name = names[random.random::<u32>() as usize % names.len()];
    stated.retain(|(h, _)| h.name == name);
    let (hidden, limit) = stated[random.random::<u32>() as usize % stated.len()];
    let mut all = Vec::new();
    for (part, level) in LEVELS {
        let mut scenario = made.scenario.clone();
        let strength = level * limit.found_in_half.unwrap_or_default();
        scenario.effects = drawn_at(made, hidden, limit, strength, random).unwrap_or_default();
        scenario.seed = random.random();
        let with = Made { scenario, ..*made };
        let item = Item { part, number, hidden: vec![hidden], level };
        let options = Options { seed: options.seed, ..options.clone() };
        all.extend(with.scored(&item, &[(hidden, strength)], &options)?.map(|(scored, _)| scored));
    }
    Ok(all)
}

/// Whether the campaign can hide the effect where the limit is stated for it, at the highest level.
fn is_possible(made: &Made<'_>, hidden: &Hidden, limit: &Limit, random: &mut ChaCha8Rng) -> bool {
    let highest = LEVELS[1].1 * limit.found_in_half.unwrap_or_default();
    let texts = drawn_at(made, hidden, limit, highest, random);
    texts.is_some_and(|texts| texts.iter().all(|text| effects::parse(text).is_ok()))
}

/// The effect at a strength, drawn where a limit is stated for it; none where it never sits there.
fn drawn_at(
    made: &Made<'_>,
    hidden: &Hidden,
    limit: &Limit,
    strength: f64,
    random: &mut ChaCha8Rng,
) -> Option<Vec<String>> {
    (0..MOST_DRAWS).find_map(|_| {
        let mut draw = Draw { teeth: made.declared.pair.teeth, peak_m_s2: [1.0; 2], random };
        let texts = (hidden.draw)(strength, &mut draw);
        sits_at(texts.first()?, limit, strength).then_some(texts)
    })
}

/// Whether the first effect of a drawing is what the limit is stated for: effect and key of the strength, body or
/// channel.
fn sits_at(text: &str, limit: &Limit, strength: f64) -> bool {
    let Some((name, keys)) = text.split_once(':') else { return false };
    let keys: Vec<(&str, f64)> = keys
        .split(',')
        .filter_map(|pair| pair.split_once('=').and_then(|(key, value)| Some((key, value.parse().ok()?))))
        .collect();
    let value = |key: &str| keys.iter().find(|(k, _)| *k == key).map(|(_, value)| *value);
    let is_strength = limit
        .strength
        .split_once(':')
        .is_some_and(|(effect, key)| effect == name && value(key).is_some_and(|v| (v / strength - 1.0).abs() < 1e-6));
    let is_free = limit.at_order && value("frequency").is_some();
    let is_within = limit.within.is_none_or(|(key, [from, to])| value(key).is_some_and(|v| from <= v && v <= to));
    is_strength && !is_free && is_within && limit.keys.iter().all(|(key, at)| value(key).unwrap_or_default() == *at)
}
