//! The columns. Version [`VERSION`], in each file's metadata as `meshband.schema`.
//!
//! One row per frame or note, so that "every frame exactly once" is a count of rows. Columns that a kind of frame
//! does not have are null and cost next to nothing. Columns are taken by their names: none is ever renamed, removed
//! or given another meaning, so a reader takes those it knows, and files of former versions are merged with their
//! lacking columns null.
//!
//! Version 2 added `available_hz`, `velocity_rms`, the shafts' orders and `quality`.

use crate::values::QUANTITIES;
use arrow_schema::{DataType, Field, Schema, TimeUnit};
use std::collections::HashMap;
use std::sync::Arc;

/// Version of the columns.
pub const VERSION: &str = "2";

/// Instants: microseconds, UTC.
pub fn instant() -> DataType {
    DataType::Timestamp(TimeUnit::Microsecond, Some("UTC".into()))
}

fn list(of: DataType) -> DataType {
    DataType::List(Arc::new(Field::new_list_field(of, true)))
}

/// All columns, in the order in which [`super::rows`] fills them.
pub fn schema() -> Arc<Schema> {
    let held = |name: &str, kind: DataType| Field::new(name, kind, false);
    let open = |name: &str, kind: DataType| Field::new(name, kind, true);
    let mut fields = vec![
        held("journal", DataType::UInt64),
        held("received", instant()),
        held("time", instant()),
        held("node", DataType::Utf8),
        held("unit", DataType::Utf8),
        held("boot", DataType::UInt32),
        open("sequence", DataType::UInt16),
        held("kind", DataType::Utf8),
        open("state", DataType::Utf8),
        open("validity", DataType::Utf8),
        open("event", DataType::Utf8),
        open("detail", DataType::Int64),
        open("count", DataType::UInt32),
        open("text", DataType::Utf8),
    ];
    fields.extend(QUANTITIES.iter().map(|quantity| open(quantity.column, DataType::Float32)));
    fields.extend([
        open("line_origin", list(DataType::Utf8)),
        open("line_hz", list(DataType::Float32)),
        open("line_amplitude", list(DataType::Float32)),
        open("waveform", list(DataType::Int16)),
        open("waveform_offset", DataType::UInt16),
        open("waveform_total", DataType::UInt16),
        open("waveform_scale", DataType::Float32),
        open("quality", DataType::Utf8),
    ]);
    let metadata = HashMap::from([("meshband.schema".to_owned(), VERSION.to_owned())]);
    Arc::new(Schema::new(fields).with_metadata(metadata))
}
