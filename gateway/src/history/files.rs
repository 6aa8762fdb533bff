//! Whole files only, and which of them count.
//!
//! A file is written under a name that no reader takes, synced, then renamed. Its name says which entries it was made
//! from: `part-FIRST-LAST.parquet`. Two rules follow, and need no manifest: a file whose first entry is not before
//! the writer's place in the journal is of a batch that was not completed, and goes at the next start; a file whose
//! range lies inside another's of its partition was merged into that one, and goes as well. Rollups keep the same
//! rules with the numbers of their [units](super::ledger).

use super::cut;
use super::schema::schema;
use crate::error::{Error, Result, at};
use arrow_array::RecordBatch;
use arrow_schema::{ArrowError, Schema};
use parquet::arrow::ArrowWriter;
use parquet::basic::{Compression, ZstdLevel};
use parquet::file::properties::{WriterProperties, WriterPropertiesBuilder};
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Rows of a row group: what a query skips by.
const GROUP: usize = 64 * 1024;
/// Level of Zstandard: higher ones cost the gateway several times the processor for a few per cent.
const ZSTD: i32 = 3;

/// Columns of a kind of file, and how they are stored.
#[derive(Clone)]
pub struct Format {
    /// The columns.
    pub schema: Arc<Schema>,
    /// Encodings and statistics.
    pub properties: WriterProperties,
}

impl Format {
    /// Zstandard and bounded row groups; `more` adds to them.
    ///
    /// # Errors
    /// Where the library refuses the level, a defect of this file.
    pub fn new(
        schema: Arc<Schema>,
        more: impl FnOnce(WriterPropertiesBuilder) -> WriterPropertiesBuilder,
    ) -> Result<Self> {
        let level = ZstdLevel::try_new(ZSTD).map_err(|reason| Error::new("Parquet", reason))?;
        let builder = WriterProperties::builder()
            .set_compression(Compression::ZSTD(level))
            .set_max_row_group_row_count(Some(GROUP));
        Ok(Self { schema, properties: more(builder).build() })
    }

    /// That of the history.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn history() -> Result<Self> {
        Self::new(schema(), |builder| builder)
    }

    /// A batch of a former version of the columns in the present ones; what it lacks is null.
    ///
    /// # Errors
    /// Where a column has another type, a defect.
    pub fn fit(&self, batch: &RecordBatch) -> std::result::Result<RecordBatch, ArrowError> {
        let column = |name: &str, kind| {
            batch.column_by_name(name).cloned().unwrap_or_else(|| arrow_array::new_null_array(kind, batch.num_rows()))
        };
        let columns = self.schema.fields().iter().map(|field| column(field.name(), field.data_type())).collect();
        RecordBatch::try_new(Arc::clone(&self.schema), columns)
    }
}

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
    (first, last): (u64, u64),
    format: &Format,
    batches: impl IntoIterator<Item = Result<RecordBatch>>,
) -> Result<Part> {
    at(partition, std::fs::create_dir_all(partition))?;
    let path = partition.join(format!("part-{first:020}-{last:020}.parquet"));
    let temporary = partition.join(format!(".part-{first:020}.new"));
    cut::point();
    let written = fill(&temporary, format, batches).and_then(|()| {
        cut::point();
        at(&path, std::fs::rename(&temporary, &path))
    });
    cut::point();
    if let Err(reason) = written {
        let _ = std::fs::remove_file(&temporary);
        return Err(reason);
    }
    // The name itself survives a power cut only when its folder is synced.
    sync(partition)?;
    Ok(Part { first, last, path })
}

fn fill(path: &Path, format: &Format, batches: impl IntoIterator<Item = Result<RecordBatch>>) -> Result {
    let refuse = |reason: parquet::errors::ParquetError| Error::new(path.display(), reason);
    let file = at(path, File::create(path))?;
    let properties = Some(format.properties.clone());
    let mut writer = ArrowWriter::try_new(file, Arc::clone(&format.schema), properties).map_err(refuse)?;
    for batch in batches {
        writer.write(&batch?).map_err(refuse)?;
    }
    let file = writer.into_inner().map_err(refuse)?;
    at(path, file.sync_all())
}

/// Has a folder's names survive a power cut.
///
/// # Errors
/// Of the file system.
pub fn sync(folder: &Path) -> Result {
    at(folder, File::open(folder).and_then(|folder| folder.sync_all()))
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

/// Machine and first day of a partition, by its folders' names.
pub fn place(partition: &Path) -> Option<(&str, &str)> {
    let day = partition.file_name()?.to_str()?.strip_prefix("day=")?;
    let machine = partition.parent()?.file_name()?.to_str()?.strip_prefix("machine=")?;
    Some((machine, day))
}

/// The partition of a machine and a first day.
pub fn partition(root: &Path, machine: &str, day: &str) -> PathBuf {
    root.join(format!("machine={machine}")).join(format!("day={day}"))
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
