//! The history's thread: from the journal into files, a batch at a time.
//!
//! A batch is what came since the last one, at most [`BATCH`] entries: memory is bounded by it. Its files are written
//! first, one per machine and day, then its end is kept as the place in the journal. A writer killed anywhere in
//! between begins the batch anew, after removing what it had written of it ([`super::files::recover`]). What waits
//! for a batch is in the journal, so a killed gateway loses nothing of it.

use super::export::{FORMER_LIST, LIST};
use super::files::{Format, partition};
use super::rollup::{Done, Keeper};
use super::rows::Rows;
use super::store::Store;
use super::{compact, day, files};
use crate::clock::wall_us;
use crate::config::History;
use crate::error::{Error, Result};
use crate::health::Health;
use crate::journal::cursor::Cursor;
use crate::journal::entry::Entry;
use crate::journal::reader::Reader;
use crate::stop::Stop;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Most entries of a batch.
pub const BATCH: usize = 20_000;
/// Time between passes of the rollups: a day that is over is rolled up within it.
const PASS: Duration = Duration::from_secs(600);
/// A pass goes on no longer than this behind a machine's day; entries wait in the journal meanwhile, and a history of
/// years that is rolled up for the first time takes many passes.
const PASS_SHARE: Duration = Duration::from_secs(10);

/// The thread's state.
pub struct Writer {
    config: History,
    store: Store,
    format: Format,
    keeper: Option<Keeper>,
    /// When the rollups were looked at last.
    passed_at: Option<Instant>,
    journal: PathBuf,
    cursor: Cursor,
    passed: Arc<AtomicU64>,
    health: Arc<Health>,
    /// The last batch was not completed.
    broken: bool,
}

impl Writer {
    /// Removes what an interrupted writer left, and goes on at its place.
    ///
    /// # Errors
    /// Of the file system.
    pub fn open(config: &History, data: &Path, passed: Arc<AtomicU64>, health: Arc<Health>) -> Result<Self> {
        if [LIST, FORMER_LIST].iter().any(|list| config.folder.join(list).exists()) {
            return Err(Error::new(config.folder.display(), "holds exports; a gateway needs a folder of its own"));
        }
        let store = Store::open(&config.folder)?;
        let cursor = Cursor::open(data, "history")?;
        let removed = store.recover(cursor.next())?;
        if removed > 0 {
            eprintln!("history: {removed} unfinished or merged files removed");
        }
        passed.store(cursor.next(), Ordering::Relaxed);
        let keeper = match &config.rollup {
            Some(rule) => Some(Keeper::open(&config.rollup_folder(), rule)?),
            None => None,
        };
        let (config, journal, format) = (config.clone(), data.join("journal"), Format::history()?);
        Ok(Self { config, store, format, keeper, passed_at: None, journal, cursor, passed, health, broken: false })
    }

    /// Number of the next entry.
    pub fn next(&self) -> u64 {
        self.cursor.next()
    }

    /// Writes files until the gateway stops, and what is left then.
    pub fn run(mut self, stop: Stop, journal_closed: impl Fn() -> bool) {
        let mut said = String::new();
        loop {
            stop.sleep(Duration::from_secs(self.config.flush_seconds));
            while stop.asked() && !journal_closed() {
                std::thread::sleep(Duration::from_millis(5));
            }
            match self.flush().and_then(|()| self.roll_up(&stop)) {
                Ok(()) => said.clear(),
                Err(reason) => {
                    self.health.history_failures.fetch_add(1, Ordering::Relaxed);
                    let reason = reason.to_string();
                    if reason != said {
                        eprintln!("history: {reason}; tried again, entries wait in the journal");
                    }
                    said = reason;
                }
            }
            if stop.asked() {
                return;
            }
        }
    }

    /// Rolls up and thins what is due, where that is configured. All that waited is written before, so a day that is
    /// over is complete.
    fn roll_up(&mut self, stop: &Stop) -> Result {
        let Some(keeper) = &mut self.keeper else { return Ok(()) };
        if self.passed_at.is_some_and(|at| at.elapsed() < PASS) {
            return Ok(());
        }
        let begun = Instant::now();
        self.passed_at = Some(begun);
        let Done { units, thinned, expired, unfinished } =
            keeper.pass(&self.store, wall_us(), || begun.elapsed() < PASS_SHARE && !stop.asked())?;
        if units + thinned + expired > 0 {
            eprintln!("rollup: {units} machine days rolled up, {thinned} thinned, {expired} days of minutes removed");
        }
        if unfinished {
            // Behind the next files at once.
            self.passed_at = None;
        }
        Ok(())
    }

    /// Writes all that waits.
    ///
    /// # Errors
    /// Of the file system; the next call begins the batch anew.
    pub fn flush(&mut self) -> Result {
        loop {
            let mut reader = Reader::new(&self.journal, self.cursor.next());
            let entries = reader.take(BATCH)?;
            if reader.missed() > 0 {
                self.health.history_lost.fetch_add(reader.missed(), Ordering::Relaxed);
            }
            let Some((last, _)) = entries.last() else { return Ok(()) };
            let (count, last) = (entries.len(), *last);
            if std::mem::replace(&mut self.broken, true) {
                self.store.recover(self.cursor.next())?;
            }
            let partitions = self.write(&entries)?;
            self.cursor.keep(last + 1)?;
            self.broken = false;
            self.passed.store(last + 1, Ordering::Relaxed);
            self.health.history_next.store(last + 1, Ordering::Relaxed);
            for partition in partitions {
                compact::compact(&self.store, &partition, self.config.compact_files, &self.format)?;
            }
            if count < BATCH {
                return Ok(());
            }
        }
    }

    /// One file per machine and day; gives their partitions.
    fn write(&self, entries: &[(u64, Entry)]) -> Result<Vec<PathBuf>> {
        let mut partitions: BTreeMap<(&str, String), Vec<&(u64, Entry)>> = BTreeMap::new();
        for held in entries {
            partitions.entry((&held.1.machine, day::of(held.1.received_us))).or_default().push(held);
        }
        let mut written = Vec::new();
        for ((machine, day), held) in partitions {
            let partition = partition(self.store.root(), machine, &day);
            let (Some((first, _)), Some((last, _))) = (held.first(), held.last()) else { continue };
            let mut rows = Rows::default();
            held.iter().for_each(|(number, entry)| rows.push(*number, entry));
            files::write(&partition, (*first, *last), &self.format, [rows.finish()])?;
            written.push(partition);
        }
        Ok(written)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::journal::Journal;
    use crate::journal::entry::{Body, Note};
    use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;

    fn entry(number: u64) -> Entry {
        Entry {
            node: "n".into(),
            machine: format!("m{}", number % 2),
            unit: [1, 2, 3],
            boot: 1,
            received_us: number as i64 * 20_000_000_000,
            time_us: 0,
            body: Body::Note { kind: Note::Command, detail: number as i64, text: String::new() },
        }
    }

    fn rows(root: &Path) -> usize {
        let parts = files::partitions(root).expect("lists").into_iter().flat_map(|p| files::parts(&p).expect("lists"));
        let count = |part: files::Part| {
            let file = std::fs::File::open(&part.path).expect("opens");
            let builder = ParquetRecordBatchReaderBuilder::try_new(file).expect("a whole file");
            builder.metadata().file_metadata().num_rows() as usize
        };
        parts.map(count).sum()
    }

    #[test]
    fn fault_a_batch_interrupted_after_any_of_its_files_is_written_once() {
        let root = std::env::temp_dir().join(format!("meshband-history-{}", std::process::id()));
        let _ = std::fs::remove_dir_all(&root);
        let (data, folder) = (root.join("data"), root.join("history"));
        let config = History { folder: folder.clone(), flush_seconds: 1, compact_files: 4, rollup: None };
        let mut journal = Journal::open(&data.join("journal"), 0).expect("opens");
        let open = || Writer::open(&config, &data, Arc::default(), Arc::default()).expect("opens");
        let mut written = 0;
        for round in 0..12 {
            journal.append(&(written..written + 8).map(entry).collect::<Vec<_>>()).expect("writes");
            written += 8;
            // Files of the batch, but not the place in the journal: what a kill in between leaves.
            let writer = open();
            let entries = Reader::new(&writer.journal, writer.next()).take(BATCH).expect("reads");
            writer.write(&entries[..=round % 8]).expect("writes");
            drop(writer);
            std::fs::write(folder.join("machine=m0/day=1970-01-01/.part-9.new"), "half").expect("writes");
            open().flush().expect("flushes");
            assert_eq!(rows(&folder), written as usize, "round {round}");
        }
        let most =
            files::partitions(&folder).expect("lists").iter().map(|p| files::parts(p).expect("lists").len()).max();
        assert!(most.is_some_and(|most| most < 4), "merged: {most:?} files in a partition at most");
        let _ = std::fs::remove_dir_all(&root);
    }
}
