//! Raw rows that stay when their days are over: those around alarms, for ever.
//!
//! A row stays where its content is within so many seconds of an alarm raised or cleared at the same machine, also
//! across midnight: the two neighbouring days are looked at as well. The alarm's own row is among them, so thinning
//! the same rows again keeps the same ones. A thinned file says so in its metadata and is not read again. Limit: an
//! alarm that comes and goes all the time keeps all rows.

use super::buckets::ALARMS;
use super::compact::{batches, range, read};
use super::day::{self, DAY_US};
use super::files::{self, Format, Part, parts, write};
use super::store::Store;
use crate::error::{Error, Result, at};
use arrow_array::cast::AsArray;
use arrow_array::types::TimestampMicrosecondType;
use arrow_array::{Array, BooleanArray, RecordBatch};
use arrow_schema::Schema;
use arrow_select::filter::filter_record_batch;
use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;
use std::fs::File;
use std::path::Path;
use std::sync::Arc;

/// Key of a thinned file's metadata; its value is the seconds around an alarm.
const MARK: &str = "meshband.thinned";

/// Thins a partition; gives whether there was anything to do.
///
/// # Errors
/// Of the files; all rows then stay.
pub fn thin(store: &Store, machine: &str, day: &str, alarm_seconds: u32) -> Result<bool> {
    let partition = files::partition(store.root(), machine, day);
    let held = parts(&partition)?;
    if let [one] = &held[..]
        && is_thinned(&one.path)?
    {
        return Ok(false);
    }
    let around_us = i64::from(alarm_seconds) * 1_000_000;
    let alarms = alarms(store.root(), machine, day)?;
    let format = marked(alarm_seconds)?;
    let stays = |instant: i64| {
        let next = alarms.partition_point(|alarm| *alarm < instant - around_us);
        alarms.get(next).is_some_and(|alarm| *alarm <= instant + around_us)
    };
    if !holds(&held, &stays)? {
        store.remove(&partition)?;
        return Ok(true);
    }
    let rows = held.iter().flat_map(|part| batches(&part.path, &format)).map(|batch| kept(&batch?, &stays));
    store.replace(&partition, &held, |folder| write(folder, range(&held), &format, rows).map(drop))?;
    Ok(true)
}

fn marked(alarm_seconds: u32) -> Result<Format> {
    let schema = super::schema::schema();
    let mut metadata = schema.metadata().clone();
    metadata.insert(MARK.to_owned(), alarm_seconds.to_string());
    Format::new(Arc::new(Schema::new(schema.fields().clone()).with_metadata(metadata)), |builder| builder)
}

fn is_thinned(path: &Path) -> Result<bool> {
    let file = at(path, File::open(path))?;
    let refuse = |reason| Error::new(path.display(), reason);
    let builder = ParquetRecordBatchReaderBuilder::try_new(file).map_err(refuse)?;
    Ok(builder.schema().metadata().contains_key(MARK))
}

/// Instants of a machine's alarms on a day and on the two beside it, in order, microseconds.
fn alarms(root: &Path, machine: &str, day: &str) -> Result<Vec<i64>> {
    let begin = day::begin(day).ok_or_else(|| Error::new(day, "is no day"))?;
    let mut found = Vec::new();
    for neighbour in [begin - DAY_US, begin, begin + DAY_US] {
        let partition = files::partition(root, machine, &day::of(neighbour));
        if !partition.is_dir() {
            continue;
        }
        for part in parts(&partition)? {
            for batch in read(&part.path, |column| ["time", "event"].contains(&column)) {
                let batch = batch?;
                let event = batch.column_by_name("event").and_then(|column| column.as_string_opt::<i32>());
                let Some(event) = event.filter(|event| event.null_count() < event.len()) else { continue };
                let time = times(&batch)?;
                let is_alarm = |row: &usize| event.is_valid(*row) && ALARMS.contains(&event.value(*row));
                found.extend((0..batch.num_rows()).filter(is_alarm).map(|row| time[row]));
            }
        }
    }
    found.sort_unstable();
    Ok(found)
}

fn times(batch: &RecordBatch) -> Result<&[i64]> {
    let time = batch.column_by_name("time").and_then(|column| column.as_primitive_opt::<TimestampMicrosecondType>());
    time.map(|time| &time.values()[..]).ok_or_else(|| Error::new("history", "a file has no column `time`"))
}

/// Whether any row stays.
fn holds(held: &[Part], stays: &impl Fn(i64) -> bool) -> Result<bool> {
    for part in held {
        for batch in read(&part.path, |column| column == "time") {
            if times(&batch?)?.iter().any(|time| stays(*time)) {
                return Ok(true);
            }
        }
    }
    Ok(false)
}

fn kept(batch: &RecordBatch, stays: &impl Fn(i64) -> bool) -> Result<RecordBatch> {
    let stay: BooleanArray = times(batch)?.iter().map(|time| Some(stays(*time))).collect();
    filter_record_batch(batch, &stay).map_err(|reason| Error::new("history", reason))
}
