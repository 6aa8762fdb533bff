//! Rows of the history folded into buckets of a minute, an hour and a day, per node and speed class.
//!
//! A bucket has least, most, mean and number of every figure, and what happened in it: frames, frames lost, alarms,
//! defects. Least and most are exactly those of the rows. The mean is summed in double precision; it is good to
//! 6e-8 of itself. A bucket is of one speed class of [`SPEED_STEP_HZ`], as levels are compared at like speed; rows
//! whose speed is not locked are in a class of their own, null. Memory: 1.2 kB per bucket, 1440 per node and day.

use super::day::DAY_US;
use crate::error::{Error, Result};
use crate::values::QUANTITIES;
use arrow_array::cast::AsArray;
use arrow_array::types::{Float32Type, Int64Type, TimestampMicrosecondType, UInt16Type, UInt64Type};
use arrow_array::{Array, Float32Array, RecordBatch, StringArray};
use std::collections::HashMap;

/// Width of a speed class, Hz; the page's trends have the same.
pub const SPEED_STEP_HZ: f32 = 1.0;
/// Events that are alarms; history keeps raw rows around them.
pub const ALARMS: [&str; 2] = ["AlarmRaised", "AlarmCleared"];
/// Words of the column `quality`, in the order of their bits; the last one is of rows whose speed is not locked.
pub const DEFECTS: [&str; 5] = ["overload", "gap", "settling", "stuck", "speed"];
const UNLOCKED: u8 = 1 << 4;

/// Lengths of buckets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    /// One minute; a file holds a day.
    Minute,
    /// One hour; a file holds a month.
    Hour,
    /// One day; a file holds a year.
    Day,
}

impl Level {
    /// All, the shortest first.
    pub const ALL: [Self; 3] = [Self::Minute, Self::Hour, Self::Day];

    /// As the partition `level=` says it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Minute => "minute",
            Self::Hour => "hour",
            Self::Day => "day",
        }
    }

    fn length_us(self) -> i64 {
        match self {
            Self::Minute => DAY_US / 1440,
            Self::Hour => DAY_US / 24,
            Self::Day => DAY_US,
        }
    }

    /// First day of the file that holds a day's buckets: of the day itself, its month, its year.
    pub fn first_day(self, day: &str) -> String {
        let kept = match self {
            Self::Minute => day.len(),
            Self::Hour => day.len().min(7),
            Self::Day => day.len().min(4),
        };
        format!("{}{}", &day[..kept], &"YYYY-01-01"[kept..])
    }
}

/// Range of a figure in a bucket.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Range {
    /// Least value; the rest is meaningless where `count` is 0.
    pub least: f32,
    /// Largest value.
    pub most: f32,
    /// Sum.
    pub sum: f64,
    /// Values.
    pub count: i32,
}

impl Range {
    /// One more value; what is no number is left out.
    pub fn take(&mut self, value: f32) {
        if !value.is_nan() {
            self.fold(&Self { least: value, most: value, sum: value.into(), count: 1 });
        }
    }

    /// Joins two ranges.
    pub fn fold(&mut self, other: &Self) {
        if self.count == 0 {
            *self = *other;
        } else if other.count > 0 {
            self.least = self.least.min(other.least);
            self.most = self.most.max(other.most);
            self.sum += other.sum;
            self.count += other.count;
        }
    }
}

/// What is known of a node in a bucket.
#[derive(Clone, Debug)]
pub struct Bucket {
    /// Frames received.
    pub frames: i32,
    /// Frames missing by sequence number.
    pub lost: i64,
    /// Alarms raised.
    pub alarms: i32,
    /// Bits of [`DEFECTS`].
    defects: u8,
    /// Of each of [`QUANTITIES`].
    pub figures: [Range; QUANTITIES.len()],
}

impl Default for Bucket {
    fn default() -> Self {
        Self { frames: 0, lost: 0, alarms: 0, defects: 0, figures: [Range::default(); QUANTITIES.len()] }
    }
}

impl Bucket {
    /// What the values lack, worst of all rows: every defect that any had; `None` where none had any.
    pub fn quality(&self) -> Option<String> {
        let held = DEFECTS.iter().enumerate().filter(|(bit, _)| self.defects & 1 << bit != 0);
        let words: Vec<&str> = held.map(|(_, word)| *word).collect();
        (!words.is_empty()).then(|| words.join(" "))
    }

    fn fold(&mut self, other: &Self) {
        self.frames += other.frames;
        self.lost += other.lost;
        self.alarms += other.alarms;
        self.defects |= other.defects;
        self.figures.iter_mut().zip(&other.figures).for_each(|(range, other)| range.fold(other));
    }
}

/// Where a bucket is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Key<'a> {
    /// Node.
    pub node: &'a str,
    /// Its begin, microseconds since 1970.
    pub start_us: i64,
    /// Middle of its speed class, Hz; `None` where the speed was not locked.
    pub class_hz: Option<f32>,
}

/// The buckets of one machine and day.
#[derive(Default)]
pub struct Buckets {
    nodes: Vec<String>,
    /// Class of each node's newest row: rows without a speed, as events, are counted there.
    classes: Vec<Option<i32>>,
    /// Buckets of a minute by node, begin and class.
    places: HashMap<(usize, i64, Option<i32>), usize>,
    held: Vec<Bucket>,
    /// Number of the last entry.
    pub last: Option<u64>,
}

/// Columns that [`Buckets::take`] reads.
pub fn is_wanted(column: &str) -> bool {
    let others = ["journal", "time", "node", "sequence", "validity", "event", "detail", "quality"];
    others.contains(&column) || QUANTITIES.iter().any(|quantity| quantity.column == column)
}

/// The columns of a batch that are there.
struct Columns<'a> {
    validity: Option<&'a StringArray>,
    event: Option<&'a StringArray>,
    quality: Option<&'a StringArray>,
    figures: Vec<(usize, &'a Float32Array)>,
}

impl<'a> Columns<'a> {
    fn of(batch: &'a RecordBatch) -> Self {
        let text = |name: &str| batch.column_by_name(name).and_then(|column| column.as_string_opt());
        let figures = QUANTITIES.iter().enumerate().filter_map(|(place, quantity)| {
            let column = batch.column_by_name(quantity.column)?.as_primitive_opt::<Float32Type>()?;
            (column.null_count() < column.len()).then_some((place, column))
        });
        Self { validity: text("validity"), event: text("event"), quality: text("quality"), figures: figures.collect() }
    }

    fn defects(&self, row: usize) -> u8 {
        let words = cell(self.quality, row).unwrap_or_default().split(' ');
        let bits =
            words.filter_map(|word| DEFECTS.iter().position(|held| *held == word)).fold(0, |bits, bit| bits | 1 << bit);
        bits | if self.is_locked(row) { 0 } else { UNLOCKED }
    }

    /// Rows of kinds that say nothing of it count as locked.
    fn is_locked(&self, row: usize) -> bool {
        cell(self.validity, row).is_none_or(|validity| validity == "Locked")
    }
}

fn cell(column: Option<&StringArray>, row: usize) -> Option<&str> {
    column.filter(|column| column.is_valid(row)).map(|column| column.value(row))
}

impl Buckets {
    /// Folds the rows in whose entries come behind `behind`.
    ///
    /// # Errors
    /// Where a column that every version has is missing.
    pub fn take(&mut self, batch: &RecordBatch, behind: Option<u64>) -> Result {
        let lack =
            || Error::new("history", "a file lacks journal, time, node, sequence or detail; it is not of a gateway");
        let number =
            batch.column_by_name("journal").and_then(|c| c.as_primitive_opt::<UInt64Type>()).ok_or_else(lack)?;
        let time = batch.column_by_name("time").and_then(|c| c.as_primitive_opt::<TimestampMicrosecondType>());
        let time = time.ok_or_else(lack)?;
        let name = batch.column_by_name("node").and_then(|c| c.as_string_opt::<i32>()).ok_or_else(lack)?;
        let sequence = batch.column_by_name("sequence").and_then(|c| c.as_primitive_opt::<UInt16Type>());
        let sequence = sequence.ok_or_else(lack)?;
        let detail = batch.column_by_name("detail").and_then(|c| c.as_primitive_opt::<Int64Type>()).ok_or_else(lack)?;
        let columns = Columns::of(batch);
        let speed = columns.figures.iter().find(|(place, _)| *place == 0).map(|(_, column)| *column);
        for row in 0..batch.num_rows() {
            if behind.is_some_and(|behind| number.value(row) <= behind) {
                continue;
            }
            self.last = self.last.max(Some(number.value(row)));
            let node = self.node(name.value(row));
            if let Some(speed) = speed.filter(|speed| speed.is_valid(row)) {
                let class = (speed.value(row) / SPEED_STEP_HZ).floor() as i32;
                self.classes[node] = columns.is_locked(row).then_some(class);
            }
            let bucket = self.bucket(node, time.value(row));
            bucket.frames += i32::from(sequence.is_valid(row));
            bucket.defects |= columns.defects(row);
            match cell(columns.event, row) {
                Some("FramesLost") => bucket.lost += detail.value(row),
                Some("AlarmRaised") => bucket.alarms += 1,
                _ => {}
            }
            for (place, column) in &columns.figures {
                if column.is_valid(row) {
                    bucket.figures[*place].take(column.value(row));
                }
            }
        }
        Ok(())
    }

    fn node(&mut self, name: &str) -> usize {
        self.nodes.iter().position(|held| held == name).unwrap_or_else(|| {
            self.nodes.push(name.to_owned());
            self.classes.push(None);
            self.nodes.len() - 1
        })
    }

    fn bucket(&mut self, node: usize, time_us: i64) -> &mut Bucket {
        let key = (node, begin(Level::Minute, time_us), self.classes[node]);
        let place = *self.places.entry(key).or_insert_with(|| {
            self.held.push(Bucket::default());
            self.held.len() - 1
        });
        &mut self.held[place]
    }

    /// Every bucket of a level, in the order of nodes' names, begins and classes.
    ///
    /// # Errors
    /// Of `visit`.
    pub fn visit(&self, level: Level, mut visit: impl FnMut(&Key<'_>, &Bucket) -> Result) -> Result {
        let key = |&(node, start, class): &(usize, i64, Option<i32>)| Key {
            node: self.nodes[node].as_str(),
            start_us: begin(level, start),
            class_hz: class.map(|class| (class as f32 + 0.5) * SPEED_STEP_HZ),
        };
        let order = |at: &(usize, i64, Option<i32>)| (self.nodes[at.0].as_str(), begin(level, at.1), at.2, at.1);
        let mut places: Vec<_> = self.places.iter().collect();
        places.sort_unstable_by(|(a, _), (b, _)| order(a).cmp(&order(b)));
        for same in places.chunk_by(|(a, _), (b, _)| key(a) == key(b)) {
            let mut folded = Bucket::default();
            same.iter().for_each(|(_, place)| folded.fold(&self.held[**place]));
            if let Some((at, _)) = same.first() {
                visit(&key(at), &folded)?;
            }
        }
        Ok(())
    }
}

fn begin(level: Level, time_us: i64) -> i64 {
    time_us - time_us.rem_euclid(level.length_us())
}
