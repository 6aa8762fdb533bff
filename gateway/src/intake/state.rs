//! What is known of each node between its frames: chip, starts, sequence, time base, and the newest frames themselves.
//!
//! A line server that repeats its last frames after a break (and a gateway that was killed between reading and
//! writing needs one) sends some twice. A frame counts as repeated when sequence and fingerprint are among the last
//! [`WINDOW`] taken. A sequence that goes back otherwise is a node that started anew; so is a status whose tick goes
//! back.
//!
//! The state is written beside the journal and brought up to date from the journal's own entries at a start, so that
//! it never contradicts what was written.

use super::time_base::TimeBase;
use crate::journal::entry::{Body, Entry, decode};
use meshband::frame::{Frame, Packet};
use meshband::message::{Identification, Message, Reply};
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

/// Frames that may be repeated after a break.
pub const WINDOW: usize = 512;

/// One node's state.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct NodeState {
    /// The chip's number; `None` until a node has answered.
    pub unit: Option<[u32; 3]>,
    /// Starts seen.
    pub boot: u32,
    /// Ticks per second of its time base.
    pub ticks_per_second: u32,
    /// Sequence expected next.
    expected: Option<u16>,
    /// Tick of the newest status.
    status_tick: u64,
    /// Its ticks as wall clock.
    #[serde(default)]
    base: TimeBase,
    /// Sequence and fingerprint of the newest frames.
    recent: VecDeque<(u16, u64)>,
    /// Alarms that stand and that no person has acknowledged, by the newest status.
    pub alarms: u32,
}

/// What a frame turned out to be.
#[derive(Clone, Debug, PartialEq)]
pub enum Verdict {
    /// Already taken.
    Repeated,
    /// New.
    New {
        /// Frames missing before it.
        lost: u16,
        /// The node started anew with or before it.
        restarted: bool,
        /// Wall clock of its content, microseconds.
        time_us: i64,
    },
}

impl NodeState {
    /// A node said who it is; gives the former chip's number where it is another one.
    pub fn identified(&mut self, identity: &Identification) -> Option<[u32; 3]> {
        let former = self.unit.filter(|&unit| unit != identity.unique_id);
        if self.unit != Some(identity.unique_id) {
            *self = Self { boot: self.boot + 1, unit: Some(identity.unique_id), ..Self::default() };
        }
        self.ticks_per_second = identity.ticks_per_second;
        former
    }

    /// Looks at a frame and remembers it.
    pub fn take(&mut self, bytes: &[u8], frame: &Frame, received_us: i64) -> Verdict {
        let mark = (frame.sequence, fingerprint(bytes));
        if self.recent.contains(&mark) {
            return Verdict::Repeated;
        }
        let ahead = self.expected.map_or(0, |expected| frame.sequence.wrapping_sub(expected));
        let back = ahead >= 1 << 15
            || matches!(&frame.packet, Packet::Message(Message::Status(s)) if s.tick < self.status_tick);
        let begun = frame.sequence == 0 && ahead != 0;
        let restarted = back || begun;
        if restarted {
            self.boot += 1;
            self.recent.clear();
            (self.base, self.status_tick) = (TimeBase::default(), 0);
        }
        self.remember(mark, frame);
        let time_us = self.time(&frame.packet, received_us);
        Verdict::New { lost: if restarted { 0 } else { ahead }, restarted, time_us }
    }

    fn remember(&mut self, mark: (u16, u64), frame: &Frame) {
        if self.recent.len() == WINDOW {
            self.recent.pop_front();
        }
        self.recent.push_back(mark);
        self.expected = Some(frame.sequence.wrapping_add(1));
        if let Packet::Message(Message::Status(status)) = &frame.packet {
            self.status_tick = status.tick;
            self.alarms = status.alarms.unseen.count_ones();
        }
    }

    /// Wall clock of a packet's content.
    fn time(&mut self, packet: &Packet, received_us: i64) -> i64 {
        let (Some(tick), 1..) = (tick(packet), self.ticks_per_second) else { return received_us };
        let since_us = (tick as f64 / f64::from(self.ticks_per_second) * 1e6) as i64;
        self.base.time(since_us, received_us)
    }

    /// The wall clock jumped: what was known of it no longer holds.
    pub fn forget_time(&mut self) {
        self.base = TimeBase::default();
    }

    /// Brings the state up to date with an entry that was written after the state.
    pub fn replay(&mut self, entry: &Entry) {
        if self.unit != Some(entry.unit) || self.boot != entry.boot {
            let kept = Self {
                unit: Some(entry.unit),
                boot: entry.boot,
                ticks_per_second: self.ticks_per_second,
                ..Self::default()
            };
            *self = kept;
        }
        match &entry.body {
            Body::Frame(bytes) => {
                let Some(frame) = decode(bytes) else { return };
                if let Packet::Reply(Reply::Identity(identity)) = &frame.packet {
                    self.ticks_per_second = identity.ticks_per_second;
                }
                self.remember((frame.sequence, fingerprint(bytes)), &frame);
            }
            Body::Note { .. } => {}
        }
    }
}

/// Tick of a packet's content, where it has one that belongs to its sending.
pub fn tick(packet: &Packet) -> Option<u64> {
    match packet {
        Packet::Message(Message::Status(status)) => Some(status.tick),
        Packet::Message(Message::Spectrum(spectrum)) => Some(spectrum.tag.first_tick),
        Packet::Message(Message::GearSpectrum(of)) => Some(of.spectrum.tag.first_tick),
        Packet::Message(Message::GearCondition(of)) => Some(of.indicators.tick),
        Packet::Message(Message::Peaks(peaks)) => Some(peaks.tag.first_tick),
        Packet::Message(Message::Indicators(indicators)) => Some(indicators.tag.first_tick),
        Packet::Message(Message::Snapshot(snapshot)) => Some(snapshot.tag.first_tick),
        Packet::Message(Message::Event(event)) => Some(event.last_tick),
        _ => None,
    }
}

/// Tells frames apart: FNV-1a. Not their CRC-32, nor another one of the whole frame: a frame ends with its own, and a
/// CRC of both is the same for all frames whose zeros lie alike.
pub fn fingerprint(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, &byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
}

/// A chip's number as text.
pub fn unit_text(unit: [u32; 3]) -> String {
    unit.map(|word| format!("{word:08x}")).concat()
}

#[cfg(test)]
mod tests {
    use super::*;
    use meshband::events::{Event, EventKind};
    use meshband::frame::{MAX_FRAME, encode};

    fn event(sequence: u16, detail: u32) -> (Vec<u8>, Frame) {
        let event = Event { kind: EventKind::Board, detail, first_tick: 1000, last_tick: 1000, count: 1 };
        let message = Message::Event(event);
        let mut buffer = [0; MAX_FRAME];
        let bytes = encode(&message, sequence, &mut buffer).expect("fits");
        let bytes = bytes[1..bytes.len() - 1].to_vec();
        let frame = decode(&bytes).expect("intact");
        (bytes, frame)
    }

    fn take(state: &mut NodeState, (bytes, frame): (Vec<u8>, Frame)) -> Verdict {
        state.take(&bytes, &frame, 5_000_000)
    }

    #[test]
    fn claim_repeats_are_known_gaps_counted_and_starts_seen() {
        let mut state = NodeState::default();
        let fresh = |lost, restarted| Verdict::New { lost, restarted, time_us: 5_000_000 };
        assert_eq!(take(&mut state, event(65_534, 1)), fresh(0, false));
        assert_eq!(take(&mut state, event(65_535, 2)), fresh(0, false));
        assert_eq!(take(&mut state, event(0, 3)), fresh(0, false), "the count goes round");
        assert_eq!(take(&mut state, event(65_535, 2)), Verdict::Repeated);
        assert_eq!(take(&mut state, event(4, 4)), fresh(3, false));
        let boot = state.boot;
        assert_eq!(take(&mut state, event(0, 9)), fresh(0, true), "another frame of a former number");
        assert_eq!(state.boot, boot + 1);
    }

    #[test]
    fn claim_a_state_replayed_from_the_journal_knows_the_same_repeats() {
        let (mut lived, mut replayed) = (NodeState::default(), NodeState::default());
        for sequence in 0..700 {
            let (bytes, frame) = event(sequence, u32::from(sequence));
            lived.take(&bytes, &frame, 0);
            let entry = Entry {
                node: "n".into(),
                machine: "m".into(),
                unit: [0; 3],
                boot: lived.boot,
                received_us: 0,
                time_us: 0,
                body: Body::Frame(bytes),
            };
            replayed.replay(&entry);
        }
        for sequence in 700 - WINDOW as u16..700 {
            assert_eq!(take(&mut replayed, event(sequence, u32::from(sequence))), Verdict::Repeated);
        }
        assert_eq!(take(&mut lived, event(700, 0)), take(&mut replayed, event(700, 0)));
    }

    #[test]
    fn claim_a_state_that_a_former_version_kept_is_read() {
        let text = r#"{"unit": [1, 2, 3], "boot": 3, "ticks_per_second": 1000, "expected": 5, "status_tick": 0,
            "zero_us": 17, "recent": [[4, 99]], "alarms": 0}"#;
        let state: NodeState = serde_json::from_str(text).expect("reads");
        assert_eq!((state.boot, state.expected, state.recent.len()), (3, Some(5), 1));
    }
}
