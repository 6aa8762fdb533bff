//! A capture of a link (`meshband monitor --record`) into a history, as if a gateway had heard it.
//!
//! Frames are told apart, gaps and starts counted as on a live line. A capture has no wall clock: the instant of its
//! first frame is given, what follows is placed by the node's ticks. A folder of exports is not a gateway's: numbers
//! of entries are given here, and a gateway would take the files for its own unfinished ones. [`LIST`] marks it and
//! says which entries hold which capture and day, written before the file: an export that was interrupted is
//! completed by the next one, one that is there is left out.

use super::capture::{Entries, survey};
use super::files;
use super::rows::Rows;
use crate::config::{machine_named, named};
use crate::error::{Error, Result, at};
use arrow_array::RecordBatch;
use clap::Args;
use serde::{Deserialize, Serialize};
use std::fs::{File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};

/// Rows of a batch: what is in memory.
const BATCH: usize = 8192;
/// File in a folder of exports that lists them, one JSON object per line. Readers of datasets leave out what begins
/// with `_`.
pub const LIST: &str = "_exports.jsonl";
/// What the list was called before; it is renamed.
pub const FORMER_LIST: &str = "exports.jsonl";

/// What to export.
#[derive(Args)]
pub struct ExportArgs {
    /// File that `meshband monitor --record` wrote
    pub capture: PathBuf,
    /// Folder of the exports, not a gateway's own; what is there stays
    pub folder: PathBuf,
    /// Name of the node
    #[arg(long)]
    pub node: String,
    /// Name of the machine
    #[arg(long)]
    pub machine: String,
    /// Instant of the first frame, seconds since 1970
    #[arg(long)]
    pub from: i64,
}

/// One day of one capture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Listed {
    /// Tells captures apart: of the first bytes, so that one that has grown since is the same.
    capture: u64,
    node: String,
    machine: String,
    from: i64,
    day: String,
    first: u64,
    last: u64,
}

/// Exports and prints what was written and what was there.
///
/// # Errors
/// For a file that is no capture, one that is there already, a folder in use otherwise, and of the file system.
pub fn run(args: &ExportArgs) -> Result {
    let place = args.capture.display().to_string();
    let names = named("--node", &args.node).and_then(|()| machine_named("--machine", &args.machine));
    names.map_err(|reason| Error::new(&place, reason))?;
    let survey = survey(args)?;
    let mut list = List::open(&args.folder)?;
    list.agrees(survey.mark, args)?;
    let mut entries = Entries::open(args, &survey.identity)?;
    let (mut written, mut there) = (0, 0);
    for (day, count) in &survey.days {
        let partition = files::partition(&args.folder, &args.machine, day);
        let Some(listed) = list.claim(survey.mark, args, day, *count, &partition)? else {
            there += 1;
            entries.by_ref().take(*count as usize).try_for_each(|entry| entry.map(drop))?;
            continue;
        };
        let rows = batches(&mut entries, listed.first, *count);
        files::write(&partition, (listed.first, listed.last), &files::Format::history()?, rows)?;
        written += count;
    }
    if written == 0 {
        return Err(Error::new(place, format!("is in {} already", args.folder.display())));
    }
    println!("{written} rows into {}; {there} days were there already", args.folder.display());
    Ok(())
}

/// So many entries as batches, numbered from `first`.
fn batches(entries: &mut Entries, first: u64, count: u64) -> impl Iterator<Item = Result<RecordBatch>> {
    let mut next = first;
    std::iter::from_fn(move || {
        let size = (first + count - next).min(BATCH as u64);
        let mut rows = Rows::default();
        for entry in entries.by_ref().take(size as usize) {
            match entry {
                Ok(entry) => rows.push(next, &entry),
                Err(reason) => return Some(Err(reason)),
            }
            next += 1;
        }
        (size > 0).then(|| rows.finish())
    })
}

/// The folder's list, held against other exports.
struct List {
    file: File,
    path: PathBuf,
    held: Vec<Listed>,
}

impl List {
    fn open(folder: &Path) -> Result<Self> {
        at(folder, std::fs::create_dir_all(folder))?;
        let (path, former) = (folder.join(LIST), folder.join(FORMER_LIST));
        if former.exists() && !path.exists() {
            at(&former, std::fs::rename(&former, &path))?;
        }
        let mut items = at(folder, std::fs::read_dir(folder))?;
        if !path.exists() && items.next().is_some() {
            return Err(Error::new(folder.display(), format!("is not empty and has no {LIST}: a gateway's own?")));
        }
        let file = at(&path, OpenOptions::new().create(true).append(true).read(true).open(&path))?;
        file.try_lock().map_err(|_| Error::new(folder.display(), "another export works in this folder"))?;
        let text = at(&path, std::fs::read_to_string(&path))?;
        // A torn last line is of an export that had not begun its file.
        let held = text.lines().filter_map(|line| serde_json::from_str(line).ok()).collect();
        Ok(Self { file, path, held })
    }

    /// One capture is of one node and one time: exported under another it would be there twice.
    fn agrees(&self, capture: u64, args: &ExportArgs) -> Result {
        let other = |held: &&Listed| {
            held.capture == capture && (&held.node, &held.machine, held.from) != (&args.node, &args.machine, args.from)
        };
        self.held.iter().find(other).map_or(Ok(()), |held| {
            let Listed { node, machine, from, .. } = held;
            let there = format!("is there as --node {node:?} --machine {machine:?} --from {from}");
            Err(Error::new(args.capture.display(), there))
        })
    }

    /// Numbers for a day of a capture; `None` where its file is there.
    fn claim(
        &mut self,
        capture: u64,
        args: &ExportArgs,
        day: &str,
        count: u64,
        partition: &Path,
    ) -> Result<Option<Listed>> {
        let parts = if partition.is_dir() { files::parts(partition)? } else { Vec::new() };
        let there = |held: &&Listed| parts.iter().any(|part| part.first <= held.first && held.last <= part.last);
        let same = |held: &&Listed| held.capture == capture && held.day == day;
        if self.held.iter().filter(same).any(|held| there(&held)) {
            return Ok(None);
        }
        // Numbers that an interrupted export had are not used again.
        let first = self.held.iter().map(|held| held.last + 1).max().unwrap_or(0);
        let listed = Listed {
            capture,
            node: args.node.clone(),
            machine: args.machine.clone(),
            from: args.from,
            day: day.to_owned(),
            first,
            last: first + count - 1,
        };
        let line = serde_json::to_string(&listed).map_err(|reason| Error::new(self.path.display(), reason))?;
        // A line of its own even behind a torn one.
        at(&self.path, self.file.write_all(format!("\n{line}\n").as_bytes()))?;
        at(&self.path, self.file.sync_data())?;
        self.held.push(listed.clone());
        Ok(Some(listed))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::history::compact::{compact, read};
    use crate::history::store::Store;
    use meshband::events::{Event, EventKind};
    use meshband::frame::{MAX_FRAME, encode};
    use meshband::message::{Identification, Message, Reply};

    fn identity() -> Reply {
        Reply::Identity(Identification {
            wire_schema: 4,
            configuration_schema: 2,
            version: [0, 1, 0],
            build: Default::default(),
            board: Default::default(),
            unique_id: [7, 8, 9],
            ticks_per_second: 1000,
            self_test: Default::default(),
            image: Default::default(),
        })
    }

    /// A frame every ten minutes from an hour before midnight: the identity, then 20 events, one of them twice, one
    /// missing.
    fn capture() -> Vec<u8> {
        let mut buffer = [0; MAX_FRAME];
        let mut bytes = b"rubbish of a port that was open before".to_vec();
        bytes.extend_from_slice(encode(&identity(), 0, &mut buffer).expect("fits"));
        for number in (1..=21u16).filter(|number| *number != 12) {
            let tick = u64::from(number) * 600_000;
            let event =
                Event { kind: EventKind::Board, detail: number.into(), first_tick: tick, last_tick: tick, count: 1 };
            let frame = encode(&Message::Event(event), number, &mut buffer).expect("fits");
            (0..if number == 3 { 2 } else { 1 }).for_each(|_| bytes.extend_from_slice(frame));
        }
        bytes
    }

    fn days(root: &Path) -> Vec<(String, usize)> {
        let rows = |part: &files::Part| {
            read(&part.path, |_| true).map(|batch| batch.expect("reads").num_rows()).sum::<usize>()
        };
        let of = |partition: PathBuf| {
            let rows = files::parts(&partition).expect("lists").iter().map(rows).sum();
            (partition.file_name().expect("a day").to_string_lossy().into_owned(), rows)
        };
        files::partitions(root).expect("lists").into_iter().map(of).collect()
    }

    #[test]
    fn claim_a_capture_is_in_the_history_once_however_often_and_wherever_its_export_was_interrupted() {
        let root = std::env::temp_dir().join(format!("meshband-export-{}", std::process::id()));
        let _ = std::fs::remove_dir_all(&root);
        std::fs::create_dir_all(&root).expect("creates");
        let (path, folder) = (root.join("a.link"), root.join("history"));
        std::fs::write(&path, capture()).expect("writes");
        let args =
            ExportArgs { capture: path, folder: folder.clone(), node: "n".into(), machine: "m".into(), from: 82_800 };
        run(&args).expect("exports");
        // The identity, 20 events of 21, and a note of the one that is missing; the first event is at the given
        // instant.
        let whole = [("day=1970-01-01".to_owned(), 7), ("day=1970-01-02".to_owned(), 15)];
        assert_eq!(days(&folder), whole);
        let again = run(&args).expect_err("it is there").to_string();
        assert!(again.contains("already"), "{again}");
        let (of, into) = (args.capture.clone(), folder.clone());
        let later = ExportArgs { capture: of, folder: into, node: "n".into(), machine: "m".into(), from: 82_801 };
        let elsewhen = run(&later).expect_err("of another time").to_string();
        assert!(elsewhen.contains("--from 82800"), "{elsewhen}");
        let second = folder.join("machine=m/day=1970-01-02");
        std::fs::remove_file(&files::parts(&second).expect("lists")[0].path).expect("removes");
        std::fs::write(folder.join(LIST), std::fs::read_to_string(folder.join(LIST)).expect("reads") + "{\"torn")
            .expect("writes");
        run(&args).expect("completes");
        assert_eq!(days(&folder), whole);
        // Another capture's rows stand behind, and merging changes nothing.
        std::fs::write(&args.capture, [b"x".to_vec(), capture()].concat()).expect("writes");
        run(&args).expect("exports");
        let (store, format) = (Store::open(&folder).expect("opens"), files::Format::history().expect("a format"));
        compact(&store, &second, 2, &format).expect("merges");
        assert_eq!(days(&folder).iter().map(|(_, rows)| rows).sum::<usize>(), 44);
        assert!(run(&args).is_err());
        let _ = std::fs::remove_dir_all(&root);
    }

    #[test]
    fn claim_readers_of_datasets_leave_the_list_out_and_a_list_of_the_former_name_still_counts() {
        assert!(LIST.starts_with('_'), "pyarrow, pandas, polars and Spark take {LIST} for data");
        let root = std::env::temp_dir().join(format!("meshband-export-former-{}", std::process::id()));
        let _ = std::fs::remove_dir_all(&root);
        std::fs::create_dir_all(&root).expect("creates");
        let (path, folder) = (root.join("a.link"), root.join("history"));
        std::fs::write(&path, capture()).expect("writes");
        let args =
            ExportArgs { capture: path, folder: folder.clone(), node: "n".into(), machine: "m".into(), from: 82_800 };
        run(&args).expect("exports");
        std::fs::rename(folder.join(LIST), folder.join(FORMER_LIST)).expect("as it was called before");
        let again = run(&args).expect_err("it is there").to_string();
        assert!(again.contains("already"), "{again}");
        assert!(folder.join(LIST).exists() && !folder.join(FORMER_LIST).exists(), "renamed");
        assert_eq!(days(&folder).iter().map(|(_, rows)| rows).sum::<usize>(), 22);
        let _ = std::fs::remove_dir_all(&root);
    }

    #[test]
    fn fault_what_is_no_capture_and_a_folder_of_another_use_are_refused() {
        let root = std::env::temp_dir().join(format!("meshband-export-refused-{}", std::process::id()));
        std::fs::create_dir_all(root.join("history/machine=m")).expect("creates");
        let (path, folder) = (root.join("a.link"), root.join("history"));
        let args = ExportArgs { capture: path, folder, node: "n".into(), machine: "m".into(), from: 0 };
        for (bytes, says) in [(b"no link at all".to_vec(), "who it is"), (capture(), "a gateway's own?")] {
            std::fs::write(&args.capture, bytes).expect("writes");
            let refused = run(&args).expect_err(says).to_string();
            assert!(refused.contains(says), "{refused}");
        }
        let _ = std::fs::remove_dir_all(&root);
    }
}
