//! One writer per target: a lock of the operating system on a hidden file beside it.
//!
//! The lock belongs to the open file, so it goes with the process however that ends; the file that a killed process
//! leaves behind blocks nobody and is used by the next. The holder removes the file before it lets go, so a taker
//! makes sure that the file it has locked is still the one with that name. Where a file system knows no locks,
//! writing goes on without.

use super::interrupt::{Temporary, undisturbed};
use super::place::{beside, identity};
use crate::{Error, Result};
use std::fs::{File, OpenOptions, TryLockError};
use std::path::Path;

/// The right to write one target, given back when dropped.
#[derive(Debug)]
pub struct Lock {
    // In this order: the name goes while the lock is still held.
    _name: Temporary,
    _file: File,
}

impl Lock {
    /// Takes the lock of `target`, whose folder must exist.
    ///
    /// # Errors
    /// Another process writes the target, or its folder cannot be written.
    pub(super) fn take(target: &Path) -> Result<Self> {
        let path = beside(target, "lock");
        loop {
            // An interrupt between the file and its registration would leave it behind.
            if let Some(lock) = undisturbed(|| Self::attempt(target, &path))? {
                return Ok(lock);
            }
        }
    }

    /// The lock, or nothing where its file went while it was taken.
    fn attempt(target: &Path, path: &Path) -> Result<Option<Self>> {
        let open = OpenOptions::new().create(true).truncate(false).write(true).open(path);
        let file = open.map_err(Error::file(target))?;
        match file.try_lock() {
            Err(TryLockError::WouldBlock) => {
                return Err(Error::invalid(target.display(), "another meshband is writing it"));
            }
            Err(TryLockError::Error(_)) | Ok(()) => {}
        }
        let held = file.metadata().ok().as_ref().and_then(identity);
        let is_ours = held == path.metadata().ok().as_ref().and_then(identity);
        Ok(is_ours.then(|| Self { _name: Temporary::register(path.to_path_buf()), _file: file }))
    }
}
