//! Merging small files: a partition of a minute's files each would have 1440 a day.
//!
//! The files between two large ones are read batch by batch and written as one, so memory is bounded by a batch and a row group.
//! Between the new file's name and the removal of the old ones a reader that takes all files would count rows twice; ours leaves
//! out files whose range lies inside another's, as [`super::files`] does.

use super::files::{Part, parts, write};
use crate::error::{Error, Result, at};
use arrow_array::RecordBatch;
use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;
use std::fs::File;
use std::path::Path;

/// Files from this size on stay as they are, bytes.
const LARGE: u64 = 32 << 20;

/// Merges a partition's small files where there are at least `least` in a row; gives how many files went into how many.
///
/// # Errors
/// Of a file; the old files then stay.
pub fn compact(partition: &Path, least: usize) -> Result<(usize, usize)> {
    let (mut from, mut into) = (0, 0);
    let small = |part: &Part| std::fs::metadata(&part.path).is_ok_and(|data| data.len() < LARGE);
    for run in parts(partition)?.chunk_by(|a, b| small(a) && small(b)).filter(|run| run.len() >= least.max(2)) {
        merge(partition, run)?;
        from += run.len();
        into += 1;
    }
    Ok((from, into))
}

fn merge(partition: &Path, run: &[Part]) -> Result<Part> {
    let first = run.iter().map(|part| part.first).min().unwrap_or(0);
    let last = run.iter().map(|part| part.last).max().unwrap_or(0);
    let merged = write(partition, first, last, run.iter().flat_map(|part| batches(&part.path)))?;
    for part in run {
        at(&part.path, std::fs::remove_file(&part.path))?;
    }
    Ok(merged)
}

/// A file's rows, batch by batch.
fn batches(path: &Path) -> Box<dyn Iterator<Item = Result<RecordBatch>>> {
    let opened = at(path, File::open(path)).and_then(|file| {
        let reader =
            ParquetRecordBatchReaderBuilder::try_new(file).and_then(|builder| builder.with_batch_size(8192).build());
        reader.map_err(|reason| Error::new(path.display(), reason))
    });
    let place = path.display().to_string();
    match opened {
        Ok(reader) => Box::new(reader.map(move |batch| batch.map_err(|reason| Error::new(&place, reason)))),
        Err(reason) => Box::new(std::iter::once(Err(reason))),
    }
}
