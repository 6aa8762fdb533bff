//! One file, whole or not at all: written beside its place under a hidden name, made durable, then renamed.

use super::interrupt::{Temporary, undisturbed};
use super::lock::Lock;
use super::place::beside;
use super::{prose, rename};
use crate::{Error, Result};
use serde::Serialize;
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

/// A file that a command has announced ([`super::Outputs::file`]) and may write, more than once.
#[derive(Debug)]
pub struct OutputFile(Place);

#[derive(Debug)]
enum Place {
    /// `-`.
    StandardOutput,
    /// A terminal, a pipe, the null device: nothing is there that could be lost.
    Stream(PathBuf),
    File(Target),
}

/// A regular file's place and the right to write it.
#[derive(Debug)]
pub(super) struct Target {
    pub path: PathBuf,
    /// Whether something is there that may go.
    pub replace: bool,
    _lock: Lock,
}

impl Target {
    /// Takes the right to write `path`, links resolved.
    ///
    /// # Errors
    /// A folder, a write-protected file, a file without `force`, another writer.
    pub(super) fn claim(path: PathBuf, force: bool) -> Result<Self> {
        let lock = Lock::take(&path)?;
        rename::recover(&path);
        let replace = match path.metadata() {
            Err(_) => false,
            Ok(found) if found.is_dir() => return Err(Error::invalid(path.display(), "is a folder")),
            Ok(found) if found.permissions().readonly() => {
                return Err(Error::invalid(path.display(), "is write-protected"));
            }
            Ok(_) if force => true,
            Ok(_) => return Err(Error::invalid(path.display(), "exists; --force replaces it")),
        };
        Ok(Self { path, replace, _lock: lock })
    }

    /// Moves the whole file `from` here.
    pub(super) fn put(&mut self, from: &Path) -> Result<()> {
        if self.replace {
            if let Ok(old) = self.path.metadata() {
                // Whoever may read the old one may read the new one.
                let _ = std::fs::set_permissions(from, old.permissions());
            }
            std::fs::rename(from, &self.path).map_err(Error::file(&self.path))?;
        } else {
            rename::put_new(from, &self.path).map_err(Error::file(&self.path))?;
        }
        // What is here now is this program's own.
        self.replace = true;
        Ok(())
    }
}

impl OutputFile {
    pub(super) fn standard_output() -> Self {
        prose::leave_stdout_to_results();
        Self(Place::StandardOutput)
    }

    pub(super) fn stream(path: PathBuf) -> Self {
        Self(Place::Stream(path))
    }

    pub(super) fn regular(target: Target) -> Self {
        Self(Place::File(target))
    }

    /// Whether what is written once can be replaced by a later [`OutputFile::write`].
    pub fn can_be_rewritten(&self) -> bool {
        matches!(self.0, Place::File(_))
    }

    /// Writes the content: afterwards the file is whole, or as it was.
    ///
    /// # Errors
    /// What the operating system says: no space, no right.
    pub fn write(&mut self, content: impl AsRef<[u8]>) -> Result<()> {
        let content = content.as_ref();
        match &mut self.0 {
            Place::StandardOutput => prose::to_stdout(content),
            Place::Stream(path) => {
                let file = std::fs::OpenOptions::new().write(true).open(&*path);
                file.and_then(|mut file| file.write_all(content)).map_err(Error::file(path))
            }
            Place::File(target) => {
                let temporary = Temporary::register(beside(&target.path, "tmp"));
                write_durably(temporary.path(), content).map_err(Error::file(&target.path))?;
                undisturbed(|| target.put(temporary.path()))?;
                rename::settle(target.path.parent().unwrap_or(Path::new(".")));
                Ok(())
            }
        }
    }

    /// Writes a value as indented JSON with a final newline.
    ///
    /// # Errors
    /// As [`OutputFile::write`].
    pub fn write_json(&mut self, value: &impl Serialize) -> Result<()> {
        let text = serde_json::to_string_pretty(value).map_err(|error| Error::invalid("JSON", error))?;
        self.write(text + "\n")
    }
}

/// Writes a new file and waits until it is on the disk.
pub(super) fn write_durably(path: &Path, content: &[u8]) -> std::io::Result<()> {
    write_new(path, content)?;
    sync(path)
}

/// Writes a new file; it is on the disk after [`sync`].
pub(super) fn write_new(path: &Path, content: &[u8]) -> std::io::Result<()> {
    undisturbed(|| File::create(path))?.write_all(content)
}

/// Waits until a file is on the disk.
pub(super) fn sync(path: &Path) -> std::io::Result<()> {
    // Some systems bring to the disk only what was opened for writing.
    std::fs::OpenOptions::new().write(true).open(path)?.sync_all()
}
