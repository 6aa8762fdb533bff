//! The journal's thread: reports of all nodes in, entries out, in the order in which they came.
//!
//! What is taken is decided by [`super::state`] and written at once; every `sync_seconds` the system is told to write
//! it down. A journal that cannot be written (full disk) loses entries, counts them and says so in the first entry
//! that can be written; measuring and the history of what came before go on.

use super::state::{NodeState, Verdict, unit_text};
use super::{News, Report};
use crate::clock::JumpWatch;
use crate::config::Node;
use crate::error::Result;
use crate::health::Health;
use crate::journal::cursor::replace;
use crate::journal::entry::{Body, Entry, Note, decode};
use crate::journal::reader::Reader;
use crate::journal::{Journal, segments};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::Ordering;

/// Machine under which the gateway's own notes are kept.
pub const OWN_MACHINE: &str = "_gateway";

/// States of all nodes as they were before an entry.
#[derive(Debug, Default, Serialize, Deserialize)]
struct Kept {
    before: u64,
    nodes: BTreeMap<String, NodeState>,
}

/// Takes reports and writes entries.
#[derive(Debug)]
pub struct Intake {
    nodes: Vec<Node>,
    states: BTreeMap<String, NodeState>,
    state_path: PathBuf,
    journal: Journal,
    /// Entries not written yet.
    pending: Vec<Entry>,
    /// Entries that could not be written.
    lost: u64,
    clock: JumpWatch,
    health: Arc<Health>,
}

impl Intake {
    /// Opens the journal below `data` and brings the nodes' states up to date with it.
    ///
    /// # Errors
    /// Of the file system.
    pub fn open(data: &Path, nodes: &[Node], at_least: u64, health: Arc<Health>) -> Result<Self> {
        let folder = data.join("journal");
        let journal = Journal::open(&folder, at_least)?;
        let state_path = data.join("nodes.json");
        // A state that cannot be read is made anew from the journal; what that lacks costs one gap per node.
        let kept: Kept =
            std::fs::read(&state_path).ok().and_then(|text| serde_json::from_slice(&text).ok()).unwrap_or_default();
        let mut states = kept.nodes;
        let from = kept.before.max(segments(&folder)?.first().copied().unwrap_or(0));
        let mut reader = Reader::new(&folder, from);
        loop {
            let entries = reader.take(1000)?;
            if entries.is_empty() {
                break;
            }
            for (_, entry) in entries.iter().filter(|(_, entry)| !entry.node.is_empty()) {
                states.entry(entry.node.clone()).or_default().replay(entry);
            }
        }
        health.journal_next.store(journal.next(), Ordering::Relaxed);
        let clock = JumpWatch::default();
        Ok(Self { nodes: nodes.to_vec(), states, state_path, journal, pending: Vec::new(), lost: 0, clock, health })
    }

    /// Takes one report; [`Intake::write`] writes what it gave.
    pub fn take(&mut self, report: Report) {
        if let Some(jump) = self.clock.look(report.wall_us, report.steady_us) {
            self.health.clock_jumps.fetch_add(1, Ordering::Relaxed);
            self.states.values_mut().for_each(NodeState::forget_time);
            self.own_note(report.wall_us, Note::ClockJump, jump / 1000, "the wall clock was set");
        }
        let Some(name) = self.nodes.get(report.node).map(|node| node.name.clone()) else { return };
        match report.news {
            News::Online(identity) => {
                let former = self.states.entry(name.clone()).or_default().identified(&identity);
                if let Some(former) = former {
                    self.note(report.node, report.wall_us, Note::Replaced, 0, unit_text(former));
                }
                let [major, minor, patch] = identity.version;
                let firmware = format!("{major}.{minor}.{patch} {} on {}", identity.build, identity.board);
                self.note(report.node, report.wall_us, Note::Connected, 0, firmware);
                self.health.node(&name, |node| node.online = true);
            }
            News::Frame(bytes) => self.frame(report.node, &name, report.wall_us, bytes),
            News::Offline(reason) => {
                self.note(report.node, report.wall_us, Note::Disconnected, 0, reason);
                self.health.node(&name, |node| node.online = false);
            }
            News::Command(text) => self.note(report.node, report.wall_us, Note::Command, 0, text),
        }
    }

    fn frame(&mut self, index: usize, name: &str, received_us: i64, bytes: Vec<u8>) {
        let Some(frame) = decode(&bytes) else {
            self.health.node(name, |node| node.refused += 1);
            return;
        };
        let state = self.states.entry(name.to_owned()).or_default();
        let Verdict::New { lost, restarted, time_us } = state.take(&bytes, &frame, received_us) else {
            self.health.node(name, |node| node.repeated += 1);
            return;
        };
        let (boot, alarms) = (state.boot, state.alarms);
        if restarted {
            self.note(index, received_us, Note::Restarted, boot.into(), String::new());
        }
        if lost > 0 {
            self.note(index, received_us, Note::FramesLost, lost.into(), String::new());
        }
        self.push(index, received_us, time_us, Body::Frame(bytes));
        self.health.node(name, |node| {
            node.frames += 1;
            node.lost += u64::from(lost);
            node.restarts += u64::from(restarted);
            node.alarms = alarms.into();
        });
    }

    fn note(&mut self, index: usize, wall_us: i64, kind: Note, detail: i64, text: String) {
        let text = text.chars().take(200).collect();
        self.push(index, wall_us, wall_us, Body::Note { kind, detail, text });
    }

    fn push(&mut self, index: usize, received_us: i64, time_us: i64, body: Body) {
        let Node { name, machine, .. } = &self.nodes[index];
        let state = self.states.get(name);
        let (unit, boot) = state.map_or(([0; 3], 0), |state| (state.unit.unwrap_or_default(), state.boot));
        self.pending.push(Entry {
            node: name.clone(),
            machine: machine.clone(),
            unit,
            boot,
            received_us,
            time_us,
            body,
        });
    }

    fn own_note(&mut self, wall_us: i64, kind: Note, detail: i64, text: &str) {
        let body = Body::Note { kind, detail, text: text.to_owned() };
        let machine = OWN_MACHINE.to_owned();
        let entry =
            Entry { node: String::new(), machine, unit: [0; 3], boot: 0, received_us: wall_us, time_us: wall_us, body };
        self.pending.push(entry);
    }

    /// Writes what is pending; what cannot be written is counted and lost.
    pub fn write(&mut self, wall_us: i64) {
        if self.pending.is_empty() {
            return;
        }
        if self.lost > 0 {
            self.own_note(wall_us, Note::EntriesLost, self.lost as i64, "the journal could not be written");
        }
        let count = self.pending.len() as u64;
        match self.journal.append(&self.pending) {
            Ok(()) => {
                if self.lost > 0 {
                    eprintln!("journal: written again, {} entries were lost", self.lost);
                }
                self.lost = 0;
            }
            Err(reason) => {
                let marker = u64::from(self.lost > 0);
                if self.lost == 0 {
                    eprintln!("journal: {reason}; frames are lost until there is room");
                }
                self.lost += count - marker;
                self.health.journal_lost.fetch_add(count - marker, Ordering::Relaxed);
            }
        }
        self.pending.clear();
        self.health.journal_next.store(self.journal.next(), Ordering::Relaxed);
    }

    /// Has the system write the journal down, keeps the nodes' states and gives back what all consumers have passed.
    ///
    /// # Errors
    /// Of the file system; the next call tries again.
    pub fn sync(&mut self, passed: u64, bytes: u64) -> Result {
        self.journal.sync()?;
        let folder = self.state_path.with_file_name("journal");
        // States are needed only for what the journal no longer holds.
        if segments(&folder)?.len() > 1 {
            let kept = Kept { before: self.journal.next(), nodes: self.states.clone() };
            let text = serde_json::to_vec(&kept).map_err(|e| crate::error::Error::new(self.state_path.display(), e))?;
            replace(&self.state_path, &text)?;
            self.journal.trim(passed, bytes)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use meshband::message::Identification;

    fn identification() -> Identification {
        Identification {
            wire_schema: 3,
            configuration_schema: 2,
            version: [0, 1, 0],
            build: Default::default(),
            board: Default::default(),
            unique_id: [1, 2, 3],
            ticks_per_second: 1_000_000,
            self_test: Default::default(),
            image: Default::default(),
        }
    }

    fn notes(data: &Path) -> Vec<(Note, i64)> {
        let entries = Reader::new(&data.join("journal"), 0).take(usize::MAX).expect("reads");
        let of = |entry: Entry| match entry.body {
            Body::Note { kind, detail, .. } => Some((kind, detail)),
            Body::Frame(_) => None,
        };
        entries.into_iter().filter_map(|(_, entry)| of(entry)).collect()
    }

    #[test]
    fn fault_a_wall_clock_that_is_set_is_noted_in_both_directions_and_disturbs_no_order() {
        let data = std::env::temp_dir().join(format!("meshband-clock-{}", std::process::id()));
        let _ = std::fs::remove_dir_all(&data);
        let node = Node { name: "n".into(), machine: "m".into(), port: "p".into(), unit: None };
        let mut intake = Intake::open(&data, &[node], 0, Arc::default()).expect("opens");
        let second = 1_000_000;
        // An hour forward, two hours back, and a drift of a millisecond per second, which is no jump.
        for (steady, wall) in [(0, 0), (1, 1), (2, 3602), (3, 3603), (4, -3596)] {
            let news = News::Online(Box::new(identification()));
            intake.take(Report { node: 0, wall_us: wall * second, steady_us: steady * second, news });
        }
        for step in 5..5000 {
            let (wall_us, steady_us) = (-3600 * second + step * (second + 1000), step * second);
            intake.take(Report { node: 0, wall_us, steady_us, news: News::Command("x".into()) });
        }
        intake.write(0);
        let jumps: Vec<i64> =
            notes(&data).iter().filter(|(kind, _)| *kind == Note::ClockJump).map(|(_, by)| *by).collect();
        assert_eq!(jumps, [3_600_000, -7_200_000]);
        assert_eq!(notes(&data).len(), 5 + 2 + 4995);
        let _ = std::fs::remove_dir_all(&data);
    }
}
