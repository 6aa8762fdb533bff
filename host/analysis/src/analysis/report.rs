//! The analysis as a page: a letter with the table of findings, then per channel the order spectrum, the order map,
//! both averages and the envelope's spectrum, with their tables.

use super::average::Average;
use super::letter;
use super::lines::WINDOW;
use super::search::Level;
use super::unexplained::Found;
use super::view::{self, Table};
use super::{ChannelOutcome, Outcome, RunOutcome};
use crate::Result;
use crate::report::Report;
use crate::report::letter::About;
use crate::report::owners::Owners;
use crate::report::plot::{Axes, Label, Series, dense_map, lines, spectrum};

/// Channels drawn; the others have their tables.
const MAX_DRAWN_CHANNELS: usize = 12;
/// Mesh harmonics that the picture of the spectrum reaches to, and that are labelled.
const HARMONICS: f64 = 6.5;
/// Decibels shown.
const SPAN_DB: f64 = 90.0;
const MAP_SPAN_DB: f64 = 100.0;
/// Families labelled.
const MAX_LABELLED_FAMILIES: usize = 4;

/// The page.
///
/// # Errors
/// A picture that cannot be drawn.
pub fn report(outcome: &Outcome, about: &About) -> Result<Report> {
    let mut report = Report::new(&format!("Analysis: {}", outcome.title), &view::heading(outcome))
        .verdict(letter::sentences(outcome, about))
        .facts(about.facts.clone());
    for note in &outcome.notes {
        report = report.note(note);
    }
    report = table(
        report.section("Orders that the mesh does not explain"),
        "Each where it is strongest.",
        letter::findings(outcome),
    );
    if let Some(channel) = loudest(outcome) {
        report = order_spectrum(report, channel, &outcome.unit)?;
        report = table(
            report,
            &format!("Mesh harmonics in {}; amplitudes in brackets do not stand over the floor.", channel.name),
            view::mesh(channel),
        );
    }
    report = report.appendix("Every run and channel");
    let mut drawn = 0;
    for run in &outcome.runs {
        for channel in &run.channels {
            report = of_channel(report, channel, run, &outcome.unit, drawn < MAX_DRAWN_CHANNELS)?;
            drawn += 1;
        }
    }
    if drawn > MAX_DRAWN_CHANNELS {
        report = report.note(&format!(
            "pictures of the first {MAX_DRAWN_CHANNELS} channels only; --run and --channel choose others"
        ));
    }
    Ok(report.section("How to read this").text(EXPLANATION))
}

/// The channel with the most that the mesh does not explain; without any, the strongest.
fn loudest(outcome: &Outcome) -> Option<&ChannelOutcome> {
    let rest = |channel: &&ChannelOutcome| {
        let strongest = channel.unexplained.spectrum.first().map_or(0.0, |found| found.family.rms);
        (strongest, channel.rms)
    };
    let channels = outcome.runs.iter().flat_map(|run| &run.channels);
    channels.max_by(|a, b| rest(a).0.total_cmp(&rest(b).0).then(rest(a).1.total_cmp(&rest(b).1)))
}

const EXPLANATION: &str = "Orders are multiples of the pinion's turns. AM and PM are indices of amplitude and phase \
    modulation (rad), given where the \
     harmonic and both sidebands stand over the floor. SER is the sum of the amplitudes of three sidebands on each \
     side over the harmonic's. FM0, \
     FM4, NA4 and the other indicators are computed by the node's own code on the average shown; NA4 runs on over \
     the runs of like torque and \
     speed. Tooth numbers count tooth pitches from angle 0. What the mesh does not explain is listed by energy and \
     named by nothing but its orders. Definitions, limits and sources: book/src/explanation/analysis.md.";

fn of_channel(
    mut report: Report,
    channel: &ChannelOutcome,
    run: &RunOutcome,
    unit: &str,
    draw: bool,
) -> Result<Report> {
    report = report
        .section(&format!("Run {}, channel {} ({})", run.run, channel.channel, channel.name))
        .text(&format!("{}. {}.", capital(&view::conditions(run)), view::level(channel, unit)));
    for note in &run.notes {
        report = report.note(note);
    }
    if draw {
        report = order_spectrum(report, channel, unit)?;
        report = order_map(report, channel, unit)?;
    }
    report = table(
        report,
        "Mesh harmonics and first sidebands; amplitudes in brackets do not stand over the floor.",
        view::mesh(channel),
    );
    report = table(report, "Synchronous averages with the node's indicators.", view::averages(channel));
    if draw {
        for average in &channel.averages {
            report = averaged(report, average, unit)?;
        }
    }
    report = report.text(&capital(&view::envelope(channel, run)));
    if draw {
        report = coherence(envelope(report, channel)?, channel)?;
    }
    report = report.text(&capital(&view::unexplained_headline(channel)));
    Ok(match view::families(channel, unit) {
        Some(rows) => table(report, "Orders that the mesh does not explain, by energy.", rows),
        None => report,
    })
}

fn table(report: Report, caption: &str, (head, rows): Table) -> Report {
    if rows.is_empty() { report } else { report.table(caption, &head, &rows) }
}

fn order_spectrum(report: Report, channel: &ChannelOutcome, unit: &str) -> Result<Report> {
    let own = &channel.order_spectrum;
    let teeth = channel.mesh.first().map_or(own.highest_order, |h| h.line.order);
    let top = own.highest_order.min(HARMONICS * teeth);
    let points = |i: usize| (own.spectrum.frequency(i), own.spectrum.values[i]);
    let first = (0.2 / own.bin_orders).ceil() as usize;
    let last = ((top / own.bin_orders) as usize).min(own.spectrum.values.len().saturating_sub(1));
    let series = [Series::new("order spectrum", (first..=last).map(points).collect())];
    let mut owners = Owners::new((top / 60.0).max(own.resolution_orders));
    let strongest = own.strongest.first().filter(|(order, _)| {
        *order < top && channel.mesh.iter().all(|h| (h.line.order - order).abs() > own.resolution_orders)
    });
    if let Some((order, _)) = strongest {
        owners.claim(*order, format!("{order:.2}"));
    }
    for harmonic in channel.mesh.iter().filter(|h| h.line.stands && h.line.order < top) {
        owners.claim(harmonic.line.order, format!("{} z", harmonic.number));
    }
    for label in marks(&channel.unexplained.spectrum, top) {
        owners.claim(label.x, label.text);
    }
    let labels = owners.labels();
    let y = format!("amplitude, dB re 1 {unit}");
    let svg = spectrum(&series, &labels, 1.0, SPAN_DB, Axes { x: "order of the pinion", y: &y })?;
    let caption = format!(
        "Order spectrum over {} turns: peak amplitude, window {}, a line {:.4} orders wide. Mesh harmonics are \
         marked k z, what the mesh does not explain and the strongest line of all by their orders.",
        own.turns, own.window, own.resolution_orders
    );
    Ok(report.picture(&svg, &caption))
}

fn order_map(report: Report, channel: &ChannelOutcome, unit: &str) -> Result<Report> {
    let map = &channel.map;
    if map.rows.first().map_or(0, Vec::len) < 2 {
        return Ok(report.note("too few turns for an order map"));
    }
    let decibel = |a: f64| 20.0 * a.max(f64::MIN_POSITIVE).log10();
    let rows: Vec<Vec<f64>> = map.rows.iter().map(|row| row.iter().map(|a| decibel(*a)).collect()).collect();
    let mut all: Vec<f64> = rows.iter().flatten().copied().collect();
    all.sort_by(f64::total_cmp);
    // From under the floor, which is most of the picture, to the highest line.
    let (low, top) = (all[all.len() / 10], all[all.len() - 1]);
    let scale = low.max(top - MAP_SPAN_DB)..top.max(low + 1.0);
    let axes = Axes { x: "time, s", y: "order of the pinion" };
    let svg = dense_map(&rows, map.time_s.0..map.time_s.1, 0.0..map.highest_order, scale, axes)?;
    let caption = format!(
        "Order map: peak amplitude in dB re 1 {unit}, stretches of {} turns. What turns with the shafts is level; \
         what stands at a frequency moves against the speed.",
        map.turns
    );
    Ok(report.picture(&svg, &caption))
}

fn averaged(report: Report, average: &Average, unit: &str) -> Result<Report> {
    let turn = |values: &[f32]| -> Vec<(f64, f64)> {
        let place = |i: usize| 360.0 * i as f64 / values.len() as f64;
        values.iter().enumerate().map(|(i, &x)| (place(i), f64::from(x))).collect()
    };
    let x = format!("angle of the {}, degrees", average.shaft);
    let drawn = |name: &str, values: &[f32]| {
        let y = format!("{name}, {unit}");
        lines(&[Series::new(name, turn(values))], Axes { x: &x, y: &y })
    };
    let caption = format!(
        "Synchronous average of the {} over {} turns{}.",
        average.shaft,
        average.turns,
        if average.whole_hunting_periods { ", whole hunting periods" } else { "; the hunting period is longer" }
    );
    let rest =
        "The same without mesh harmonics, their first sidebands and shaft orders 1 and 2: a single tooth shows here.";
    Ok(report
        .picture(&drawn("average", &average.samples)?, &caption)
        .picture(&drawn("difference", &average.difference)?, rest))
}

fn envelope(report: Report, channel: &ChannelOutcome) -> Result<Report> {
    let own = &channel.envelope;
    let Some(level) = own.levels.iter().min_by_key(|level| level.averages) else { return Ok(report) };
    let last = ((own.highest_order / level.density.bin) as usize).min(level.density.values.len().saturating_sub(1));
    let share = |i: usize| (level.density.frequency(i), 100.0 * amplitude(level, i));
    let first = (0.2 / level.density.bin).ceil() as usize;
    let series = [Series::new("squared envelope", (first..=last).map(share).collect())];
    let declared = channel.bearing_lines.iter().map(|own| Label { x: own.order, text: own.part.clone() });
    let labels: Vec<Label> = declared.chain(marks(&channel.unexplained.envelope, own.highest_order)).collect();
    let axes = Axes { x: "order of the pinion", y: "share of the band's power, dB re 1 %" };
    let svg = spectrum(&series, &labels, 1.0, 50.0, axes)?;
    Ok(report.picture(
        &svg,
        "Spectrum of the squared envelope of what is locked to neither shaft; marked what the shafts do not explain.",
    ))
}

/// The map of coherence, where there is one.
fn coherence(report: Report, channel: &ChannelOutcome) -> Result<Report> {
    let map = &channel.coherence;
    let highest = map.rows.iter().flatten().copied().fold(0.0, f64::max);
    if highest <= 0.0 {
        return Ok(report);
    }
    let top = map.width_hz * map.rows.len() as f64;
    let shares: Vec<Vec<f64>> = map.rows.iter().map(|row| row.iter().map(|x| 100.0 * x).collect()).collect();
    let svg = dense_map(
        &shares,
        0.0..map.highest_order,
        0.0..top,
        0.0..100.0 * highest,
        Axes { x: "order of the pinion", y: "frequency of the band, Hz" },
    )?;
    Ok(report.picture(
        &svg,
        "Cyclic coherence by bands: how much of its mean power, %, the power of each band swells by at each order. \
         Impacts stand at equal distances in the bands of the resonances that they excite.",
    ))
}

/// Base order of each of the first families, or its strongest line where the base itself has none.
fn marks(found: &[Found], highest: f64) -> Vec<Label> {
    let of = |found: &Found| {
        let members = &found.family.members;
        let base = members.iter().find(|m| m.place == "1 o").or(members.first())?.line.order;
        Some(Label { x: base, text: format!("{base:.2}") })
    };
    found.iter().take(MAX_LABELLED_FAMILIES).filter_map(of).filter(|label| label.x < highest).collect()
}

fn amplitude(level: &Level, i: usize) -> f64 {
    (2.0 * level.density.values[i] * WINDOW.enbw_bins() * level.density.bin).sqrt()
}

fn capital(text: &str) -> String {
    let mut characters = text.chars();
    characters.next().map_or(String::new(), |first| first.to_uppercase().chain(characters).collect())
}
