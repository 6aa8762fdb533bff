//! A whole folder or none: written beside its place under a hidden name, then put there in one step.
//!
//! What is written is brought to the disk at the end, all files at once: one after the other they would each wait for
//! the disk's journal.
//!
//! An existing folder is replaced only where it is what this program would have written, file by file: a user's own
//! file in it is never lost, whatever options say.

use super::file::{sync, write_new};
use super::interrupt::{Temporary, undisturbed};
use super::inventory::Content;
use super::lock::Lock;
use super::place::beside;
use super::{inventory, rename};
use crate::{Error, Result};
use rayon::prelude::*;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// A folder that a command has announced ([`super::Outputs::folder`]).
#[derive(Debug)]
pub struct OutputFolder {
    target: PathBuf,
    replace: bool,
    temporary: Temporary,
    /// Names of the files written so far.
    written: Mutex<BTreeSet<PathBuf>>,
    _lock: Lock,
    _parents: Parents,
}

impl OutputFolder {
    /// Takes the right to write `target`, links resolved, and opens the temporary beside it.
    pub(super) fn claim(target: PathBuf, parents: Parents, content: Content, force: bool) -> Result<Self> {
        if std::env::current_dir().and_then(|d| d.canonicalize()).is_ok_and(|current| current.starts_with(&target)) {
            return Err(Error::invalid(target.display(), "is the folder you are in; name one inside it"));
        }
        let lock = Lock::take(&target)?;
        rename::recover(&target);
        let replace = match target.metadata() {
            Err(_) => false,
            Ok(found) if !found.is_dir() => return Err(Error::invalid(target.display(), "exists and is no folder")),
            Ok(_) if inventory::is_empty(&target)? => false,
            Ok(_) if !force => {
                inventory::replaceable(&target, content)?;
                return Err(Error::invalid(target.display(), "exists; --force replaces it"));
            }
            Ok(_) => {
                inventory::replaceable(&target, content)?;
                true
            }
        };
        let temporary = Temporary::register(beside(&target, "tmp"));
        undisturbed(|| std::fs::create_dir(temporary.path())).map_err(Error::file(&target))?;
        Ok(Self { target, replace, temporary, written: Mutex::default(), _lock: lock, _parents: parents })
    }

    /// Writes one file of the folder; callable from several threads.
    ///
    /// # Errors
    /// What the operating system says, with the name the file was to have in the end.
    pub fn write(&self, name: impl AsRef<Path>, content: impl AsRef<[u8]>) -> Result<()> {
        let name = name.as_ref();
        let path = self.temporary.path().join(name);
        let folder = path.parent().unwrap_or(self.temporary.path());
        // Not while an interrupt removes the temporary, which would come back with this.
        let made = undisturbed(|| std::fs::create_dir_all(folder));
        let done = made.and_then(|()| write_new(&path, content.as_ref()));
        done.map_err(Error::file(&self.target.join(name)))?;
        self.written.lock().unwrap_or_else(PoisonError::into_inner).insert(name.to_owned());
        Ok(())
    }

    /// Puts the folder into its place.
    ///
    /// # Errors
    /// The place was taken meanwhile, or what the operating system says; the old state then stands.
    pub fn commit(self) -> Result<()> {
        self.settle()?;
        let (from, target) = (self.temporary.path(), self.target.as_path());
        let put =
            || if self.replace { rename::replace_folder(from, target) } else { rename::put_new_folder(from, target) };
        undisturbed(put).map_err(Error::file(target))?;
        rename::settle(target.parent().unwrap_or(Path::new(".")));
        Ok(())
    }

    /// Waits until all files and the folders they are in are on the disk.
    fn settle(&self) -> Result<()> {
        let written = self.written.lock().unwrap_or_else(PoisonError::into_inner);
        let folders: BTreeSet<&Path> = written.iter().flat_map(|name| name.ancestors().skip(1)).collect();
        let to_disk =
            |name: &PathBuf| sync(&self.temporary.path().join(name)).map_err(Error::file(&self.target.join(name)));
        let settled = || folders.par_iter().for_each(|name| rename::settle(&self.temporary.path().join(name)));
        rayon::join(|| written.par_iter().try_for_each(to_disk), settled).0
    }
}

/// Folders above a target that were made for it; those still empty go again.
#[derive(Debug, Default)]
pub(super) struct Parents(Vec<PathBuf>);

impl Parents {
    /// Makes what is missing above `path`.
    pub(super) fn make(path: &Path) -> Result<Self> {
        let mut made = Self::default();
        let missing: Vec<&Path> = path
            .ancestors()
            .skip(1)
            .take_while(|p| !p.as_os_str().is_empty() && p.symlink_metadata().is_err())
            .collect();
        for folder in missing.into_iter().rev() {
            match std::fs::create_dir(folder) {
                Ok(()) => made.0.push(folder.to_owned()),
                // Another writer was quicker.
                Err(error) if error.kind() == std::io::ErrorKind::AlreadyExists => {}
                Err(error) => return Err(Error::file(folder)(error)),
            }
        }
        Ok(made)
    }
}

impl Drop for Parents {
    fn drop(&mut self) {
        for folder in self.0.iter().rev() {
            // Refused where something has been put there, as it should be.
            let _ = std::fs::remove_dir(folder);
        }
    }
}
