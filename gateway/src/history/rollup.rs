//! Rollups of days that are over, and what goes then: raw rows and buckets of a minute, by rule.
//!
//! A pass looks at every machine and day of the history whose day ended [`GRACE_US`] ago. Rows that no unit has are
//! folded into buckets and written at three levels; then the [ledger](super::ledger) has the unit. Only rows that the
//! ledger has are thinned. A kill at any place leaves work for the next pass and nothing twice: files of a unit
//! without a line are removed, a thinned partition comes whole or not at all ([`Store::replace`]). Cost: a pass reads
//! each raw row once, some 0.3 s per million rows; entries wait in the journal meanwhile. Rows of the gateway itself
//! (`_gateway`) have no figures and stay.

use super::buckets::{Buckets, Level, is_wanted};
use super::compact::{compact, read};
use super::day::{self, DAY_US};
use super::files::{self, Format, parts};
use super::ledger::Ledger;
use super::store::Store;
use super::{levels, thin};
use crate::config::Rollup;
use crate::error::{Error, Result, at};
use std::path::{Path, PathBuf};

/// After its end a day is left alone for so long: frames on their way are then in its files, microseconds.
const GRACE_US: i64 = 15 * 60 * 1_000_000;
/// Rows of the gateway itself.
const GATEWAY: &str = "_gateway";
/// Files of a month or year from which on they are merged; when the span is over, two.
const MERGE: usize = 16;

/// What a pass did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Done {
    /// Units rolled up.
    pub units: usize,
    /// Partitions of raw rows thinned.
    pub thinned: usize,
    /// Days of minutes removed.
    pub expired: usize,
    /// There is more to do.
    pub unfinished: bool,
}

/// The rollups of one history.
pub struct Keeper {
    rule: Rollup,
    ledger: Ledger,
    store: Store,
    format: Format,
}

impl Keeper {
    /// Opens the rollups and removes what an interrupted pass left.
    ///
    /// # Errors
    /// Of the file system, and where another process works there.
    pub fn open(folder: &Path, rule: &Rollup) -> Result<Self> {
        let store = Store::open(folder)?;
        let ledger = Ledger::open(folder)?;
        for level in Level::ALL {
            let root = levels::root(folder, level);
            at(&root, std::fs::create_dir_all(&root))?;
            files::recover(&root, ledger.next())?;
        }
        Ok(Self { rule: rule.clone(), ledger, store, format: levels::format()? })
    }

    /// Rolls up, thins and removes what is due at an instant, a machine's day after the other as long as `goes_on`; one
    /// day at least, so that passes come to an end.
    ///
    /// # Errors
    /// Of the file system; what was done until then counts.
    pub fn pass(&mut self, history: &Store, now_us: i64, goes_on: impl Fn() -> bool) -> Result<Done> {
        let mut done = Done::default();
        for partition in files::partitions(history.root())? {
            if done != Done::default() && !goes_on() {
                return Ok(Done { unfinished: true, ..done });
            }
            let Some((machine, day)) = files::place(&partition) else { continue };
            let Some(begin) = day::begin(day).filter(|_| machine != GATEWAY) else { continue };
            let age_us = now_us - (begin + DAY_US);
            if age_us < GRACE_US {
                continue;
            }
            done.units += usize::from(self.roll(&partition, machine, day)?);
            let over = |days: u32| age_us >= i64::from(days) * DAY_US + GRACE_US;
            if self.rule.raw_days.is_some_and(over) {
                done.thinned += usize::from(thin::thin(history, machine, day, self.rule.alarm_seconds)?);
            }
        }
        done.expired = self.expire(now_us)?;
        self.merge(now_us)?;
        Ok(done)
    }

    /// Folds rows that no unit has; gives whether there were any.
    fn roll(&mut self, partition: &Path, machine: &str, day: &str) -> Result<bool> {
        let behind = self.ledger.last(machine, day);
        let fresh = |part: &files::Part| behind.is_none_or(|behind| part.last > behind);
        let mut buckets = Buckets::default();
        for part in parts(partition)?.iter().filter(|part| fresh(part)) {
            for batch in read(&part.path, is_wanted) {
                let place = |reason| Error::new(part.path.display(), reason);
                buckets.take(&batch?, behind).map_err(place)?;
            }
        }
        let Some(last) = buckets.last else { return Ok(false) };
        for level in Level::ALL {
            self.write(level, machine, day, &buckets)?;
        }
        self.ledger.add(machine, day, last)?;
        Ok(true)
    }

    /// The next unit's file of one level.
    fn write(&self, level: Level, machine: &str, day: &str, buckets: &Buckets) -> Result {
        let partition = files::partition(&self.root(level), machine, &level.first_day(day));
        let (unit, batches) = (self.ledger.next(), levels::batches(buckets, level, &self.format)?);
        files::write(&partition, (unit, unit), &self.format, batches.into_iter().map(Ok)).map(drop)
    }

    fn root(&self, level: Level) -> PathBuf {
        levels::root(self.store.root(), level)
    }

    /// Removes days of minutes that are over.
    fn expire(&self, now_us: i64) -> Result<usize> {
        let Some(days) = self.rule.minute_days else { return Ok(0) };
        let mut removed = 0;
        for partition in files::partitions(&self.root(Level::Minute))? {
            let first = files::place(&partition).and_then(|(_, day)| day::begin(day));
            let over = |begin| now_us - span_end(Level::Minute, begin) >= i64::from(days) * DAY_US;
            if first.is_some_and(over) {
                self.store.remove(&partition)?;
                removed += 1;
            }
        }
        Ok(removed)
    }

    /// Merges files: many, or all of a span that is over.
    fn merge(&self, now_us: i64) -> Result {
        for level in Level::ALL {
            for partition in files::partitions(&self.root(level))? {
                let Some(first) = files::place(&partition).and_then(|(_, day)| day::begin(day)) else { continue };
                let over = now_us - span_end(level, first) > DAY_US;
                compact(&self.store, &partition, if over { 2 } else { MERGE }, &self.format)?;
            }
        }
        Ok(())
    }
}

/// First instant behind a file's span.
fn span_end(level: Level, first_us: i64) -> i64 {
    let longest_us = match level {
        Level::Minute => DAY_US,
        Level::Hour => 31 * DAY_US,
        Level::Day => 366 * DAY_US,
    };
    first_us + longest_us
}

#[cfg(test)]
mod tests;
