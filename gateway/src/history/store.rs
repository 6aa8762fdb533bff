//! A folder of partitions that one process changes while others read it.
//!
//! What goes in place of a partition is built in a folder beside the root (`ROOT.staging`), so that no pattern of a
//! reader meets it, and the two are exchanged by one rename. A kill leaves the old content or the new one, never both,
//! and what is in the staging folder goes at the next start. Where the file system cannot exchange (NFS) or no folder
//! can be made beside the root, the new file comes first and the old ones go behind it: for that moment a reader of
//! plain files counts rows twice. A lock in the staging folder keeps a second process from changing the same root.

use super::cut;
use super::files::{Part, parts, recover, sync};
use crate::error::{Error, Result, at};
use std::fs::{File, TryLockError};
use std::io::ErrorKind;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// A root and the right to change it.
#[derive(Debug)]
pub struct Store {
    root: PathBuf,
    /// What is built to go in place of a partition; `None` where no folder can be beside the root, or only on another
    /// file system.
    next: Option<PathBuf>,
    /// Held as long as the root is.
    _lock: Option<File>,
}

impl Store {
    /// Creates the root and takes it; removes what an interrupted exchange left.
    ///
    /// # Errors
    /// Of the file system, and where another process works there.
    pub fn open(root: &Path) -> Result<Self> {
        at(root, std::fs::create_dir_all(root))?;
        let mut name = root.file_name().unwrap_or_default().to_owned();
        name.push(".staging");
        // The folder itself, so that `history/` and a link to it have the same lock.
        let beside = at(root, root.canonicalize())?.with_file_name(name);
        let lock = match std::fs::create_dir_all(&beside) {
            Ok(()) => Some(lock(root, &beside)?),
            Err(reason) if matches!(reason.kind(), ErrorKind::PermissionDenied | ErrorKind::ReadOnlyFilesystem) => None,
            Err(reason) => return Err(Error::new(beside.display(), reason)),
        };
        let device = |path: &Path| at(path, std::fs::metadata(path)).map(|data| data.dev());
        let together = lock.is_some() && device(root)? == device(&beside)?;
        let next = together.then(|| beside.join("partition"));
        let store = Self { root: root.to_owned(), next, _lock: lock };
        store.clear()?;
        Ok(store)
    }

    /// The root.
    pub fn root(&self) -> &Path {
        &self.root
    }

    fn clear(&self) -> Result {
        match &self.next {
            Some(next) if next.exists() => at(next, std::fs::remove_dir_all(next)),
            _ => Ok(()),
        }
    }

    /// Removes what an interrupted writer left; see [`recover`].
    ///
    /// # Errors
    /// Of the file system.
    pub fn recover(&self, next: u64) -> Result<usize> {
        recover(&self.root, next)
    }

    /// Puts what `build` writes into the folder that it is given in place of the files `old`; the others stay.
    ///
    /// # Errors
    /// Of the file system; the partition is then as before.
    pub fn replace(&self, partition: &Path, old: &[Part], build: impl FnOnce(&Path) -> Result) -> Result {
        let Some(next) = &self.next else { return in_place(partition, old, build) };
        self.clear()?;
        at(next, std::fs::create_dir_all(next))?;
        build(next)?;
        let fresh = parts(next)?;
        for kept in parts(partition)?.iter().filter(|part| !old.contains(part)) {
            let Some(name) = kept.path.file_name() else { continue };
            if let Err(reason) = std::fs::hard_link(&kept.path, next.join(name)) {
                return apart(partition, old, &fresh, &reason);
            }
        }
        sync(next)?;
        cut::point();
        if let Err(reason) = exchange(next, partition) {
            return apart(partition, old, &fresh, &reason);
        }
        cut::point();
        if let Some(above) = partition.parent() {
            sync(above)?;
        }
        self.clear()
    }

    /// Takes a partition away, whole.
    ///
    /// # Errors
    /// Of the file system; the partition then stays, or some of its files where it can only be removed piece by piece.
    pub fn remove(&self, partition: &Path) -> Result {
        self.clear()?;
        cut::point();
        let moved = self.next.as_ref().is_some_and(|next| std::fs::rename(partition, next).is_ok());
        if !moved {
            at(partition, std::fs::remove_dir_all(partition))?;
        }
        cut::point();
        if let Some(above) = partition.parent() {
            sync(above)?;
            // The last partition of a machine: its folder is empty, and goes where it is.
            let _ = std::fs::remove_dir(above);
        }
        self.clear()
    }
}

fn lock(root: &Path, staging: &Path) -> Result<File> {
    let path = staging.join("lock");
    let file = at(&path, File::create(&path))?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(TryLockError::WouldBlock) => {
            Err(Error::new(root.display(), "another process works in this folder; stop the gateway first"))
        }
        Err(TryLockError::Error(reason)) => Err(Error::new(path.display(), reason)),
    }
}

/// The new file first, then the old ones go.
fn in_place(partition: &Path, old: &[Part], build: impl FnOnce(&Path) -> Result) -> Result {
    build(partition)?;
    let fresh: Vec<Part> = parts(partition)?.into_iter().filter(|part| covers(old, part)).collect();
    for part in old.iter().filter(|part| !fresh.contains(part)) {
        at(&part.path, std::fs::remove_file(&part.path))?;
    }
    sync(partition)
}

/// Whether a file has the range of all the old ones.
fn covers(old: &[Part], part: &Part) -> bool {
    old.iter().all(|old| part.first <= old.first && old.last <= part.last)
}

/// What was built goes over file by file, as the folders cannot be exchanged.
fn apart(partition: &Path, old: &[Part], fresh: &[Part], reason: &std::io::Error) -> Result {
    let other = matches!(
        reason.kind(),
        ErrorKind::Unsupported | ErrorKind::InvalidInput | ErrorKind::CrossesDevices | ErrorKind::PermissionDenied
    );
    if !other {
        return Err(Error::new(partition.display(), reason));
    }
    in_place(partition, old, |folder| {
        for part in fresh {
            let Some(name) = part.path.file_name() else { continue };
            at(&part.path, std::fs::rename(&part.path, folder.join(name)))?;
        }
        Ok(())
    })
}

#[cfg(target_os = "linux")]
fn exchange(one: &Path, other: &Path) -> std::io::Result<()> {
    use rustix::fs::{CWD, RenameFlags, renameat_with};
    Ok(renameat_with(CWD, one, CWD, other, RenameFlags::EXCHANGE)?)
}

#[cfg(not(target_os = "linux"))]
fn exchange(_: &Path, _: &Path) -> std::io::Result<()> {
    Err(ErrorKind::Unsupported.into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::history::compact::{compact, read};
    use crate::history::files::{Format, write};
    use crate::history::rows::Rows;
    use crate::journal::entry::{Body, Entry, Note};

    fn folder(name: &str) -> PathBuf {
        let folder = std::env::temp_dir().join(format!("meshband-store-{name}-{}", std::process::id()));
        let _ = std::fs::remove_dir_all(&folder);
        folder
    }

    /// Three files of ten rows.
    fn fill(partition: &Path) {
        let format = Format::history().expect("a format");
        for first in [0, 10, 20] {
            let mut rows = Rows::default();
            for number in first..first + 10 {
                let body = Body::Note { kind: Note::Command, detail: 0, text: String::new() };
                let (node, machine) = ("n".to_owned(), "m".to_owned());
                rows.push(number, &Entry { node, machine, unit: [1; 3], boot: 1, received_us: 0, time_us: 0, body });
            }
            write(partition, (first, first + 9), &format, [rows.finish()]).expect("writes");
        }
    }

    fn held(partition: &Path) -> (Vec<(u64, u64)>, usize) {
        let parts = parts(partition).expect("lists");
        let rows =
            parts.iter().flat_map(|part| read(&part.path, |_| true)).map(|batch| batch.expect("reads").num_rows());
        (parts.iter().map(|part| (part.first, part.last)).collect(), rows.sum())
    }

    #[test]
    fn claim_a_partition_is_replaced_alike_with_and_without_an_exchange_and_other_files_stay() {
        let folder = folder("replace");
        let root = folder.join("history");
        let store = Store::open(&root).expect("opens");
        let piecewise = Store { root: root.clone(), next: None, _lock: None };
        let format = Format::history().expect("a format");
        for (name, store) in [("a", &store), ("b", &piecewise)] {
            let partition = root.join(format!("machine={name}/day=2026-01-01"));
            fill(&partition);
            let two = &parts(&partition).expect("lists")[..2];
            let rows = two.iter().flat_map(|part| crate::history::compact::batches(&part.path, &format));
            store.replace(&partition, two, |folder| write(folder, (0, 19), &format, rows).map(drop)).expect("replaces");
            assert_eq!(held(&partition), (vec![(0, 19), (20, 29)], 30), "{name}");
            assert_eq!(compact(store, &partition, 2, &format).expect("merges"), (2, 1));
            assert_eq!(held(&partition), (vec![(0, 29)], 30), "{name}");
            store.remove(&partition).expect("removes");
            assert!(!partition.exists() && !root.join(format!("machine={name}")).exists());
        }
        assert_eq!(std::fs::read_dir(folder.join("history.staging")).expect("lists").count(), 1, "the lock alone");
        let _ = std::fs::remove_dir_all(&folder);
    }

    #[test]
    fn fault_what_cannot_be_built_leaves_the_partition_as_it_was() {
        let folder = folder("built");
        let store = Store::open(&folder.join("history")).expect("opens");
        let partition = folder.join("history/machine=m/day=2026-01-01");
        fill(&partition);
        let all = parts(&partition).expect("lists");
        let refused = store.replace(&partition, &all, |_| Err(Error::new("disk", "full"))).expect_err("refused");
        assert_eq!(refused.to_string(), "disk: full");
        assert_eq!(held(&partition), (vec![(0, 9), (10, 19), (20, 29)], 30));
        let _ = std::fs::remove_dir_all(&folder);
    }

    #[test]
    fn fault_a_second_process_on_one_root_is_refused_with_a_remedy() {
        let folder = folder("lock");
        let _first = Store::open(&folder.join("history")).expect("opens");
        let second = Store::open(&folder.join("history/")).expect_err("is taken").to_string();
        assert!(second.contains("stop the gateway first"), "{second}");
        let _ = std::fs::remove_dir_all(&folder);
    }
}
