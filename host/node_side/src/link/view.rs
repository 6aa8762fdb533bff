//! What is known of a node: the newest of everything it said. The live view, texts, reports and JSON show this and
//! nothing else.
//!
//! A status decides which alarms stand; an event of a later tick is taken into it until the next one. Time is the
//! node's own, so a capture that is replayed gives what was seen live.

use super::Losses;
use super::alarms::Alarms;
use super::words::words;
use crate::terminal::table;
use meshband::alarm::AlarmBand;
use meshband::events::{Event, EventKind};
use meshband::health::Health;
use meshband::levels::Departure;
use meshband::message::{
    Bound, ChannelValues, Identification, Indicators, Message, Peaks, Quality, Reply, SelfTest, Snapshot, Spectrum,
    Statistics, Status,
};
use meshband::watch::reason;
use meshband::waveform::CapturePhase;
use std::collections::VecDeque;

/// Events shown.
const EVENTS: usize = 8;

/// Tick from which a node that begins at 0 of its timer counts: the timer's 32 bits are extended, and nothing lies
/// before its first.
pub const FIRST_TICK: u64 = 1 << 32;
/// Places for the ticks at which alarms were raised.
const ALARMS: usize = 8;

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
    /// Its alarm bands, where its configuration was read.
    #[serde(skip)]
    pub bands: Option<Vec<AlarmBand>>,
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
            Reply::Configuration(config) => self.bands = Some(config.alarms.to_vec()),
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

    /// For `--json`: the same whether heard live or replayed.
    pub fn json(&self, losses: Losses) -> serde_json::Value {
        let alarms = Alarms::of(self);
        serde_json::json!({ "identity": self.identity, "alarms": alarms, "view": self, "losses": losses })
    }

    /// The picture as text.
    pub fn text(&self, losses: Losses) -> String {
        let mut out = match &self.status {
            Some(s) => status_lines(s),
            None => "no status yet\n".to_owned(),
        };
        Alarms::of(self).lines().iter().for_each(|line| out += &format!("{line}\n"));
        if let Some(text) = self.status.and_then(|status| capture_text(status.capture)) {
            out += &format!("{text}\n");
        }
        if let Some(i) = &self.indicators {
            out += &format!(
                "RMS {:.4} m/s2   peak {:.4} m/s2   crest {:.2}   kurtosis {:.2}   sideband ratio {:.3}\n",
                i.rms, i.peak, i.crest, i.kurtosis, i.sideband_energy_ratio
            );
            if let Some(gear) = &i.gear {
                out += &format!(
                    "FM0 {:.3}   FM4 {:.3}   NA4 {:.3}   residual {:.4} m/s2\n",
                    gear.fm0, gear.fm4, gear.na4, gear.residual_rms
                );
            }
            out += &overall(i);
        }
        if let Some(health) = self.health.as_ref().map(super::health::short).filter(|text| !text.is_empty()) {
            out += &format!("device {health}\n");
        }
        if let Some(spectrum) = &self.spectrum {
            out += &format!("\nmesh bands, {:.3} Hz per line\n{}", spectrum.tag.resolution_hz, bands(spectrum));
        }
        if let Some(peaks) = &self.peaks {
            let lines: Vec<String> =
                peaks.lines.iter().take(6).map(|l| format!("{:.1} Hz {:.4}", l.frequency_hz, l.amplitude)).collect();
            out += &format!("\nstrongest lines (m/s2): {}\n", lines.join(", "));
        }
        if let Some((have, total)) = self.snapshot {
            out += &format!("snapshot: {have} of {total} samples\n");
        }
        if !self.events.is_empty() {
            out += "\nevents\n";
        }
        for e in &self.events {
            let time = self
                .since_start_s(e.first_tick)
                .map_or_else(|| format!("tick {}", e.first_tick), |seconds| format!("{seconds:10.3} s"));
            out += &format!("{time}  {}  x{}\n", super::words::event(e), e.count);
        }
        let also = [(losses.unread, "messages not read in time"), (losses.reopened, "times the link was opened again")];
        let also = also.iter().filter(|(count, _)| *count > 0).map(|(count, what)| format!(", {count} {what}"));
        out += &format!(
            "\n{} messages; {} frames lost, {} pieces refused, {} restarts of the node{}\n",
            self.messages,
            losses.lost,
            losses.refused,
            losses.restarts,
            also.collect::<String>()
        );
        if losses.unknown > 0 {
            out += &format!("{} messages of kinds that only a newer program knows\n", losses.unknown);
        }
        out
    }
}

/// What is to be known about the figures of a status.
pub fn status_notes(s: &Status) -> Vec<&'static str> {
    let all = [
        (s.law_clamped, "speed outside the law's domain"),
        (s.law_provisional, "law provisional"),
        (s.limited, "rate limited by the board"),
        (s.safe_rate, "no speed: safe maximum rate"),
        (s.bound == Bound::AnalogueFilter, "the analogue filter passes less than the law asks"),
        (s.bound == Bound::Sensor, "the sensor passes less than the law asks"),
    ];
    all.into_iter().filter_map(|(set, note)| set.then_some(note)).collect()
}

fn status_lines(s: &Status) -> String {
    let notes = status_notes(s);
    let notes = if notes.is_empty() { String::new() } else { format!("({})\n", notes.join("; ")) };
    format!(
        "{}   speed {:.4} Hz +- {:.1e} ({}, {:.2} s old)\nlaw {:.1} Hz of which {:.1} Hz there   requested {:.1} \
         Hz   granted {:.1} Hz   \
         ADC {:.1} Hz / 2^{}\n{notes}{}",
        words(&s.state),
        s.speed_hz,
        s.speed_uncertainty,
        words(&s.validity),
        s.age_s,
        s.bandwidth_hz,
        s.available_hz,
        s.requested_hz,
        s.granted_hz,
        s.adc_hz,
        s.stages,
        sensor_line(s)
    )
}

/// Velocity, orders of both shafts, and what all values rest on.
fn overall(i: &Indicators) -> String {
    let [from, to] = i.velocity_band_hz;
    let mut out = format!(
        "velocity {:.3} mm/s RMS, {from:.0} Hz to {to:.0} Hz   ({})\n",
        1e3 * i.velocity_rms,
        quality_text(&i.quality)
    );
    for (shaft, orders) in [("pinion", &i.pinion), ("gear", &i.wheel)] {
        let Some(orders) = orders else { continue };
        let lines: Vec<String> = (1..)
            .zip(&orders.lines)
            .map(|(order, line)| format!("{order}x {:.4} m/s2 at {:.0} deg", line.amplitude, line.phase_deg))
            .collect();
        out += &format!("{shaft} {} ({} turns)\n", lines.join("   "), orders.turns);
    }
    out + &second_line(i.second.as_ref()) + &departure_line(i)
}

/// Values of the second sensor; empty without one.
pub fn second_line(second: Option<&ChannelValues>) -> String {
    let Some(s) = second else { return String::new() };
    format!(
        "second sensor RMS {:.4} m/s2   peak {:.4} m/s2   crest {:.2}   kurtosis {:.2}   velocity {:.3} mm/s   ({})\n",
        s.rms,
        s.peak,
        s.crest,
        s.kurtosis,
        1e3 * s.velocity_rms,
        quality_text(&s.quality)
    )
}

/// What is expected and how far from it the values are; empty without a table of levels or outside it.
pub fn departure_line(values: &Indicators) -> String {
    let part = |(name, d): (&str, Departure)| format!("{name} {:+.1} dB (+- {:.1})", d.departure_db, d.uncertainty_db);
    let parts: Vec<String> = departures(values).map(part).collect();
    if parts.is_empty() { String::new() } else { format!("against the expected levels: {}\n", parts.join("   ")) }
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

/// What a value rests on, in words.
pub fn quality_text(quality: &Quality) -> String {
    let mut text = match quality.turns {
        0 => format!("{:.2} s by the clock: no speed", quality.duration_s),
        turns => format!("{turns} whole turns in {:.2} s", quality.duration_s),
    };
    let faults = [
        (quality.overload, "clipped"),
        (quality.gap, "samples missing"),
        (quality.settling, "filters settling"),
        (quality.stuck, "signal does not move"),
    ];
    for (is, fault) in faults {
        if is {
            text += &format!("; {fault}");
        }
    }
    text
}

/// What is to be said of waveforms.
pub fn capture_text(phase: CapturePhase) -> Option<&'static str> {
    match phase {
        CapturePhase::Off | CapturePhase::Watching => None,
        CapturePhase::Collecting | CapturePhase::Sealing => Some("a waveform is being taken"),
        CapturePhase::Held => Some("a WAVEFORM IS HELD: `meshband capture` fetches it"),
    }
}

/// Why a sensor is not in order, in words; what was, where nothing is wrong any more.
pub fn sensor_text(reasons: u16) -> String {
    let words = [
        (reason::CLIPPED, "clipped"),
        (reason::STILL, "does not move"),
        (reason::SECOND_CLIPPED, "second sensor clipped"),
        (reason::SECOND_STILL, "second sensor does not move"),
        (reason::BIAS, "bias out of its band"),
        (reason::MEAN, "mean out of its band"),
        (reason::FLOOR, "too quiet for a shaft that turns"),
        (reason::FAR_BELOW, "far below what is expected"),
        (reason::BLIND, "nothing to judge limits by"),
    ];
    let of: Vec<&str> = words.into_iter().filter(|(bit, _)| reasons & bit != 0).map(|(_, word)| word).collect();
    if of.is_empty() { "latched".to_owned() } else { of.join(", ") }
}

/// What the node says of its own sensor, if that is not in order.
fn sensor_line(status: &Status) -> String {
    let sensor = status.sensor;
    if sensor.standing { format!("sensor not in order: {}\n", sensor_text(sensor.reasons)) } else { String::new() }
}

fn bands(spectrum: &Spectrum) -> String {
    table(&["harmonic", "Hz", "m/s2", "sideband Hz", "m/s2"], &band_rows(spectrum))
}

/// Per mesh harmonic: its line and the strongest sideband.
pub fn band_rows(spectrum: &Spectrum) -> Vec<Vec<String>> {
    spectrum
        .bands
        .iter()
        .map(|band| {
            let strongest = band.sidebands.iter().max_by(|a, b| a.amplitude.total_cmp(&b.amplitude));
            vec![
                band.harmonic.to_string(),
                format!("{:.3}", band.line.frequency_hz),
                format!("{:.5}", band.line.amplitude),
                strongest.map_or(String::new(), |l| format!("{:.3}", l.frequency_hz)),
                strongest.map_or(String::new(), |l| format!("{:.5}", l.amplitude)),
            ]
        })
        .collect()
}
