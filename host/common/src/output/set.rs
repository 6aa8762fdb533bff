//! Several files of one folder that belong together: written aside, used from there, then put into their places
//! together.
//!
//! No interrupt comes between the renames; only a kill or a power cut there could leave some of them old. A file that
//! was announced and not written goes if it was there: it belonged to the state that is replaced.

use super::file::{Target, write_durably};
use super::interrupt::{Temporary, undisturbed};
use super::place::beside;
use super::rename;
use crate::{Error, Result};
use std::path::{Path, PathBuf};

/// Files that a command has announced together ([`super::Outputs::set`]).
#[derive(Debug)]
pub struct OutputSet {
    folder: PathBuf,
    temporary: Temporary,
    targets: Vec<Target>,
}

impl OutputSet {
    /// The files at `targets`, all of one folder; at least one.
    pub(super) fn new(targets: Vec<Target>) -> Result<Self> {
        let folder = targets[0].path.parent().unwrap_or(Path::new(".")).to_owned();
        let temporary = Temporary::register(beside(&targets[0].path, "tmp"));
        undisturbed(|| std::fs::create_dir(temporary.path())).map_err(Error::file(&folder))?;
        Ok(Self { folder, temporary, targets })
    }

    /// Where the files will be.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Where they are until then.
    pub fn staging(&self) -> &Path {
        self.temporary.path()
    }

    /// Writes one of the files aside.
    ///
    /// # Errors
    /// What the operating system says.
    ///
    /// # Panics
    /// If the name was not announced: a programming error of the caller.
    pub fn write(&self, name: &str, content: impl AsRef<[u8]>) -> Result<()> {
        let path = self.folder.join(name);
        assert!(self.targets.iter().any(|t| t.path.file_name() == path.file_name()), "{name} was not announced");
        write_durably(&self.temporary.path().join(name), content.as_ref()).map_err(Error::file(&path))
    }

    /// Puts all that was written into place.
    ///
    /// # Errors
    /// What the operating system says of the first file that cannot be put.
    pub fn commit(mut self) -> Result<()> {
        let staging = self.temporary.path().to_owned();
        undisturbed(|| {
            self.targets.iter_mut().try_for_each(|target| {
                let from = staging.join(target.path.file_name().unwrap_or_default());
                match from.exists() {
                    true => target.put(&from),
                    false if target.replace => std::fs::remove_file(&target.path).map_err(Error::file(&target.path)),
                    false => Ok(()),
                }
            })
        })?;
        rename::settle(&self.folder);
        Ok(())
    }
}
