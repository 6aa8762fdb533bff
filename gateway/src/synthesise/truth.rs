//! What the rollups must say: ranges of every node, day and figure, kept while values are made up, before any file.
//!
//! Rows of each level are folded to days and compared: least and largest value and number exactly, means to the
//! precision of their column. Memory: 1.2 kB per node and day.

use super::node_name;
use crate::error::{Error, Result};
use crate::history::buckets::{Level, Range};
use crate::history::compact::read;
use crate::history::day::DAY_US;
use crate::history::{files, levels};
use crate::values::{QUANTITIES, figures};
use arrow_array::cast::AsArray;
use arrow_array::types::{Float32Type, Int32Type, TimestampMicrosecondType};
use arrow_array::{Array, RecordBatch};
use meshband::events::EventKind;
use meshband::message::Message;
use std::collections::HashMap;
use std::path::Path;

/// Largest relative error of a mean: single precision, folded once more.
const MEAN_ERROR: f64 = 2e-7;

/// Of one node and day.
#[derive(Clone, Debug)]
struct Day {
    figures: [Range; QUANTITIES.len()],
    frames: i32,
    alarms: i32,
}

impl Default for Day {
    fn default() -> Self {
        Self { figures: [Range::default(); QUANTITIES.len()], frames: 0, alarms: 0 }
    }
}

/// Of all nodes and days, by node's name and begin of the day.
#[derive(Debug, Default)]
pub struct Truth {
    days: HashMap<(String, i64), Day>,
}

/// Outcome of a comparison.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Compared {
    /// Ranges compared, and counts of frames and alarms.
    pub ranges: u64,
    /// Of which differ.
    pub differ: u64,
}

impl Truth {
    /// A message that a node sends.
    pub fn take(&mut self, node: u32, time_us: i64, message: &Message) {
        let key = (node_name(node), time_us - time_us.rem_euclid(DAY_US));
        let day = self.days.entry(key).or_default();
        day.frames += 1;
        day.alarms += i32::from(matches!(message, Message::Event(event) if event.kind == EventKind::AlarmRaised));
        figures(message).into_iter().for_each(|(place, value)| day.figures[place].take(value));
    }

    /// Compares the days of a level that are there.
    ///
    /// # Errors
    /// Of a file.
    pub fn compare(&self, folder: &Path, level: Level) -> Result<Compared> {
        let mut held: HashMap<(String, i64), Day> = HashMap::new();
        for partition in files::partitions(&levels::root(folder, level))? {
            for part in files::parts(&partition)? {
                for batch in read(&part.path, |_| true) {
                    fold(&batch?, &mut held).map_err(|reason| Error::new(part.path.display(), reason))?;
                }
            }
        }
        let mut compared = Compared::default();
        for (key, day) in &held {
            let absent = Day::default();
            let truth = self.days.get(key).unwrap_or(&absent);
            let pairs = day.figures.iter().zip(&truth.figures);
            let differ = pairs.filter(|(held, truth)| !is_same(held, truth)).count() as u64;
            compared.ranges += QUANTITIES.len() as u64 + 1;
            compared.differ += differ + u64::from((day.frames, day.alarms) != (truth.frames, truth.alarms));
        }
        // Minutes go; hours and days of all days must be there.
        let missing =
            if level == Level::Minute { 0 } else { self.days.keys().filter(|key| !held.contains_key(*key)).count() };
        compared.differ += missing as u64;
        Ok(compared)
    }
}

fn is_same(held: &Range, truth: &Range) -> bool {
    let near = (held.sum - truth.sum).abs() <= MEAN_ERROR * truth.sum.abs().max(f64::MIN_POSITIVE);
    held.count == truth.count && (held.count == 0 || (held.least == truth.least && held.most == truth.most && near))
}

fn fold(batch: &RecordBatch, held: &mut HashMap<(String, i64), Day>) -> Result {
    let lack = |name: &str| Error::new(name, "no such column of its type");
    let float = |name: String| {
        batch.column_by_name(&name).and_then(|c| c.as_primitive_opt::<Float32Type>()).ok_or_else(|| lack(&name))
    };
    let whole = |name: &str| {
        batch.column_by_name(name).and_then(|c| c.as_primitive_opt::<Int32Type>()).ok_or_else(|| lack(name))
    };
    let node = batch.column_by_name("node").and_then(|c| c.as_string_opt::<i32>()).ok_or_else(|| lack("node"))?;
    let start = batch.column_by_name("start").and_then(|c| c.as_primitive_opt::<TimestampMicrosecondType>());
    let (start, frames, alarms) = (start.ok_or_else(|| lack("start"))?, whole("frames")?, whole("alarms")?);
    let key = |row: usize| (node.value(row).to_owned(), start.value(row) - start.value(row).rem_euclid(DAY_US));
    for row in 0..batch.num_rows() {
        let day = held.entry(key(row)).or_default();
        day.frames += frames.value(row);
        day.alarms += alarms.value(row);
    }
    for (place, quantity) in QUANTITIES.iter().enumerate() {
        let name = quantity.column;
        let (min, max) = (float(format!("{name}_min"))?, float(format!("{name}_max"))?);
        let (mean, count) = (float(format!("{name}_mean"))?, whole(&format!("{name}_count"))?);
        if min.null_count() == min.len() {
            continue;
        }
        for row in (0..batch.num_rows()).filter(|row| min.is_valid(*row)) {
            let count = count.value(row);
            let range = Range {
                least: min.value(row),
                most: max.value(row),
                sum: f64::from(mean.value(row)) * f64::from(count),
                count,
            };
            held.entry(key(row)).or_default().figures[place].fold(&range);
        }
    }
    Ok(())
}
