//! A case file: files, rates, teeth and nominal values of one published record, as `meshband import` takes them.

use crate::import::{ImportOptions, TachChoice, Unit};
use crate::{Error, Result, budget};
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// Unit of the source.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
pub enum CaseUnit {
    /// m/s2.
    #[serde(rename = "m/s2")]
    Acceleration,
    /// Not stated.
    #[serde(rename = "unknown")]
    Unknown,
}

/// A frequency, or a range.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(untagged)]
pub enum Mesh {
    /// A guess, Hz.
    Guess(f64),
    /// Range, Hz.
    Range([f64; 2]),
}

/// One published record.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Case {
    /// File name without ending.
    #[serde(skip)]
    pub name: String,
    /// Title.
    pub title: String,
    /// Where the data are from, and their licence.
    pub source: String,
    /// What must not be concluded.
    pub caution: String,
    /// What stands for `{}` in `path`, file by file.
    pub files: Vec<String>,
    /// Path of a file in the data folder.
    pub path: String,
    /// Whether every file is a run.
    #[serde(default)]
    pub runs: bool,
    /// Load of every run.
    #[serde(default)]
    pub load: Vec<f64>,
    /// Sampling rate, Hz.
    pub rate_hz: f64,
    /// Unit of the source.
    pub unit: CaseUnit,
    /// Tooth counts; absent: one shaft without gears.
    pub teeth: Option<[u32; 2]>,
    /// Mesh frequency as far as known, Hz.
    pub mesh_hz: Option<Mesh>,
    /// Nominal speed where there is no mesh line to follow, rpm.
    pub speed_rpm: Option<f64>,
}

/// The cases of a folder, by file name.
///
/// # Errors
/// An unreadable folder, a file that is no case, no case at all.
pub fn cases(folder: &Path) -> Result<Vec<Case>> {
    let unreadable = |error: std::io::Error| Error::invalid(folder.display(), error.to_string());
    let mut paths: Vec<PathBuf> = std::fs::read_dir(folder)
        .map_err(unreadable)?
        .filter_map(|entry| entry.ok().map(|entry| entry.path()))
        .filter(|path| path.extension().is_some_and(|ending| ending == "toml"))
        .collect();
    paths.sort();
    if paths.is_empty() {
        return Err(Error::invalid(folder.display(), "holds no case (*.toml)"));
    }
    paths.iter().map(|path| Case::read(path)).collect()
}

impl Case {
    /// Reads a case file.
    ///
    /// # Errors
    /// One line with file and key.
    pub fn read(path: &Path) -> Result<Self> {
        let text = budget::read_text(path)?;
        let parsed: std::result::Result<Case, toml::de::Error> = toml::from_str(&text);
        let mut case = parsed.map_err(|error| {
            let line = error.span().map_or(1, |span| text[..span.start.min(text.len())].lines().count().max(1));
            Error::invalid(format!("{}:{line}", path.display()), error.message().replace('\n', " "))
        })?;
        case.name = path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
        Ok(case)
    }

    /// Its files, which must be there.
    ///
    /// # Errors
    /// The first that is not.
    pub fn paths(&self, data: &Path) -> Result<Vec<PathBuf>> {
        let path = |file: &String| {
            let path = data.join(self.path.replace("{}", file));
            if path.is_file() {
                return Ok(path);
            }
            let what = "is absent; the measured data are not part of the project, their sources are in the case files";
            Err(Error::invalid(path.display(), what))
        };
        self.files.iter().map(path).collect()
    }

    /// The import that `meshband import` would make.
    pub fn import_options(&self) -> ImportOptions {
        ImportOptions {
            title: self.name.clone(),
            rate_hz: Some(self.rate_hz),
            teeth: self.teeth,
            no_gears: self.teeth.is_none(),
            mesh_guess_hz: match self.mesh_hz {
                Some(Mesh::Guess(hz)) => Some(hz),
                _ => None,
            },
            mesh_range_hz: match self.mesh_hz {
                Some(Mesh::Range(range)) => Some(range),
                _ => None,
            },
            units: vec![match self.unit {
                CaseUnit::Acceleration => Unit::MetrePerSecondSquared,
                CaseUnit::Unknown => Unit::Unknown,
            }],
            files_are_runs: self.runs,
            loads: self.load.clone(),
            tach: self.speed_rpm.map_or(TachChoice::Virtual, |rpm| TachChoice::Nominal(rpm / 60.0)),
            ..ImportOptions::default()
        }
    }

    /// The same as command lines.
    pub fn commands(&self) -> String {
        let files: Vec<String> = self.files.iter().map(|file| self.path.replace("{}", file)).collect();
        let mut line = format!("meshband import {} --rate {}", files.join(" "), self.rate_hz);
        line += match self.unit {
            CaseUnit::Acceleration => " --unit m/s2",
            CaseUnit::Unknown => " --unit unknown",
        };
        line += &self.teeth.map_or(" --no-gears".into(), |[a, b]| format!(" --teeth {a},{b}"));
        line += &match self.mesh_hz {
            Some(Mesh::Guess(hz)) => format!(" --mesh {hz}"),
            Some(Mesh::Range([from, to])) => format!(" --mesh {from},{to}"),
            None => String::new(),
        };
        line += &self.speed_rpm.map_or(String::new(), |rpm| format!(" --speed {rpm}"));
        if self.runs {
            line += " --runs";
        }
        if !self.load.is_empty() {
            let loads: Vec<String> = self.load.iter().map(f64::to_string).collect();
            line += &format!(" --load {}", loads.join(","));
        }
        format!("{line} -o {name}\nmeshband loop {name}", name = self.name)
    }
}
