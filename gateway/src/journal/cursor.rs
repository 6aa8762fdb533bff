//! A consumer's place in the journal: one number in one file, replaced whole.

use crate::error::{Result, at};
use std::io::Write;
use std::path::{Path, PathBuf};

/// Number of the next entry that a consumer will take.
#[derive(Debug)]
pub struct Cursor {
    path: PathBuf,
    next: u64,
}

impl Cursor {
    /// The place kept, or the journal's beginning.
    ///
    /// # Errors
    /// Of the file, and for a file that holds no number.
    pub fn open(folder: &Path, consumer: &str) -> Result<Self> {
        let path = folder.join(format!("{consumer}.cursor"));
        let next = match std::fs::read_to_string(&path) {
            Ok(text) => text.trim().parse().map_err(|reason| crate::error::Error::new(path.display(), reason))?,
            Err(absent) if absent.kind() == std::io::ErrorKind::NotFound => 0,
            Err(reason) => return Err(crate::error::Error::new(path.display(), reason)),
        };
        Ok(Self { path, next })
    }

    /// Number of the next entry.
    pub fn next(&self) -> u64 {
        self.next
    }

    /// Keeps a new place.
    ///
    /// # Errors
    /// Of the file; the place kept before stays, in memory as well.
    pub fn keep(&mut self, next: u64) -> Result {
        if next != self.next {
            replace(&self.path, next.to_string().as_bytes())?;
            self.next = next;
        }
        Ok(())
    }
}

/// Replaces a file in one step: a reader, and a start after a power cut, sees the old or the new content.
///
/// # Errors
/// Of the file system; the old content stays.
pub fn replace(path: &Path, content: &[u8]) -> Result {
    let temporary = path.with_extension("new");
    let written = (|| {
        let mut file = std::fs::File::create(&temporary)?;
        file.write_all(content)?;
        file.sync_data()?;
        std::fs::rename(&temporary, path)
    })();
    at(path, written)
}
