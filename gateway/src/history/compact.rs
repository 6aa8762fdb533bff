//! Merging small files: a partition of a minute's files each would have 1440 a day.
//!
//! The files between two large ones are read batch by batch and written as one, so memory is bounded by a batch and a
//! row group. [`Store::replace`] then exchanges the whole partition in one step, so a reader never sees rows twice; one
//! that listed the old files and has not opened them yet gets an error, and asks again. Files of a former schema get
//! the columns they lack, null.

use super::files::{Format, Part, parts, write};
use super::store::Store;
use crate::error::{Error, Result, at};
use arrow_array::RecordBatch;
use parquet::arrow::ProjectionMask;
use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;
use std::fs::File;
use std::path::Path;

/// Rows of a batch: what is in memory of a file.
const BATCH: usize = 8192;
/// Files from this size on stay as they are, bytes.
const LARGE: u64 = 32 << 20;

/// Merges a partition's small files where there are at least `least` in a row; gives how many files went into how many.
///
/// # Errors
/// Of a file; the old files then stay.
pub fn compact(store: &Store, partition: &Path, least: usize, format: &Format) -> Result<(usize, usize)> {
    let (mut from, mut into) = (0, 0);
    let small = |part: &Part| std::fs::metadata(&part.path).is_ok_and(|data| data.len() < LARGE);
    for run in parts(partition)?.chunk_by(|a, b| small(a) && small(b)).filter(|run| run.len() >= least.max(2)) {
        let range = range(run);
        let rows = run.iter().flat_map(|part| batches(&part.path, format));
        store.replace(partition, run, |folder| write(folder, range, format, rows).map(drop))?;
        from += run.len();
        into += 1;
    }
    Ok((from, into))
}

/// First and last number of files.
pub fn range(parts: &[Part]) -> (u64, u64) {
    let first = parts.iter().map(|part| part.first).min().unwrap_or(0);
    (first, parts.iter().map(|part| part.last).max().unwrap_or(0))
}

/// A file's rows, batch by batch, in the present columns.
pub fn batches(path: &Path, format: &Format) -> Box<dyn Iterator<Item = Result<RecordBatch>>> {
    let (format, place) = (format.clone(), path.display().to_string());
    let fit = move |batch: Result<RecordBatch>| format.fit(&batch?).map_err(|reason| Error::new(&place, reason));
    Box::new(read(path, |_| true).map(fit))
}

/// A file's rows, batch by batch, of the columns that are wanted and there.
pub fn read(path: &Path, wanted: impl Fn(&str) -> bool) -> Box<dyn Iterator<Item = Result<RecordBatch>>> {
    let opened = at(path, File::open(path)).and_then(|file| {
        let reader = ParquetRecordBatchReaderBuilder::try_new(file).and_then(|builder| {
            let fields = builder.schema().fields().iter().enumerate();
            let roots: Vec<usize> = fields.filter(|(_, field)| wanted(field.name())).map(|(root, _)| root).collect();
            let mask = ProjectionMask::roots(builder.parquet_schema(), roots);
            builder.with_projection(mask).with_batch_size(BATCH).build()
        });
        reader.map_err(|reason| Error::new(path.display(), reason))
    });
    let place = path.display().to_string();
    match opened {
        Ok(reader) => Box::new(reader.map(move |batch| batch.map_err(|reason| Error::new(&place, reason)))),
        Err(reason) => Box::new(std::iter::once(Err(reason))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::history::rows::Rows;
    use crate::journal::entry::{Body, Entry, Note};
    use arrow_array::Array;
    use parquet::arrow::ArrowWriter;

    fn rows(numbers: std::ops::Range<u64>) -> RecordBatch {
        let mut rows = Rows::default();
        for number in numbers {
            let body = Body::Note { kind: Note::Command, detail: number as i64, text: String::new() };
            let (node, machine) = ("n".to_owned(), "m".to_owned());
            rows.push(number, &Entry { node, machine, unit: [1; 3], boot: 1, received_us: 0, time_us: 0, body });
        }
        rows.finish().expect("columns fit")
    }

    #[test]
    fn claim_files_of_a_former_schema_are_merged_with_what_they_lack_null() {
        let above = std::env::temp_dir().join(format!("meshband-former-{}", std::process::id()));
        let root = above.join("history");
        let partition = root.join("machine=m/day=1970-01-01");
        std::fs::create_dir_all(&partition).expect("creates");
        let now = rows(0..5);
        let kept: Vec<usize> = (0..now.num_columns())
            .filter(|&at| !["quality", "velocity_rms"].contains(&now.schema().field(at).name().as_str()))
            .collect();
        let former = now.project(&kept).expect("columns are there");
        let path = partition.join(format!("part-{:020}-{:020}.parquet", 0, 4));
        let mut writer =
            ArrowWriter::try_new(File::create(&path).expect("creates"), former.schema(), None).expect("writes");
        writer.write(&former).expect("writes");
        writer.close().expect("writes");
        let (store, format) = (Store::open(&root).expect("opens"), Format::history().expect("a format"));
        write(&partition, (5, 9), &format, [Ok(rows(5..10))]).expect("writes");
        assert_eq!(compact(&store, &partition, 2, &format).expect("merges"), (2, 1));
        let parts = parts(&partition).expect("lists");
        assert_eq!(parts.iter().map(|part| (part.first, part.last)).collect::<Vec<_>>(), [(0, 9)]);
        let merged: Vec<RecordBatch> = batches(&parts[0].path, &format).collect::<Result<_>>().expect("reads");
        assert_eq!(merged.iter().map(RecordBatch::num_rows).sum::<usize>(), 10);
        let nulls = |name: &str| {
            merged.iter().map(|batch| batch.column_by_name(name).expect("there").null_count()).sum::<usize>()
        };
        assert_eq!((nulls("velocity_rms"), nulls("quality"), nulls("detail")), (10, 10, 0));
        let _ = std::fs::remove_dir_all(above);
    }
}
