//! The analysis in words: short tables for the terminal, the same rows for the report.

use super::families::Kind;
use super::sidebands::{Harmonic, Pair};
use super::unexplained::Found;
use super::{ChannelOutcome, Outcome, RunOutcome};
use crate::terminal;

/// Harmonics shown, families shown, lines of the envelope shown.
const HARMONICS: usize = 8;
const FAMILIES: usize = 10;
const ENVELOPE_LINES: usize = 6;
const PLACES: usize = 5;

/// Head and rows of a table.
pub type Table = (Vec<&'static str>, Vec<Vec<String>>);

/// What is to be said where no mesh line stands: figures of a mesh that is not there mean nothing.
pub fn without_mesh(outcome: &Outcome) -> Option<String> {
    let channels = || outcome.runs.iter().flat_map(|run| &run.channels).filter(|channel| !channel.mesh.is_empty());
    let stands = |channel: &ChannelOutcome| channel.mesh.iter().any(|harmonic| harmonic.line.stands);
    (channels().count() > 0 && !channels().any(stands)).then(|| {
        let [pinion, gear] = outcome.teeth;
        format!(
            "No mesh harmonic of {pinion}/{gear} teeth stands over the noise in any channel: check the tooth counts \
             and the tachometer's shaft before anything below is believed."
        )
    })
}

/// The whole outcome as text.
pub fn text(outcome: &Outcome) -> String {
    let mut out = format!("{}\n", heading(outcome));
    for note in outcome.notes.iter().chain(&without_mesh(outcome)) {
        out += &format!("note: {note}\n");
    }
    for run in &outcome.runs {
        out += &format!("\nrun {}: {}\n", run.run, conditions(run));
        for note in &run.notes {
            out += &format!("note: {note}\n");
        }
        for channel in &run.channels {
            out += &of_channel(channel, run, &outcome.unit);
        }
    }
    out
}

/// Record, teeth, tach and unit in one line.
pub fn heading(outcome: &Outcome) -> String {
    let tach = &outcome.tach;
    let of = if tach.virtual_source { "virtual tach" } else { "tach" };
    format!(
        "{}: teeth {}/{}, the same teeth meet every {} turns; {of} on the {}, {} per turn; amplitudes are peak, {}",
        crate::text::name(&outcome.title),
        outcome.teeth[0],
        outcome.teeth[1],
        outcome.hunting_turns,
        tach.shaft,
        tach.pulses_per_rev,
        outcome.unit
    )
}

/// Speed and length of a run.
pub fn conditions(run: &RunOutcome) -> String {
    let speed = run.speed;
    let torque = run.input_torque_n_m.map_or(String::new(), |t| format!(", {t} N m"));
    format!(
        "pinion {:.4} Hz ({:.4} to {:.4}){torque}, {:.0} turns of it and {:.1} of the gear",
        speed.mean_hz, speed.slowest_hz, speed.fastest_hz, run.turns[0], run.turns[1]
    )
}

/// Level and spectrum of a channel in one line.
pub fn level(channel: &ChannelOutcome, unit: &str) -> String {
    let spectrum = &channel.order_spectrum;
    format!(
        "RMS {} {unit}, {:.1} % of its power locked to the shafts; orders to {:.1}, a line is {:.4} orders wide",
        figure(channel.rms),
        100.0 * channel.locked_share,
        spectrum.highest_order,
        spectrum.resolution_orders
    )
}

fn of_channel(channel: &ChannelOutcome, run: &RunOutcome, unit: &str) -> String {
    let shown = |(head, rows): Table| terminal::table(&head, &rows);
    let mut out = format!("\nchannel {} ({}): {}\n", channel.channel, channel.name, level(channel, unit));
    if !channel.mesh.is_empty() {
        out += &shown(mesh(channel));
    }
    out += "\n";
    out += &shown(averages(channel));
    out += &format!("\n{}\n", envelope(channel, run));
    out += &format!("{}\n", unexplained_headline(channel));
    if let Some(table) = families(channel, unit) {
        out += &shown(table);
    }
    out
}

/// Mesh harmonics with the first sidebands of both shafts.
pub fn mesh(channel: &ChannelOutcome) -> Table {
    let head =
        vec!["mesh", "order", "Hz", "amplitude", "pinion +-1, dB", "AM", "PM", "gear +-1, dB", "AM", "PM", "SER p/g"];
    let row = |h: &Harmonic| {
        let amplitude =
            if h.line.stands { figure(h.line.amplitude) } else { format!("({})", figure(h.line.amplitude)) };
        let mut row = vec![h.number.to_string(), figure(h.line.order), format!("{:.1}", h.frequency_hz), amplitude];
        row.extend(first_pair(&h.pinion));
        row.extend(first_pair(&h.gear));
        row.push(h.sideband_energy_ratio.map_or("-".into(), |[p, g]| format!("{p:.2} / {g:.2}")));
        row
    };
    (head, channel.mesh.iter().take(HARMONICS).map(row).collect())
}

fn first_pair(pairs: &[Pair]) -> [String; 3] {
    let Some(pair) = pairs.first() else { return ["-", "-", "-"].map(Into::into) };
    let index = |index: Option<f64>| index.map_or("-".into(), |i| format!("{i:.3}"));
    [format!("{:.1}", pair.level_db), index(pair.amplitude_index), index(pair.phase_index)]
}

/// Averages with the node's indicators.
pub fn averages(channel: &ChannelOutcome) -> Table {
    let head = vec![
        "average",
        "turns",
        "hunting",
        "RMS",
        "peak",
        "crest",
        "kurtosis",
        "FM0",
        "FM4",
        "NA4",
        "rest RMS",
        "tooth (x median)",
    ];
    let row = |a: &super::average::Average| {
        let i = &a.indicators;
        let f = |x: f32| figure(f64::from(x));
        let whole = if a.whole_hunting_periods { "whole" } else { "broken" };
        let mut row = vec![a.shaft.to_string(), a.turns.to_string(), whole.to_string()];
        row.extend([i.rms, i.peak, i.crest, i.kurtosis, i.fm0, i.fm4, i.na4, i.difference_rms].map(f));
        row.push(format!("{} ({:.1})", a.strongest_tooth, a.strongest_tooth_over_median));
        row
    };
    (head, channel.averages.iter().map(row).collect())
}

/// Band and strongest lines of the envelope in a sentence.
pub fn envelope(channel: &ChannelOutcome, run: &RunOutcome) -> String {
    let e = &channel.envelope;
    let lines: Vec<String> = e
        .lines
        .iter()
        .take(ENVELOPE_LINES)
        .map(|line| {
            let hz = line.order * run.speed.mean_hz;
            format!("{:.3} ({:.1} Hz, {:.1} %)", line.order, hz, 100.0 * line.amplitude)
        })
        .collect();
    let lines = match lines.as_slice() {
        [] => "no line over its floor".into(),
        all => format!("orders (those of the shafts too; amplitude of the band's mean power) {}", all.join(", ")),
    };
    let declared = channel
        .bearing_lines
        .iter()
        .map(|own| format!("{} {:.3} ({:.1} %)", own.part, own.order, 100.0 * own.amplitude));
    let declared: Vec<String> = declared.collect();
    let declared =
        if declared.is_empty() { String::new() } else { format!("; declared bearings: {}", declared.join(", ")) };
    format!(
        "envelope of the rest, {:.0} to {:.0} Hz (excess kurtosis {:.2}, {:.1} standard errors, highest of {} \
         bands): {lines}{declared}",
        e.band.low_hz, e.band.high_hz, e.band.kurtosis, e.band.score, e.bands_tried
    )
}

/// How much the mesh does not explain, in a sentence.
pub fn unexplained_headline(channel: &ChannelOutcome) -> String {
    let u = &channel.unexplained;
    let chance = format!("noise gives any with {:.0} % per spectrum", 100.0 * u.false_alarm);
    match (u.spectrum.len(), u.envelope.len()) {
        (0, 0) => format!("orders that mesh and shafts do not explain: none ({chance})"),
        (s, e) => {
            format!("orders that mesh and shafts do not explain: {s} in the spectrum, {e} in the envelope ({chance})")
        }
    }
}

/// Families, the spectrum's first; `None` where there is none.
pub fn families(channel: &ChannelOutcome, unit: &str) -> Option<Table> {
    let head = vec!["order", "RMS", "of", "lines", "built as", "strongest"];
    let of_envelope = "x mean power".to_owned();
    let rows: Vec<Vec<String>> =
        [(&channel.unexplained.spectrum, unit.to_owned()), (&channel.unexplained.envelope, of_envelope)]
            .into_iter()
            .flat_map(|(found, of)| found.iter().take(FAMILIES).map(move |found| family(found, &of)))
            .collect();
    (!rows.is_empty()).then_some((head, rows))
}

fn family(found: &Found, of: &str) -> Vec<String> {
    let family = &found.family;
    let places: Vec<String> = family.members.iter().take(PLACES).map(|m| format!("{:.3}", m.line.order)).collect();
    let more = if family.members.len() > PLACES { ", ..." } else { "" };
    let kinds: Vec<&str> = std::iter::once(&family.kind).chain(&family.also).map(|kind| kind_name(*kind)).collect();
    let mut built = kinds.join(", ");
    if let Some(hz) = found.fixed_frequency_hz {
        built += &format!(", stands at {hz:.2} Hz");
    }
    if found.in_both {
        built += ", in both";
    }
    vec![
        format!("{:.4}", family.base_order),
        figure(family.rms),
        of.to_owned(),
        family.members.len().to_string(),
        built,
        places.join(", ") + more,
    ]
}

fn kind_name(kind: Kind) -> &'static str {
    match kind {
        Kind::Single => "single line",
        Kind::Harmonics => "harmonics",
        Kind::ModulatedByPinion => "harmonics +- pinion",
        Kind::ModulatedByGear => "harmonics +- gear",
        Kind::AboutMesh => "about the mesh",
    }
}

/// Four significant digits.
pub fn figure(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return value.to_string();
    }
    let digits = 3 - value.abs().log10().floor() as i32;
    match digits {
        ..=0 if value.abs() < 1e7 => format!("{value:.0}"),
        1..=6 => format!("{value:.*}", digits as usize),
        _ => format!("{value:.3e}"),
    }
}
