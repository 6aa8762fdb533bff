//! What the rollups were made of, one line per unit: all rows of one machine and day that had no unit before.
//!
//! A unit's files come first, its line last. Files are named by units, so what a kill leaves of a unit without a line
//! is known by its number and removed ([`super::files::recover`]). Rows of a machine and day are written in the
//! order of their numbers: the largest one of a unit says which rows are in it, also after merges and when the clock
//! was put back and rows came late. The list lies in the rollups' folder: it belongs to them, not to a gateway. Cost:
//! 80 bytes per machine and day.

use super::cut;
use crate::error::{Error, Result, at};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};

/// File in the rollups' folder. Readers of datasets leave out what begins with `_`.
pub const LEDGER: &str = "_units.jsonl";

/// One unit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Unit {
    /// Its number.
    pub unit: u64,
    /// Machine of its rows.
    pub machine: String,
    /// Day of reception of its rows.
    pub day: String,
    /// Number of the last entry among its rows.
    pub last: u64,
}

/// The list, open for more.
#[derive(Debug)]
pub struct Ledger {
    file: File,
    path: PathBuf,
    next: u64,
    /// Number of the last entry rolled up, by machine and day.
    last: BTreeMap<(String, String), u64>,
}

impl Ledger {
    /// Reads the list; a torn last line is of a unit that was not completed.
    ///
    /// # Errors
    /// Of the file.
    pub fn open(folder: &Path) -> Result<Self> {
        let path = folder.join(LEDGER);
        let file = at(&path, OpenOptions::new().create(true).append(true).read(true).open(&path))?;
        let text = at(&path, std::fs::read_to_string(&path))?;
        let mut ledger = Self { file, path, next: 0, last: BTreeMap::new() };
        text.lines().filter_map(|line| serde_json::from_str(line).ok()).for_each(|unit| ledger.hold(unit));
        Ok(ledger)
    }

    fn hold(&mut self, unit: Unit) {
        self.next = self.next.max(unit.unit + 1);
        let last = self.last.entry((unit.machine, unit.day)).or_default();
        *last = unit.last.max(*last);
    }

    /// Number of the next unit.
    pub fn next(&self) -> u64 {
        self.next
    }

    /// Number of the last entry of a machine and day that is rolled up.
    pub fn last(&self, machine: &str, day: &str) -> Option<u64> {
        self.last.get(&(machine.to_owned(), day.to_owned())).copied()
    }

    /// Adds the next unit; it counts from here on.
    ///
    /// # Errors
    /// Of the file; the unit then does not count.
    pub fn add(&mut self, machine: &str, day: &str, last: u64) -> Result {
        let unit = Unit { unit: self.next, machine: machine.to_owned(), day: day.to_owned(), last };
        let line = serde_json::to_string(&unit).map_err(|reason| Error::new(self.path.display(), reason))?;
        // A line of its own even behind a torn one.
        let bytes = format!("\n{line}\n").into_bytes();
        let (begin, rest) = bytes.split_at(bytes.len() / 2);
        cut::point();
        at(&self.path, self.file.write_all(begin))?;
        cut::point();
        at(&self.path, self.file.write_all(rest))?;
        cut::point();
        at(&self.path, self.file.sync_data())?;
        self.hold(unit);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fault_a_list_cut_anywhere_has_the_units_whose_lines_are_whole_and_takes_more() {
        let folder = std::env::temp_dir().join(format!("meshband-ledger-{}", std::process::id()));
        let _ = std::fs::remove_dir_all(&folder);
        std::fs::create_dir_all(&folder).expect("creates");
        let mut ledger = Ledger::open(&folder).expect("opens");
        ledger.add("m", "2026-01-01", 10).expect("adds");
        let one = std::fs::metadata(folder.join(LEDGER)).expect("there").len() as usize;
        ledger.add("m", "2026-01-02", 20).expect("adds");
        ledger.add("m", "2026-01-01", 30).expect("adds");
        let whole = std::fs::read(folder.join(LEDGER)).expect("reads");
        for cut in 0..=whole.len() {
            std::fs::write(folder.join(LEDGER), &whole[..cut]).expect("writes");
            let mut ledger = Ledger::open(&folder).expect("opens");
            // The line's end is not needed.
            let lines = [one - 1, 2 * one - 1, whole.len() - 1].iter().filter(|end| cut >= **end).count() as u64;
            assert_eq!(ledger.next(), lines, "cut at {cut}");
            ledger.add("m", "2026-01-03", 99).expect("adds");
            let again = Ledger::open(&folder).expect("opens");
            assert_eq!((again.next(), again.last("m", "2026-01-03")), (lines + 1, Some(99)), "cut at {cut}");
            let last = [None, Some(10), Some(10), Some(30)][lines as usize];
            assert_eq!(again.last("m", "2026-01-01"), last, "cut at {cut}");
        }
        let _ = std::fs::remove_dir_all(&folder);
    }
}
