//! A node's settings from a TOML file: the tables and keys of `meshband::config::Configuration`, as many as are to
//! change.
//!
//! ```toml
//! policy = "Spectrum"              # or [policy.Waveform] multiple = 8.0, or "Critical"
//! velocity_from = 2.0              # Hz, lower edge of the velocity's band; 0 for 10
//! [tach]
//! pulses_per_turn = 60
//! missing = 2
//! [sensor]
//! acceleration_per_code = 0.00494  # m/s^2
//! [limits]
//! analogue_stop = 100000.0         # Hz
//! [front_end]
//! tach_edge = "Falling"            # or "Rising"
//! gain = "X4"                      # X1, X2, X4, X5, X8, X10, X16, X32
//! sensor_supply = "On"             # or "Off"
//! [[alarms]]                       # the list replaces the node's
//! watched = "Rms"
//! from = 5.0                       # Hz of the pinion
//! to = 25.0
//! raise = 12.0
//! clear = 10.0
//! persistence = 3
//! [holding]                        # of all alarms
//! latching = true
//! persistence_s = 2.0              # s
//! watch_signal = true
//! [[modes]]                        # of the alarms, in their order; a missing one is an upper limit, a danger
//! side = "Above"                   # or "Below", "Rise"
//! severity = "Danger"              # or "Alert": told and shown, the output stays
//! [range]                          # codes between which the front end does not clip; 0 for 2.5 % from either end
//! lowest = 1638
//! highest = 63897
//! [sensor_check]                   # when the sensor is in order
//! bias_v = [8.0, 14.0]             # V at the sensor, by a divider into PA4
//! bias_divider = 5.7
//! floor = 0.05                     # m/s^2 RMS while the shaft turns
//! output = "Own"                   # or "WithAlarm"
//! [pass]
//! analogue = 40000.0               # Hz, 0 for not declared
//! [link]                           # from the node's next start on
//! personality = "Modbus"           # or "Meshband"
//! address = 17
//! [capture]                        # waveforms for alarms
//! keep = "Fixed"                   # or "Law", "Off"
//! rate = 10000.0                   # Hz
//! [second]                         # a second accelerometer; second = "None" takes it away
//! acceleration_per_code = 0.00494  # m/s^2
//! band = 10000.0                   # Hz, 0 for not declared
//! [[train]]                        # further gears that are followed; `configure --train` writes them
//! stage = 2
//! teeth = 19
//! mate_teeth = 77
//! turns = 21                       # of it in so many turns of the pinion:
//! pinion_turns = 83
//! ```
//!
//! The file is read onto the configuration in force, so what it does not name stays. A key that no node has, a value of
//! another kind and a number that is not finite are refused with their table and key; ranges are the node's business
//! ([`Configuration::validate`]). The law comes from a law file, never from here.

use crate::{Error, Result};
use meshband::alarm::{AlarmBand, AlarmMode};
use meshband::config::{Configuration, SecondSensor, StageLaw, TrainGear};
use meshband::levels::{LevelPoint, LocalPoint};
use meshband::rate_plan::RatePolicy;
use serde::de::DeserializeOwned;
use serde_json::{Map, Value};
use std::path::Path;

/// Settings read from a file and not yet applied.
#[derive(Clone, Debug)]
pub struct Settings {
    place: String,
    tables: Map<String, Value>,
}

impl Settings {
    /// Reads a file.
    ///
    /// # Errors
    /// A file that cannot be read or is no TOML, an unknown table or key, a value that is not finite or of another
    /// kind.
    pub fn read(path: &Path) -> Result<Self> {
        let text = crate::budget::read_text(path)?;
        Self::from_toml(&text, &path.display().to_string())
    }

    /// Reads TOML text; `place` names it in errors.
    ///
    /// # Errors
    /// As [`Settings::read`].
    pub fn from_toml(text: &str, place: &str) -> Result<Self> {
        let table: toml::Table = text.parse().map_err(|error: toml::de::Error| {
            let line = error.span().map_or(1, |span| text[..span.start.min(text.len())].lines().count().max(1));
            Error::invalid(format!("{place}, line {line}"), error.message().replace('\n', " "))
        })?;
        let mut tables = Map::new();
        for (key, value) in table {
            tables.insert(key.clone(), finite(value, &key, place)?);
        }
        let settings = Self { place: place.into(), tables };
        // Any configuration shows whether keys and kinds are right.
        settings.apply(&mut Configuration::default())?;
        Ok(settings)
    }

    /// Changes what the file names.
    ///
    /// # Errors
    /// As [`Settings::read`].
    pub fn apply(&self, config: &mut Configuration) -> Result<()> {
        let refuse = |key: &str, what: String| Error::invalid(format!("{}: {key}", self.place), what);
        let mut whole = serde_json::to_value(&*config).map_err(|e| Error::invalid("configuration", e))?;
        for (key, new) in &self.tables {
            if key == "second" {
                whole[key] = second(&whole[key], new).map_err(|what| refuse(key, what))?;
            }
            match (key.as_str(), whole.get_mut(key), new) {
                ("schema" | "law" | "latched" | "sensor_latched", ..) | (_, None, _) => {
                    let known = "gears, tach, sensor, limits, policy, mesh, alarms, modes, front_end, holding, range, \
                        sensor_check, velocity_from, pass, levels, local_levels, link, capture, second, train, \
                        stage_laws, alarm_gears";
                    return Err(refuse(key, format!("not a table of a node's settings: {known}")));
                }
                ("second", Some(Value::Null), _) => {}
                ("policy", Some(held), new) => {
                    read::<RatePolicy>(new).map_err(|what| refuse(key, what))?;
                    *held = new.clone();
                }
                ("velocity_from", Some(held), Value::Number(_)) => *held = new.clone(),
                ("alarm_gears", Some(held), Value::Array(_)) => *held = new.clone(),
                (
                    "alarms" | "modes" | "levels" | "local_levels" | "train" | "stage_laws",
                    Some(held),
                    Value::Array(list),
                ) => {
                    for (n, item) in list.iter().enumerate() {
                        check_item(key, item).map_err(|what| refuse(&format!("[[{key}]] {}", n + 1), what))?;
                    }
                    *held = new.clone();
                }
                (_, Some(Value::Object(held)), Value::Object(new)) => {
                    for (name, value) in new {
                        let place = format!("[{key}] {name}");
                        let Some(old) = held.get_mut(name) else {
                            let known: Vec<&str> = held.keys().map(String::as_str).collect();
                            return Err(refuse(&place, format!("no such key: {}", known.join(", "))));
                        };
                        if old.is_string() != value.is_string() || old.is_number() != value.is_number() {
                            let kind = if old.is_string() { "a name" } else { "a number" };
                            return Err(refuse(&place, format!("must be {kind}, not {value}")));
                        }
                        if old.is_u64() && !value.is_u64() {
                            return Err(refuse(&place, format!("must be a whole number, not {value}")));
                        }
                        *old = value.clone();
                    }
                }
                (_, Some(_), _) => {
                    return Err(refuse(key, "must be a table, or for alarms and levels a list of tables".into()));
                }
            }
            if key == "alarms" && !self.tables.contains_key("alarm_gears") {
                // Another list: what watched which gear says nothing of it.
                whole["alarm_gears"] = Value::Array(Vec::new());
            }
            // What is left are whole numbers beyond their range, names that do not exist and too many alarms.
            *config = read(&whole).map_err(|what| refuse(key, what))?;
        }
        Ok(())
    }
}

/// The table that the settings of a second sensor are written onto, or none where it is taken away.
fn second(held: &Value, new: &Value) -> std::result::Result<Value, String> {
    match (held, new) {
        (_, Value::String(word)) if word == "None" => Ok(Value::Null),
        (Value::Null, Value::Object(_)) => {
            serde_json::to_value(SecondSensor::default()).map_err(|error| error.to_string())
        }
        (held, Value::Object(_)) => Ok(held.clone()),
        _ => Err("must be a table, or \"None\" where there is no second sensor".into()),
    }
}

/// Whether an item of a list can be read, by the list's key.
fn check_item(key: &str, item: &Value) -> std::result::Result<(), String> {
    match key {
        "alarms" => read::<AlarmBand>(item).map(drop),
        "modes" => read::<AlarmMode>(item).map(drop),
        "levels" => read::<LevelPoint>(item).map(drop),
        "train" => read::<TrainGear>(item).map(drop),
        "stage_laws" => read::<StageLaw>(item).map(drop),
        _ => read::<LocalPoint>(item).map(drop),
    }
}

fn read<T: DeserializeOwned>(value: &Value) -> std::result::Result<T, String> {
    serde_json::from_value(value.clone()).map_err(|e| e.to_string().replace('\n', " "))
}

/// The value as JSON has it; numbers that JSON cannot hold are refused.
fn finite(value: toml::Value, key: &str, place: &str) -> Result<Value> {
    Ok(match value {
        toml::Value::Float(number) => {
            let what = || Error::invalid(format!("{place}: {key}"), format!("{number} is not a number to work with"));
            serde_json::Number::from_f64(number).map(Value::Number).ok_or_else(what)?
        }
        toml::Value::Table(table) => {
            let entries = table.into_iter().map(|(name, value)| {
                let value = finite(value, &format!("[{key}] {name}"), place)?;
                Ok((name, value))
            });
            Value::Object(entries.collect::<Result<_>>()?)
        }
        toml::Value::Array(list) => {
            let items = list.into_iter().enumerate().map(|(n, value)| finite(value, &format!("{key}[{n}]"), place));
            Value::Array(items.collect::<Result<_>>()?)
        }
        toml::Value::Integer(number) => number.into(),
        toml::Value::Boolean(is) => is.into(),
        toml::Value::String(text) => text.into(),
        toml::Value::Datetime(date) => date.to_string().into(),
    })
}
