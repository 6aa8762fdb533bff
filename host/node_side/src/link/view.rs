//! What a person sees of a node: the newest of everything it said, as plain text.

use super::Losses;
use super::words::words;
use crate::terminal::table;
use meshband::events::Event;
use meshband::health::Health;
use meshband::levels::Departure;
use meshband::message::{
    Bound, ChannelValues, Indicators, Message, Peaks, Quality, SelfTest, Snapshot, Spectrum, Statistics,
    Status,
};
use meshband::watch::reason;
use meshband::waveform::CapturePhase;
use std::collections::VecDeque;

/// Events shown.
const EVENTS: usize = 8;

/// Newest messages of each kind.
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
}

impl View {
    /// Takes in a message.
    pub fn take(&mut self, message: Message) {
        self.messages += 1;
        match message {
            Message::Status(status) => self.status = Some(status),
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

    /// The picture as text; `ticks_per_second` of the node's time base, where known, turns event times into seconds.
    pub fn text(&self, losses: Losses, ticks_per_second: Option<u32>) -> String {
        let mut out = match &self.status {
            Some(s) => status_lines(s),
            None => "no status yet\n".to_owned(),
        };
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
            let time = match ticks_per_second {
                Some(rate) => format!("{:10.3} s", e.first_tick as f64 / f64::from(rate)),
                None => format!("tick {}", e.first_tick),
            };
            out += &format!("{time}  {} {}  x{}\n", words(&e.kind), e.detail, e.count);
        }
        out += &format!(
            "\n{} messages; {} frames lost, {} pieces refused, {} restarts of the node{}\n",
            self.messages,
            losses.lost,
            losses.refused,
            losses.restarts,
            if losses.unread > 0 { format!(", {} messages not read in time", losses.unread) } else { String::new() }
        );
        if losses.unknown > 0 {
            out += &format!("{} messages of kinds that only a newer program knows\n", losses.unknown);
        }
        out
    }
}

fn status_lines(s: &Status) -> String {
    let mut notes = Vec::new();
    for (set, note) in [
        (s.law_clamped, "speed outside the law's domain"),
        (s.law_provisional, "law provisional"),
        (s.limited, "rate limited by the board"),
        (s.safe_rate, "no speed: safe maximum rate"),
        (s.bound == Bound::AnalogueFilter, "the analogue filter passes less than the law asks"),
        (s.bound == Bound::Sensor, "the sensor passes less than the law asks"),
    ] {
        if set {
            notes.push(note);
        }
    }
    let notes = if notes.is_empty() { String::new() } else { format!("({})\n", notes.join("; ")) };
    format!(
        "{}   speed {:.4} Hz +- {:.1e} ({}, {:.2} s old)\nlaw {:.1} Hz of which {:.1} Hz there   requested {:.1} Hz   granted {:.1} Hz   \
         ADC {:.1} Hz / 2^{}\n{notes}{}{}",
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
        alarm_line(s),
        capture_text(s.capture).map_or(String::new(), |text| format!("{text}\n"))
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

/// Alarms by their number in the configuration.
fn alarm_line(status: &Status) -> String {
    let (alarms, sensor) = (&status.alarms, status.sensor);
    let numbers = |bits: u8| {
        let of: Vec<String> = (0..8).filter(|n| bits >> n & 1 != 0).map(|n| n.to_string()).collect();
        of.join(", ")
    };
    let mut parts = Vec::new();
    if alarms.raised != 0 {
        parts.push(format!("raised: {}", numbers(alarms.raised)));
    }
    if alarms.standing & !alarms.raised != 0 {
        parts.push(format!("latched: {}", numbers(alarms.standing & !alarms.raised)));
    }
    let alerts = alarms.standing & status.alerts;
    if alerts != 0 {
        parts.push(format!("of these alerts only: {}", numbers(alerts)));
    }
    if sensor.standing {
        parts.push(format!("sensor not in order: {}", sensor_text(sensor.reasons)));
    }
    if parts.is_empty() { String::new() } else { format!("ALARM ({})\n", parts.join("; ")) }
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
