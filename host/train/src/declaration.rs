//! What the owner states of a gear train: `[[stage]]` and what hangs on its shafts, in machine files, `train.toml`
//! and records.
//!
//! Shaft 0 is the first stage's input; shaft `n` is the output of stage `n`, counted from 1 as in tables and refusals.
//! A stage takes the shaft before it, or the one that `from` names (parallel branches). Unknown keys are refused;
//! every refusal names table and key.

use crate::{Error, Result};
use serde::{Deserialize, Serialize};
use std::path::Path;
use toml::{Table, Value};

/// Tooth counts of any gear.
pub const TEETH: std::ops::RangeInclusive<u32> = 5..=1000;
/// Most stages of a train.
pub const MOST_STAGES: usize = 8;
/// Planets of a set.
const PLANETS: std::ops::RangeInclusive<u32> = 1..=12;
/// Helix angles, degrees either way.
const STEEPEST_HELIX_DEG: f64 = 45.0;
/// Slip of a belt, share of its speed.
const SLIPS: std::ops::Range<f64> = 0.0..0.1;
/// Diameters of pulleys and lengths of belts, mm.
const BELTS_MM: std::ops::RangeInclusive<f64> = 1.0..=100_000.0;

/// One member of a planetary set.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Member {
    /// The sun.
    Sun,
    /// The ring.
    Ring,
    /// The carrier of the planets.
    Carrier,
}

/// One stage.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase", deny_unknown_fields)]
pub enum Stage {
    /// Two gears on parallel shafts, with idlers between them where there are any.
    Pair {
        /// Teeth of driver and driven gear.
        teeth: [u32; 2],
        /// Helix angle, degrees; 0 is spur.
        #[serde(default)]
        helix_angle_deg: f64,
        /// Teeth of the gears between the two, from the driver on.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        idlers: Vec<u32>,
        /// Whether the driven gear has its teeth inside.
        #[serde(default, skip_serializing_if = "is_false")]
        internal: bool,
        /// Driving shaft; the output of the stage before where absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        from: Option<usize>,
    },
    /// A planetary set.
    Planetary {
        /// Teeth of the sun.
        sun: u32,
        /// Teeth of a planet.
        planet: u32,
        /// Teeth of the ring.
        ring: u32,
        /// Number of planets.
        planets: u32,
        /// Member that stands still.
        fixed: Member,
        /// Member that is driven.
        input: Member,
        /// Places of the planets on the carrier, degrees; evenly spaced where absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        spacing_deg: Option<Vec<f64>>,
        /// Helix angle, degrees; 0 is spur.
        #[serde(default)]
        helix_angle_deg: f64,
        /// Driving shaft; the output of the stage before where absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        from: Option<usize>,
    },
    /// A belt, whose slip makes everything behind it inexact.
    Belt {
        /// Effective diameters of driving and driven pulley, mm.
        pulleys_mm: [f64; 2],
        /// Share of the speed that is lost.
        #[serde(default)]
        slip: f64,
        /// Length of the belt, mm, where its own passage is asked for.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        length_mm: Option<f64>,
        /// Driving shaft; the output of the stage before where absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        from: Option<usize>,
    },
}

fn is_false(value: &bool) -> bool {
    !value
}

/// `[[coupling]]`: what joins two halves of one shaft.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Coupling {
    /// Its shaft.
    pub shaft: usize,
    /// Jaws or elements, which pass once per turn each.
    #[serde(default)]
    pub elements: Option<u32>,
}

/// `[motor]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Motor {
    /// Its shaft.
    #[serde(default)]
    pub shaft: usize,
    /// Pole pairs.
    #[serde(default)]
    pub pole_pairs: Option<u32>,
    /// Bars of the rotor.
    #[serde(default)]
    pub rotor_bars: Option<u32>,
}

/// `[driven]`: fan, pump, mixer.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Driven {
    /// Its shaft; the last one where absent.
    #[serde(default)]
    pub shaft: Option<usize>,
    /// Blades or vanes.
    #[serde(default)]
    pub blades: Option<u32>,
}

/// `[tach]` or one of several `[[tach]]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainTach {
    /// Its shaft.
    pub shaft: usize,
    /// Pulses per turn of that shaft.
    pub pulses_per_turn: u32,
    /// Channel or file of its signal, as `import --tach` takes it.
    #[serde(default)]
    pub source: Option<String>,
}

/// A declared train.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Declaration {
    /// Title, empty where none is given.
    pub title: String,
    /// The stages.
    pub stages: Vec<Stage>,
    /// Tachometers, the reference first.
    pub tachs: Vec<TrainTach>,
    /// Bearings by shaft, as their own type reads them.
    pub bearings: Vec<Table>,
    /// Couplings.
    pub couplings: Vec<Coupling>,
    /// Motor.
    pub motor: Option<Motor>,
    /// What is driven.
    pub driven: Option<Driven>,
}

/// Tables of a train.
const KEYS: [&str; 7] = ["title", "stage", "tach", "bearing", "coupling", "motor", "driven"];
/// Of these, what a record keeps under the same names.
pub const RECORD_KEYS: [&str; 5] = ["stage", "bearing", "coupling", "motor", "driven"];

impl Declaration {
    /// Reads and checks a file.
    ///
    /// # Errors
    /// One line with file, table and key.
    pub fn read(path: &Path) -> Result<Self> {
        Self::parse(&crate::budget::read_text(path)?, &path.display().to_string())
    }

    /// [`Declaration::read`] of text; `place` names it.
    ///
    /// # Errors
    /// As [`Declaration::read`].
    pub fn parse(text: &str, place: &str) -> Result<Self> {
        let table: Table = toml::from_str(text).map_err(|error| {
            let line = error.span().map_or(0, |span| text[..span.start.min(text.len())].lines().count().max(1));
            Error::invalid(format!("{place}:{line}"), crate::text::one_line(error.message()))
        })?;
        check_form(&table, place)?;
        if let Some(key) = table.keys().find(|key| !KEYS.contains(&key.as_str())) {
            let what = format!("unknown table or key; a train has {}", KEYS.join(", "));
            return Err(Error::invalid(format!("{place} {}", crate::text::name(key)), what));
        }
        Self::of_table(&table, place)
    }

    /// A declaration from the tables of a file or record.
    ///
    /// # Errors
    /// As [`Declaration::read`].
    pub fn of_table(table: &Table, place: &str) -> Result<Self> {
        check_form(table, place)?;
        let declaration = Self {
            title: table.get("title").and_then(Value::as_str).unwrap_or_default().to_owned(),
            stages: list(table, place, "stage")?,
            tachs: list(table, place, "tach")?,
            bearings: list(table, place, "bearing")?,
            couplings: list(table, place, "coupling")?,
            motor: list(table, place, "motor")?.pop(),
            driven: list(table, place, "driven")?.pop(),
        };
        declaration.check(place)?;
        Ok(declaration)
    }

    /// The tables that a record keeps.
    ///
    /// # Errors
    /// A number that TOML cannot hold.
    pub fn tables(&self) -> Result<Table> {
        let refuse = |error: toml::ser::Error| Error::invalid("train", crate::text::one_line(&error.to_string()));
        let mut table = Table::new();
        let mut put = |key: &str, value: Value| {
            let is_empty = value.as_array().is_some_and(Vec::is_empty);
            if !is_empty {
                table.insert(key.into(), value);
            }
        };
        put("stage", Value::try_from(&self.stages).map_err(refuse)?);
        put("bearing", Value::try_from(&self.bearings).map_err(refuse)?);
        put("coupling", Value::try_from(&self.couplings).map_err(refuse)?);
        if let Some(motor) = &self.motor {
            put("motor", Value::try_from(motor).map_err(refuse)?);
        }
        if let Some(driven) = &self.driven {
            put("driven", Value::try_from(driven).map_err(refuse)?);
        }
        Ok(table)
    }

    /// Number of shafts: the input and one per stage.
    pub fn shafts(&self) -> usize {
        self.stages.len() + 1
    }

    /// Tooth counts where the train is one plain pair: such a record is a pair's.
    pub fn as_pair(&self) -> Option<[u32; 2]> {
        match self.stages.as_slice() {
            [Stage::Pair { teeth, idlers, .. }] if idlers.is_empty() => Some(*teeth),
            _ => None,
        }
    }

    fn check(&self, place: &str) -> Result<()> {
        if self.stages.is_empty() {
            return Err(Error::invalid(place, "has no [[stage]]; a train needs at least one"));
        }
        if self.stages.len() > MOST_STAGES {
            let what = format!("{} stages, at most {MOST_STAGES} are taken", self.stages.len());
            return Err(Error::invalid(format!("{place} [[stage]]"), what));
        }
        for (i, stage) in self.stages.iter().enumerate() {
            stage.check(i, &format!("{place} [[stage]] {}", i + 1))?;
        }
        for (i, tach) in self.tachs.iter().enumerate() {
            let own = format!("{place} [tach] {}", i + 1);
            self.check_shaft(&own, tach.shaft)?;
            if !(1..=10_000).contains(&tach.pulses_per_turn) {
                let what = format!("{} is not within 1 to 10000", tach.pulses_per_turn);
                return Err(Error::invalid(format!("{own} pulses_per_turn"), what));
            }
        }
        let counts = [
            ("[motor] pole_pairs", self.motor.as_ref().and_then(|m| m.pole_pairs)),
            ("[motor] rotor_bars", self.motor.as_ref().and_then(|m| m.rotor_bars)),
            ("[driven] blades", self.driven.as_ref().and_then(|d| d.blades)),
        ];
        for (key, count) in counts {
            if let Some(count) = count.filter(|count| !(1..=1000).contains(count)) {
                return Err(Error::invalid(format!("{place} {key}"), format!("{count} is not within 1 to 1000")));
            }
        }
        for (i, coupling) in self.couplings.iter().enumerate() {
            self.check_shaft(&format!("{place} [[coupling]] {}", i + 1), coupling.shaft)?;
        }
        let others = self.motor.as_ref().map(|m| ("[motor]", m.shaft)).into_iter();
        let driven = self.driven.as_ref().and_then(|d| d.shaft).map(|shaft| ("[driven]", shaft));
        others.chain(driven).try_for_each(|(key, shaft)| self.check_shaft(&format!("{place} {key}"), shaft))?;
        Ok(())
    }

    fn check_shaft(&self, place: &str, shaft: usize) -> Result<()> {
        if shaft < self.shafts() {
            return Ok(());
        }
        let what = format!("{shaft} is no shaft; they are 0 (input) to {} (output)", self.shafts() - 1);
        Err(Error::invalid(format!("{place} shaft"), what))
    }
}

/// Refuses stages in a form that TOML knows and a train does not have.
fn check_form(table: &Table, place: &str) -> Result<()> {
    let refuse = |key: &str, what: &str| Err(Error::invalid(format!("{place} {key}"), what));
    if table.get("stage").is_some_and(Value::is_table) {
        return refuse("[stage]", "stages are a list, be it of one; write [[stage]]");
    }
    if table.contains_key("stages") {
        return refuse("stages", "unknown table; write [[stage]] above every stage");
    }
    Ok(())
}

/// A table or an array of tables, typed.
fn list<T: serde::de::DeserializeOwned>(table: &Table, place: &str, key: &str) -> Result<Vec<T>> {
    let values = match table.get(key) {
        None => return Ok(Vec::new()),
        Some(Value::Array(values)) => values.clone(),
        Some(value) => vec![value.clone()],
    };
    let typed = |(i, value): (usize, Value)| {
        value.try_into().map_err(|error: toml::de::Error| {
            Error::invalid(format!("{place} [[{key}]] {}", i + 1), crate::text::one_line(error.message()))
        })
    };
    values.into_iter().enumerate().map(typed).collect()
}

impl Stage {
    /// Shaft that drives stage `index`.
    pub fn driven_from(&self, index: usize) -> usize {
        let (Self::Pair { from, .. } | Self::Planetary { from, .. } | Self::Belt { from, .. }) = self;
        from.unwrap_or(index)
    }

    fn check(&self, index: usize, place: &str) -> Result<()> {
        let refuse = |key: &str, what: String| Err(Error::invalid(format!("{place} {key}"), what));
        if self.driven_from(index) > index {
            let what = format!("{} is no shaft before this stage (0 to {index})", self.driven_from(index));
            return refuse("from", what);
        }
        let teeth = |key: &str, counts: &[u32]| match counts.iter().find(|z| !TEETH.contains(*z)) {
            Some(z) => refuse(key, format!("{z} is no tooth count (5 to 1000)")),
            None => Ok(()),
        };
        match self {
            Self::Pair { teeth: own, helix_angle_deg, idlers, internal, .. } => {
                teeth("teeth", own)?;
                teeth("idlers", idlers)?;
                if *internal && own[1] <= own[0] {
                    return refuse("internal", format!("a ring of {} teeth cannot hold {}", own[1], own[0]));
                }
                check_helix(*helix_angle_deg, place)
            }
            Self::Planetary { sun, planet, ring, planets, fixed, input, spacing_deg, helix_angle_deg, .. } => {
                teeth("sun", &[*sun])?;
                teeth("planet", &[*planet])?;
                teeth("ring", &[*ring])?;
                if !PLANETS.contains(planets) {
                    return refuse("planets", format!("{planets} is not within 1 to 12"));
                }
                if fixed == input {
                    return refuse("input", "the member that stands still cannot be driven".into());
                }
                if *ring < sun + planet {
                    return refuse("ring", format!("{ring} teeth do not reach around sun {sun} and planet {planet}"));
                }
                if let Some(spacing) = spacing_deg
                    && (spacing.len() != *planets as usize || spacing.iter().any(|s| !s.is_finite()))
                {
                    return refuse("spacing_deg", format!("needs one angle for each of {planets} planets"));
                }
                check_helix(*helix_angle_deg, place)
            }
            Self::Belt { pulleys_mm, slip, length_mm, .. } => {
                let lengths = pulleys_mm.iter().chain(length_mm);
                if let Some(mm) = lengths.into_iter().find(|mm| !BELTS_MM.contains(*mm)) {
                    return refuse("pulleys_mm, length_mm", format!("{mm} mm is not within 1 to 100000"));
                }
                if !SLIPS.contains(slip) {
                    return refuse("slip", format!("{slip} is not within 0 to 0.1 of the speed"));
                }
                Ok(())
            }
        }
    }
}

fn check_helix(degrees: f64, place: &str) -> Result<()> {
    if degrees.abs() <= STEEPEST_HELIX_DEG {
        return Ok(());
    }
    Err(Error::invalid(format!("{place} helix_angle_deg"), format!("{degrees} is not within -45 to 45")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fault_stages_are_counted_from_one_and_wrong_forms_have_a_remedy() {
        let refused = |text: &str| Declaration::parse(text, "t.toml").expect_err("refused").to_string();
        let pair = "kind = \"pair\"\nteeth = [20, 40]\n";
        let bad = "kind = \"pair\"\nteeth = [2, 40]\n";
        for (text, words) in [
            (format!("[[stage]]\n{bad}"), "[[stage]] 1 teeth"),
            (format!("[[stage]]\n{pair}[[stage]]\n{bad}"), "[[stage]] 2 teeth"),
            (format!("[[stage]]\n{pair}[[stage]]\nkind = \"worm\"\n"), "[[stage]] 2"),
            (format!("[stage]\n{pair}"), "write [[stage]]"),
            (format!("[[stages]]\n{pair}"), "write [[stage]]"),
        ] {
            let error = refused(&text);
            assert!(error.contains(words) && error.contains("t.toml"), "{words} in {error}");
        }
    }
}
