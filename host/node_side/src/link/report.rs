//! What a node said, and how it is configured, as reports for people.

use super::Losses;
use super::text::{band_rows, figure, identity, quality_text};
use super::view::View;
use super::words::words;
use crate::Result;
use crate::report::Report;
use crate::report::plot::{self, Axes, Series};
use meshband::config::Configuration;
use meshband::events::Event;
use meshband::health::Health;
use meshband::message::{Identification, SelfTest, Spectrum, Status};
use serde_json::Value;

/// Items of the boot self-test, by bit.
const ITEMS: [&str; 5] = [
    "samples against the timer",
    "converter off its rails",
    "converter moves",
    "tach pulses",
    "results of the signal chain",
];

/// The self-test's outcome in words.
pub fn self_test(test: SelfTest) -> String {
    let named = |bits: u8| {
        let set = (0..ITEMS.len()).filter(|n| bits >> n & 1 != 0).map(|n| ITEMS[n]);
        set.collect::<Vec<_>>().join(", ")
    };
    match (test.run, test.failed) {
        (0, _) => "self-test not run".to_owned(),
        (run, 0) if run.count_ones() as usize == ITEMS.len() => "self-test passed".to_owned(),
        (run, 0) => format!("self-test passed so far ({})", named(run)),
        (_, failed) => format!("self-test FAILED: {}", named(failed)),
    }
}

/// The report of `meshband monitor`.
///
/// # Errors
/// A picture that cannot be drawn.
pub fn of_view(view: &View, losses: Losses, source: &str) -> Result<Report> {
    let node = view.identity.as_ref();
    let mut report = Report::new("Node", &format!("What the node at {source} said"))
        .verdict(super::letter::of_view(view, losses, source))
        .facts(super::letter::facts(view, source))
        .figure("Messages", view.messages)
        .figure("Frames lost", losses.lost)
        .figure("Pieces refused", losses.refused)
        .figure("Restarts", losses.restarts);
    if let Some(status) = &view.status {
        report = report.figure("State", words(&status.state)).figure("Speed", format!("{:.4} Hz", status.speed_hz));
    }
    if let Some(node) = node {
        let test = view.self_test.unwrap_or(node.self_test);
        report = report.figure("Node", identity(node)).figure("Self-test", self_test(test));
    }
    report = match &view.status {
        Some(status) => {
            report.section("Speed and rates").table("The newest status.", &["quantity", "value"], &status_rows(status))
        }
        None => report.note("No status came."),
    };
    if let Some(spectrum) = &view.spectrum {
        report = report
            .section("Mesh bands")
            .picture(&bands(spectrum)?, "Mesh harmonics and the sidebands of both shafts, newest spectrum.")
            .table(
                &format!("{} turns, {:.3} Hz per line.", spectrum.turns, spectrum.tag.resolution_hz),
                &["harmonic", "Hz", "m/s2", "strongest sideband, Hz", "m/s2"],
                &band_rows(spectrum),
            );
    }
    if let Some(i) = &view.indicators {
        let mut rows = vec![
            row("RMS, m/s2", format!("{:.5}", i.rms)),
            row("peak, m/s2", format!("{:.5}", i.peak)),
            row("crest factor", format!("{:.3}", i.crest)),
            row("kurtosis", format!("{:.3}", i.kurtosis)),
            row("sideband energy ratio", format!("{:.4}", i.sideband_energy_ratio)),
            row("velocity RMS, mm/s", figure(1e3 * i.velocity_rms, 4)),
            row("all of these from", quality_text(&i.quality)),
        ];
        for (shaft, orders) in [("pinion", &i.pinion), ("gear", &i.wheel)] {
            for (order, line) in (1..).zip(orders.iter().flat_map(|orders| orders.lines)) {
                let value = format!("{:.4} at {:.1}", line.amplitude, line.phase_deg);
                rows.push(row(&format!("{order}x of the {shaft}, m/s2 at degrees"), value));
            }
        }
        if let Some(second) = &i.second {
            rows.push(row("second sensor: RMS, m/s2", format!("{:.5}", second.rms)));
            rows.push(row("second sensor: peak, m/s2", format!("{:.5}", second.peak)));
            rows.push(row("second sensor: crest factor", format!("{:.3}", second.crest)));
            rows.push(row("second sensor: kurtosis", format!("{:.3}", second.kurtosis)));
            rows.push(row("second sensor: velocity RMS, mm/s", figure(1e3 * second.velocity_rms, 4)));
            rows.push(row("second sensor: bias, code of 65536", format!("{:.0}", second.mean_code)));
            rows.push(row("second sensor: all of these from", quality_text(&second.quality)));
        }
        if let Some(gear) = &i.gear {
            rows.push(row("FM0", format!("{:.4}", gear.fm0)));
            rows.push(row("FM4", format!("{:.4}", gear.fm4)));
            rows.push(row("NA4", figure(gear.na4, 4)));
        }
        if let Some(measured) = &i.bandwidth {
            let both = format!("{:.0} against {:.0}", measured.bandwidth_hz, measured.law_hz);
            rows.push(row("bandwidth measured against law, Hz", both));
        }
        for (name, departure) in super::view::departures(i) {
            let value =
                format!("{:+.1} (standard uncertainty {:.1})", departure.departure_db, departure.uncertainty_db);
            rows.push(row(&format!("{name} over its expected level, dB"), value));
        }
        report = report.section("Indicators").table("The newest of each.", &["indicator", "value"], &rows);
    }
    if let Some(health) = &view.health {
        report = report.section("Health").table(
            "The node as a device.",
            &["quantity", "value"],
            &super::health::rows(health),
        );
    }
    if !view.events.is_empty() {
        let time = |tick: u64| view.since_start_s(tick).map_or(format!("tick {tick}"), |s| format!("{s:.3} s"));
        let event = |e: &Event| vec![time(e.first_tick), super::words::event(e), e.count.to_string()];
        let rows: Vec<Vec<String>> = view.events.iter().map(event).collect();
        report = report.section("Events").table("The newest.", &["since start", "event", "times"], &rows);
    }
    Ok(report)
}

/// The report of `meshband health`.
pub fn of_health(health: &Health, node: &Identification, source: &str) -> Report {
    Report::new("Device", &format!("The node at {source} as a device"))
        .figure("Node", identity(node))
        .section("Health")
        .table("As the node gave it.", &["quantity", "value"], &super::health::rows(health))
}

/// The report of `meshband configure`.
pub fn of_configuration(config: &Configuration, node: &Identification, stored: bool, source: &str) -> Report {
    Report::new("Configuration", &format!("In force on the node at {source}"))
        .figure("Node", identity(node))
        .figure("Time base", format!("{} Hz", node.ticks_per_second))
        .figure("Self-test", self_test(node.self_test))
        .figure("Stored", if stored { "yes" } else { "no: until the next power-up" })
        .section("Settings")
        .table("As the node gave them back.", &["key", "value"], &settings_rows(config))
}

/// Every setting as a row of key and value.
pub fn settings_rows(config: &Configuration) -> Vec<Vec<String>> {
    let mut rows = Vec::new();
    flatten(&shortest_digits(serde_json::to_value(config).unwrap_or_default()), "", &mut rows);
    rows
}

/// Numbers of single precision with as many digits as they have.
pub fn shortest_digits(value: Value) -> Value {
    match value {
        Value::Number(number) if number.is_f64() => {
            let shortest = number.as_f64().and_then(|x| format!("{}", x as f32).parse::<f64>().ok());
            shortest.and_then(serde_json::Number::from_f64).map_or(Value::Number(number), Value::Number)
        }
        Value::Array(items) => Value::Array(items.into_iter().map(shortest_digits).collect()),
        Value::Object(entries) => {
            Value::Object(entries.into_iter().map(|(key, value)| (key, shortest_digits(value))).collect())
        }
        other => other,
    }
}

fn row(name: &str, value: String) -> Vec<String> {
    vec![name.into(), value]
}

fn status_rows(s: &Status) -> Vec<Vec<String>> {
    vec![
        row("validity of the speed", words(&s.validity)),
        row("speed of the pinion, Hz", format!("{:.5}", s.speed_hz)),
        row("law's bandwidth, Hz", format!("{:.1}", s.bandwidth_hz)),
        row("rate requested, Hz", format!("{:.1}", s.requested_hz)),
        row("rate granted, Hz", format!("{:.1}", s.granted_hz)),
        row("converter, Hz", format!("{:.1}", s.adc_hz)),
    ]
}

fn bands(spectrum: &Spectrum) -> Result<String> {
    let point = |line: &meshband::message::SpectralLine| (f64::from(line.frequency_hz), f64::from(line.amplitude));
    let all = |of: fn(&meshband::message::MeshBand) -> Vec<meshband::message::SpectralLine>| {
        let lines = spectrum.bands.iter().flat_map(of);
        lines.filter(|line| line.amplitude > 0.0).map(|line| point(&line)).collect::<Vec<_>>()
    };
    let series = [
        Series::new("mesh harmonics", all(|band| vec![band.line])),
        Series::new("pinion's sidebands", all(|band| band.sidebands.to_vec())),
        Series::new("gear's sidebands", all(|band| band.gear_sidebands.to_vec())),
    ];
    plot::stems(&series, Axes { x: "frequency, Hz", y: "amplitude, m/s2" })
}

/// Rows of key and value; lists of numbers stay one value.
fn flatten(value: &Value, key: &str, rows: &mut Vec<Vec<String>>) {
    match value {
        Value::Object(entries) => entries.iter().for_each(|(name, inner)| {
            let key = if key.is_empty() { name.clone() } else { format!("{key}.{name}") };
            flatten(inner, &key, rows);
        }),
        Value::String(text) => rows.push(vec![key.into(), text.clone()]),
        other => rows.push(vec![key.into(), other.to_string()]),
    }
}
