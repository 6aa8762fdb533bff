//! Entries of the journal as rows.

use super::schema::schema;
use crate::error::{Error, Result};
use crate::intake::state::unit_text;
use crate::journal::entry::{Body, Entry};
use crate::sparkplug::metrics::reply_kind;
use crate::values::{QUANTITIES, defects, figures, kind, lines};
use arrow_array::builder::{
    Float32Builder, Int16Builder, Int64Builder, ListBuilder, StringBuilder, TimestampMicrosecondBuilder, UInt16Builder,
    UInt32Builder, UInt64Builder,
};
use arrow_array::{ArrayRef, RecordBatch};
use meshband::frame::Packet;
use meshband::message::{Message, Snapshot};
use std::sync::Arc;

/// Columns being filled.
pub struct Rows {
    journal: UInt64Builder,
    received: TimestampMicrosecondBuilder,
    time: TimestampMicrosecondBuilder,
    node: StringBuilder,
    unit: StringBuilder,
    boot: UInt32Builder,
    sequence: UInt16Builder,
    kind: StringBuilder,
    state: StringBuilder,
    validity: StringBuilder,
    event: StringBuilder,
    detail: Int64Builder,
    count: UInt32Builder,
    text: StringBuilder,
    figures: Vec<Float32Builder>,
    line_origin: ListBuilder<StringBuilder>,
    line_hz: ListBuilder<Float32Builder>,
    line_amplitude: ListBuilder<Float32Builder>,
    waveform: ListBuilder<Int16Builder>,
    waveform_offset: UInt16Builder,
    waveform_total: UInt16Builder,
    waveform_scale: Float32Builder,
    quality: StringBuilder,
}

/// The cells of a row that only some kinds have.
#[derive(Default)]
struct Special<'a> {
    kind: &'static str,
    state: Option<String>,
    validity: Option<String>,
    event: Option<String>,
    detail: Option<i64>,
    count: Option<u32>,
    text: Option<&'a str>,
}

impl Default for Rows {
    fn default() -> Self {
        let instant = || TimestampMicrosecondBuilder::new().with_timezone("UTC");
        Self {
            journal: UInt64Builder::new(),
            received: instant(),
            time: instant(),
            node: StringBuilder::new(),
            unit: StringBuilder::new(),
            boot: UInt32Builder::new(),
            sequence: UInt16Builder::new(),
            kind: StringBuilder::new(),
            state: StringBuilder::new(),
            validity: StringBuilder::new(),
            event: StringBuilder::new(),
            detail: Int64Builder::new(),
            count: UInt32Builder::new(),
            text: StringBuilder::new(),
            figures: QUANTITIES.iter().map(|_| Float32Builder::new()).collect(),
            line_origin: ListBuilder::new(StringBuilder::new()),
            line_hz: ListBuilder::new(Float32Builder::new()),
            line_amplitude: ListBuilder::new(Float32Builder::new()),
            waveform: ListBuilder::new(Int16Builder::new()),
            waveform_offset: UInt16Builder::new(),
            waveform_total: UInt16Builder::new(),
            waveform_scale: Float32Builder::new(),
            quality: StringBuilder::new(),
        }
    }
}

impl Rows {
    /// Adds an entry.
    pub fn push(&mut self, number: u64, entry: &Entry) {
        self.journal.append_value(number);
        self.received.append_value(entry.received_us);
        self.time.append_value(entry.time_us);
        self.node.append_value(&entry.node);
        self.unit.append_value(unit_text(entry.unit));
        self.boot.append_value(entry.boot);
        let frame = entry.frame();
        self.sequence.append_option(frame.as_ref().map(|frame| frame.sequence));
        let packet = frame.as_ref().map(|frame| &frame.packet);
        let message = match packet {
            Some(Packet::Message(message)) => Some(message),
            _ => None,
        };
        self.special(&special(entry, packet));
        self.message(message);
    }

    fn special(&mut self, cells: &Special) {
        self.kind.append_value(cells.kind);
        self.state.append_option(cells.state.as_deref());
        self.validity.append_option(cells.validity.as_deref());
        self.event.append_option(cells.event.as_deref());
        self.detail.append_option(cells.detail);
        self.count.append_option(cells.count);
        self.text.append_option(cells.text);
    }

    fn message(&mut self, message: Option<&Message>) {
        let mut held = [None; QUANTITIES.len()];
        for (place, value) in message.map(figures).unwrap_or_default() {
            held[place] = Some(value);
        }
        self.figures.iter_mut().zip(held).for_each(|(column, value)| column.append_option(value));
        let lines = message.map(lines).unwrap_or_default();
        for line in &lines {
            self.line_origin.values().append_value(&line.origin);
            self.line_hz.values().append_value(line.frequency_hz);
            self.line_amplitude.values().append_value(line.amplitude);
        }
        self.line_origin.append(!lines.is_empty());
        self.line_hz.append(!lines.is_empty());
        self.line_amplitude.append(!lines.is_empty());
        let snapshot = match message {
            Some(Message::Snapshot(snapshot)) => Some(snapshot),
            _ => None,
        };
        self.snapshot(snapshot);
        self.quality.append_option(message.and_then(defects));
    }

    fn snapshot(&mut self, snapshot: Option<&Snapshot>) {
        if let Some(snapshot) = snapshot {
            self.waveform.values().append_slice(&snapshot.samples);
        }
        self.waveform.append(snapshot.is_some());
        self.waveform_offset.append_option(snapshot.map(|snapshot| snapshot.offset));
        self.waveform_total.append_option(snapshot.map(|snapshot| snapshot.total));
        self.waveform_scale.append_option(snapshot.map(|snapshot| snapshot.scale));
    }

    /// The rows as a batch, and none left.
    ///
    /// # Errors
    /// Where columns and schema differ, a defect of this file.
    pub fn finish(&mut self) -> Result<RecordBatch> {
        let mut columns: Vec<ArrayRef> = vec![
            Arc::new(self.journal.finish()),
            Arc::new(self.received.finish()),
            Arc::new(self.time.finish()),
            Arc::new(self.node.finish()),
            Arc::new(self.unit.finish()),
            Arc::new(self.boot.finish()),
            Arc::new(self.sequence.finish()),
            Arc::new(self.kind.finish()),
            Arc::new(self.state.finish()),
            Arc::new(self.validity.finish()),
            Arc::new(self.event.finish()),
            Arc::new(self.detail.finish()),
            Arc::new(self.count.finish()),
            Arc::new(self.text.finish()),
        ];
        columns.extend(self.figures.iter_mut().map(|column| Arc::new(column.finish()) as ArrayRef));
        columns.extend([
            Arc::new(self.line_origin.finish()) as ArrayRef,
            Arc::new(self.line_hz.finish()),
            Arc::new(self.line_amplitude.finish()),
            Arc::new(self.waveform.finish()),
            Arc::new(self.waveform_offset.finish()),
            Arc::new(self.waveform_total.finish()),
            Arc::new(self.waveform_scale.finish()),
            Arc::new(self.quality.finish()),
        ]);
        RecordBatch::try_new(schema(), columns).map_err(|reason| Error::new("history", reason))
    }
}

fn special<'a>(entry: &'a Entry, packet: Option<&Packet>) -> Special<'a> {
    match (&entry.body, packet) {
        (Body::Note { kind, detail, text }, _) => Special {
            kind: "note",
            event: Some(format!("{kind:?}")),
            detail: Some(*detail),
            text: Some(text),
            ..Special::default()
        },
        (_, Some(Packet::Message(message))) => of_message(message),
        (_, Some(Packet::Reply(reply))) => Special { kind: reply_kind(reply), ..Special::default() },
        _ => Special { kind: "unknown", ..Special::default() },
    }
}

fn of_message(message: &Message) -> Special<'static> {
    let plain = Special { kind: kind(message), ..Special::default() };
    match message {
        Message::Status(s) => {
            Special { state: Some(format!("{:?}", s.state)), validity: Some(format!("{:?}", s.validity)), ..plain }
        }
        Message::Event(e) => Special {
            event: Some(format!("{:?}", e.kind)),
            detail: Some(e.detail.into()),
            count: Some(e.count),
            ..plain
        },
        Message::Spectrum(s) => Special { validity: Some(format!("{:?}", s.tag.validity)), ..plain },
        Message::Peaks(p) => Special { validity: Some(format!("{:?}", p.tag.validity)), ..plain },
        Message::Indicators(i) => Special { validity: Some(format!("{:?}", i.tag.validity)), ..plain },
        Message::GearSpectrum(of) => Special {
            validity: Some(format!("{:?}", of.spectrum.tag.validity)),
            detail: Some(of.gear.into()),
            ..plain
        },
        Message::GearCondition(of) => Special { detail: Some(of.gear.into()), ..plain },
        Message::SelfTest(test) => Special { detail: Some(test.failed.into()), ..plain },
        Message::Snapshot(_) | Message::Statistics(_) => plain,
    }
}
