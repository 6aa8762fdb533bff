//! The last step of every write: a whole temporary takes the target's place.
//!
//! On Linux a target that must not exist is never replaced even if it appears at the last moment, and an existing
//! folder is exchanged with the new one in one step. Elsewhere (and on file systems that cannot) there is a moment
//! between two renames in which a folder's old state is found under its hidden name beside the target only; the next
//! writer of the target puts it back.

use super::interrupt::remove;
use super::place::beside;
use std::io::{Error, ErrorKind, Result};
use std::path::Path;

/// Moves a file to `target`, which must not exist.
pub(super) fn put_new(from: &Path, target: &Path) -> Result<()> {
    #[cfg(target_os = "linux")]
    {
        use rustix::fs::{CWD, RenameFlags, renameat_with};
        match renameat_with(CWD, from, CWD, target, RenameFlags::NOREPLACE) {
            Err(rustix::io::Errno::INVAL | rustix::io::Errno::NOSYS) => {}
            done => return done.map_err(Error::from),
        }
    }
    if target.symlink_metadata().is_ok() {
        return Err(Error::from(ErrorKind::AlreadyExists));
    }
    std::fs::rename(from, target)
}

/// Moves a folder to `target`, which must not exist or be empty.
pub(super) fn put_new_folder(from: &Path, target: &Path) -> Result<()> {
    if cfg!(not(unix)) && target.is_dir() {
        std::fs::remove_dir(target)?;
    }
    // Refused by the operating system where the folder is not empty.
    std::fs::rename(from, target)
}

/// Puts the folder `from` where the folder `target` is, and removes the old one.
pub(super) fn replace_folder(from: &Path, target: &Path) -> Result<()> {
    #[cfg(target_os = "linux")]
    {
        use rustix::fs::{CWD, RenameFlags, renameat_with};
        match renameat_with(CWD, from, CWD, target, RenameFlags::EXCHANGE) {
            Err(rustix::io::Errno::INVAL | rustix::io::Errno::NOSYS) => {}
            // What is old now has the temporary's name and goes with it.
            done => return done.map_err(Error::from),
        }
    }
    let old = beside(target, "old");
    remove(&old);
    std::fs::rename(target, &old)?;
    if let Err(error) = std::fs::rename(from, target) {
        std::fs::rename(&old, target)?;
        return Err(error);
    }
    remove(&old);
    Ok(())
}

/// Puts back what a writer left that was killed between the two renames of [`replace_folder`], and removes its
/// temporary.
pub(super) fn recover(target: &Path) {
    let old = beside(target, "old");
    if old.symlink_metadata().is_ok() {
        match target.symlink_metadata() {
            Ok(_) => remove(&old),
            // Where that fails the target does not exist, which the caller sees.
            Err(_) => drop(std::fs::rename(&old, target)),
        }
    }
    remove(&beside(target, "tmp"));
}

/// Makes renames in `folder` last through a power cut; file systems that cannot are none the worse.
pub(super) fn settle(folder: &Path) {
    if let Ok(folder) = std::fs::File::open(folder) {
        let _ = folder.sync_all();
    }
}
