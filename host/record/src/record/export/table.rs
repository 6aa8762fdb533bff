//! A run as a Parquet table: a column of doubles per channel with its unit, the rate as metadata of the table.

use super::File;
use crate::{Error, Result};
use arrow_array::{ArrayRef, Float64Array, RecordBatch};
use arrow_schema::{DataType, Field, Schema};
use parquet::arrow::ArrowWriter;
use std::collections::HashMap;
use std::sync::Arc;

pub(super) fn content(file: &File) -> Result<Vec<u8>> {
    let refuse = |error: &dyn std::fmt::Display| Error::invalid("--to parquet", error.to_string());
    let one = |key: &str, value: String| HashMap::from([(key.to_owned(), value)]);
    let column = |name: &String| {
        let field = Field::new(name, DataType::Float64, false);
        if file.unit == "unknown" { field } else { field.with_metadata(one("unit", file.unit.into())) }
    };
    let fields: Vec<Field> = file.names.iter().map(column).collect();
    let schema = Arc::new(Schema::new(fields).with_metadata(one("sample_rate_hz", format!("{:?}", file.rate_hz))));
    let arrays = file.signals.iter().map(|signal| Arc::new(Float64Array::from(signal.clone())) as ArrayRef);
    let batch = RecordBatch::try_new(Arc::clone(&schema), arrays.collect()).map_err(|error| refuse(&error))?;
    let mut writer = ArrowWriter::try_new(Vec::new(), schema, None).map_err(|error| refuse(&error))?;
    writer.write(&batch).map_err(|error| refuse(&error))?;
    writer.into_inner().map_err(|error| refuse(&error))
}
