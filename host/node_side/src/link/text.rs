//! What is known of a node as text and as JSON, alarms included.
//!
//! Beside [`view`](super::view), which knows nothing of words: alarms are read from a view.

use super::Losses;
use super::alarms::Alarms;
use super::view::{View, band_rows, capture_text, departure_line, quality_text, second_line, status_notes};
use super::words::words;
use crate::terminal::table;
use meshband::message::{Indicators, Spectrum, Status};

impl View {
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

fn status_lines(s: &Status) -> String {
    let notes = status_notes(s);
    let notes = if notes.is_empty() { String::new() } else { format!("({})\n", notes.join("; ")) };
    format!(
        "{}   speed {:.4} Hz +- {:.1e} ({}, {:.2} s old)\nlaw {:.1} Hz of which {:.1} Hz there   requested {:.1} \
         Hz   granted {:.1} Hz   \
         ADC {:.1} Hz / 2^{}\n{notes}",
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
        s.stages
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

fn bands(spectrum: &Spectrum) -> String {
    table(&["harmonic", "Hz", "m/s2", "sideband Hz", "m/s2"], &band_rows(spectrum))
}
