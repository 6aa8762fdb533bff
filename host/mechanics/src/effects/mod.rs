//! The library of effects: what real gears add to the ideal model.
//!
//! One effect per file; its [`Entry`] names it, its parameters with units, ranges and defaults, and builds
//! the [`Effect`]; beside them stand what the loop looks for and what a campaign hides ([`hypothesis`]). Adding one
//! means one file here and one line in [`REGISTRY`] (and its `mod` line).

mod aliasing;
mod backlash;
mod bearing_impacts;
mod bearing_stiffness_modulation;
mod casing_resonance;
pub mod catalogue;
mod clipping;
mod coupling_misalignment;
mod eccentricity;
mod echo;
mod filter;
mod fixed_tone;
mod friction;
mod ghost_order;
pub mod hypothesis;
mod imbalance;
mod load_fluctuation;
mod mains_hum;
mod mesh_stiffness_modulation;
mod noise;
mod pitch_error;
mod profile_error;
mod quantisation;
mod sensor_nonlinearity;
mod sensor_resonance;
mod speed_fluctuation;
mod stiffness_drift;
mod thermal_drift;
mod tip_relief;
mod tooth_crack;
mod torque_ripple;
mod transfer_path;
mod transfer_path_resonance;
mod wear;
mod wobble;

use crate::dynamics::Effect;
use crate::dynamics::excitation::Facts;
use crate::{Error, Result};
use hypothesis::{Hidden, Hypothesis};
use rand_chacha::ChaCha12Rng;
use rand_chacha::rand_core::SeedableRng;

/// Every known effect; those of the measuring chain are applied in the order the caller gives them. Of effects with
/// the same seat the first describes what stands elsewhere than at its own place.
pub const REGISTRY: &[&Entry] = &[
    &eccentricity::ENTRY,
    &pitch_error::ENTRY,
    &profile_error::ENTRY,
    &tip_relief::ENTRY,
    &wear::ENTRY,
    &ghost_order::ENTRY,
    &tooth_crack::ENTRY,
    &mesh_stiffness_modulation::ENTRY,
    &wobble::ENTRY,
    &stiffness_drift::ENTRY,
    &friction::ENTRY,
    &backlash::ENTRY,
    &imbalance::ENTRY,
    &torque_ripple::ENTRY,
    &load_fluctuation::ENTRY,
    &coupling_misalignment::ENTRY,
    &bearing_stiffness_modulation::ENTRY,
    &bearing_impacts::ENTRY,
    &speed_fluctuation::ENTRY,
    &casing_resonance::ENTRY,
    &transfer_path_resonance::ENTRY,
    &transfer_path::ENTRY,
    &echo::ENTRY,
    &sensor_resonance::ENTRY,
    &sensor_nonlinearity::ENTRY,
    &clipping::ENTRY,
    &thermal_drift::ENTRY,
    &mains_hum::ENTRY,
    &fixed_tone::ENTRY,
    &noise::ENTRY,
    &aliasing::ENTRY,
    &quantisation::ENTRY,
];

/// Other names of entries.
const ALIASES: [(&str, &str); 2] = [("ghost", "ghost-order"), ("tone", "fixed-tone")];

/// One parameter of an effect.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameter {
    /// Key.
    pub name: &'static str,
    /// Unit, empty for pure numbers.
    pub unit: &'static str,
    /// Value where none is given.
    pub default: f64,
    /// Least and largest sensible value.
    pub range: [f64; 2],
    /// What it is.
    pub meaning: &'static str,
}

/// An effect's description and constructor.
pub struct Entry {
    /// Name used on the command line and in files.
    pub name: &'static str,
    /// One sentence.
    pub meaning: &'static str,
    /// Where it shows and how it depends on speed and torque, as the tests prove it.
    pub signature: &'static str,
    /// Values of the picture in the documentation, as `key=value,...`.
    pub example: &'static str,
    /// Highest frequency of that picture, Hz.
    pub span_hz: f64,
    /// Parameters.
    pub parameters: &'static [Parameter],
    /// Builds the effect from checked values.
    pub build: fn(&Values) -> Box<dyn Effect>,
    /// What the loop looks for, if it looks for it.
    pub hypotheses: &'static [Hypothesis],
    /// What a campaign hides.
    pub hidden: &'static [Hidden],
}

/// Everything that the loop looks for.
pub fn hypotheses() -> impl Iterator<Item = &'static Hypothesis> {
    REGISTRY.iter().flat_map(|entry| entry.hypotheses)
}

/// Everything that a campaign hides, in the order it cycles through them.
pub fn hidden() -> impl Iterator<Item = &'static Hidden> {
    REGISTRY.iter().flat_map(|entry| entry.hidden)
}

/// The effect of a table that a hypothesis carries to.
///
/// # Errors
/// As [`parse`].
pub fn of_table((name, keys): &hypothesis::Table) -> Result<Box<dyn Effect>> {
    entry(name)?.with(keys)
}

/// Checked parameter values of one effect.
#[derive(Debug, Clone)]
pub struct Values(Vec<(&'static str, f64)>);

impl Values {
    /// Value of a parameter.
    ///
    /// # Panics
    /// For a name the effect's entry does not list: a programming error of the effect.
    pub fn get(&self, name: &str) -> f64 {
        self.0.iter().find(|(n, _)| *n == name).map(|(_, v)| *v).expect("a listed parameter")
    }

    /// A gear index: 0 pinion, 1 gear.
    pub fn body(&self) -> usize {
        usize::from(self.get("gear") >= 0.5)
    }

    /// The channels meant.
    fn channels(&self) -> std::ops::Range<usize> {
        match self.get("channel") {
            c if c < 0.5 => 0..1,
            c if c < 1.5 => 1..2,
            _ => 0..2,
        }
    }
}

/// A parameter in one line.
const fn parameter(
    name: &'static str,
    unit: &'static str,
    default: f64,
    range: [f64; 2],
    meaning: &'static str,
) -> Parameter {
    Parameter { name, unit, default, range, meaning }
}

/// Shared parameter of all effects that sit on one gear.
const GEAR: Parameter = parameter("gear", "", 0.0, [0.0, 1.0], "0 pinion, 1 gear");
/// Shared phase parameter.
const PHASE: Parameter = parameter("phase", "rad", 0.0, [-10.0, 10.0], "phase at angle or time 0");
/// Shared parameter of effects on one tooth.
const TOOTH: Parameter = parameter("tooth", "", 0.0, [0.0, 999.0], "which tooth, counted from that of pair 0");
/// Shared parameter of all effects in the measuring chain.
const CHANNEL: Parameter = parameter("channel", "", 2.0, [0.0, 2.0], "0 or 1; 2: both");

/// Parameters that count or number something: fractions of them mean nothing.
const INTEGER_KEYS: [&str; 5] = ["gear", "tooth", "channel", "seed", "exponent"];

/// Effects that change nothing unless one of these parameters is other than zero.
const NONZERO_KEYS: [(&str, [&str; 2]); 4] = [
    ("torque-ripple", ["order", "frequency"]),
    ("load-fluctuation", ["order", "frequency"]),
    ("speed-fluctuation", ["order", "frequency"]),
    ("pitch-error", ["single", "random"]),
];

/// Refuses a tooth that the gear does not have; `name` is the effect's.
fn check_tooth(name: &str, tooth: u32, body: usize, facts: &Facts) -> Result<()> {
    let teeth = facts.teeth[body];
    if tooth < teeth {
        return Ok(());
    }
    let what = format!("{tooth} on a {} with teeth 0 to {}", ["pinion", "gear"][body], teeth - 1);
    Err(Error::invalid(format!("effect {name}: tooth"), what))
}

/// The random stream of one effect in one run.
fn random(seed: u64, effect: u64) -> ChaCha12Rng {
    let mut random = ChaCha12Rng::seed_from_u64(seed);
    random.set_stream(effect);
    random
}

impl Entry {
    /// Builds the effect from given values; missing ones take their defaults.
    ///
    /// # Errors
    /// An unknown parameter, one given twice with different values, a value out of its range or a fraction where a
    /// number is counted, and values with which the effect changes nothing.
    pub fn with(&self, given: &[(&str, f64)]) -> Result<Box<dyn Effect>> {
        let place = |key: &str| format!("effect {}: {key}", self.name);
        let mut values: Vec<(&'static str, f64)> = self.parameters.iter().map(|p| (p.name, p.default)).collect();
        for (i, &(key, value)) in given.iter().enumerate() {
            let Some(index) = self.parameters.iter().position(|p| p.name == key) else {
                let known: Vec<_> = self.parameters.iter().map(|p| p.name).collect();
                return Err(Error::invalid(place(key), format!("is not one of {}", known.join(", "))));
            };
            let [low, high] = self.parameters[index].range;
            if !(value >= low && value <= high) {
                return Err(Error::invalid(place(key), format!("{value} is not within {low} to {high}")));
            }
            if INTEGER_KEYS.contains(&key) && value.fract() != 0.0 {
                return Err(Error::invalid(place(key), format!("{value} is not a whole number")));
            }
            if let Some((_, before)) = given[..i].iter().find(|(other, before)| *other == key && *before != value) {
                let what = format!("{value} contradicts {before}, which the name or the same key says before");
                return Err(Error::invalid(place(key), what));
            }
            values[index].1 = value;
        }
        let is_zero = |name: &str| values.iter().any(|(n, v)| *n == name && *v == 0.0);
        if let Some((_, needed)) =
            NONZERO_KEYS.iter().find(|(name, needed)| *name == self.name && needed.iter().all(|n| is_zero(n)))
        {
            let what = format!("and {} are both 0, so that the effect changes nothing; give one of them", needed[1]);
            return Err(Error::invalid(place(needed[0]), what));
        }
        Ok((self.build)(&Values(values)))
    }
}

/// The entry of a name; `pinion-` or `gear-` before the name of an effect on one gear chooses the gear.
///
/// # Errors
/// An unknown name; the message lists the known ones.
pub fn entry(name: &str) -> Result<&'static Entry> {
    resolve(name).map(|(entry, _)| entry)
}

/// The entry of a name, and the gear the name chooses.
fn resolve(name: &str) -> Result<(&'static Entry, Option<f64>)> {
    let known = |name: &str| {
        let name = ALIASES.iter().find(|(alias, _)| *alias == name).map_or(name, |(_, entry)| entry);
        REGISTRY.iter().find(|e| e.name == name).copied()
    };
    let on_gear = |prefix: &str, gear: f64| {
        let entry = known(name.strip_prefix(prefix)?)?;
        entry.parameters.iter().any(|p| p.name == GEAR.name).then_some((entry, Some(gear)))
    };
    let found = known(name).map(|entry| (entry, None));
    found.or_else(|| on_gear("pinion-", 0.0)).or_else(|| on_gear("gear-", 1.0)).ok_or_else(|| {
        let near = nearest(name).join(", ");
        let what = format!("`{}` is no effect; nearest: {near}; `meshband effects` lists all", crate::text::name(name));
        Error::invalid("effect", what)
    })
}

/// Names of the library that share most with a name that is none: first by whole words, then by letters at both ends.
fn nearest(name: &str) -> Vec<&'static str> {
    /// Names given.
    const MAX_NAMES: usize = 3;
    let words = |of: &str| of.split(['-', '_', ' ']).map(str::to_owned).collect::<Vec<_>>();
    let own = words(name);
    let shared = |other: &str| {
        let whole = words(other).iter().filter(|word| own.contains(word)).count();
        let front = other.bytes().zip(name.bytes()).take_while(|(a, b)| a == b).count();
        let back = other.bytes().rev().zip(name.bytes().rev()).take_while(|(a, b)| a == b).count();
        (whole, front + back)
    };
    let mut names: Vec<&str> = REGISTRY.iter().map(|entry| entry.name).collect();
    names.sort_by_key(|other| std::cmp::Reverse(shared(other)));
    names.truncate(MAX_NAMES);
    names
}

/// An effect from `name` or `name:key=value,key=value`.
///
/// # Errors
/// Unknown names and keys, values that are no numbers or out of range.
pub fn parse(text: &str) -> Result<Box<dyn Effect>> {
    let (name, list) = text.split_once(':').unwrap_or((text, ""));
    let (entry, gear) = resolve(name.trim())?;
    let mut given: Vec<(&str, f64)> = gear.map(|gear| (GEAR.name, gear)).into_iter().collect();
    for item in list.split(',').filter(|item| !item.trim().is_empty()) {
        let refuse = || Error::invalid(format!("effect {name}"), format!("`{item}` is not key=number"));
        let (key, value) = item.split_once('=').ok_or_else(refuse)?;
        given.push((key.trim(), value.trim().parse().map_err(|_| refuse())?));
    }
    entry.with(&given)
}

/// An effect from a table of numbers (`[effect.name]` in TOML).
///
/// # Errors
/// As [`parse`].
pub fn from_table(name: &str, table: &toml::Table) -> Result<Box<dyn Effect>> {
    let (entry, gear) = resolve(name)?;
    let mut given: Vec<(&str, f64)> = gear.map(|gear| (GEAR.name, gear)).into_iter().collect();
    for (key, value) in table {
        let number = value.as_float().or(value.as_integer().map(|i| i as f64));
        let number = number
            .ok_or_else(|| Error::invalid(format!("effect {name}: {key}"), format!("{value} is not a number")))?;
        given.push((key.as_str(), number));
    }
    entry.with(&given)
}

fn table_of(path: &std::path::Path) -> Result<toml::Table> {
    let text = crate::budget::read_text(path)?;
    text.parse().map_err(|e: toml::de::Error| Error::invalid(path.display(), e.message()))
}

/// Effects of a file: `[[effect]]` tables with `name` and the effect's keys, as `meshband loop --apply` writes them.
///
/// # Errors
/// An unreadable file, a table without a name, and as [`parse`].
pub fn read(path: &std::path::Path) -> Result<Vec<Box<dyn Effect>>> {
    let whole = table_of(path)?;
    let refuse = |what: &str| Error::invalid(path.display(), what);
    let list =
        whole.get("effect").map(|list| list.as_array().ok_or_else(|| refuse("`effect` must be [[effect]] tables")));
    let Some(list) = list.transpose()? else { return Ok(Vec::new()) };
    list.iter()
        .map(|entry| {
            let mut table = entry.as_table().ok_or_else(|| refuse("`effect` must be [[effect]] tables"))?.clone();
            let name = table.remove("name");
            let name =
                name.as_ref().and_then(toml::Value::as_str).ok_or_else(|| refuse("[[effect]]: `name` is missing"))?;
            from_table(name, &table)
        })
        .collect()
}

/// Factor on every declared torque that such a file states (`torque_factor`, 1 where absent): torque meters are off
/// by a share, too.
///
/// # Errors
/// An unreadable file, a factor that is not within 0.5 to 2.
pub fn read_torque_factor(path: &std::path::Path) -> Result<f64> {
    let whole = table_of(path)?;
    let Some(value) = whole.get("torque_factor") else { return Ok(1.0) };
    let factor = value.as_float().or(value.as_integer().map(|i| i as f64)).filter(|f| (0.5..=2.0).contains(f));
    factor.ok_or_else(|| Error::invalid(format!("{}: torque_factor", path.display()), "must lie between 0.5 and 2"))
}

/// Turns of the pinion by which every run of a record starts later than its pulse 0 says (`pinion_turns`, empty where
/// absent): what teeth and phases of the gear hold with.
///
/// # Errors
/// An unreadable file, values that are no whole numbers from 0 to 100 000.
pub fn read_pinion_turns(path: &std::path::Path) -> Result<Vec<u32>> {
    let whole = table_of(path)?;
    let Some(value) = whole.get("pinion_turns") else { return Ok(Vec::new()) };
    let turns = |v: &toml::Value| v.as_integer().and_then(|k| u32::try_from(k).ok()).filter(|k| *k <= 100_000);
    let list: Option<Vec<u32>> = value.as_array().and_then(|list| list.iter().map(turns).collect());
    list.ok_or_else(|| {
        Error::invalid(format!("{}: pinion_turns", path.display()), "must be a list of whole numbers from 0 to 100000")
    })
}
