//! Parquet and Feather (Arrow) tables: every column of numbers is a signal.
//!
//! Read by the crates of Apache Arrow. A unit is metadata of a column (`unit`) or stands in its name, a sampling rate
//! is metadata of the table (`sample_rate_hz`, `fs`); time stamps are seconds since the first one. Missing values are
//! no numbers. Texts, lists and structures are passed over and counted. Damaged files make these crates panic
//! (arrow-ipc 60.1.0); that ends here as a refusal.

use super::signals::{Signal, Signals};
use super::variables::{is_unit, rate_of};
use crate::budget::VALUES;
use crate::{Error, Result};
use arrow_array::cast::AsArray;
use arrow_array::{Array, ArrowPrimitiveType, RecordBatch, types};
use arrow_ipc::reader::FileReader;
use arrow_schema::{ArrowError, DataType, Field, Schema, TimeUnit};
use bytes::Bytes;
use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;
use std::cell::Cell;
use std::io::Cursor;
use std::panic::{self, AssertUnwindSafe};
use std::path::Path;
use std::sync::Once;

/// The name under which pandas writes an index without one.
const INDEX: &str = "__index_level_0__";
/// Rows that are decoded at a time.
const BATCH: usize = 65_536;

pub(super) fn is_parquet(bytes: &[u8]) -> bool {
    bytes.starts_with(b"PAR1")
}

pub(super) fn is_feather(bytes: &[u8]) -> bool {
    bytes.starts_with(b"ARROW1\0\0")
}

pub(super) fn parquet(path: &Path, bytes: Vec<u8>) -> Result<Signals> {
    guarded(path, "Parquet", || read_parquet(path, bytes))
}

pub(super) fn feather(path: &Path, bytes: Vec<u8>) -> Result<Signals> {
    guarded(path, "Feather", || read_feather(path, bytes))
}

thread_local! {
    /// Whether a panic on this thread is caught and said as a refusal.
    static PANIC_GUARD: Cell<bool> = const { Cell::new(false) };
}

/// Runs a reader whose panics are refusals, without their own message.
fn guarded(path: &Path, what: &str, read: impl FnOnce() -> Result<Signals>) -> Result<Signals> {
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        let before = panic::take_hook();
        panic::set_hook(Box::new(move |info| {
            if !PANIC_GUARD.get() {
                before(info);
            }
        }));
    });
    PANIC_GUARD.set(true);
    let made = panic::catch_unwind(AssertUnwindSafe(read));
    PANIC_GUARD.set(false);
    made.unwrap_or_else(|_| Err(broken(path, what, &"damaged or truncated")))
}

fn read_parquet(path: &Path, bytes: Vec<u8>) -> Result<Signals> {
    let refuse = |error: &dyn std::fmt::Display| broken(path, "Parquet", error);
    let builder = ParquetRecordBatchReaderBuilder::try_new(Bytes::from(bytes)).map_err(|error| refuse(&error))?;
    let (rows, schema) = (builder.metadata().file_metadata().num_rows(), builder.schema().clone());
    let columns = schema.fields().iter().filter(|field| is_read(field.data_type())).count();
    VALUES.check(path.display(), rows as f64 * columns as f64, "save fewer columns or a shorter part")?;
    let mut table = Table::of(path, &schema);
    for batch in builder.with_batch_size(BATCH).build().map_err(|error| refuse(&error))? {
        table.add(&batch.map_err(|error| refuse(&error))?)?;
    }
    Ok(table.signals())
}

fn read_feather(path: &Path, bytes: Vec<u8>) -> Result<Signals> {
    let refuse = |error: ArrowError| broken(path, "Feather", &error);
    let claimed = claimed_bytes(&bytes).unwrap_or(0.0);
    VALUES.check(path.display(), claimed / size_of::<f64>() as f64, "save fewer rows in a batch")?;
    let reader = FileReader::try_new(Cursor::new(bytes), None).map_err(refuse)?;
    let mut table = Table::of(path, &reader.schema());
    for batch in reader {
        table.add(&batch.map_err(refuse)?)?;
    }
    Ok(table.signals())
}

/// Most bytes that the compressed buffers of one batch say they hold: the reader allocates as much before it looks
/// (arrow-ipc 60.1.0). Nothing where the file's own places do not hold; the reader refuses those.
fn claimed_bytes(bytes: &[u8]) -> Option<f64> {
    /// Length of the footer, and the magic behind it.
    const TRAILER: usize = 10;
    let end = bytes.len().checked_sub(TRAILER)?;
    let length = i32::from_le_bytes(bytes.get(end..end + 4)?.try_into().ok()?);
    let footer = bytes.get(end.checked_sub(usize::try_from(length).ok()?)?..end)?;
    let footer = arrow_ipc::root_as_footer(footer).ok()?;
    let blocks = [footer.recordBatches(), footer.dictionaries()].into_iter().flatten().flatten();
    Some(blocks.filter_map(|block| claimed_by(bytes, block)).fold(0.0, f64::max))
}

/// The same of the batch of one block.
fn claimed_by(bytes: &[u8], block: &arrow_ipc::Block) -> Option<f64> {
    /// Marks a length of the present format; the older one begins with the length.
    const CONTINUATION: [u8; 4] = [0xff; 4];
    let start = usize::try_from(block.offset()).ok()?;
    let body = start.checked_add(usize::try_from(block.metaDataLength()).ok()?)?;
    let head = bytes.get(start..body)?;
    let message = head.get(if head.starts_with(&CONTINUATION) { 8 } else { 4 }..)?;
    let message = arrow_ipc::root_as_message(message).ok()?;
    let dictionary = message.header_as_dictionary_batch().and_then(|own| own.data());
    let batch = message.header_as_record_batch().or(dictionary)?;
    batch.compression()?;
    let claimed = |buffer: &arrow_ipc::Buffer| -> Option<f64> {
        let at = body.checked_add(usize::try_from(buffer.offset()).ok()?)?;
        let prefix = bytes.get(at..at.checked_add(8)?)?.try_into().ok()?;
        Some(i64::from_le_bytes(prefix).max(0) as f64).filter(|_| buffer.length() > 0)
    };
    Some(batch.buffers()?.iter().filter_map(claimed).sum())
}

fn broken(path: &Path, what: &str, error: &dyn std::fmt::Display) -> Error {
    Error::invalid(path.display(), format!("{what} data is broken or not read ({error})"))
}

/// Columns as they grow batch by batch.
struct Table<'a> {
    path: &'a Path,
    columns: Vec<Option<Column>>,
    found: Signals,
    skipped: usize,
    values: f64,
}

struct Column {
    signal: Signal,
    /// Time stamps: ticks of a second, and the first one.
    stamps: Option<(f64, Option<i64>)>,
}

impl<'a> Table<'a> {
    fn of(path: &'a Path, schema: &Schema) -> Self {
        let columns: Vec<Option<Column>> = schema.fields().iter().map(|field| Column::of(field)).collect();
        let stated = schema.metadata().iter().filter_map(|(name, value)| rate_of(name, value.trim().parse().ok()?));
        let rates: Vec<f64> = stated.collect();
        let found = Signals { rate_hz: rates.first().copied(), ..Signals::default() };
        let skipped = columns.iter().filter(|column| column.is_none()).count();
        Self { path, columns, found, skipped, values: 0.0 }
    }

    fn add(&mut self, batch: &RecordBatch) -> Result<()> {
        let count = self.columns.iter().flatten().count();
        self.values += batch.num_rows() as f64 * count as f64;
        VALUES.check(self.path.display(), self.values, "save fewer columns or a shorter part")?;
        for (column, array) in self.columns.iter_mut().zip(batch.columns()) {
            if let Some(column) = column {
                column.add(array.as_ref());
            }
        }
        Ok(())
    }

    fn signals(mut self) -> Signals {
        if self.skipped > 0 {
            self.found.remarks.push(format!("{} columns that are no numbers were skipped", self.skipped));
        }
        self.found.signals = self.columns.into_iter().flatten().map(|column| column.signal).collect();
        self.found
    }
}

impl Column {
    fn of(field: &Field) -> Option<Self> {
        if !is_read(field.data_type()) {
            return None;
        }
        let stamps = match field.data_type() {
            DataType::Timestamp(unit, _) | DataType::Duration(unit) => Some((ticks(unit), None)),
            _ => None,
        };
        let name = match (field.name().as_str(), &stamps) {
            (INDEX, Some(_)) => "time",
            (INDEX, None) => "index",
            (name, _) => name,
        };
        let mut signal = Signal::new(name, Vec::new());
        signal.unit = field.metadata().iter().find(|(name, _)| is_unit(name)).map(|(_, unit)| unit.clone());
        if stamps.is_some() {
            signal.unit = Some("s".into());
        }
        Some(Self { signal, stamps })
    }

    fn add(&mut self, array: &dyn Array) {
        let values = &mut self.signal.values;
        match array.data_type() {
            DataType::Float64 => extend::<types::Float64Type>(values, array, |x| x),
            DataType::Float32 => extend::<types::Float32Type>(values, array, f64::from),
            DataType::Float16 => extend::<types::Float16Type>(values, array, f64::from),
            DataType::Int8 => extend::<types::Int8Type>(values, array, f64::from),
            DataType::Int16 => extend::<types::Int16Type>(values, array, f64::from),
            DataType::Int32 => extend::<types::Int32Type>(values, array, f64::from),
            DataType::Int64 => extend::<types::Int64Type>(values, array, |x| x as f64),
            DataType::UInt8 => extend::<types::UInt8Type>(values, array, f64::from),
            DataType::UInt16 => extend::<types::UInt16Type>(values, array, f64::from),
            DataType::UInt32 => extend::<types::UInt32Type>(values, array, f64::from),
            DataType::UInt64 => extend::<types::UInt64Type>(values, array, |x| x as f64),
            _ => self.add_stamps(array),
        }
    }

    fn add_stamps(&mut self, array: &dyn Array) {
        let Some((ticks, first)) = &mut self.stamps else { return };
        let mut add = |stamp: i64| (stamp - *first.get_or_insert(stamp)) as f64 / *ticks;
        let values = &mut self.signal.values;
        match array.data_type() {
            DataType::Timestamp(TimeUnit::Second, _) => extend::<types::TimestampSecondType>(values, array, add),
            DataType::Timestamp(TimeUnit::Millisecond, _) => {
                extend::<types::TimestampMillisecondType>(values, array, add);
            }
            DataType::Timestamp(TimeUnit::Microsecond, _) => {
                extend::<types::TimestampMicrosecondType>(values, array, add);
            }
            DataType::Timestamp(TimeUnit::Nanosecond, _) => {
                extend::<types::TimestampNanosecondType>(values, array, add);
            }
            DataType::Duration(TimeUnit::Second) => extend::<types::DurationSecondType>(values, array, &mut add),
            DataType::Duration(TimeUnit::Millisecond) => extend::<types::DurationMillisecondType>(values, array, add),
            DataType::Duration(TimeUnit::Microsecond) => extend::<types::DurationMicrosecondType>(values, array, add),
            DataType::Duration(TimeUnit::Nanosecond) => extend::<types::DurationNanosecondType>(values, array, add),
            _ => {}
        }
    }
}

/// Appends an array's values, with NaN for those that are missing.
fn extend<T: ArrowPrimitiveType>(values: &mut Vec<f64>, array: &dyn Array, mut number: impl FnMut(T::Native) -> f64) {
    values.extend(array.as_primitive::<T>().iter().map(|x| x.map_or(f64::NAN, &mut number)));
}

fn is_read(kind: &DataType) -> bool {
    kind.is_integer() || kind.is_floating() || matches!(kind, DataType::Timestamp(..) | DataType::Duration(_))
}

/// Ticks per second.
fn ticks(unit: &TimeUnit) -> f64 {
    match unit {
        TimeUnit::Second => 1.0,
        TimeUnit::Millisecond => 1e3,
        TimeUnit::Microsecond => 1e6,
        TimeUnit::Nanosecond => 1e9,
    }
}
