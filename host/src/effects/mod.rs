//! The library of effects: what real gears add to the ideal model.
//!
//! One effect per file; its [`Entry`] names it, its parameters with units, ranges and defaults, and builds
//! the [`Effect`]. Adding one means one file here and one line in [`REGISTRY`] (and its `mod` line).

mod backlash;
mod eccentricity;
mod friction;
mod ghost;
mod imbalance;
mod pitch_error;
mod torque_ripple;

use crate::dynamics::Effect;
use crate::{Error, Result};

/// Every known effect.
pub const REGISTRY: &[&Entry] = &[
    &eccentricity::ENTRY,
    &pitch_error::ENTRY,
    &torque_ripple::ENTRY,
    &imbalance::ENTRY,
    &ghost::ENTRY,
    &friction::ENTRY,
    &backlash::ENTRY,
];

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
    /// Parameters.
    pub parameters: &'static [Parameter],
    /// Builds the effect from checked values.
    pub build: fn(&Values) -> Box<dyn Effect>,
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
}

/// Shared parameter of all effects that sit on one gear.
const GEAR: Parameter =
    Parameter { name: "gear", unit: "", default: 0.0, range: [0.0, 1.0], meaning: "0 pinion, 1 gear" };
/// Shared phase parameter.
const PHASE: Parameter =
    Parameter { name: "phase", unit: "rad", default: 0.0, range: [-10.0, 10.0], meaning: "phase at angle or time 0" };

impl Entry {
    /// Builds the effect from given values; missing ones take their defaults.
    ///
    /// # Errors
    /// An unknown parameter, or a value out of its range.
    pub fn with(&self, given: &[(&str, f64)]) -> Result<Box<dyn Effect>> {
        let place = |key: &str| format!("effect {}: {key}", self.name);
        let mut values: Vec<(&'static str, f64)> = self.parameters.iter().map(|p| (p.name, p.default)).collect();
        for &(key, value) in given {
            let Some(index) = self.parameters.iter().position(|p| p.name == key) else {
                let known: Vec<_> = self.parameters.iter().map(|p| p.name).collect();
                return Err(Error::invalid(place(key), format!("is not one of {}", known.join(", "))));
            };
            let [low, high] = self.parameters[index].range;
            if !(value >= low && value <= high) {
                return Err(Error::invalid(place(key), format!("{value} is not within {low} to {high}")));
            }
            values[index].1 = value;
        }
        Ok((self.build)(&Values(values)))
    }
}

/// The entry of a name.
///
/// # Errors
/// An unknown name; the message lists the known ones.
pub fn entry(name: &str) -> Result<&'static Entry> {
    REGISTRY.iter().find(|e| e.name == name).copied().ok_or_else(|| {
        let known: Vec<_> = REGISTRY.iter().map(|e| e.name).collect();
        Error::invalid("effect", format!("`{name}` is not one of {}", known.join(", ")))
    })
}

/// An effect from `name` or `name:key=value,key=value`.
///
/// # Errors
/// Unknown names and keys, values that are no numbers or out of range.
pub fn parse(text: &str) -> Result<Box<dyn Effect>> {
    let (name, list) = text.split_once(':').unwrap_or((text, ""));
    let entry = entry(name.trim())?;
    let mut given = Vec::new();
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
    let mut given = Vec::new();
    for (key, value) in table {
        let number = value.as_float().or(value.as_integer().map(|i| i as f64));
        let number = number
            .ok_or_else(|| Error::invalid(format!("effect {name}: {key}"), format!("{value} is not a number")))?;
        given.push((key.as_str(), number));
    }
    entry(name)?.with(&given)
}
