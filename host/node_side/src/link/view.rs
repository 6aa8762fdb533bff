//! What is known of a node: the newest of everything it said. The live view, texts, reports and JSON show this and
//! nothing else.
//!
//! A status decides which alarms stand; an event of a later tick is taken into it until the next one. Time is the
//! node's own, so a capture that is replayed gives what was seen live.

use super::limit::Limit;
use meshband::config::TrainGear;
use meshband::events::{Event, EventKind};
use meshband::health::Health;
use meshband::levels::Departure;
use meshband::message::{
    GearIndicators, Identification, Indicators, Message, Peaks, Reply, SelfTest, Snapshot, Spectrum, Statistics, Status,
};
use std::collections::{BTreeMap, VecDeque};

/// Events shown.
const EVENTS: usize = 8;

/// Tick from which a node that begins at 0 of its timer counts: the timer's 32 bits are extended, and nothing lies
/// before its first.
pub const FIRST_TICK: u64 = 1 << 32;
/// Places for the ticks at which alarms were raised.
const ALARMS: usize = 8;

/// What is known of a further gear of a train.
#[derive(Clone, Debug, Default, serde::Serialize)]
pub struct FurtherGear {
    /// Its mesh bands.
    pub spectrum: Option<Spectrum>,
    /// Of its synchronous average.
    pub indicators: Option<GearIndicators>,
}

/// Newest messages of each kind, and the answers that say who the node is.
#[derive(Clone, Debug, Default, serde::Serialize)]
pub struct View {
    /// Messages received.
    pub messages: u64,
    /// Speed and rates.
    pub status: Option<Status>,
    /// Mesh bands.
    pub spectrum: Option<Spectrum>,
    /// Strongest lines.
    pub peaks: Option<Peaks>,
    /// Indicators.
    pub indicators: Option<Indicators>,
    /// Further gears of a train, by their number from 1.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub gears: BTreeMap<u8, FurtherGear>,
    /// Counters.
    pub statistics: Option<Statistics>,
    /// The node as a device, where it was asked.
    pub health: Option<Health>,
    /// Result of the latest self-test that ended while listening.
    pub self_test: Option<SelfTest>,
    /// Newest events, oldest first.
    pub events: VecDeque<Event>,
    /// The waveform that is arriving: samples so far and in all.
    pub snapshot: Option<(usize, usize)>,
    /// Who the node is, where it was asked.
    #[serde(skip)]
    pub identity: Option<Identification>,
    /// Its alarms' limits, where its configuration was read.
    #[serde(skip)]
    pub limits: Option<Vec<Limit>>,
    /// Further gears as configured, where its configuration was read.
    #[serde(skip)]
    pub train: Vec<TrainGear>,
    /// Ticks at which alarms were raised, where that was heard.
    #[serde(skip)]
    started_tick: Option<u64>,
    #[serde(skip)]
    raised_tick: [Option<u64>; ALARMS],
}

impl View {
    /// Takes in a message.
    pub fn take(&mut self, message: Message) {
        self.messages += 1;
        match message {
            Message::Status(status) => self.status(status),
            Message::Spectrum(spectrum) => self.spectrum = Some(spectrum),
            Message::Peaks(peaks) => self.peaks = Some(peaks),
            Message::Indicators(mut indicators) => {
                // These come in one message of several; the newest of each is kept, with the tick or rate it carries.
                let former = self.indicators.take();
                indicators.gear = indicators.gear.or(former.and_then(|i| i.gear));
                indicators.bandwidth = indicators.bandwidth.or(former.and_then(|i| i.bandwidth));
                self.indicators = Some(indicators);
            }
            Message::GearSpectrum(of) => self.gears.entry(of.gear).or_default().spectrum = Some(of.spectrum),
            Message::GearCondition(of) => self.gears.entry(of.gear).or_default().indicators = Some(of.indicators),
            Message::Statistics(statistics) => self.statistics = Some(statistics),
            Message::SelfTest(result) => self.self_test = Some(result),
            Message::Event(event) => {
                if event.kind == EventKind::Started {
                    self.started_tick = Some(event.first_tick);
                }
                self.alarm_event(&event);
                if self.events.len() == EVENTS {
                    self.events.pop_front();
                }
                self.events.push_back(event);
            }
            Message::Snapshot(Snapshot { offset, total, samples, .. }) => {
                self.snapshot = Some((usize::from(offset) + samples.len(), usize::from(total)));
            }
        }
    }

    /// Takes in an answer: who the node is, its alarms' limits, its health; others say nothing of the link.
    pub fn take_reply(&mut self, reply: Reply) {
        match reply {
            Reply::Identity(identity) => self.identity = Some(identity),
            Reply::Configuration(config) => {
                self.limits = Some(Limit::all(&config));
                if self.train != config.train.as_slice() {
                    self.gears.clear();
                }
                self.train = config.train.to_vec();
            }
            Reply::Health(health) => self.health = Some(health),
            Reply::SelfTest(result) => self.self_test = Some(result),
            Reply::Statistics(statistics) => self.statistics = Some(statistics),
            _ => {}
        }
    }

    fn status(&mut self, status: Status) {
        if self.status.is_some_and(|former| status.tick < former.tick) {
            // The node began anew: what it was heard to raise before is another run's.
            self.raised_tick = [None; ALARMS];
        }
        for (index, raised) in self.raised_tick.iter_mut().enumerate() {
            if status.alarms.standing >> index & 1 == 0 {
                *raised = None;
            }
        }
        self.status = Some(status);
    }

    /// What an event newer than the status says of alarms; a node repeats old ones on request.
    fn alarm_event(&mut self, event: &Event) {
        let Some(status) = self.status.as_mut().filter(|status| event.last_tick > status.tick) else { return };
        let index = event.detail as usize;
        let bit = 1u8.checked_shl(event.detail).unwrap_or(0);
        let alarms = &mut status.alarms;
        match event.kind {
            EventKind::AlarmRaised => {
                for bits in [&mut alarms.raised, &mut alarms.standing, &mut alarms.unseen] {
                    *bits |= bit;
                }
                if let Some(tick) = self.raised_tick.get_mut(index) {
                    *tick = Some(event.last_tick);
                }
            }
            // Said only when it stands no longer: a latched one is silent.
            EventKind::AlarmCleared => {
                for bits in [&mut alarms.raised, &mut alarms.standing, &mut alarms.unseen] {
                    *bits &= !bit;
                }
                if let Some(tick) = self.raised_tick.get_mut(index) {
                    *tick = None;
                }
            }
            EventKind::SignalBad => alarms.signal_bad = true,
            EventKind::SignalGood => alarms.signal_bad = false,
            EventKind::AlarmsAcknowledged => alarms.unseen = 0,
            _ => {}
        }
    }

    /// Seconds for which an alarm has stood at the newest status, where its beginning was heard.
    pub(super) fn raised_for_s(&self, index: u8) -> Option<f64> {
        let raised = (*self.raised_tick.get(usize::from(index))?)?;
        let rate = self.ticks_per_second()?;
        Some(self.status?.tick.saturating_sub(raised) as f64 / rate)
    }

    /// Seconds since the node's start, as its health counts them; the start's own event says where that was.
    pub fn since_start_s(&self, tick: u64) -> Option<f64> {
        let origin = self.started_tick.unwrap_or(0).max(FIRST_TICK);
        Some(tick.saturating_sub(origin) as f64 / self.ticks_per_second()?)
    }

    fn ticks_per_second(&self) -> Option<f64> {
        self.identity.as_ref().map(|node| f64::from(node.ticks_per_second)).filter(|&rate| rate > 0.0)
    }
}

/// The departures that are known, by name.
pub(crate) fn departures(values: &Indicators) -> impl Iterator<Item = (&'static str, Departure)> {
    let (all, local) = (&values.departures, &values.local_departures);
    let of = [
        ("RMS", all.rms),
        ("velocity", all.velocity_rms),
        ("first mesh harmonic", all.mesh_amplitude),
        ("residual", all.residual_rms),
        ("sidebands", local.sidebands),
        ("FM0", local.fm0),
    ];
    of.into_iter().filter_map(|(name, departure)| Some((name, departure?)))
}
