//! A node as a Sparkplug device: which metrics it has, and what an entry of the journal changes of them.
//!
//! A device's metrics are places in one list; its aliases are those places in a block of numbers of its own. Each data
//! message carries `Frame/Journal`, the entry's number: what a broker delivers twice (a session that broke between
//! message and acknowledgement) has the same number twice.

use super::payload::{Metric, Quality, Value, datatype, properties};
use crate::intake::state::unit_text;
use crate::journal::entry::{Body, Entry, Note};
use crate::values::{QUANTITIES, defects, figures};
use meshband::frame::Packet;
use meshband::message::{Message, Reply};
use meshband::tach::Validity;
use std::collections::BTreeMap;

/// Aliases of a device: no two metrics of the edge node have one number.
const BLOCK: u64 = 256;
/// Metrics of a device.
const PLACES: usize = OTHERS.len() + QUANTITIES.len();
// The next device's aliases begin behind the block.
const _: () = assert!(PLACES as u64 <= BLOCK);

/// Metrics that are no figures; their places come before those of the figures.
const OTHERS: [(&str, u32); 21] = [
    ("Frame/Journal", datatype::UINT64),
    ("Frame/Sequence", datatype::INT32),
    ("Frame/Boot", datatype::INT32),
    ("Frame/Kind", datatype::STRING),
    ("Node/Unit", datatype::STRING),
    ("Node/Firmware", datatype::STRING),
    ("Node/Machine", datatype::STRING),
    ("Node/State", datatype::STRING),
    ("Speed/Validity", datatype::STRING),
    ("Event/Kind", datatype::STRING),
    ("Event/Detail", datatype::INT64),
    ("Event/Count", datatype::INT64),
    ("Alarm/Unacknowledged", datatype::INT32),
    ("Waveform/Samples", datatype::BYTES),
    ("Waveform/Scale", datatype::FLOAT),
    ("Waveform/Offset", datatype::INT32),
    ("Command/Start", datatype::BOOLEAN),
    ("Command/Stop", datatype::BOOLEAN),
    ("Command/Snapshot", datatype::BOOLEAN),
    ("Command/Acknowledge", datatype::BOOLEAN),
    ("Command/Configure", datatype::STRING),
];

/// Name, type and unit of a metric by its place.
fn metric(place: usize) -> Option<(&'static str, u32, &'static str)> {
    OTHERS.get(place).map(|(name, kind)| (*name, *kind, "")).or_else(|| {
        let quantity = QUANTITIES.get(place - OTHERS.len())?;
        Some((quantity.metric, datatype::FLOAT, quantity.unit))
    })
}

/// Place of a metric that is no figure.
fn place(name: &str) -> usize {
    OTHERS.iter().position(|(other, _)| *other == name).unwrap_or(PLACES)
}

/// All devices of the edge node.
#[derive(Clone, Debug, Default)]
pub struct Devices(BTreeMap<String, Device>);

impl Devices {
    /// The devices of the configuration, in its order.
    pub fn of<'a>(names: impl IntoIterator<Item = &'a str>) -> Self {
        let mut devices = Self::default();
        for name in names {
            devices.device(name);
        }
        devices
    }

    /// A device by its name. A new one has the next block of aliases, for as long as the gateway runs: none is taken
    /// out, so a rebirth gives every metric the alias it had.
    pub fn device(&mut self, name: &str) -> &mut Device {
        let index = self.0.len() as u64;
        self.0.entry(name.to_owned()).or_insert_with(|| Device::new(index * BLOCK))
    }

    /// Name of the metric that has this alias, where it is one of this device.
    pub fn metric_name(&self, device: &str, alias: u64) -> Option<&'static str> {
        let place = alias.checked_sub(self.0.get(device)?.first)?;
        metric(usize::try_from(place).ok()?).map(|(name, ..)| name)
    }

    /// Names of all devices that were born in this session and did not die since.
    pub fn born(&self) -> Vec<String> {
        self.0.iter().filter(|(_, device)| device.born).map(|(name, _)| name.clone()).collect()
    }

    /// A session begins: none was born in it.
    pub fn unborn(&mut self) {
        self.0.values_mut().for_each(|device| device.born = false);
    }
}

/// A device as the broker last heard of it.
#[derive(Clone, Debug)]
pub struct Device {
    /// Alias of its first metric.
    first: u64,
    values: Vec<Option<Value>>,
    quality: Quality,
    /// A birth was sent in this session and no death since.
    pub born: bool,
}

impl Device {
    fn new(first: u64) -> Self {
        let mut values = vec![None; PLACES];
        for (place, (name, _)) in OTHERS.iter().enumerate() {
            if name.starts_with("Command/") {
                values[place] =
                    Some(if *name == "Command/Configure" { Value::Text(String::new()) } else { Value::Boolean(false) });
            }
        }
        Self { first, values, quality: Quality::Stale, born: false }
    }

    /// All metrics with what is known of them, for a birth.
    pub fn birth(&self, now_ms: u64) -> Vec<Metric> {
        (0..)
            .zip(&self.values)
            .filter_map(|(place, value)| {
                let (name, kind, unit) = metric(place)?;
                Some(Metric {
                    name: Some(name.to_owned()),
                    alias: Some(self.first + place as u64),
                    timestamp: Some(now_ms),
                    datatype: Some(kind),
                    is_historical: None,
                    is_null: value.is_none().then_some(true),
                    properties: Some(properties(unit, if value.is_some() { self.quality } else { Quality::Stale })),
                    value: value.clone(),
                })
            })
            .collect()
    }

    /// Takes an entry in; gives the metrics it changes, for a data message.
    pub fn take(&mut self, number: u64, entry: &Entry, historical: bool) -> Vec<Metric> {
        let mut changes =
            vec![(place("Frame/Journal"), Value::Long(number)), (place("Frame/Boot"), Value::Int(entry.boot))];
        let mut set = |name: &str, value: Value| changes.push((place(name), value));
        match &entry.body {
            Body::Note { kind, detail, text } => {
                set("Frame/Kind", Value::Text("note".to_owned()));
                set("Event/Kind", Value::Text(format!("{kind:?}")));
                set("Event/Detail", Value::Long(*detail as u64));
                if *kind == Note::Connected {
                    set("Node/Firmware", Value::Text(text.clone()));
                    set("Node/Unit", Value::Text(unit_text(entry.unit)));
                    set("Node/Machine", Value::Text(entry.machine.clone()));
                }
            }
            Body::Frame(_) => self.frame(entry, &mut changes),
        }
        self.keep(&changes);
        let stamp = u64::try_from(entry.time_us / 1000).ok();
        let quality = if defective(entry) { Quality::Bad } else { self.quality };
        let metric = |(place, value)| self.data(place, value, stamp, historical, quality);
        changes.into_iter().map(metric).collect()
    }

    fn frame(&mut self, entry: &Entry, changes: &mut Vec<(usize, Value)>) {
        let Some(frame) = entry.frame() else { return };
        let mut set = |name: &str, value: Value| changes.push((place(name), value));
        set("Frame/Sequence", Value::Int(frame.sequence.into()));
        let message = match &frame.packet {
            Packet::Message(message) => message,
            Packet::Reply(reply) => return set("Frame/Kind", Value::Text(reply_kind(reply).to_owned())),
            Packet::Request(_) => return,
        };
        set("Frame/Kind", Value::Text(crate::values::kind(message).to_owned()));
        match message {
            Message::Status(status) => {
                set("Node/State", Value::Text(format!("{:?}", status.state)));
                set("Speed/Validity", Value::Text(format!("{:?}", status.validity)));
                set("Alarm/Unacknowledged", Value::Int(status.alarms.unseen.count_ones()));
                self.quality = if status.validity == Validity::Locked { Quality::Good } else { Quality::Bad };
            }
            Message::Event(event) => {
                set("Event/Kind", Value::Text(format!("{:?}", event.kind)));
                set("Event/Detail", Value::Long(event.detail.into()));
                set("Event/Count", Value::Long(event.count.into()));
            }
            Message::Snapshot(snapshot) => {
                let samples = snapshot.samples.iter().flat_map(|sample| sample.to_le_bytes()).collect();
                set("Waveform/Samples", Value::Bytes(samples));
                set("Waveform/Scale", Value::Float(snapshot.scale));
                set("Waveform/Offset", Value::Int(snapshot.offset.into()));
            }
            _ => {}
        }
        changes.extend(figures(message).into_iter().map(|(place, value)| (OTHERS.len() + place, Value::Float(value))));
    }

    fn keep(&mut self, changes: &[(usize, Value)]) {
        for (place, value) in changes {
            if let Some(held) = self.values.get_mut(*place) {
                *held = Some(value.clone());
            }
        }
    }

    /// A metric of a data message.
    fn data(&self, place: usize, value: Value, stamp: Option<u64>, historical: bool, quality: Quality) -> Metric {
        let (_, kind, _) = metric(place).unwrap_or(("", 0, ""));
        Metric {
            name: None,
            alias: Some(self.first + place as u64),
            timestamp: stamp,
            datatype: Some(kind),
            is_historical: historical.then_some(true),
            is_null: None,
            // The unit was said at birth; quality changes.
            properties: (kind == datatype::FLOAT).then(|| properties("", quality)),
            value: Some(value),
        }
    }
}

/// Whether the node itself says that its values say nothing of the machine: clipped, with gaps, unsettled or still.
fn defective(entry: &Entry) -> bool {
    match entry.frame().map(|frame| frame.packet) {
        Some(Packet::Message(message)) => defects(&message).is_some(),
        _ => false,
    }
}

/// What kind of answer a frame carries.
pub fn reply_kind(reply: &Reply) -> &'static str {
    match reply {
        Reply::Identity(_) => "identity",
        Reply::Configuration(_) => "configuration",
        Reply::Law(_) => "law",
        Reply::Statistics(_) => "statistics",
        Reply::SelfTest(_) => "self_test",
        Reply::Health(_) => "health",
        Reply::Done | Reply::Committing => "done",
        Reply::Refused(_) => "refused",
        Reply::Update(_) => "update",
        Reply::Capture(_) | Reply::CapturePart(_) => "capture",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use meshband::message::{AlarmState, Indicators};

    #[test]
    fn claim_every_metric_has_one_alias_and_one_name() {
        let names: std::collections::BTreeSet<_> = (0..).map_while(metric).map(|(name, ..)| name).collect();
        assert_eq!(names.len(), PLACES);
        assert_eq!(Device::new(0).birth(0).len(), names.len());
    }

    /// The entry of a message.
    fn entry(message: &Message) -> Entry {
        let mut buffer = [0; meshband::frame::MAX_FRAME];
        let frame = meshband::frame::encode(message, 1, &mut buffer).expect("fits");
        let body = Body::Frame(frame[1..frame.len() - 1].to_vec());
        let (node, machine) = ("n".to_owned(), "m".to_owned());
        Entry { node, machine, unit: [1; 3], boot: 1, received_us: 0, time_us: 0, body }
    }

    fn status(unseen: u8) -> Entry {
        let mut status = crate::synthesise::status(1, 10.0);
        status.alarms = AlarmState { unseen, ..AlarmState::default() };
        entry(&Message::Status(status))
    }

    #[test]
    fn claim_values_that_say_nothing_are_bad_and_the_next_ones_are_not() {
        let overload = |overload| {
            let quality = meshband::message::Quality { overload, ..Default::default() };
            entry(&Message::Indicators(Indicators { quality, ..Indicators::default() }))
        };
        let mut device = Device::new(0);
        device.take(0, &status(0), false);
        let mut quality_of = |entry: &Entry| {
            let rms =
                device.take(1, entry, false).into_iter().find(|metric| metric.alias == Some(alias_of("Vibration/RMS")));
            rms.and_then(|metric| metric.properties)
        };
        assert_eq!(quality_of(&overload(true)), Some(properties("", Quality::Bad)));
        assert_eq!(quality_of(&overload(false)), Some(properties("", Quality::Good)));
    }

    #[test]
    fn claim_alarms_are_those_of_the_newest_status() {
        let mut device = Device::new(0);
        for (unseen, count) in [(0b101, 2), (0, 0)] {
            let metrics = device.take(1, &status(unseen), false);
            let alarms = metrics.iter().find(|metric| metric.alias == Some(alias_of("Alarm/Unacknowledged")));
            assert_eq!(alarms.and_then(|metric| metric.value.clone()), Some(Value::Int(count)));
        }
    }

    fn alias_of(name: &str) -> u64 {
        (0..PLACES).find(|&place| metric(place).is_some_and(|(other, ..)| other == name)).expect("of that name") as u64
    }
}
