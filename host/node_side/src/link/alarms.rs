//! Alarms in words: what stands, on what, for how long; the same sentences in the view, in reports, in texts and in
//! JSON.
//!
//! The node's status decides; events that are newer than it are taken in by [`View`] until the next one. Alarms are
//! numbered from 1, as the registers of a PLC have them; the settings' list begins with number 1, too. Before the first
//! status nothing is said of them.

use super::limit::{beyond, call};
use super::view::View;
use super::words::name_and_unit;
use meshband::alarm::{Severity, Side, Watched};
use meshband::message::AlarmState;
use serde::Serialize;

/// Bits of an [`AlarmState`].
const ALARM_BITS: u8 = 8;

/// All alarms of a node as far as they are known.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Alarms {
    /// Whether a status has come.
    pub known: bool,
    /// How many are configured, where the configuration has been read.
    pub configured: Option<usize>,
    /// The sensor is not in order, or was not and nobody has acknowledged that.
    pub signal_bad: bool,
    /// Those that stand, by number.
    pub standing: Vec<Standing>,
}

/// An alarm that stands.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Standing {
    /// Its place in the settings, from 1.
    pub number: u8,
    /// Quantity, where the configuration has been read.
    pub what: Option<&'static str>,
    /// Unit of value and limit; empty for a plain number.
    pub unit: &'static str,
    /// Gear of a train that it is of: 0 the pinion, and whatever is of no gear.
    #[serde(skip_serializing_if = "is_pinion")]
    pub gear: u8,
    /// Newest value.
    pub value: Option<f32>,
    /// Value beyond which it is raised.
    pub limit: Option<f32>,
    /// Which side of the limit is wrong, where the configuration has been read.
    pub side: Option<Side>,
    /// What it asks for, likewise.
    pub severity: Option<Severity>,
    /// The value is beyond the limit now; else it was, and nobody has acknowledged it.
    pub raised: bool,
    /// A person has seen it.
    pub acknowledged: bool,
    /// Seconds since it was raised, by the node's clock, where that was heard.
    pub for_s: Option<f64>,
}

fn is_pinion(gear: &u8) -> bool {
    *gear == 0
}

impl Alarms {
    /// As a view knows them.
    pub fn of(view: &View) -> Self {
        let configured = view.limits.as_ref().map(Vec::len);
        let Some(status) = &view.status else {
            return Self { known: false, configured, signal_bad: false, standing: Vec::new() };
        };
        let bits = status.alarms;
        let standing = numbers(&bits).map(|index| standing(view, &bits, index)).collect();
        Self { known: true, configured, signal_bad: bits.signal_bad, standing }
    }

    /// Whether one stands, or the signal is bad.
    pub fn any(&self) -> bool {
        self.signal_bad || !self.standing.is_empty()
    }

    /// One line for each that stands, else one that says why there is none.
    pub fn lines(&self) -> Vec<String> {
        if !self.known {
            return vec!["alarms not known yet: no status has come".into()];
        }
        let mut lines: Vec<String> = self.standing.iter().map(Standing::line).collect();
        if self.signal_bad {
            lines.push("ALARM of the sensor: clipped, still, or its bias or level is not that of a sound one".into());
        }
        if lines.is_empty() {
            lines.push(match self.configured {
                Some(0) => "no alarm (none is configured)".into(),
                Some(_) => "no alarm".into(),
                None => "no alarm (which are configured is not known)".into(),
            });
        }
        lines
    }
}

impl Standing {
    /// The alarm as a sentence.
    pub fn line(&self) -> String {
        let (call, number) = (call(self.severity.unwrap_or_default()), self.number);
        let Some((what, limit)) = self.what.zip(self.limit) else {
            let state = if self.raised { "raised" } else { "latched" };
            return format!("{call} {number}: {state}{}; its limit is not known here{}", self.since(), self.seen());
        };
        let what = if self.gear == 0 { what.to_owned() } else { format!("{what} of gear {}", self.gear) };
        let beyond = beyond(self.side.unwrap_or_default(), limit, self.unit);
        let unit = if self.unit.is_empty() { String::new() } else { format!(" {}", self.unit) };
        let value = self.value.filter(|value| value.is_finite()).map(|value| format!(" {}", figures(value)));
        if self.raised {
            let value = value.map_or(String::new(), |value| format!("{value}{unit}"));
            format!("{call} {number}: {what}{value} {beyond}{}{}", self.since(), self.seen())
        } else {
            let now = value.map_or(String::new(), |value| format!(", now{value}{unit}"));
            format!("{call} {number}: {what} was {beyond}{now}; latched until acknowledged{}", self.since())
        }
    }

    fn since(&self) -> String {
        self.for_s.map_or(String::new(), |age| format!(", for {}", super::words::seconds(age)))
    }

    fn seen(&self) -> &'static str {
        if self.acknowledged { ", acknowledged" } else { "" }
    }
}

/// Three digits that count.
fn figures(value: f32) -> String {
    let digits = if value == 0.0 { 0 } else { (2 - value.abs().log10().floor() as i32).clamp(0, 6) };
    format!("{value:.*}", digits as usize)
}

/// Indices of those that stand, ascending.
pub fn numbers(bits: &AlarmState) -> impl Iterator<Item = u8> + use<> {
    let set = bits.standing | bits.raised;
    (0..ALARM_BITS).filter(move |index| set >> index & 1 != 0)
}

fn standing(view: &View, bits: &AlarmState, index: u8) -> Standing {
    let set = |bits: u8| bits >> index & 1 != 0;
    let limit = view.limits.as_ref().and_then(|limits| limits.get(usize::from(index)));
    let (what, unit) = limit.map_or((None, ""), |limit| {
        let (name, unit) = name_and_unit(limit.band.watched);
        (Some(name), unit)
    });
    Standing {
        number: index + 1,
        what,
        unit,
        value: limit.and_then(|limit| match limit.gear {
            0 => value(view, limit.band.watched),
            gear => value_of_gear(view, gear, limit.band.watched),
        }),
        gear: limit.map_or(0, |limit| limit.gear),
        limit: limit.map(|limit| limit.band.raise),
        side: limit.map(|limit| limit.mode.side),
        severity: limit.map(|limit| limit.mode.severity),
        raised: set(bits.raised),
        acknowledged: !set(bits.unseen),
        for_s: view.raised_for_s(index),
    }
}

/// The newest value of a further gear of a train; none of what is no gear's.
fn value_of_gear(view: &View, gear: u8, watched: Watched) -> Option<f32> {
    let of = view.gears.get(&gear)?;
    match watched {
        Watched::Fm0 => of.indicators.map(|gear| gear.fm0),
        Watched::Fm4 => of.indicators.map(|gear| gear.fm4),
        Watched::MeshAmplitude => of.spectrum.as_ref()?.bands.first().map(|band| band.line.amplitude),
        _ => None,
    }
}

/// The newest value of what an alarm watches, in the alarm's unit.
fn value(view: &View, watched: Watched) -> Option<f32> {
    let values = view.indicators.as_ref();
    let second = values.and_then(|values| values.second);
    let gear = values.and_then(|values| values.gear);
    match watched {
        Watched::Rms => values.map(|values| values.rms),
        Watched::Peak => values.map(|values| values.peak),
        Watched::Crest => values.map(|values| values.crest),
        Watched::Kurtosis => values.map(|values| values.kurtosis),
        Watched::Fm0 => gear.map(|gear| gear.fm0),
        Watched::Fm4 => gear.map(|gear| gear.fm4),
        Watched::SidebandEnergyRatio => values.map(|values| values.sideband_energy_ratio),
        Watched::MeshAmplitude => {
            let first = view.spectrum.as_ref()?.bands.iter().find(|band| band.harmonic == 1)?;
            Some(first.line.amplitude)
        }
        Watched::BandwidthRatio => values?.bandwidth.map(|measured| measured.bandwidth_hz / measured.law_hz),
        Watched::VelocityRms => values.map(|values| values.velocity_rms),
        Watched::OncePerTurn => values?.pinion.and_then(|orders| orders.lines.first().map(|line| line.amplitude)),
        Watched::Departure => {
            let largest = super::view::departures(values?).map(|(_, departure)| departure.normalised());
            largest.max_by(f32::total_cmp)
        }
        Watched::SecondRms => second.map(|second| second.rms),
        Watched::SecondPeak => second.map(|second| second.peak),
        Watched::SecondCrest => second.map(|second| second.crest),
        Watched::SecondKurtosis => second.map(|second| second.kurtosis),
        Watched::SecondVelocityRms => second.map(|second| second.velocity_rms),
    }
}
