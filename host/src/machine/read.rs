//! Reading a declaration: TOML text to a checked [`Machine`], every refusal one line with table and key.

use super::Machine;
use crate::{Error, Result};
use std::path::Path;

/// Tables that a record folder's `record.toml` adds to the machine's; skipped here, read by the record.
const RECORD_TABLES: [&str; 3] = ["acquisition", "tach", "run"];

impl Machine {
    /// Reads a machine file, or a record's `record.toml` (whose record tables are passed over).
    ///
    /// A folder stands for the `record.toml` in it. Tables named in the file are looked up beside it.
    pub fn read(path: &Path) -> Result<Self> {
        let file = if path.is_dir() { path.join("record.toml") } else { path.to_owned() };
        let text = std::fs::read_to_string(&file).map_err(Error::file(&file))?;
        let folder = file.parent().unwrap_or(Path::new("")).to_owned();
        Self::from_toml(&text, &file.display().to_string(), &folder)
    }

    /// Reads a machine from TOML text; `place` names it in errors, `folder` resolves relative paths.
    pub fn from_toml(text: &str, place: &str, folder: &Path) -> Result<Self> {
        let table: toml::Table = text.parse().map_err(|error| syntax(&error, text, place))?;
        refuse_non_finite(&toml::Value::Table(table), "", place)?;
        let mut machine: Machine = match toml::from_str::<AnyRecord>(text) {
            Ok(any) => any.machine(),
            Err(error) => return Err(syntax(&error, text, place)),
        };
        machine.folder = folder.to_owned();
        machine.check(place)?;
        machine.resolve_damping(place)?;
        Ok(machine)
    }
}

/// A machine's tables with a record's beside them, so that spans in errors refer to the whole text.
#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct AnyRecord {
    title: String,
    pair: super::Pair,
    shafts: super::Shafts,
    engagement: Option<super::Engagement>,
    crack: Option<super::Crack>,
    motor: Option<super::Motor>,
    load: Option<super::Load>,
    casing: Option<super::Casing>,
    nominal: Option<super::Nominal>,
    #[serde(rename = "acquisition")]
    _acquisition: Option<toml::Table>,
    #[serde(rename = "tach")]
    _tach: Option<toml::Table>,
    #[serde(rename = "run")]
    _run: Option<Vec<toml::Table>>,
}

impl AnyRecord {
    fn machine(self) -> Machine {
        Machine {
            title: self.title,
            pair: self.pair,
            shafts: self.shafts,
            engagement: self.engagement,
            crack: self.crack,
            motor: self.motor,
            load: self.load,
            casing: self.casing,
            nominal: self.nominal,
            folder: Default::default(),
        }
    }
}

/// One line for a TOML error: line number, the table it stands in, the reader's reason.
fn syntax(error: &toml::de::Error, text: &str, place: &str) -> Error {
    let at = error.span().map_or(0, |span| span.start.min(text.len()));
    let line = text[..at].matches('\n').count() + 1;
    let before = text.lines().take(line);
    let table = before.map(str::trim).filter(|l| l.starts_with('[')).last().unwrap_or("top level");
    let reason = error.message().split_whitespace().collect::<Vec<_>>().join(" ");
    Error::invalid(place, format!("line {line}, {table}: {reason}"))
}

/// TOML can spell `nan` and `inf`; no quantity here may be either.
fn refuse_non_finite(value: &toml::Value, key: &str, place: &str) -> Result<()> {
    let join = |inner: &str| if key.is_empty() { inner.to_owned() } else { format!("{key}.{inner}") };
    match value {
        toml::Value::Float(number) if !number.is_finite() => {
            Err(Error::invalid(place, format!("{key}: {number} is not a finite number")))
        }
        toml::Value::Table(table) if key.is_empty() => table
            .iter()
            .filter(|(name, _)| !RECORD_TABLES.contains(&name.as_str()))
            .try_for_each(|(name, inner)| refuse_non_finite(inner, &format!("[{name}]"), place)),
        toml::Value::Table(table) => {
            table.iter().try_for_each(|(name, inner)| refuse_non_finite(inner, &join(name), place))
        }
        toml::Value::Array(list) => list.iter().try_for_each(|inner| refuse_non_finite(inner, key, place)),
        _ => Ok(()),
    }
}
