//! Reading a declaration: TOML text to a checked [`Machine`], every refusal one line with table and key.

use super::{Machine, keys};
use crate::{Error, Result, budget};
use std::path::Path;

/// Tables that a record folder's `record.toml` adds to the machine's; skipped here, read by the record.
const RECORD_TABLES: [&str; 3] = ["acquisition", "tach", "run"];

impl Machine {
    /// Reads a machine file, or a record's `record.toml` (whose record tables are passed over).
    ///
    /// A folder stands for the `record.toml` in it. Tables named in the file are looked up beside it.
    pub fn read(path: &Path) -> Result<Self> {
        let file = if path.is_dir() { path.join("record.toml") } else { path.to_owned() };
        let text = budget::read_text(&file)?;
        let folder = file.parent().unwrap_or(Path::new("")).to_owned();
        Self::from_toml(&text, &file.display().to_string(), &folder)
    }

    /// Reads a machine from TOML text; `place` names it in errors, `folder` resolves relative paths.
    pub fn from_toml(text: &str, place: &str, folder: &Path) -> Result<Self> {
        let table: toml::Table = text.parse().map_err(|error| syntax(&error, text, place))?;
        check_lists(&table, place)?;
        let unknown = keys::unknown(&table);
        if !unknown.is_empty() {
            let what = format!("unknown: {}; `meshband machine keys` lists all keys", unknown.join(", "));
            return Err(Error::invalid(place, what));
        }
        refuse_non_finite(&toml::Value::Table(table), "", place)?;
        let machine: Machine = match toml::from_str::<AnyRecord>(text) {
            Ok(any) => {
                any.check_names(place)?;
                any.machine()
            }
            Err(error) => return Err(syntax(&error, text, place)),
        };
        machine.prepared(place, folder)
    }

    /// Checks a machine that was put together otherwise and resolves what depends on its place: the folder of its
    /// tables, and the mesh damping where the ratio is given.
    pub fn prepared(mut self, place: &str, folder: &Path) -> Result<Self> {
        self.folder = folder.to_owned();
        self.check(place)?;
        self.resolve_damping(place)?;
        Ok(self)
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
    acquisition: Option<toml::Table>,
    #[serde(rename = "tach")]
    _tach: Option<toml::Table>,
    run: Option<Vec<toml::Table>>,
}

impl AnyRecord {
    /// A record's tables lie in its folder; a machine file may name them anywhere.
    fn check_names(&self, place: &str) -> Result<()> {
        if self.acquisition.is_none() && self.run.is_none() {
            return Ok(());
        }
        let tables = [("pair_stiffness", &self.pair.pair_stiffness), ("total_stiffness", &self.pair.total_stiffness)];
        tables.into_iter().try_for_each(|(key, table)| match table {
            Some(table) => crate::confined::check_name(&format!("{place} [pair] {key}"), table),
            None => Ok(()),
        })
    }

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

/// Tables of a machine; every list in them has one entry per gear or shaft.
const MACHINE_TABLES: [&str; 8] = ["pair", "shafts", "engagement", "crack", "motor", "load", "casing", "nominal"];

/// Refuses lists with more or fewer entries than two: reading would take the first ones and say nothing.
pub fn check_lists(source: &toml::Table, place: &str) -> Result<()> {
    for (name, table) in MACHINE_TABLES.iter().filter_map(|name| Some((name, source.get(*name)?.as_table()?))) {
        let mut lists = table.iter().filter_map(|(key, list)| Some((key, list.as_array()?.len())));
        if let Some((key, count)) = lists.find(|(_, count)| *count != 2) {
            return Err(Error::invalid(place, format!("[{name}] {key}: {count} entries where 2 are meant")));
        }
    }
    Ok(())
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
