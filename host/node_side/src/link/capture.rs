//! A waveform that a node holds: fetched, checked whole, and made a record.
//!
//! The node's memory is read by commands that name the byte, so a lost answer is asked for again by the client like
//! any other; nothing is accepted unless the checksum over all bytes is the node's. Only then may the node be told to
//! release it.
//!
//! The record has one channel in m/s^2 and the turns of the pinion as its tach (one pulse per turn), so order
//! tracking on the host stands on the same turns as the node's.

use super::Client;
use crate::record::{Acquisition, Declaration, Record, Run, RunDeclaration, Tach, suggested_full_scale};
use crate::{Error, Result};
use meshband::frame::CRC32;
use meshband::sample_ring::{BLOCK, BLOCK_BYTES, Coded, decode};
use meshband::waveform::{CaptureEnd, CaptureFacts, CaptureHead, CapturePhase, PART_BYTES, Trigger};
use std::path::PathBuf;
use std::time::{Duration, Instant};
use toml::{Table, Value};

/// Time between looks at a node that is still collecting.
const LOOK_EVERY: Duration = Duration::from_millis(200);
/// Fewest turns that a tach is declared for.
const FEWEST_TURNS: usize = 2;

/// A waveform that has arrived whole.
#[derive(Clone, Debug, PartialEq)]
pub struct Waveform {
    /// What the node says of it.
    pub facts: CaptureFacts,
    /// Samples, m/s^2.
    pub samples: Vec<f64>,
    /// Turns of the pinion, ticks from the first sample.
    pub marks: Vec<u32>,
}

/// Waits until the node holds a waveform, first asking for one where `trigger` says so.
///
/// # Errors
/// [`Error::Tool`] where the node keeps none or does not come to hold one within `patience`; those of the link.
pub fn await_held(client: &mut Client, trigger: bool, patience: Duration) -> Result<CaptureHead> {
    let deadline = Instant::now() + patience;
    let mut report = client.capture(false)?;
    if trigger && report.phase == CapturePhase::Watching {
        report = client.capture(true)?;
    }
    loop {
        match (report.phase, report.head) {
            (_, Some(head)) => return Ok(head),
            (CapturePhase::Off, _) => {
                return Err(Error::tool("node", "keeps no waveforms: `[capture] keep` of its settings is \"Off\""));
            }
            (CapturePhase::Watching, _) if !trigger => {
                return Err(Error::tool("node", "holds no waveform; --trigger asks for one"));
            }
            (phase, _) if Instant::now() >= deadline => {
                let seconds = patience.as_secs();
                return Err(Error::tool("node", format!("holds no waveform after {seconds} s ({phase:?})")));
            }
            _ => {}
        }
        let until = Instant::now() + LOOK_EVERY;
        client.listen(until)?;
        report = client.capture(false)?;
    }
}

/// Reads all bytes of a waveform and checks them.
///
/// # Errors
/// Those of the link, and bytes that are not those the node sealed.
pub fn fetch(client: &mut Client, head: &CaptureHead) -> Result<Waveform> {
    let mut bytes: Vec<u8> = Vec::with_capacity(head.bytes as usize);
    while bytes.len() < head.bytes as usize {
        let part = client.capture_part(head.facts.number, bytes.len() as u32)?;
        if part.bytes.is_empty() || part.bytes.len() > PART_BYTES {
            let what = format!("waveform {} is no longer held", head.facts.number);
            return Err(Error::tool("node", what));
        }
        bytes.extend_from_slice(&part.bytes);
    }
    Waveform::of_bytes(head, &bytes)
}

impl Waveform {
    /// The waveform that these bytes are.
    ///
    /// # Errors
    /// [`Error::Invalid`] where the checksum or the counts are not those of the head.
    pub fn of_bytes(head: &CaptureHead, bytes: &[u8]) -> Result<Self> {
        let facts = head.facts;
        let refuse = |what: &str| Error::invalid(format!("waveform {}", facts.number), what);
        if CRC32.checksum(bytes) != head.checksum {
            return Err(refuse("did not arrive as the node sealed it: its checksum is another one"));
        }
        let marks_end = 4 * usize::from(facts.marks);
        let blocks = (facts.samples as usize).div_ceil(BLOCK);
        if bytes.len() != marks_end + blocks * BLOCK_BYTES || facts.period_ticks == 0 || facts.ticks_per_second == 0 {
            return Err(refuse("has other counts than bytes"));
        }
        let (marks, coded) = bytes.split_at(marks_end);
        let marks =
            marks.chunks_exact(4).map(|mark| u32::from_le_bytes([mark[0], mark[1], mark[2], mark[3]])).collect();
        let of_block = |block: &[u8]| Coded::try_from(block).map(|block| decode(&block)).unwrap_or([0; BLOCK]);
        let scale = f64::from(facts.scale);
        let samples = coded.chunks_exact(BLOCK_BYTES).flat_map(of_block).map(|unit| f64::from(unit) * scale).collect();
        Ok(Self { facts, samples, marks })
    }

    /// Samples per second.
    pub fn rate_hz(&self) -> f64 {
        f64::from(self.facts.ticks_per_second) / f64::from(self.facts.period_ticks)
    }

    /// Length, s.
    pub fn duration_s(&self) -> f64 {
        self.samples.len() as f64 / self.rate_hz()
    }

    /// Instant of the trigger, s from the first sample.
    pub fn trigger_s(&self) -> f64 {
        (self.facts.trigger_tick as f64 - self.facts.first_tick as f64) / f64::from(self.facts.ticks_per_second)
    }

    /// What to say of it in a line.
    pub fn summary(&self) -> String {
        let facts = &self.facts;
        let cause = match facts.trigger {
            Trigger::Request => "asked for".to_owned(),
            Trigger::Alarm { index } => format!("by alarm {}", u16::from(index) + 1),
        };
        let mut text = format!(
            "waveform {}, {cause}: {} samples at {:.1} Hz, {:.3} s of which {:.3} s before the trigger, {} turns at \
             {:.3} Hz",
            facts.number,
            self.samples.len(),
            self.rate_hz(),
            self.duration_s(),
            self.trigger_s().clamp(0.0, self.duration_s()),
            self.marks.len(),
            facts.speed_hz
        );
        let faults = [
            (facts.overload, "clipped"),
            (!facts.marks_whole, "turns missing"),
            (facts.end == CaptureEnd::SamplesLost, "ended by lost samples"),
            (facts.end == CaptureEnd::RateChanged, "ended by a change of rate"),
            (facts.end == CaptureEnd::Commanded, "ended by a command"),
        ];
        for (is, fault) in faults {
            if is {
                text += &format!("; {fault}");
            }
        }
        text
    }

    /// The record that `meshband analyse` reads; `board` names the node.
    ///
    /// # Errors
    /// A waveform without samples.
    pub fn record(&self, board: &str) -> Result<Record> {
        let facts = &self.facts;
        let acquisition = Acquisition {
            sample_rate_hz: self.rate_hz(),
            channels: vec!["acceleration".into()],
            full_scale_m_s2: suggested_full_scale(std::slice::from_ref(&self.samples)),
            code_bits: 16,
            unit: None,
            other: Table::new(),
        };
        let clock = f64::from(facts.ticks_per_second);
        // Turns that miss one in between would be counted wrongly.
        let edges_s: Vec<f64> = self.marks.iter().map(|&mark| f64::from(mark) / clock).collect();
        let with_tach = facts.marks_whole && edges_s.len() >= FEWEST_TURNS;
        let tach = with_tach.then(|| Tach {
            shaft: "pinion".into(),
            turns_per_pinion_turn: None,
            pulses_per_rev: 1,
            jitter_s: None,
            source: Some("measured".into()),
            other: Table::new(),
        });
        let title = format!("waveform {} of {board}", facts.number);
        let mut declaration = Declaration::of_import(&title, Some(facts.teeth.map(u32::from)), acquisition, tach);
        declaration.rest.insert("capture".into(), Value::Table(self.table()));
        let run = RunDeclaration::numbered(0, with_tach, None);
        let edges_s = if with_tach { edges_s } else { Vec::new() };
        let run = Run::from_signals(run, &declaration.acquisition, std::slice::from_ref(&self.samples), edges_s)?;
        declaration.runs = vec![run.declaration.clone()];
        Ok(Record { folder: PathBuf::new(), declaration, runs: vec![run] })
    }

    /// The node's facts, for who reads the record's file.
    fn table(&self) -> Table {
        let facts = &self.facts;
        Table::from_iter([
            ("trigger".to_owned(), Value::String(format!("{:?}", facts.trigger))),
            ("trigger_s".to_owned(), Value::Float(self.trigger_s())),
            ("first_tick".to_owned(), Value::Integer(facts.first_tick as i64)),
            ("ticks_per_second".to_owned(), Value::Integer(facts.ticks_per_second.into())),
            ("period_ticks".to_owned(), Value::Integer(facts.period_ticks.into())),
            ("speed_hz".to_owned(), Value::Float(facts.speed_hz.into())),
            ("end".to_owned(), Value::String(format!("{:?}", facts.end))),
            ("overload".to_owned(), Value::Boolean(facts.overload)),
            ("turns_whole".to_owned(), Value::Boolean(facts.marks_whole)),
            ("configuration_crc32".to_owned(), Value::Integer(facts.configuration.into())),
        ])
    }
}
