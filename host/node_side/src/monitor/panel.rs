//! What the live view adds to the state of the link ([`View`]): ages, trends, alarms that are over.
//!
//! Values that come in one message of several (FM0, NA4, measured bandwidth) are kept until their next, with their
//! own age.

use crate::link::Losses;
use crate::link::alarms::numbers;
use crate::link::view::{View, departures};
use meshband::events::Event;
use meshband::message::{Indicators, Message};
use std::collections::{BTreeMap, BTreeSet, VecDeque};

/// Values of a trend that are kept.
pub const TREND: usize = 240;
/// Events that are kept.
pub const EVENTS: usize = 200;
/// Silence from which on it is said, s: a node sends a status every half second at least.
pub const SILENT_S: f64 = 2.0;

/// A quantity over time.
#[derive(Debug, Clone, Default)]
pub struct Trend {
    values: VecDeque<f64>,
    /// Seconds since the start at which the newest came.
    pub at_s: f64,
}

impl Trend {
    /// Adds a value.
    pub fn push(&mut self, value: f64, now_s: f64) {
        if self.values.len() == TREND {
            self.values.pop_front();
        }
        self.values.push_back(value);
        self.at_s = now_s;
    }

    /// The newest value.
    pub fn last(&self) -> Option<f64> {
        self.values.back().copied()
    }

    /// The newest `count` values between 0 and `steps`, relative to their own range; a constant is in the middle.
    pub fn scaled(&self, count: usize, steps: u64) -> Vec<u64> {
        let newest: Vec<f64> = self.values.iter().rev().take(count).rev().copied().filter(|x| x.is_finite()).collect();
        let (low, high) = newest.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), &x| (l.min(x), h.max(x)));
        let of = |x: f64| if high > low { (x - low) / (high - low) } else { 0.5 };
        newest.iter().map(|&x| 1 + (of(x) * steps.saturating_sub(1) as f64).round() as u64).collect()
    }
}

/// Everything the screen shows.
#[derive(Debug, Clone, Default)]
pub struct Panel {
    /// The state of the link: newest of each message, who the node is, its alarms.
    pub view: View,
    /// Seconds since the start at which any message came last.
    pub heard_s: Option<f64>,
    /// Ages: when each kind came last.
    pub status_s: Option<f64>,
    /// When the newest mesh-band spectrum came.
    pub spectrum_s: Option<f64>,
    /// Named values with their trends, in the order of [`VALUES`].
    pub values: BTreeMap<&'static str, Trend>,
    /// First line of each mesh harmonic, by number.
    pub harmonics: BTreeMap<u8, Trend>,
    /// Alarms that are over, by index, with the seconds since the start at which they ended.
    pub over: BTreeMap<u8, f64>,
    /// Events, oldest first, with the seconds since the start at which they came.
    pub events: VecDeque<(f64, Event)>,
}

/// Values shown, in order, with their digits after the point.
pub const VALUES: [(&str, usize); 12] = [
    ("RMS, m/s2", 4),
    ("peak, m/s2", 3),
    ("crest factor", 2),
    ("kurtosis", 2),
    ("sideband ratio", 3),
    ("FM0", 3),
    ("FM4", 3),
    ("NA4", 3),
    ("residual RMS", 4),
    ("bandwidth, Hz", 0),
    ("measured / law", 3),
    ("departure, dB", 1),
];

impl Panel {
    /// Takes in a message at an instant.
    pub fn take(&mut self, message: Message, now_s: f64) {
        self.heard_s = Some(now_s);
        let before = self.standing();
        match &message {
            Message::Status(_) => self.status_s = Some(now_s),
            Message::Spectrum(spectrum) => {
                self.spectrum_s = Some(now_s);
                for band in &spectrum.bands {
                    let trend = self.harmonics.entry(band.harmonic).or_default();
                    trend.push(f64::from(band.line.amplitude), now_s);
                }
            }
            Message::Indicators(indicators) => self.indicators(indicators, now_s),
            Message::Event(event) => self.event(*event, now_s),
            _ => {}
        }
        self.view.take(message);
        let after = self.standing();
        self.over.retain(|index, _| !after.contains(index));
        self.over.extend(before.difference(&after).map(|&index| (index, now_s)));
    }

    fn standing(&self) -> BTreeSet<u8> {
        self.view.status.iter().flat_map(|status| numbers(&status.alarms)).collect()
    }

    fn indicators(&mut self, i: &Indicators, now_s: f64) {
        // What the node had nothing to make of is no value.
        let mut push = |name, value: f32| {
            if !value.is_nan() {
                self.values.entry(name).or_default().push(f64::from(value), now_s);
            }
        };
        push("RMS, m/s2", i.rms);
        push("peak, m/s2", i.peak);
        push("crest factor", i.crest);
        push("kurtosis", i.kurtosis);
        push("sideband ratio", i.sideband_energy_ratio);
        if let Some(gear) = &i.gear {
            push("FM0", gear.fm0);
            push("FM4", gear.fm4);
            push("NA4", gear.na4);
            push("residual RMS", gear.residual_rms);
        }
        if let Some(measured) = &i.bandwidth {
            push("bandwidth, Hz", measured.bandwidth_hz);
            push("measured / law", measured.bandwidth_hz / measured.law_hz);
        }
        if let Some(second) = &i.second {
            push("2nd RMS, m/s2", second.rms);
            push("2nd peak, m/s2", second.peak);
            push("2nd kurtosis", second.kurtosis);
            push("2nd velocity, mm/s", 1e3 * second.velocity_rms);
        }
        // Of the quantity that stands out most of its expectation.
        let largest = departures(i).map(|(_, departure)| departure);
        if let Some(departure) = largest.max_by(|a, b| a.normalised().total_cmp(&b.normalised())) {
            push("departure, dB", departure.departure_db);
        }
    }

    fn event(&mut self, event: Event, now_s: f64) {
        if self.events.len() == EVENTS {
            self.events.pop_front();
        }
        self.events.push_back((now_s, event));
    }

    /// Seconds since anything came, where that is long enough to be said.
    pub fn silent_s(&self, now_s: f64) -> Option<f64> {
        let silent = now_s - self.heard_s.unwrap_or(0.0);
        (silent >= SILENT_S).then_some(silent)
    }

    /// Whether losses or silence make the figures doubtful.
    pub fn is_doubtful(&self, losses: Losses, now_s: f64) -> bool {
        self.silent_s(now_s).is_some() || losses.lost + losses.refused > 0
    }
}
