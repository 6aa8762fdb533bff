//! Everything the command writes: no output over an input, nothing replaced unasked, whole or not at all.
//!
//! A command names what it reads and announces what it will write before its work ([`Outputs`]): what must not be
//! written is refused while nothing is lost yet, and a lock keeps a second writer from the same target. Then it
//! works, writes its files, and only then shows text ([`crate::say`]). Whatever ends it in between (an error, a full
//! disk, an interrupt) leaves the old state or the new one; a kill leaves at most a hidden temporary that no command
//! takes for a result and that the next writer of the same target removes.

mod file;
mod folder;
pub mod interrupt;
mod inventory;
mod lock;
mod place;
mod prose;
mod rename;
mod set;

pub use file::OutputFile;
pub use folder::OutputFolder;
pub use inventory::{COMMISSIONING, Content};
pub use lock::Lock;
pub use place::is_left_over;
pub use prose::{CLOSED_EXIT_CODE, show};
pub use set::OutputSet;

use crate::{Error, Result};
use file::Target;
use folder::Parents;
use place::{Existing, resolved};
use std::path::{Path, PathBuf};

/// What a command reads and what it will write.
#[derive(Debug, Default)]
pub struct Outputs {
    force: bool,
    inputs: Vec<Existing>,
    claimed: Vec<PathBuf>,
    on_stdout: bool,
}

impl Outputs {
    /// Nothing yet; with `force` existing results may be replaced.
    pub fn new(force: bool) -> Self {
        Self { force, ..Self::default() }
    }

    /// Names an input: a file, a machine with its tables, a record folder with its files. What does not exist is
    /// passed over.
    pub fn reads(&mut self, path: &Path) {
        self.inputs.extend(Existing::at(path));
        let declaration = if path.is_dir() { path.join("record.toml") } else { path.to_owned() };
        self.inputs.extend(Existing::at(&declaration));
        let is_text = declaration.extension().is_some_and(|e| e == "toml") && declaration.is_file();
        let Some(text) = is_text.then(|| std::fs::read_to_string(&declaration).ok()).flatten() else { return };
        let folder = declaration.parent().unwrap_or(Path::new(""));
        self.inputs.extend(inventory::named(&text).iter().filter_map(|name| Existing::at(&folder.join(name))));
    }

    /// Announces a file; `-` is standard output, and text for people then goes to standard error.
    ///
    /// # Errors
    /// An input, another output, something that exists (without force), a folder, another writer, no such folder.
    pub fn file(&mut self, path: &Path) -> Result<OutputFile> {
        if path == Path::new("-") {
            if std::mem::replace(&mut self.on_stdout, true) {
                return Err(Error::invalid("-", "only one result can go to standard output"));
            }
            return Ok(OutputFile::standard_output());
        }
        match path.metadata() {
            Ok(found) if is_stream(&found) => Ok(OutputFile::stream(path.to_owned())),
            _ => Ok(OutputFile::regular(self.target(path)?)),
        }
    }

    /// Announces a file where one is wanted.
    ///
    /// # Errors
    /// As [`Outputs::file`].
    pub fn optional(&mut self, path: Option<&Path>) -> Result<Option<OutputFile>> {
        path.map(|path| self.file(path)).transpose()
    }

    /// Announces files of one folder that belong together.
    ///
    /// # Errors
    /// As [`Outputs::file`], for any of them.
    pub fn set(&mut self, folder: &Path, names: &[String]) -> Result<OutputSet> {
        let targets = names.iter().map(|name| self.target(&folder.join(name))).collect::<Result<_>>()?;
        OutputSet::new(targets)
    }

    /// Announces a file that is written from now on, line by line: what it holds is kept.
    ///
    /// # Errors
    /// An input, another output, another writer, no such folder.
    pub fn appended(&mut self, path: &Path) -> Result<Lock> {
        let path = resolved(path)?;
        self.claim(&path)?;
        Lock::take(&path)
    }

    /// Announces a folder; what is missing above it is made.
    ///
    /// # Errors
    /// As [`Outputs::file`], and a folder that holds anything but `content`.
    pub fn folder(&mut self, path: &Path, content: Content) -> Result<OutputFolder> {
        let parents = Parents::make(path)?;
        let path = resolved(path)?;
        self.claim(&path)?;
        OutputFolder::claim(path, parents, content, self.force)
    }

    fn target(&mut self, path: &Path) -> Result<Target> {
        let path = resolved(path)?;
        self.claim(&path)?;
        Target::claim(path, self.force)
    }

    /// Refuses what is an input or holds one, and what another output is or holds.
    fn claim(&mut self, path: &Path) -> Result<()> {
        let existing = Existing::at(path);
        let is_input = |input: &Existing| {
            let holds = existing.as_ref().is_some_and(|e| e.is(input));
            holds || input.path.starts_with(path)
        };
        if let Some(input) = self.inputs.iter().find(|input| is_input(input)) {
            let what = if input.path == path {
                "is read by this command".into()
            } else {
                format!("is or holds {}, which this command reads", input.path.display())
            };
            return Err(Error::invalid(path.display(), what + "; name another output"));
        }
        if let Some(other) = self.claimed.iter().find(|other| path.starts_with(other) || other.starts_with(path)) {
            let what = format!("and the output {} would be in each other's way", other.display());
            return Err(Error::invalid(path.display(), what));
        }
        self.claimed.push(path.to_owned());
        Ok(())
    }
}

/// Terminals, pipes and the null device, but no disk.
#[cfg(unix)]
fn is_stream(found: &std::fs::Metadata) -> bool {
    use std::os::unix::fs::FileTypeExt;
    found.file_type().is_char_device() || found.file_type().is_fifo()
}

/// Nothing that can be told.
#[cfg(not(unix))]
fn is_stream(_: &std::fs::Metadata) -> bool {
    false
}
