//! The files of the rollups: their columns, and buckets as rows.
//!
//! `level=minute|hour|day/machine=NAME/day=YYYY-MM-DD/part-UNIT-UNIT.parquet`; the day is the first one of the file's
//! span. Every value that a reader guesses at is a word or a date to all of them. A bucket may have several rows, where
//! frames came after midnight or late: least of the leasts, largest of the largest, sum of mean times count. Columns
//! keep their types and are never renamed or removed. Floats are stored plainly, as dictionaries of values that hardly
//! repeat cost more than the values; statistics are kept per column and file, since pages of a few hundred
//! rows need none.

use super::buckets::{Bucket, Buckets, Key, Level};
use super::files::Format;
use super::schema::instant;
use crate::error::{Error, Result};
use crate::values::QUANTITIES;
use arrow_array::builder::{Float32Builder, Int32Builder, Int64Builder, StringBuilder, TimestampMicrosecondBuilder};
use arrow_array::{ArrayRef, RecordBatch};
use arrow_schema::{DataType, Field, Schema};
use parquet::file::properties::EnabledStatistics;
use parquet::schema::types::ColumnPath;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Version of the columns, in each file's metadata as `meshband.rollup`.
pub const VERSION: &str = "1";
/// Rows of a batch.
const BATCH: usize = 8192;
/// Columns of each figure, behind its name.
const PARTS: [(&str, DataType); 4] =
    [("min", DataType::Float32), ("max", DataType::Float32), ("mean", DataType::Float32), ("count", DataType::Int32)];

/// Root of a level's partitions.
pub fn root(folder: &Path, level: Level) -> PathBuf {
    folder.join(format!("level={}", level.name()))
}

/// How files of the rollups are stored.
///
/// # Errors
/// As [`Format::new`].
pub fn format() -> Result<Format> {
    Format::new(schema(), |builder| {
        let plain = QUANTITIES.iter().flat_map(|quantity| {
            let column = |(part, _)| ColumnPath::from(format!("{}_{part}", quantity.column));
            PARTS.into_iter().filter(|(_, kind)| *kind == DataType::Float32).map(column)
        });
        let builder = builder.set_statistics_enabled(EnabledStatistics::Chunk).set_offset_index_disabled(true);
        plain.fold(builder, |builder, column| builder.set_column_dictionary_enabled(column, false))
    })
}

fn schema() -> Arc<Schema> {
    let held = |name: &str, kind: DataType| Field::new(name, kind, false);
    let mut fields = vec![
        held("node", DataType::Utf8),
        held("start", instant()),
        Field::new("speed_class_hz", DataType::Float32, true),
        held("frames", DataType::Int32),
        held("lost", DataType::Int64),
        held("alarms", DataType::Int32),
        Field::new("quality", DataType::Utf8, true),
    ];
    let parts = QUANTITIES.iter().flat_map(|quantity| {
        PARTS.into_iter().map(|(part, kind)| Field::new(format!("{}_{part}", quantity.column), kind, true))
    });
    fields.extend(parts);
    let metadata = HashMap::from([("meshband.rollup".to_owned(), VERSION.to_owned())]);
    Arc::new(Schema::new(fields).with_metadata(metadata))
}

#[derive(Default)]
struct Figure {
    min: Float32Builder,
    max: Float32Builder,
    mean: Float32Builder,
    count: Int32Builder,
}

struct Columns {
    node: StringBuilder,
    start: TimestampMicrosecondBuilder,
    class: Float32Builder,
    frames: Int32Builder,
    lost: Int64Builder,
    alarms: Int32Builder,
    quality: StringBuilder,
    figures: Vec<Figure>,
    rows: usize,
}

impl Columns {
    fn new() -> Self {
        Self {
            node: StringBuilder::new(),
            start: TimestampMicrosecondBuilder::new().with_timezone("UTC"),
            class: Float32Builder::new(),
            frames: Int32Builder::new(),
            lost: Int64Builder::new(),
            alarms: Int32Builder::new(),
            quality: StringBuilder::new(),
            figures: QUANTITIES.iter().map(|_| Figure::default()).collect(),
            rows: 0,
        }
    }

    fn push(&mut self, key: &Key, bucket: &Bucket) {
        self.node.append_value(key.node);
        self.start.append_value(key.start_us);
        self.class.append_option(key.class_hz);
        self.frames.append_value(bucket.frames);
        self.lost.append_value(bucket.lost);
        self.alarms.append_value(bucket.alarms);
        self.quality.append_option(bucket.quality());
        for (figure, range) in self.figures.iter_mut().zip(&bucket.figures) {
            let there = range.count > 0;
            figure.min.append_option(there.then_some(range.least));
            figure.max.append_option(there.then_some(range.most));
            figure.mean.append_option(there.then_some((range.sum / f64::from(range.count)) as f32));
            figure.count.append_value(range.count);
        }
        self.rows += 1;
    }

    fn finish(&mut self, schema: &Arc<Schema>) -> Result<RecordBatch> {
        self.rows = 0;
        let mut columns: Vec<ArrayRef> = vec![
            Arc::new(self.node.finish()),
            Arc::new(self.start.finish()),
            Arc::new(self.class.finish()),
            Arc::new(self.frames.finish()),
            Arc::new(self.lost.finish()),
            Arc::new(self.alarms.finish()),
            Arc::new(self.quality.finish()),
        ];
        for figure in &mut self.figures {
            columns.push(Arc::new(figure.min.finish()));
            columns.push(Arc::new(figure.max.finish()));
            columns.push(Arc::new(figure.mean.finish()));
            columns.push(Arc::new(figure.count.finish()));
        }
        RecordBatch::try_new(Arc::clone(schema), columns).map_err(|reason| Error::new("rollup", reason))
    }
}

/// The buckets of a level as batches.
///
/// # Errors
/// Where columns and schema differ, a defect of this file.
pub fn batches(buckets: &Buckets, level: Level, format: &Format) -> Result<Vec<RecordBatch>> {
    let (mut columns, mut batches) = (Columns::new(), Vec::new());
    buckets.visit(level, |key, bucket| {
        columns.push(key, bucket);
        if columns.rows == BATCH {
            batches.push(columns.finish(&format.schema)?);
        }
        Ok(())
    })?;
    if columns.rows > 0 {
        batches.push(columns.finish(&format.schema)?);
    }
    Ok(batches)
}
