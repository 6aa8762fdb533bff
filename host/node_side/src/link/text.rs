//! What is known of a node in words, alarms included, and as JSON.
//!
//! [`view`](super::view) keeps what is known, [`alarms`](super::alarms) reads it; both are put in words here.

use super::Losses;
use super::alarms::Alarms;
use super::view::{FurtherGear, View, departures};
use super::words::words;
use crate::terminal::table;
use meshband::levels::Departure;
use meshband::message::{Bound, ChannelValues, Identification, Indicators, Quality, Spectrum, Status};
use meshband::update::{RunningImage, Slot};
use meshband::watch::reason;
use meshband::waveform::CapturePhase;

/// A sideband below this share of its harmonic (-34 dB) is the search's own noise more often than not.
pub const SIDE_SHARE: f32 = 0.02;

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
                    "FM0 {:.3}   FM4 {:.3}   NA4 {}   residual {:.4} m/s2\n",
                    gear.fm0,
                    gear.fm4,
                    figure(gear.na4, 3),
                    gear.residual_rms
                );
            }
            out += &overall(i);
        }
        for (&number, gear) in &self.gears {
            out += &format!("{}\n", gear_line(self, number, gear));
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

/// A further gear of a train in one line.
pub fn gear_line(view: &View, number: u8, gear: &FurtherGear) -> String {
    let mut out = gear_name(view, number);
    if let Some(spectrum) = &gear.spectrum {
        let mesh = spectrum.bands.first().map_or(f32::NAN, |band| band.line.amplitude);
        out += &format!("   {:.3} Hz   mesh 1 {} m/s2", spectrum.tag.speed_hz, figure(mesh, 4));
    }
    if let Some(of) = &gear.indicators {
        let residual = figure(of.residual_rms, 4);
        out += &format!("   FM0 {:.3}   FM4 {:.3}   residual {residual} m/s2", of.fm0, of.fm4);
    }
    out
}

/// A further gear of a train by its number from 1, with stage and teeth where the configuration was read.
fn gear_name(view: &View, number: u8) -> String {
    let configured = usize::from(number).checked_sub(1).and_then(|place| view.train.get(place));
    let of = configured.map_or_else(String::new, |gear| format!(" (stage {}, {} teeth)", gear.stage, gear.teeth));
    format!("gear {number} of the train{of}")
}

/// A value in so many digits; a dash for one that the node had nothing to make of.
pub fn figure(value: f32, digits: usize) -> String {
    if value.is_nan() { "-".to_owned() } else { format!("{value:.digits$}") }
}

/// Velocity, orders of both shafts, and what all values rest on.
fn overall(i: &Indicators) -> String {
    let [from, to] = i.velocity_band_hz;
    let mut out = format!(
        "velocity {} mm/s RMS, {from:.0} Hz to {to:.0} Hz   ({})\n",
        figure(1e3 * i.velocity_rms, 3),
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

/// Why a sensor is not in order, in words; what was, where nothing is wrong any more.
pub fn sensor_text(reasons: u16) -> String {
    let words = [
        (reason::CLIPPING, "clipped"),
        (reason::STANDSTILL, "does not move"),
        (reason::SECOND_CLIPPING, "second sensor clipped"),
        (reason::SECOND_STANDSTILL, "second sensor does not move"),
        (reason::BIAS, "bias out of its band"),
        (reason::MEAN, "mean out of its band"),
        (reason::FLOOR, "too quiet for a shaft that turns"),
        (reason::LEVEL_DROP, "far below what is expected"),
        (reason::BLINDNESS, "nothing to judge limits by"),
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

/// Which node it is, in one line.
pub fn identity(node: &Identification) -> String {
    let [major, minor, patch] = node.version;
    let [a, b, c] = node.unique_id;
    let chip = if node.unique_id == [0; 3] { String::new() } else { format!(", chip {a:08x}{b:08x}{c:08x}") };
    format!(
        "{} with firmware {major}.{minor}.{patch} ({}){chip}{}; schemas: link {}, configuration {}",
        node.board,
        node.build,
        image(&node.image),
        node.wire_schema,
        node.configuration_schema
    )
}

/// Which image runs and why, where the board has slots.
fn image(image: &RunningImage) -> String {
    if image.slot == Slot::None {
        return String::new();
    }
    let given_up = image.given_up.map(|[major, minor, patch]| format!(", {major}.{minor}.{patch} given up"));
    let (standing, started) = (words(&image.standing), words(&image.started));
    format!(", slot {:?} {standing}{}, started by {started}", image.slot, given_up.unwrap_or_default())
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

/// Values of the second sensor; empty without one.
pub fn second_line(second: Option<&ChannelValues>) -> String {
    let Some(s) = second else { return String::new() };
    format!(
        "second sensor RMS {:.4} m/s2   peak {:.4} m/s2   crest {:.2}   kurtosis {:.2}   velocity {} mm/s   ({})\n",
        s.rms,
        s.peak,
        s.crest,
        s.kurtosis,
        figure(1e3 * s.velocity_rms, 3),
        quality_text(&s.quality)
    )
}

/// What is expected and how far from it the values are; empty without a table of levels or outside it.
pub fn departure_line(values: &Indicators) -> String {
    let part = |(name, d): (&str, Departure)| format!("{name} {:+.1} dB (+- {:.1})", d.departure_db, d.uncertainty_db);
    let parts: Vec<String> = departures(values).map(part).collect();
    if parts.is_empty() { String::new() } else { format!("against the expected levels: {}\n", parts.join("   ")) }
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

/// Per mesh harmonic: its line and the strongest sideband.
pub fn band_rows(spectrum: &Spectrum) -> Vec<Vec<String>> {
    spectrum
        .bands
        .iter()
        .map(|band| {
            let strongest = band.sidebands.iter().max_by(|a, b| a.amplitude.total_cmp(&b.amplitude));
            let strongest = strongest.filter(|side| side.amplitude >= SIDE_SHARE * band.line.amplitude);
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
