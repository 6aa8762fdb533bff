//! What a folder holds, entry by entry, without following symbolic links: compared before and after an attack.

use std::collections::BTreeMap;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::os::unix::fs::FileTypeExt;
use std::path::{Path, PathBuf};

/// One entry of a folder.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub enum Entry {
    /// A folder.
    Folder,
    /// A file by length and hash of its bytes.
    File(u64, u64),
    /// A symbolic link by its target.
    Link(PathBuf),
    /// A fifo, socket or device.
    Special,
}

/// Entries by their path in the folder.
#[derive(Debug, Clone, Default, PartialEq, Eq, Hash)]
pub struct Snapshot(pub BTreeMap<PathBuf, Entry>);

/// Files beyond this are compared by length and first bytes: sparse files of a terabyte are among the attacks.
const MAX_HASHED_BYTES: u64 = 1 << 28;

impl Snapshot {
    /// Everything below a folder; a file is one entry with an empty path; nothing where there is nothing.
    pub fn of(path: &Path) -> Self {
        let mut entries = BTreeMap::new();
        walk(path, Path::new(""), &mut entries);
        Self(entries)
    }

    /// The part below a path.
    pub fn below(&self, path: &Path) -> Self {
        let inside = |(key, entry): (&PathBuf, &Entry)| Some((key.strip_prefix(path).ok()?.to_owned(), entry.clone()));
        Self(self.0.iter().filter_map(inside).collect())
    }

    /// One number for everything.
    pub fn digest(&self) -> u64 {
        let mut hasher = DefaultHasher::new();
        self.hash(&mut hasher);
        hasher.finish()
    }

    /// Whether there is nothing, or only an empty folder.
    pub fn is_empty(&self) -> bool {
        self.0.keys().all(|path| path.as_os_str().is_empty()) && !self.0.values().any(|e| matches!(e, Entry::File(..)))
    }
}

fn walk(root: &Path, inner: &Path, entries: &mut BTreeMap<PathBuf, Entry>) {
    let path = if inner.as_os_str().is_empty() { root.to_owned() } else { root.join(inner) };
    let Ok(about) = std::fs::symlink_metadata(&path) else { return };
    let kind = about.file_type();
    let entry = if kind.is_symlink() {
        Entry::Link(std::fs::read_link(&path).unwrap_or_default())
    } else if kind.is_dir() {
        Entry::Folder
    } else if kind.is_fifo() || kind.is_socket() || kind.is_char_device() || kind.is_block_device() {
        Entry::Special
    } else {
        Entry::File(about.len(), hash_of(&path, about.len()))
    };
    let is_folder = entry == Entry::Folder;
    entries.insert(inner.to_owned(), entry);
    if is_folder {
        for child in std::fs::read_dir(&path).into_iter().flatten().flatten() {
            walk(root, &inner.join(child.file_name()), entries);
        }
    }
}

fn hash_of(path: &Path, length: u64) -> u64 {
    let mut hasher = DefaultHasher::new();
    if length <= MAX_HASHED_BYTES {
        // Unreadable counts as a state of its own.
        std::fs::read(path).ok().hash(&mut hasher);
    }
    hasher.finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn theory_any_change_of_content_place_or_kind_is_seen() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path();
        std::fs::create_dir(root.join("a")).unwrap();
        std::fs::write(root.join("a/b"), "one").unwrap();
        std::os::unix::fs::symlink("a/b", root.join("link")).unwrap();
        let before = Snapshot::of(root);
        assert_eq!(before, Snapshot::of(root));
        assert_eq!(before.below(Path::new("a")), Snapshot::of(&root.join("a")));
        std::fs::write(root.join("a/b"), "two").unwrap();
        assert_ne!(before.digest(), Snapshot::of(root).digest());
        std::fs::write(root.join("a/b"), "one").unwrap();
        assert_eq!(before.digest(), Snapshot::of(root).digest());
        std::fs::remove_file(root.join("link")).unwrap();
        std::fs::write(root.join("link"), "one").unwrap();
        assert_ne!(before, Snapshot::of(root));
        assert!(Snapshot::of(&root.join("absent")).is_empty() && !before.is_empty());
    }
}
