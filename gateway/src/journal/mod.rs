//! The write-ahead journal between the nodes and everything slower than they are.
//!
//! Every frame goes here first, then by cursors of their own to the history and to the broker. Segments of
//! [`SEGMENT`] bytes, named by the number of their first entry; an entry is its length, its CRC-32 and its postcard.
//! A killed process loses nothing written (the system has it), a power cut what was written since the last sync. A
//! torn end is cut off at the next start. Space comes back by whole segments, when every consumer has passed them, or
//! when the limit is reached.

pub mod cursor;
pub mod entry;
pub mod reader;

use crate::error::{Result, at};
use entry::Entry;
use meshband::frame::CRC32;
use std::fs::{File, OpenOptions};
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// Bytes from which on a new segment is begun.
pub const SEGMENT: u64 = 4 << 20;
/// Longest entry: a frame and its names.
pub const MAX_ENTRY: usize = 4096;
const HEADER: usize = 8;

/// The writing end; there is one.
#[derive(Debug)]
pub struct Journal {
    folder: PathBuf,
    file: File,
    /// Good bytes of the newest segment.
    length: u64,
    next: u64,
    dirty: bool,
}

impl Journal {
    /// Opens the folder's journal, cutting off a torn end; numbers go on at `at_least` or later.
    ///
    /// # Errors
    /// Of the file system.
    pub fn open(folder: &Path, at_least: u64) -> Result<Self> {
        at(folder, std::fs::create_dir_all(folder))?;
        let newest = segments(folder)?.pop();
        if let Some(first) = newest {
            let path = segment_path(folder, first);
            let (entries, good) = reader::measure(&path)?;
            let mut file = at(&path, OpenOptions::new().read(true).write(true).open(&path))?;
            at(&path, file.set_len(good))?;
            at(&path, file.seek(SeekFrom::End(0)))?;
            if first + entries >= at_least {
                let next = first + entries;
                return Ok(Self { folder: folder.to_owned(), file, length: good, next, dirty: false });
            }
        }
        let file = begin(folder, at_least)?;
        Ok(Self { folder: folder.to_owned(), file, length: 0, next: at_least, dirty: false })
    }

    /// Number that the next entry will have.
    pub fn next(&self) -> u64 {
        self.next
    }

    /// Adds entries, all or none.
    ///
    /// # Errors
    /// Of the file system, a full disk above all; the journal is then as before.
    pub fn append(&mut self, entries: &[Entry]) -> Result {
        let path = segment_path(&self.folder, self.next);
        if self.length >= SEGMENT {
            at(&path, self.file.sync_data())?;
            self.file = begin(&self.folder, self.next)?;
            self.length = 0;
        }
        let mut bytes = Vec::new();
        for entry in entries {
            let body =
                postcard::to_stdvec(entry).map_err(|reason| crate::error::Error::new("journal entry", reason))?;
            debug_assert!(body.len() <= MAX_ENTRY, "an entry of {} bytes", body.len());
            bytes.extend_from_slice(&(body.len() as u32).to_le_bytes());
            bytes.extend_from_slice(&CRC32.checksum(&body).to_le_bytes());
            bytes.extend_from_slice(&body);
        }
        if let Err(reason) = self.file.write_all(&bytes) {
            // What was written of it would hide all that follows.
            let _ = self.file.set_len(self.length);
            let _ = self.file.seek(SeekFrom::Start(self.length));
            return at(&self.folder, Err(reason));
        }
        self.length += bytes.len() as u64;
        self.next += entries.len() as u64;
        self.dirty = true;
        Ok(())
    }

    /// Has the system write what it holds.
    ///
    /// # Errors
    /// Of the file system.
    pub fn sync(&mut self) -> Result {
        if std::mem::take(&mut self.dirty) {
            at(&self.folder, self.file.sync_data())?;
        }
        Ok(())
    }

    /// Gives back segments that all consumers have passed, and the oldest beyond `bytes`.
    ///
    /// # Errors
    /// Of the file system.
    pub fn trim(&self, passed: u64, bytes: u64) -> Result {
        let firsts = segments(&self.folder)?;
        let size = |first: u64| std::fs::metadata(segment_path(&self.folder, first)).map_or(0, |data| data.len());
        let mut total: u64 = firsts.iter().map(|&first| size(first)).sum();
        for pair in firsts.windows(2) {
            if pair[1] > passed && total <= bytes {
                break;
            }
            total -= size(pair[0]);
            let path = segment_path(&self.folder, pair[0]);
            at(&path, std::fs::remove_file(&path))?;
        }
        Ok(())
    }
}

fn begin(folder: &Path, first: u64) -> Result<File> {
    let path = segment_path(folder, first);
    at(&path, OpenOptions::new().create(true).truncate(true).write(true).open(&path))
}

fn segment_path(folder: &Path, first: u64) -> PathBuf {
    folder.join(format!("{first:020}.journal"))
}

/// First numbers of all segments, ascending.
///
/// # Errors
/// Of the file system.
pub fn segments(folder: &Path) -> Result<Vec<u64>> {
    let mut firsts = Vec::new();
    for item in at(folder, std::fs::read_dir(folder))? {
        let name = at(folder, item)?.file_name();
        let stem = name.to_str().and_then(|name| name.strip_suffix(".journal"));
        firsts.extend(stem.and_then(|stem| stem.parse::<u64>().ok()));
    }
    firsts.sort_unstable();
    Ok(firsts)
}
