//! Record folders: what was measured (or simulated) together with what its owner declares about the machine.
//!
//! A record is a folder with `record.toml`, one `runNN.npy` of int16 codes (samples x channels) and one
//! `runNN.tach.csv` of edge times (s from the run's first sample) per run; `docs/records.md` has every key.
//! Reading checks everything that later code relies on, so that a [`Record`] in memory is sound: known
//! channel count, finite numbers, strictly ascending edges, sensible tooth counts. Each refusal is one line
//! with file, table and key. A whole record is held in memory as codes (2 bytes per value).

mod codes;
mod declaration;
pub mod npy;
mod run;
mod tach;

pub use codes::{CODE_MAX, encode, suggested_full_scale};
pub use declaration::{Acquisition, Declaration, RunDeclaration, Tach};
pub use run::Run;
pub use tach::{read_edges, write_edges};

use crate::{Error, Result};
use std::path::{Path, PathBuf};

/// A record folder in memory: declaration and runs, in the declaration's order.
#[derive(Debug, Clone)]
pub struct Record {
    /// Folder the record was read from; relative paths of the declaration (`pair_stiffness`) start here.
    pub folder: PathBuf,
    /// Everything in `record.toml`.
    pub declaration: Declaration,
    /// The runs, same order and count as `declaration.runs`.
    pub runs: Vec<Run>,
}

impl Record {
    /// Reads the record in `folder` (or the folder of a given `record.toml`).
    ///
    /// # Errors
    /// One line naming file and key for anything missing, truncated, of the wrong type or senseless.
    pub fn read(folder: &Path) -> Result<Self> {
        let folder = if folder.file_name().is_some_and(|name| name == "record.toml") {
            folder.parent().unwrap_or(Path::new("."))
        } else {
            folder
        };
        let declaration = Declaration::read(&folder.join("record.toml"))?;
        let runs =
            declaration.runs.iter().map(|run| Run::read(folder, run, &declaration)).collect::<Result<Vec<_>>>()?;
        Ok(Self { folder: folder.to_owned(), declaration, runs })
    }

    /// Writes the record into `folder`, which is created; existing files of the same names are replaced.
    ///
    /// A `pair_stiffness` table is copied along and the declaration points at the copy. Comments of a
    /// `record.toml` that was read are not kept; every key is.
    ///
    /// # Errors
    /// Files that cannot be written or a stiffness table that cannot be read.
    pub fn write(&self, folder: &Path) -> Result<()> {
        std::fs::create_dir_all(folder).map_err(Error::file(folder))?;
        let mut declaration = self.declaration.clone();
        if let Some(table) = declaration.pair_stiffness() {
            let source = self.folder.join(&table);
            let name = PathBuf::from(source.file_name().unwrap_or("pair_stiffness.csv".as_ref()));
            let bytes = std::fs::read(&source).map_err(Error::file(&source))?;
            let target = folder.join(&name);
            std::fs::write(&target, bytes).map_err(Error::file(&target))?;
            declaration.set_pair_stiffness(&name);
        }
        declaration.runs = self.runs.iter().map(|run| run.declaration.clone()).collect();
        for run in &self.runs {
            npy::write_i16(&folder.join(&run.declaration.signal), run.codes(), run.channels())?;
            if let Some(tach) = &run.declaration.tach {
                write_edges(&folder.join(tach), &run.edges_s)?;
            }
        }
        declaration.write(&folder.join("record.toml"))
    }

    /// Run `index`.
    ///
    /// # Errors
    /// Where there is no such run.
    pub fn run(&self, index: usize) -> Result<&Run> {
        self.runs.get(index).ok_or_else(|| {
            Error::invalid(self.folder.display(), format!("has no run {index}; it has {}", self.runs.len()))
        })
    }

    /// Refuses records without tachometer, with the reason a command needs one.
    ///
    /// # Errors
    /// Where `[tach]` is absent or a run names no edge file.
    pub fn require_tach(&self) -> Result<&Tach> {
        let place = self.folder.join("record.toml");
        let tach = self.declaration.tach.as_ref();
        let tach =
            tach.ok_or_else(|| Error::invalid(place.display(), "has no [tach]; this command needs shaft speed"))?;
        if let Some(i) = self.runs.iter().position(|run| run.edges_s.is_empty()) {
            return Err(Error::invalid(
                place.display(),
                format!("[[run]] {i}: has no tach edges; this command needs them"),
            ));
        }
        Ok(tach)
    }
}
