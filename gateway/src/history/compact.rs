//! Merging small files: a partition of a minute's files each would have 1440 a day.
//!
//! The files between two large ones are read batch by batch and written as one, so memory is bounded by a batch and a
//! row group. Between the new file's name and the removal of the old ones a reader that takes all files would count
//! rows twice; ours leaves out files whose range lies inside another's, as [`super::files`] does. Files of a former
//! schema get the columns they lack, null.

use super::files::{Part, parts, write};
use super::schema::schema;
use crate::error::{Error, Result, at};
use arrow_array::{RecordBatch, new_null_array};
use arrow_schema::ArrowError;
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

/// A file's rows, batch by batch, in the present columns.
pub fn batches(path: &Path) -> Box<dyn Iterator<Item = Result<RecordBatch>>> {
    let opened = at(path, File::open(path)).and_then(|file| {
        let reader =
            ParquetRecordBatchReaderBuilder::try_new(file).and_then(|builder| builder.with_batch_size(8192).build());
        reader.map_err(|reason| Error::new(path.display(), reason))
    });
    let place = path.display().to_string();
    match opened {
        Ok(reader) => {
            Box::new(reader.map(move |batch| {
                batch.and_then(|batch| in_schema(&batch)).map_err(|reason| Error::new(&place, reason))
            }))
        }
        Err(reason) => Box::new(std::iter::once(Err(reason))),
    }
}

/// A batch in the present columns.
fn in_schema(batch: &RecordBatch) -> std::result::Result<RecordBatch, ArrowError> {
    let column = |name: &str, kind| {
        batch.column_by_name(name).cloned().unwrap_or_else(|| new_null_array(kind, batch.num_rows()))
    };
    let schema = schema();
    let columns = schema.fields().iter().map(|field| column(field.name(), field.data_type())).collect();
    RecordBatch::try_new(schema, columns)
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
        let partition =
            std::env::temp_dir().join(format!("meshband-former-{}/machine=m/day=1970-01-01", std::process::id()));
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
        write(&partition, 5, 9, [Ok(rows(5..10))]).expect("writes");
        assert_eq!(compact(&partition, 2).expect("merges"), (2, 1));
        let parts = parts(&partition).expect("lists");
        assert_eq!(parts.iter().map(|part| (part.first, part.last)).collect::<Vec<_>>(), [(0, 9)]);
        let merged: Vec<RecordBatch> = batches(&parts[0].path).collect::<Result<_>>().expect("reads");
        assert_eq!(merged.iter().map(RecordBatch::num_rows).sum::<usize>(), 10);
        let nulls = |name: &str| {
            merged.iter().map(|batch| batch.column_by_name(name).expect("there").null_count()).sum::<usize>()
        };
        assert_eq!((nulls("velocity_rms"), nulls("quality"), nulls("detail")), (10, 10, 0));
        let _ = std::fs::remove_dir_all(partition.ancestors().nth(2).expect("own folder"));
    }
}
