//! What a person sees of a node: the newest of everything it said, as plain text.

use super::Losses;
use super::words::words;
use crate::terminal::table;
use meshband::events::Event;
use meshband::message::{Indicators, Message, Peaks, SelfTest, Snapshot, Spectrum, Statistics, Status};
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
    ] {
        if set {
            notes.push(note);
        }
    }
    let notes = if notes.is_empty() { String::new() } else { format!("({})\n", notes.join("; ")) };
    format!(
        "{}   speed {:.4} Hz +- {:.1e} ({}, {:.2} s old)\nlaw {:.1} Hz   requested {:.1} Hz   granted {:.1} Hz   \
         ADC {:.1} Hz / 2^{}\n{notes}",
        words(&s.state),
        s.speed_hz,
        s.speed_uncertainty,
        words(&s.validity),
        s.age_s,
        s.bandwidth_hz,
        s.requested_hz,
        s.granted_hz,
        s.adc_hz,
        s.stages
    )
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
