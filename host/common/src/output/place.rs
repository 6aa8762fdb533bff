//! Where a path really leads: links resolved, hard links told by device and inode.

use crate::{Error, Result};
use std::fs::Metadata;
use std::path::{Path, PathBuf};

/// Marks the hidden names that belong to a target while it is written.
const MARK: &str = ".meshband-";

/// A name beside `target` that belongs to it and that nothing takes for a result.
pub(super) fn beside(target: &Path, purpose: &str) -> PathBuf {
    let name = target.file_name().unwrap_or_default().to_string_lossy();
    target.with_file_name(format!(".{name}{MARK}{purpose}"))
}

/// Whether `path` names what an interrupted writer left behind.
pub fn is_left_over(path: &Path) -> bool {
    path.file_name().is_some_and(|name| {
        let name = name.to_string_lossy();
        name.starts_with('.') && name.rsplit_once(MARK).is_some()
    })
}

/// Device and inode.
#[cfg(unix)]
pub(super) fn identity(metadata: &Metadata) -> Option<(u64, u64)> {
    use std::os::unix::fs::MetadataExt;
    Some((metadata.dev(), metadata.ino()))
}

/// Unknown: paths alone are compared.
#[cfg(not(unix))]
pub(super) fn identity(_: &Metadata) -> Option<(u64, u64)> {
    None
}

/// Something that exists, by every name it may have.
#[derive(Debug, Clone)]
pub(super) struct Existing {
    /// Its path with all links resolved.
    pub path: PathBuf,
    id: Option<(u64, u64)>,
}

impl Existing {
    /// What `path` leads to, where that exists.
    pub(super) fn at(path: &Path) -> Option<Self> {
        let metadata = path.metadata().ok()?;
        Some(Self { path: path.canonicalize().ok()?, id: identity(&metadata) })
    }

    /// Whether both are one file or folder.
    pub(super) fn is(&self, other: &Self) -> bool {
        self.path == other.path || (self.id.is_some() && self.id == other.id)
    }
}

/// The path of a target with links resolved, whether it exists or not; its folder must exist.
///
/// # Errors
/// No such folder, a path without a name, or a link that leads nowhere.
pub(super) fn resolved(path: &Path) -> Result<PathBuf> {
    if path.symlink_metadata().is_ok() {
        return path.canonicalize().map_err(Error::file(path));
    }
    let name = path.file_name().ok_or_else(|| Error::invalid(path.display(), "names no file"))?;
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    Ok(folder.canonicalize().map_err(Error::file(path))?.join(name))
}
