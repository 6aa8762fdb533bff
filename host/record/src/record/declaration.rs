//! `record.toml`: acquisition, tach, runs, and whatever else the owner declares.
//!
//! The document is kept whole: the tables this module knows are typed, every other table or key is carried
//! through reading and writing unchanged. The machine is read from those others on demand, because an
//! imported record may know no more of its machine than the tooth counts.

use super::beside::BesideDeclaration;
use crate::confined::check_name;
use crate::machine::bearing::Bearing;
use crate::machine::{Machine, check_lists};
use crate::train::{self, Train};
use crate::{Error, Result};
use serde::{Deserialize, Serialize, de::DeserializeOwned};
use std::path::{Path, PathBuf};
use toml::{Table, Value};

/// Tooth counts outside this are a slip of the keyboard, not a gear.
const TEETH: std::ops::RangeInclusive<i64> = 5..=1000;

/// Sampling rates of vibration, Hz.
const RATES_HZ: std::ops::RangeInclusive<f64> = 1.0..=1e9;
/// Full scales in whatever unit the record has.
const FULL_SCALES: std::ops::RangeInclusive<f64> = 1e-15..=1e15;
/// Turns of any tach shaft per turn of the pinion: what the node's configuration takes, too.
const SHAFT_RATIOS: std::ops::RangeInclusive<f64> = 0.001..=1000.0;
/// Longest standard deviation of a tach edge, s.
const JITTER_S: std::ops::RangeInclusive<f64> = 0.0..=1.0;

/// Keys of `record.toml` that do not describe the machine.
const RECORD_KEYS: [&str; 6] = ["acquisition", "tach", "run", "import", "stage", BEARING];

/// Key of the tables of declared bearings.
const BEARING: &str = "bearing";

/// Keys of `[pair]` that name a file.
const STIFFNESS_KEYS: [&str; 2] = ["pair_stiffness", "total_stiffness"];

/// The content of `record.toml`.
#[derive(Debug, Clone, PartialEq)]
pub struct Declaration {
    /// Sampling and channels.
    pub acquisition: Acquisition,
    /// Tachometer; `None` where the record has none.
    pub tach: Option<Tach>,
    /// One table per run.
    pub runs: Vec<RunDeclaration>,
    /// Everything else: `title`, `[pair]`, `[shafts]`, `[import]` and unknown keys.
    pub rest: Table,
    /// Name of the file in messages.
    place: String,
    /// Folder that the machine's tables are looked up in.
    folder: PathBuf,
}

/// `[acquisition]`: sampling rate, channels and scale.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Acquisition {
    /// Sampling rate of every run, Hz.
    pub sample_rate_hz: f64,
    /// Channel names, in the order of the columns.
    pub channels: Vec<String>,
    /// Value of code 32767, m/s2 (or in `unit` where that is given).
    pub full_scale_m_s2: f64,
    /// Bits of the samples: 16 for codes, 32 for float values in the record's unit.
    #[serde(default = "sixteen")]
    pub code_bits: u32,
    /// Unit of the channels where it is not m/s2: "V", or "unknown" for sources that state none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
    /// Unknown keys, kept.
    #[serde(flatten)]
    pub other: Table,
}

/// Key of `[import]`: whether the rig has gears.
const GEARS: &str = "gears";
/// Key of `[[run]]`: load in any one unit of the record's runs.
pub const LOAD: &str = "load";
/// Key of a `[[run]]` that is part of a longer recording: which one, in words.
pub const PART: &str = "part";

/// Key of `[tach]`: its shaft in a train.
const TRAIN_SHAFT: &str = "train_shaft";

/// `code_bits` of float samples.
pub const FLOAT_BITS: u32 = 32;

fn sixteen() -> u32 {
    16
}

/// `[tach]`: which shaft, how many pulses.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Tach {
    /// Shaft with the pick-up: "pinion", "gear", or "other", which `turns_per_pinion_turn` then places.
    pub shaft: String,
    /// Turns of that shaft per turn of the pinion, with `shaft = "other"` and only there.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub turns_per_pinion_turn: Option<f64>,
    /// Pulses per turn of that shaft.
    pub pulses_per_rev: u32,
    /// Standard deviation of an edge time, s, where declared.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub jitter_s: Option<f64>,
    /// "virtual" where the edges come from the mesh line's phase, "measured" where they come from a pick-up whose place
    /// against the teeth nobody stated: angle 0 is then arbitrary. Absent: angle 0 is that of the declared machine.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub source: Option<String>,
    /// Unknown keys, kept.
    #[serde(flatten)]
    pub other: Table,
}

impl Tach {
    /// Turns of the tach's shaft per turn of the pinion; `None` for the gear's shaft of a pair without tooth counts.
    pub fn turns_per_pinion_turn(&self, teeth: Option<[u32; 2]>) -> Option<f64> {
        match self.shaft.as_str() {
            "pinion" => Some(1.0),
            "gear" => teeth.map(|[pinion, gear]| f64::from(pinion) / f64::from(gear)),
            _ => self.turns_per_pinion_turn,
        }
    }

    /// Shaft of a declared train, with `shaft = "other"` (`train_shaft`): the ratio is then exact.
    pub fn train_shaft(&self) -> Option<usize> {
        usize::try_from(self.other.get(TRAIN_SHAFT)?.as_integer()?).ok()
    }

    /// The same tach on a shaft of a train, with its turns per turn of shaft 0.
    #[must_use]
    pub fn on_train_shaft(mut self, shaft: usize, turns: f64) -> Self {
        self.other.insert(TRAIN_SHAFT.into(), Value::Integer(shaft as i64));
        Self { shaft: "other".into(), turns_per_pinion_turn: Some(turns), ..self }
    }

    /// Whether the edges were made from the mesh line; tooth index and angle 0 are then unknown.
    pub fn is_virtual(&self) -> bool {
        self.source.as_deref() == Some("virtual")
    }
}

/// One `[[run]]` table.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunDeclaration {
    /// File of the codes, relative to the record folder.
    pub signal: String,
    /// File of the tach edges; absent where the record has no tach.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tach: Option<String>,
    /// Pulses from shaft angle 0 to the first edge, modulo pulses per turn.
    #[serde(default)]
    pub first_pulse_index: u32,
    /// Torque at the pinion's shaft, N m, where known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub input_torque_n_m: Option<f64>,
    /// What was recorded beside the channels.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub beside: Vec<BesideDeclaration>,
    /// Unknown keys, kept.
    #[serde(flatten)]
    pub other: Table,
}

impl RunDeclaration {
    /// Which part of a longer recording this is, in words; `None` for a whole one.
    pub fn part(&self) -> Option<&str> {
        self.other.get(PART)?.as_str()
    }

    /// Load of the run, in whatever unit its record's runs share, where declared.
    pub fn load(&self) -> Option<f64> {
        let value = self.other.get(LOAD)?;
        value.as_float().or(value.as_integer().map(|load| load as f64))
    }

    /// The standard names of run `index`: `runNN.npy` and, with a tach, `runNN.tach.csv`.
    pub fn numbered(index: usize, with_tach: bool, input_torque_n_m: Option<f64>) -> Self {
        Self {
            signal: format!("run{index:02}.npy"),
            tach: with_tach.then(|| format!("run{index:02}.tach.csv")),
            first_pulse_index: 0,
            input_torque_n_m,
            beside: Vec::new(),
            other: Table::new(),
        }
    }
}

impl Declaration {
    /// A declaration of `machine`; `rest` may then be extended.
    ///
    /// # Errors
    /// A machine that TOML cannot hold (a number beyond its range).
    pub fn of_machine(machine: &Machine, acquisition: Acquisition, tach: Option<Tach>) -> Result<Self> {
        let rest =
            Table::try_from(machine).map_err(|error| Error::invalid(&machine.title, one_line(&error.to_string())))?;
        let folder = machine.folder.clone();
        Ok(Self { acquisition, tach, runs: Vec::new(), rest, place: "record.toml".into(), folder })
    }

    /// A declaration of an imported record: a title and, where known, tooth counts.
    pub fn of_import(title: &str, teeth: Option<[u32; 2]>, acquisition: Acquisition, tach: Option<Tach>) -> Self {
        let mut rest = Table::new();
        rest.insert("title".into(), title.into());
        if let Some(teeth) = teeth {
            let teeth: Vec<Value> = teeth.iter().map(|&z| Value::Integer(z.into())).collect();
            rest.insert("pair".into(), Value::Table(Table::from_iter([("teeth".to_string(), Value::Array(teeth))])));
        }
        Self { acquisition, tach, runs: Vec::new(), rest, place: "record.toml".into(), folder: PathBuf::new() }
    }

    /// Declares a rig of one shaft without gears (`[import] gears = false`).
    pub fn declare_no_gears(&mut self) {
        let import = Table::from_iter([(GEARS.to_owned(), Value::Boolean(false))]);
        self.rest.insert("import".into(), Value::Table(import));
    }

    /// Whether the rig is declared to have no gears.
    pub fn has_no_gears(&self) -> bool {
        self.rest.get("import").and_then(|import| import.get(GEARS)) == Some(&Value::Boolean(false))
    }

    /// Declares bearings (`[[bearing]]`).
    ///
    /// # Errors
    /// A bearing whose orders cannot be told.
    pub fn declare_bearings(&mut self, bearings: &[Bearing]) -> Result<()> {
        for bearing in bearings {
            bearing.orders()?;
        }
        let tables = bearings.iter().map(Value::try_from).collect::<std::result::Result<Vec<Value>, _>>();
        let tables = tables.map_err(|error| Error::invalid(&self.place, error))?;
        if !tables.is_empty() {
            self.rest.insert(BEARING.into(), Value::Array(tables));
        }
        Ok(())
    }

    /// The declared bearings (`[[bearing]]`).
    ///
    /// # Errors
    /// One line with file and key.
    pub fn bearings(&self) -> Result<Vec<Bearing>> {
        let Some(tables) = self.rest.get(BEARING) else { return Ok(Vec::new()) };
        let read: std::result::Result<Vec<Bearing>, _> = tables.clone().try_into();
        read.map_err(|error| Error::invalid(&self.place, format!("[[bearing]]: {}", error.message())))
    }

    /// Reads and checks a `record.toml`.
    ///
    /// # Errors
    /// One line with file, table and key.
    pub fn read(path: &Path) -> Result<Self> {
        let text = crate::budget::read_text(path)?;
        Self::parse(&text, &path.display().to_string())
    }

    /// Parses and checks the text of a `record.toml`; `place` names it in messages, and its folder is where the
    /// machine's tables are looked up.
    ///
    /// # Errors
    /// As [`Declaration::read`].
    pub fn parse(text: &str, place: &str) -> Result<Self> {
        let mut rest: Table = toml::from_str(text).map_err(|error| {
            let line = error.span().map_or(0, |span| text[..span.start.min(text.len())].lines().count().max(1));
            Error::invalid(format!("{place}:{line}"), one_line(error.message()))
        })?;
        refuse_non_finite(place, "", &Value::Table(rest.clone()))?;
        let acquisition = take(&mut rest, place, "acquisition")?
            .ok_or_else(|| Error::invalid(place, "has no table [acquisition]"))?;
        let tach = take(&mut rest, place, "tach")?;
        let runs: Vec<RunDeclaration> = match rest.remove("run") {
            Some(Value::Array(tables)) => tables
                .into_iter()
                .enumerate()
                .map(|(i, table)| typed(table, &format!("{place} [[run]] {i}")))
                .collect::<Result<_>>()?,
            Some(_) => return Err(Error::invalid(place, "run must be an array of tables [[run]]")),
            None => Vec::new(),
        };
        let folder = Path::new(place).parent().unwrap_or(Path::new("")).to_owned();
        let declaration = Self { acquisition, tach, runs, rest, place: place.into(), folder };
        declaration.check()?;
        Ok(declaration)
    }

    /// The text of the document.
    ///
    /// # Errors
    /// What reading would refuse, and a number that TOML cannot hold.
    pub fn to_toml(&self) -> Result<String> {
        self.check()?;
        let refuse = |error: toml::ser::Error| Error::invalid(&self.place, one_line(&error.to_string()));
        let mut document = self.rest.clone();
        document.insert("acquisition".into(), Value::try_from(&self.acquisition).map_err(refuse)?);
        if let Some(tach) = &self.tach {
            document.insert("tach".into(), Value::try_from(tach).map_err(refuse)?);
        }
        document.insert("run".into(), Value::try_from(&self.runs).map_err(refuse)?);
        toml::to_string(&document).map_err(refuse)
    }

    /// Title, empty where none is given.
    pub fn title(&self) -> &str {
        self.rest.get("title").and_then(Value::as_str).unwrap_or_default()
    }

    /// Tooth counts of pinion and gear, where declared.
    pub fn teeth(&self) -> Option<[u32; 2]> {
        let teeth = self.rest.get("pair")?.get("teeth")?.as_array()?;
        match teeth.as_slice() {
            [pinion, gear] => Some([pinion.as_integer()?.try_into().ok()?, gear.as_integer()?.try_into().ok()?]),
            _ => None,
        }
    }

    /// The declared train; none where there is none, or one plain pair, which is a pair's record.
    ///
    /// # Errors
    /// As [`train::Declaration::read`].
    pub fn train(&self) -> Result<Option<Train>> {
        if !self.has_train() {
            return Ok(None);
        }
        let declared = train::Declaration::of_table(&self.rest, &self.place)?;
        if declared.as_pair().is_some() { Ok(None) } else { Train::of(declared).map(Some) }
    }

    /// Whether stages are declared.
    pub fn has_train(&self) -> bool {
        self.rest.contains_key("stage")
    }

    /// Whether the whole machine is declared and not only its tooth counts.
    pub fn has_machine(&self) -> bool {
        self.rest.contains_key("shafts") && self.rest.get("pair").is_some_and(|pair| pair.get("module_m").is_some())
    }

    /// Whether it says how a pair takes up its load.
    pub fn has_engagement(&self) -> bool {
        self.rest.contains_key("engagement")
    }

    /// The declared machine, checked, with its tables and its mesh damping resolved.
    ///
    /// # Errors
    /// Where the record declares only tooth counts, a key is missing or unknown, or a value makes no sense.
    pub fn machine(&self) -> Result<Machine> {
        if !self.has_machine() {
            let what = "declares no machine ([pair] geometry and [shafts]); this command needs one";
            return Err(Error::invalid(&self.place, what));
        }
        let mut tables = self.rest.clone();
        tables.retain(|key, _| !RECORD_KEYS.contains(&key));
        check_lists(&tables, &self.place)?;
        typed::<Machine>(Value::Table(tables), &self.place)?.prepared(&self.place, &self.folder)
    }

    /// Keys of `[pair]` that name stiffness tables, with the paths as declared.
    pub fn stiffness_tables(&self) -> Vec<(&'static str, PathBuf)> {
        let pair = self.rest.get("pair");
        let table = |key: &'static str| Some((key, PathBuf::from(pair?.get(key)?.as_str()?)));
        STIFFNESS_KEYS.into_iter().filter_map(table).collect()
    }

    pub(super) fn set_stiffness_table(&mut self, key: &str, path: &str) {
        if let Some(Value::Table(pair)) = self.rest.get_mut("pair") {
            pair.insert(key.into(), path.into());
        }
    }

    fn check(&self) -> Result<()> {
        let refuse = |place: &str, what: String| Err(Error::invalid(format!("{} {place}", self.place), what));
        let a = &self.acquisition;
        if a.sample_rate_hz <= 0.0 || !a.sample_rate_hz.is_finite() {
            return refuse("[acquisition] sample_rate_hz", format!("{} is not a positive rate", a.sample_rate_hz));
        }
        if !RATES_HZ.contains(&a.sample_rate_hz) {
            let what = format!("{} Hz is not within 1 Hz to 1 GHz", a.sample_rate_hz);
            return refuse("[acquisition] sample_rate_hz", what);
        }
        if a.full_scale_m_s2 <= 0.0 || !a.full_scale_m_s2.is_finite() {
            return refuse("[acquisition] full_scale_m_s2", format!("{} is not positive", a.full_scale_m_s2));
        }
        if !FULL_SCALES.contains(&a.full_scale_m_s2) {
            return refuse(
                "[acquisition] full_scale_m_s2",
                format!("{} is not within 1e-15 to 1e15", a.full_scale_m_s2),
            );
        }
        if a.channels.is_empty() {
            return refuse("[acquisition] channels", "names no channel".into());
        }
        if ![16, FLOAT_BITS].contains(&a.code_bits) {
            return refuse(
                "[acquisition] code_bits",
                format!("{} is not supported, only 16 and 32 (float)", a.code_bits),
            );
        }
        if let Some(tach) = &self.tach {
            self.check_shaft(tach)?;
            if let Some(jitter) = tach.jitter_s.filter(|jitter| !JITTER_S.contains(jitter)) {
                return refuse("[tach] jitter_s", format!("{jitter} s is not within 0 to 1 s"));
            }
            if !(1..=10_000).contains(&tach.pulses_per_rev) {
                return refuse("[tach] pulses_per_rev", format!("{} is not within 1 to 10000", tach.pulses_per_rev));
            }
        }
        let train = self.train()?;
        if let Some(shaft) = self.tach.as_ref().and_then(Tach::train_shaft)
            && train.as_ref().is_none_or(|train| shaft >= train.shafts.len())
        {
            return refuse("[tach] train_shaft", format!("{shaft} is no shaft of the declared [[stage]]s"));
        }
        for (key, table) in self.stiffness_tables() {
            check_name(&format!("{} [pair] {key}", self.place), &table)?;
        }
        for (i, run) in self.runs.iter().enumerate() {
            for (key, name) in [("signal", Some(&run.signal)), ("tach", run.tach.as_ref())] {
                let place = format!("{} [[run]] {i} {key}", self.place);
                name.map_or(Ok(()), |name| check_name(&place, name.as_ref()))?;
            }
            for (k, beside) in run.beside.iter().enumerate() {
                let place = format!("{} [[run]] {i} beside {k}", self.place);
                check_name(&place, beside.file.as_ref())?;
                if let Some(rate) = beside.sample_rate_hz.filter(|rate| !(rate.is_finite() && *rate > 0.0)) {
                    return Err(Error::invalid(place, format!("{rate} Hz is not a positive rate")));
                }
            }
            if let (Some(tach), true) = (&self.tach, run.tach.is_some())
                && run.first_pulse_index >= tach.pulses_per_rev
            {
                let what = format!("{} is not below pulses_per_rev {}", run.first_pulse_index, tach.pulses_per_rev);
                return refuse(&format!("[[run]] {i} first_pulse_index"), what);
            }
            if run.tach.is_some() && self.tach.is_none() {
                return refuse(&format!("[[run]] {i} tach"), "names an edge file but there is no [tach]".into());
            }
        }
        self.check_teeth()
    }

    /// The shaft's name, and a ratio with exactly the shaft that has no name.
    fn check_shaft(&self, tach: &Tach) -> Result<()> {
        let refuse = |key: &str, what: String| Err(Error::invalid(format!("{} [tach] {key}", self.place), what));
        match (tach.shaft.as_str(), tach.turns_per_pinion_turn) {
            ("pinion" | "gear", None) => Ok(()),
            ("pinion" | "gear", Some(_)) => {
                refuse("turns_per_pinion_turn", format!("belongs to shaft = \"other\", not to '{}'", tach.shaft))
            }
            ("other", Some(ratio)) if SHAFT_RATIOS.contains(&ratio) => Ok(()),
            ("other", Some(ratio)) => {
                refuse("turns_per_pinion_turn", format!("{ratio} is not within 0.001 to 1000 turns per pinion turn"))
            }
            ("other", None) => refuse("turns_per_pinion_turn", "is needed with shaft = \"other\"".into()),
            (other, _) => refuse("shaft", format!("'{other}' is neither pinion nor gear nor other")),
        }
    }

    fn check_teeth(&self) -> Result<()> {
        let Some(teeth) = self.rest.get("pair").and_then(|pair| pair.get("teeth")) else { return Ok(()) };
        let place = format!("{} [pair] teeth", self.place);
        match teeth.as_array().map(Vec::as_slice) {
            Some([Value::Integer(pinion), Value::Integer(gear)]) => {
                match [pinion, gear].into_iter().find(|z| !TEETH.contains(z)) {
                    Some(z) => Err(Error::invalid(place, format!("{z} is not a tooth count (5 to 1000)"))),
                    None => Ok(()),
                }
            }
            _ => Err(Error::invalid(place, "must be two whole numbers [pinion, gear]")),
        }
    }
}

/// Removes `[key]` and types it.
fn take<T: DeserializeOwned>(document: &mut Table, place: &str, key: &str) -> Result<Option<T>> {
    document.remove(key).map(|value| typed(value, &format!("{place} [{key}]"))).transpose()
}

fn typed<T: DeserializeOwned>(value: Value, place: &str) -> Result<T> {
    value.try_into().map_err(|error: toml::de::Error| Error::invalid(place, one_line(error.message())))
}

/// TOML has NaN and infinity; no key of ours means anything with them.
fn refuse_non_finite(place: &str, path: &str, value: &Value) -> Result<()> {
    match value {
        Value::Float(x) if !x.is_finite() => Err(Error::invalid(format!("{place} {path}"), format!("is {x}"))),
        Value::Array(items) => items.iter().enumerate().try_for_each(|(i, item)| {
            let name = if item.is_table() { format!("{path} {i}") } else { path.to_string() };
            refuse_non_finite(place, &name, item)
        }),
        Value::Table(table) => table.iter().try_for_each(|(key, item)| {
            let is_table = item.is_table() || item.as_array().is_some_and(|a| a.iter().any(Value::is_table));
            let name = if is_table { format!("[{key}]") } else { key.clone() };
            let name = if path.is_empty() { name } else { format!("{path} {name}") };
            refuse_non_finite(place, &name, item)
        }),
        _ => Ok(()),
    }
}

fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}
