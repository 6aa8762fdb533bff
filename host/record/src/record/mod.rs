//! Record folders: what was measured (or simulated) together with what its owner declares about the machine.
//!
//! A record is a folder with `record.toml`, one `runNN.npy` of int16 codes or float32 values (samples x channels) and
//! one `runNN.tach.csv` of edge times (s from the run's first sample) per run; `book/src/reference/record.md` has
//! every key. Files that a record names lie in its folder. Reading checks everything that later code relies on, so
//! that a [`Record`] in memory is sound: known channel count, finite numbers, strictly ascending edges, sensible
//! tooth counts. Each refusal is one line with file, table and key. A whole record is held in memory as it is stored
//! (2 or 4 bytes per value).

mod beside;
mod codes;
mod declaration;
pub mod export;
pub mod facts;
pub mod npy;
mod run;
mod tach;

pub use beside::{Beside, BesideDeclaration};
pub use codes::{CODE_MAX, encode, suggested_full_scale};
pub use declaration::{Acquisition, Declaration, FLOAT_BITS, LOAD, PART, RunDeclaration, Tach};
pub use run::Run;
pub use tach::{edges_text, read_edges};

use crate::confined;
use crate::output::{Content, OutputFolder, Outputs, is_left_over};
use crate::part::Part;
use crate::{Error, Result};
use std::collections::BTreeSet;
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
        if is_left_over(folder) {
            return Err(Error::invalid(folder.display(), "is what an interrupted command left, no record"));
        }
        let table = folder.join("record.toml");
        if folder.is_file() {
            let what = "is a file, not a record: a recording is made one by `meshband import FILE... -o RECORD`";
            return Err(Error::invalid(folder.display(), what));
        }
        if folder.is_dir() && !table.exists() {
            let what =
                "is no record (it has no record.toml): `meshband import FILE... -o RECORD` makes one of a recording";
            return Err(Error::invalid(folder.display(), what));
        }
        let declaration = Declaration::read(&table)?;
        // A table that is missing is said by whoever needs it.
        let tables = declaration.stiffness_tables().into_iter().filter(|(_, table)| folder.join(table).exists());
        for (_, table) in tables {
            confined::inside(folder, &table.to_string_lossy())?;
        }
        let runs =
            declaration.runs.iter().map(|run| Run::read(folder, run, &declaration)).collect::<Result<Vec<_>>>()?;
        Ok(Self { folder: folder.to_owned(), declaration, runs })
    }

    /// Writes the record as the new folder `folder`, whole or not at all; see [`Record::write_to`].
    ///
    /// # Errors
    /// A folder that exists and is not empty, and those of [`Record::write_to`].
    pub fn write(&self, folder: &Path) -> Result<()> {
        self.write_to(Outputs::default().folder(folder, Content::Record)?)
    }

    /// Writes the record into an announced folder and puts that into its place, `record.toml` last.
    ///
    /// Stiffness tables are copied along and the declaration points at the copies. Comments of a `record.toml` that
    /// was read are not kept; every key is.
    ///
    /// # Errors
    /// What reading would refuse, two files of one name, a stiffness table that cannot be read, files that cannot be
    /// written. Nothing is changed then.
    pub fn write_to(&self, folder: OutputFolder) -> Result<()> {
        let mut declaration = self.declaration.clone();
        let mut tables = Vec::new();
        for (key, table) in declaration.stiffness_tables() {
            let source = self.folder.join(&table);
            let name = source.file_name().unwrap_or_default().to_string_lossy().into_owned();
            tables.push((name.clone(), crate::budget::read(&source)?));
            declaration.set_stiffness_table(key, &name);
        }
        declaration.runs = self.runs.iter().map(|run| run.declaration.clone()).collect();
        let text = declaration.to_toml()?;
        let beside = declaration.runs.iter().flat_map(|run| run.beside.iter().map(|beside| &beside.file));
        let of_runs = declaration.runs.iter().flat_map(|run| [Some(&run.signal), run.tach.as_ref()]).flatten();
        let of_runs = of_runs.chain(beside);
        let mut names = BTreeSet::from(["record.toml"]);
        if let Some(name) = tables.iter().map(|t| &t.0).chain(of_runs).find(|name| !names.insert(name.as_str())) {
            return Err(Error::invalid("record.toml", format!("two files of the record are named {name}")));
        }
        for (name, bytes) in &tables {
            folder.write(name, bytes)?;
        }
        for run in &self.runs {
            folder.write(&run.declaration.signal, run.npy_bytes())?;
            if let Some(tach) = &run.declaration.tach {
                folder.write(tach, edges_text(&run.edges_s))?;
            }
            for (declaration, values) in run.declaration.beside.iter().zip(&run.beside) {
                folder.write(&declaration.file, npy::bytes_f32(values, 1))?;
            }
        }
        folder.write("record.toml", text)?;
        folder.commit()
    }

    /// The same part of every run, for a look at it: what was recorded beside the channels is left out. Turns count on
    /// from the whole run's first, so that teeth keep their numbers.
    ///
    /// # Errors
    /// A run that ends before the part begins.
    pub fn part(mut self, part: Part) -> Result<Self> {
        let folder = self.folder.clone();
        let cut = |(i, run): (usize, Run)| run.part(&format!("{} run {i}", folder.display()), part);
        self.runs = self.runs.into_iter().enumerate().map(cut).collect::<Result<_>>()?;
        self.declaration.runs = self.runs.iter().map(|run| run.declaration.clone()).collect();
        Ok(self)
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
