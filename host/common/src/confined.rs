//! Names inside a record stay inside it: a record from elsewhere must not make this program read or write other files.
//!
//! Refused are absolute paths, `..`, and links that lead out of the folder; links within it are followed.

use crate::{Error, Result};
use std::path::{Component, Path, PathBuf};

/// Checks a name as it stands in `record.toml`; `place` names the key.
///
/// # Errors
/// An empty or absolute name, or one with `..`.
pub fn check_name(place: &str, name: &Path) -> Result<()> {
    let inside = name.components().all(|part| matches!(part, Component::Normal(_) | Component::CurDir));
    if inside && name.file_name().is_some() {
        return Ok(());
    }
    Err(Error::invalid(place, format!("'{}' is not a file of the record's own folder", name.display())))
}

/// Path of a file of the record in `folder`, links followed for the check.
///
/// # Errors
/// No such file, or one outside the folder.
pub fn inside(folder: &Path, name: &str) -> Result<PathBuf> {
    let path = folder.join(name);
    let real = path.canonicalize().map_err(Error::file(&path))?;
    let root = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    if !real.starts_with(root.canonicalize().map_err(Error::file(root))?) {
        return Err(Error::invalid(path.display(), format!("leads out of the record, to {}", real.display())));
    }
    Ok(path)
}
