//! The frames of a capture as entries, with the notes that a gateway would have made of them.

use super::day;
use super::export::ExportArgs;
use crate::error::{Error, Result, at};
use crate::intake::state::{NodeState, Verdict, fingerprint, tick};
use crate::journal::entry::{Body, Entry, Note, decode};
use meshband::frame::{Frame, MAX_FRAME, Packet};
use meshband::message::{Identification, Reply};
use std::collections::VecDeque;
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::PathBuf;

/// Bytes at a capture's begin that tell it from others.
const BEGIN: u64 = 4096;

/// What a first reading finds.
pub struct Survey {
    /// Fingerprint of the first bytes.
    pub mark: u64,
    /// Who the node is.
    pub identity: Identification,
    /// Days in order, with their entries.
    pub days: Vec<(String, u64)>,
}

/// Reads a capture once: whose it is, and how many entries of which days it gives.
///
/// # Errors
/// Of the file, and where no node says who it is.
pub fn survey(args: &ExportArgs) -> Result<Survey> {
    let mut begin = Vec::new();
    let file = at(&args.capture, File::open(&args.capture))?;
    at(&args.capture, file.take(BEGIN).read_to_end(&mut begin))?;
    let identity = Pieces::open(&args.capture)?.find_map(|piece| match decode(&piece.ok()?)?.packet {
        Packet::Reply(Reply::Identity(identity)) => Some(identity),
        _ => None,
    });
    let identity = identity.ok_or_else(|| Error::new(args.capture.display(), "no node says in it who it is"))?;
    let mut days: Vec<(String, u64)> = Vec::new();
    for entry in Entries::open(args, &identity)? {
        let of = day::of(entry?.received_us);
        match days.last_mut() {
            Some((day, count)) if *day == of => *count += 1,
            _ => days.push((of, 1)),
        }
    }
    Ok(Survey { mark: fingerprint(&begin), identity, days })
}

/// Bytes between delimiters.
struct Pieces {
    file: BufReader<File>,
    path: PathBuf,
}

impl Pieces {
    fn open(path: &std::path::Path) -> Result<Self> {
        Ok(Self { file: BufReader::new(at(path, File::open(path))?), path: path.to_owned() })
    }
}

impl Iterator for Pieces {
    type Item = Result<Vec<u8>>;

    fn next(&mut self) -> Option<Self::Item> {
        let mut piece = Vec::new();
        while piece.is_empty() {
            // Longer than any frame is rubbish; it is read in portions, so that memory stays bounded.
            let read = self.file.by_ref().take(2 * MAX_FRAME as u64).read_until(0, &mut piece);
            match at(&self.path, read) {
                Ok(0) => return None,
                Ok(_) => drop(piece.pop_if(|byte| *byte == 0)),
                Err(reason) => return Some(Err(reason)),
            }
        }
        Some(Ok(piece))
    }
}

/// Entries in order of reception.
pub struct Entries {
    pieces: Pieces,
    node: String,
    machine: String,
    state: NodeState,
    /// Wall clock at tick zero of the node's present start, once a frame has had ticks.
    zero_us: Option<i64>,
    /// Wall clock of the newest frame.
    now_us: i64,
    ready: VecDeque<Entry>,
}

impl Entries {
    /// Begins a capture.
    ///
    /// # Errors
    /// Of the file.
    pub fn open(args: &ExportArgs, identity: &Identification) -> Result<Self> {
        let mut state = NodeState::default();
        state.identified(identity);
        Ok(Self {
            pieces: Pieces::open(&args.capture)?,
            node: args.node.clone(),
            machine: args.machine.clone(),
            state,
            zero_us: None,
            now_us: args.from * 1_000_000,
            ready: VecDeque::new(),
        })
    }

    fn take(&mut self, bytes: Vec<u8>, frame: &Frame) {
        if let Packet::Reply(Reply::Identity(identity)) = &frame.packet
            && self.state.identified(identity).is_some()
        {
            self.zero_us = None;
            self.note(Note::Replaced, 0);
        }
        let before = self.zero_us;
        let received_us = self.advance(frame);
        match self.state.take(&bytes, frame, received_us) {
            Verdict::Repeated => self.zero_us = before,
            Verdict::New { lost, restarted, time_us } => {
                if restarted {
                    // Its ticks begin anew at the present instant.
                    self.zero_us = None;
                    self.now_us = self.advance(frame);
                    self.note(Note::Restarted, self.state.boot.into());
                } else {
                    self.now_us = received_us;
                }
                if lost > 0 {
                    self.note(Note::FramesLost, lost.into());
                }
                self.push(time_us, Body::Frame(bytes));
            }
        }
    }

    /// Wall clock at which a frame came: by its ticks, never before the frame in front of it.
    fn advance(&mut self, frame: &Frame) -> i64 {
        let (Some(tick), 1..) = (tick(&frame.packet), self.state.ticks_per_second) else { return self.now_us };
        let since = (tick as f64 / f64::from(self.state.ticks_per_second) * 1e6) as i64;
        let zero = *self.zero_us.get_or_insert(self.now_us - since);
        self.now_us.max(zero + since)
    }

    fn note(&mut self, kind: Note, detail: i64) {
        self.push(self.now_us, Body::Note { kind, detail, text: String::new() });
    }

    fn push(&mut self, time_us: i64, body: Body) {
        self.ready.push_back(Entry {
            node: self.node.clone(),
            machine: self.machine.clone(),
            unit: self.state.unit.unwrap_or_default(),
            boot: self.state.boot,
            received_us: self.now_us,
            time_us,
            body,
        });
    }
}

impl Iterator for Entries {
    type Item = Result<Entry>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            if let Some(entry) = self.ready.pop_front() {
                return Some(Ok(entry));
            }
            match self.pieces.next()? {
                Ok(bytes) => {
                    if let Some(frame) = decode(&bytes) {
                        self.take(bytes, &frame);
                    }
                }
                Err(reason) => return Some(Err(reason)),
            }
        }
    }
}
