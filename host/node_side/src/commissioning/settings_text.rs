//! A configuration as the settings file that `meshband configure --settings` reads, and its difference to another one.

use crate::link::report::{settings_rows, shortest_digits};
use crate::{Error, Result};
use meshband::config::Configuration;
use serde::Serialize;
use serde_json::{Map, Value};

/// What a settings file does not hold: the law has a file of its own, the others are the node's.
const NOT_SETTINGS: [&str; 4] = ["schema", "law", "latched", "sensor_latched"];

/// A setting that differs.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Change {
    /// Table and key.
    pub key: String,
    /// Before; empty where there was none.
    pub before: String,
    /// Now.
    pub after: String,
}

/// All settings as TOML.
///
/// # Errors
/// [`Error::Invalid`] for a configuration that has no such form: none that a node holds.
pub fn to_toml(config: &Configuration, head: &str) -> Result<String> {
    let refuse = |e: &dyn std::fmt::Display| Error::invalid("configuration", e);
    let Value::Object(mut tables) = serde_json::to_value(config).map_err(|e| refuse(&e))? else {
        return Err(refuse(&"is no table"));
    };
    tables.retain(|key, _| !NOT_SETTINGS.contains(&key.as_str()));
    // TOML has no word for what is not there; settings have.
    let said = |value| if value == Value::Null { Value::from("None") } else { shortest_digits(value) };
    let tables: Map<String, Value> = tables.into_iter().map(|(key, value)| (key, said(value))).collect();
    let table = toml::Table::try_from(tables).map_err(|e| refuse(&e))?;
    Ok(format!("{head}{}", toml::to_string(&table).map_err(|e| refuse(&e))?))
}

/// Settings that differ, in the order of the configuration; long lists by their length.
pub fn changes(before: &Configuration, after: &Configuration) -> Vec<Change> {
    let rows = |config: &Configuration| -> Vec<(String, String)> {
        let of = |mut row: Vec<String>| Some((row.first().cloned()?, row.pop()?));
        settings_rows(config).into_iter().filter_map(of).collect()
    };
    let (before, after) = (rows(before), rows(after));
    let held = |rows: &[(String, String)], key: &str| {
        rows.iter().find(|(name, _)| name == key).map_or_else(String::new, |(_, value)| value.clone())
    };
    let mut keys: Vec<&String> = after.iter().map(|(key, _)| key).collect();
    keys.extend(before.iter().map(|(key, _)| key).filter(|key| !after.iter().any(|(name, _)| name == *key)));
    let change = |key: &String| Change { key: key.clone(), before: held(&before, key), after: held(&after, key) };
    keys.into_iter()
        .map(change)
        .filter(|change| change.before != change.after && change.key != "latched" && change.key != "sensor_latched")
        .map(brief)
        .collect()
}

/// Longest value that is shown whole.
const MAX_VALUE_LENGTH: usize = 60;

fn brief(change: Change) -> Change {
    let shown = |text: String| match serde_json::from_str::<Value>(&text) {
        Ok(Value::Array(items)) if text.len() > MAX_VALUE_LENGTH => format!("{} entries", items.len()),
        Ok(Value::Number(number)) if change.key.ends_with("hash") => {
            number.as_u64().map_or(text, |hash| format!("{hash:#018x}"))
        }
        _ => text,
    };
    Change { before: shown(change.before), after: shown(change.after), ..change }
}
