//! Whole files only, and which of them count.
//!
//! A file is written under a name that no reader takes, synced, then renamed. Its name says which entries it was made
//! from: `part-FIRST-LAST.parquet`. Two rules follow, and need no manifest: a file whose first entry is not before
//! the writer's place in the journal is of a batch that was not completed, and goes at the next start; a file whose
//! range lies inside another's of its partition was merged into that one, and goes as well.

use super::schema::schema;
use crate::error::{Error, Result, at};
use arrow_array::RecordBatch;
use parquet::arrow::ArrowWriter;
use parquet::basic::{Compression, ZstdLevel};
use parquet::file::properties::WriterProperties;
use std::fs::File;
use std::path::{Path, PathBuf};

/// Rows of a row group: what a query skips by.
const GROUP: usize = 64 * 1024;

/// A finished file.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Part {
    /// Number of the first entry of its batch.
    pub first: u64,
    /// Number of the last.
    pub last: u64,
    /// Where it is.
    pub path: PathBuf,
}

/// Writes batches into one file of a partition.
///
/// # Errors
/// Of the file system, or of a batch; no file is left then.
pub fn write(
    partition: &Path,
    first: u64,
    last: u64,
    batches: impl IntoIterator<Item = Result<RecordBatch>>,
) -> Result<Part> {
    at(partition, std::fs::create_dir_all(partition))?;
    let path = partition.join(format!("part-{first:020}-{last:020}.parquet"));
    let temporary = partition.join(format!(".part-{first:020}.new"));
    let written = fill(&temporary, batches).and_then(|()| at(&path, std::fs::rename(&temporary, &path)));
    if let Err(reason) = written {
        let _ = std::fs::remove_file(&temporary);
        return Err(reason);
    }
    // The name itself survives a power cut only when its folder is synced.
    at(partition, File::open(partition).and_then(|folder| folder.sync_all()))?;
    Ok(Part { first, last, path })
}

fn fill(path: &Path, batches: impl IntoIterator<Item = Result<RecordBatch>>) -> Result {
    let refuse = |reason: parquet::errors::ParquetError| Error::new(path.display(), reason);
    let file = at(path, File::create(path))?;
    let level = ZstdLevel::try_new(3).map_err(refuse)?;
    let properties = WriterProperties::builder()
        .set_compression(Compression::ZSTD(level))
        .set_max_row_group_row_count(Some(GROUP))
        .build();
    let mut writer = ArrowWriter::try_new(file, schema(), Some(properties)).map_err(refuse)?;
    for batch in batches {
        writer.write(&batch?).map_err(refuse)?;
    }
    let file = writer.into_inner().map_err(refuse)?;
    at(path, file.sync_all())
}

/// The files of a partition, by their first entry.
///
/// # Errors
/// Of the file system.
pub fn parts(partition: &Path) -> Result<Vec<Part>> {
    let mut parts = Vec::new();
    for item in at(partition, std::fs::read_dir(partition))? {
        let path = at(partition, item)?.path();
        parts.extend(part(&path));
    }
    parts.sort();
    Ok(parts)
}

fn part(path: &Path) -> Option<Part> {
    let name = path.file_name()?.to_str()?;
    let (first, last) = name.strip_prefix("part-")?.strip_suffix(".parquet")?.split_once('-')?;
    Some(Part { first: first.parse().ok()?, last: last.parse().ok()?, path: path.to_owned() })
}

/// All partitions below the root.
///
/// # Errors
/// Of the file system.
pub fn partitions(root: &Path) -> Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    for machine in folders(root, "machine=")? {
        found.extend(folders(&machine, "day=")?);
    }
    found.sort();
    Ok(found)
}

fn folders(above: &Path, prefix: &str) -> Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    for item in at(above, std::fs::read_dir(above))? {
        let item = at(above, item)?;
        if item.file_name().to_str().is_some_and(|name| name.starts_with(prefix)) && item.path().is_dir() {
            found.push(item.path());
        }
    }
    Ok(found)
}

/// Removes what an interrupted writer left: files of batches not completed, merged ones, unfinished ones.
///
/// # Errors
/// Of the file system.
pub fn recover(root: &Path, next: u64) -> Result<usize> {
    let mut removed = 0;
    for partition in partitions(root)? {
        for item in at(&partition, std::fs::read_dir(&partition))? {
            let path = at(&partition, item)?.path();
            if path.extension().is_some_and(|extension| extension == "new") {
                at(&path, std::fs::remove_file(&path))?;
                removed += 1;
            }
        }
        let parts = parts(&partition)?;
        for part in &parts {
            let inside = |other: &Part| other != part && other.first <= part.first && part.last <= other.last;
            if part.first >= next || parts.iter().any(inside) {
                at(&part.path, std::fs::remove_file(&part.path))?;
                removed += 1;
            }
        }
    }
    Ok(removed)
}
