//! The analysis of a train as text and page.

use super::train::{StageHarmonic, TrainChannel, TrainOutcome, TrainRun};
use crate::Result;
use crate::report::Report;
use crate::report::letter::{About, hertz};
use crate::report::owners::Owners;
use crate::report::plot::{Axes, Series, lines, spectrum};
use crate::terminal::table;

/// Harmonics in the table of a stage.
const HARMONICS: usize = 3;
/// Lines, and families of lines without an owner, listed.
const LINES: usize = 12;
const MAX_UNOWNED_FAMILIES: usize = 6;
/// Decibels shown, and labels put, in a picture.
const SPAN_DB: f64 = 90.0;
const MAX_LABELS: usize = 10;

/// Power of a gear's sidebands over their mesh harmonic from which they are named, dB.
const SIDEBANDS_DB: f64 = -38.0;

type Table = (Vec<&'static str>, Vec<Vec<String>>);

/// As text.
pub fn text(outcome: &TrainOutcome) -> String {
    let mut out = format!("train {}, tach on shaft {}, unit {}\n", outcome.title, outcome.tach_shaft, outcome.unit);
    outcome.notes.iter().for_each(|note| out += &format!("note: {note}\n"));
    for run in &outcome.runs {
        out += &format!("\nrun {}: {}\n", run.run, conditions(run));
        run.notes.iter().for_each(|note| out += &format!("note: {note}\n"));
        for channel in &run.channels {
            out += &format!("\nchannel {} ({}): {}\n", channel.channel, channel.name, level(channel, &outcome.unit));
            for (head, rows) in [stages(channel), averages(channel), strongest(channel)] {
                if !rows.is_empty() {
                    out += &format!("{}\n", table(&head, &rows));
                }
            }
            unowned(channel).iter().for_each(|line| out += &format!("{line}\n"));
        }
    }
    out
}

fn conditions(run: &TrainRun) -> String {
    let speed = run.speed;
    let turns: Vec<String> = run.turns.iter().map(|turns| format!("{turns:.1}")).collect();
    format!(
        "input {:.4} Hz ({:.4} to {:.4}), turns of the shafts {}",
        speed.mean_hz,
        speed.slowest_hz,
        speed.fastest_hz,
        turns.join(", ")
    )
}

fn level(channel: &TrainChannel, unit: &str) -> String {
    format!(
        "rms {:.4} {unit}, {:.1} % of the power at orders that a part of the train owns",
        channel.rms,
        100.0 * channel.owned_share
    )
}

/// The strongest line about a harmonic: of a sound set it need not be the harmonic.
fn amplitude(h: &StageHarmonic) -> String {
    let best = h.carrier.iter().filter(|c| c.sound).map(|c| (c.line.amplitude, c.line.stands, c.number));
    let (amplitude, stands, number) =
        best.fold((h.line.amplitude, h.line.stands, 0), |a, b| if b.0 > a.0 { b } else { a });
    let at = if number == 0 { String::new() } else { format!(" at {number:+}") };
    if stands { format!("{amplitude:.4}{at}") } else { format!("({amplitude:.4}{at})") }
}

/// Mesh harmonics and sidebands of every stage and gear.
pub fn stages(channel: &TrainChannel) -> Table {
    let mut rows = Vec::new();
    for stage in &channel.stages {
        for h in stage.harmonics.iter().take(HARMONICS) {
            let sidebands: Vec<String> = h.gears.iter().map(|g| format!("{} {:.1}", g.gear, g.level_db)).collect();
            rows.push(vec![
                format!("stage {}, {} x", stage.stage, h.number),
                format!("{:.4}", h.line.order),
                format!("{:.2}", h.frequency_hz),
                amplitude(h),
                sidebands.join(", "),
            ]);
        }
    }
    (vec!["mesh", "order", "Hz", "amplitude", "sidebands +-1 to +-3, dB"], rows)
}

/// Averages of every gear.
pub fn averages(channel: &TrainChannel) -> Table {
    let row = |a: &super::train_average::GearAverage| {
        vec![
            format!("{}{}", a.gear, if a.windowed { ", windowed" } else { "" }),
            format!("{:.0}", a.periods),
            format!("{:.4}", a.indicators.rms),
            format!("{:.2}", a.indicators.kurtosis),
            format!("{:.2}", a.indicators.fm4),
            format!("{:.2}", a.indicators.na4),
            format!("{} of {}", a.strongest_tooth, a.teeth),
            format!("{:.1}", a.strongest_tooth_over_median),
        ]
    };
    let head = vec!["average", "periods", "rms", "kurtosis", "FM4", "NA4", "tooth", "over median"];
    (head, channel.averages.iter().map(row).collect())
}

/// The strongest lines and whose they are.
pub fn strongest(channel: &TrainChannel) -> Table {
    let row = |line: &super::train::OwnedLine| {
        let owners = if line.owners.is_empty() { "no part of the train".into() } else { line.owners.join("; ") };
        vec![format!("{:.4}", line.order), format!("{:.4}", line.amplitude), owners]
    };
    (vec!["strongest line", "amplitude", "owner"], channel.strongest.iter().take(LINES).map(row).collect())
}

fn unowned(channel: &TrainChannel) -> Vec<String> {
    let one = |family: &super::families::Family| {
        let places: Vec<String> =
            family.members.iter().take(4).map(|m| format!("{} at {:.3}", m.place, m.line.order)).collect();
        format!("owned by no part: order {:.4}, RMS {:.5}: {}", family.base_order, family.rms, places.join(", "))
    };
    channel.unowned.iter().take(MAX_UNOWNED_FAMILIES).map(one).collect()
}

/// As page.
///
/// # Errors
/// A picture that cannot be drawn.
pub fn report(outcome: &TrainOutcome, about: &About) -> Result<Report> {
    let subtitle = format!("orders of the input (shaft 0); tach on shaft {}", outcome.tach_shaft);
    let mut page = Report::new(&format!("Analysis of a train: {}", outcome.title), &subtitle)
        .verdict(sentences(outcome, about))
        .facts(about.facts.clone());
    for note in outcome.notes.iter().chain(outcome.runs.iter().flat_map(|run| &run.notes)) {
        page = page.note(note);
    }
    let shafts: Vec<Vec<String>> = outcome
        .shafts
        .iter()
        .zip(&outcome.orders)
        .map(|(words, order)| vec![words.clone(), format!("{order:.6}")])
        .collect();
    page = page.table("Shafts.", &["shaft", "order"], &shafts);
    let loudest = channels(outcome).max_by(|a, b| a.1.rms.total_cmp(&b.1.rms));
    if let Some((run, channel)) = loudest {
        page = headed(page, run, channel, outcome);
        page = of_channel(page, channel, &outcome.unit)?;
    }
    page = page.appendix("Averages, and every other run and channel");
    for (run, channel) in channels(outcome) {
        page = headed(page, run, channel, outcome);
        if loudest.is_none_or(|own| !std::ptr::eq(own.1, channel)) {
            page = of_channel(page, channel, &outcome.unit)?;
        }
        page = of_averages(page, channel, &outcome.unit)?;
    }
    Ok(page)
}

fn channels(outcome: &TrainOutcome) -> impl Iterator<Item = (&TrainRun, &TrainChannel)> {
    outcome.runs.iter().flat_map(|run| run.channels.iter().map(move |channel| (run, channel)))
}

fn headed(page: Report, run: &TrainRun, channel: &TrainChannel, outcome: &TrainOutcome) -> Report {
    let heading = format!("Run {}, channel {} ({})", run.run, channel.channel, channel.name);
    page.section(&heading).text(&format!("{}; {}", conditions(run), level(channel, &outcome.unit)))
}

/// What was measured, which sidebands and which lines without an owner stand out, what to do next.
fn sentences(outcome: &TrainOutcome, about: &About) -> Vec<String> {
    let mut letter: Vec<String> = Some(about.how.clone()).filter(|how| !how.is_empty()).into_iter().collect();
    let sidebands = channels(outcome).flat_map(|(_, channel)| {
        let of_stage = |stage: &super::train::StageLines| {
            let first = stage.harmonics.first().filter(|own| own.line.stands)?;
            let gear = first.gears.iter().max_by(|a, b| a.level_db.total_cmp(&b.level_db))?;
            Some((gear.level_db, format!("the {} of stage {}", gear.gear, stage.stage), channel))
        };
        channel.stages.iter().filter_map(of_stage).collect::<Vec<_>>()
    });
    let strongest = sidebands.max_by(|a, b| a.0.total_cmp(&b.0)).filter(|own| own.0 > SIDEBANDS_DB);
    letter.push(match &strongest {
        Some((db, gear, channel)) => format!(
            "The strongest sidebands about a first mesh harmonic are those of {gear}, {:.0} dB below it, in {}.",
            -db, channel.name
        ),
        None => format!("No sidebands of a gear come within {:.0} dB of their first mesh harmonic.", -SIDEBANDS_DB),
    });
    let mut orders: Vec<(f64, f64)> =
        channels(outcome).flat_map(|(_, channel)| &channel.unowned).map(|own| (own.rms, own.base_order)).collect();
    orders.sort_by(|a, b| b.0.total_cmp(&a.0));
    if let Some((_, order)) = orders.first() {
        let hz = about.hz(*order).map_or(String::new(), |hz| format!(" ({})", hertz(hz)));
        let more =
            if orders.len() > 1 { format!(", the strongest of {} such orders", orders.len()) } else { String::new() };
        letter.push(format!("No part of the train owns {order:.3} x the input{hz}{more}."));
    }
    letter.push("Next: `meshband diagnose` says which of this is a finding, and how sure it is.".into());
    letter
}

fn of_channel(mut page: Report, channel: &TrainChannel, unit: &str) -> Result<Report> {
    let own = &channel.order_spectrum;
    let first = (0.05 / own.bin_orders).ceil() as usize;
    let points =
        (first..own.spectrum.values.len()).map(|i| (own.spectrum.frequency(i), own.spectrum.values[i])).collect();
    let mut owners = Owners::new(own.highest_order / 60.0);
    for line in channel.strongest.iter().take(MAX_LABELS) {
        owners.claim(line.order, line.owners.first().map_or("unowned", String::as_str));
    }
    let labels = owners.labels();
    let caption = format!("amplitude, dB re 1 {unit}");
    let axes = Axes { x: "order of the input", y: &caption };
    let drawn = spectrum(&[Series::new("order spectrum", points)], &labels, 1.0, SPAN_DB, axes)?;
    page = page.picture(&drawn, "Order spectrum; the strongest lines say their owners where there is room.");
    for (caption, (head, rows)) in [
        (
            "Mesh harmonics and sidebands of every stage; in brackets what does not stand over the floor.",
            stages(channel),
        ),
        ("Synchronous averages of every gear with the node's indicators.", averages(channel)),
        ("The strongest lines and their owners.", strongest(channel)),
    ] {
        if !rows.is_empty() {
            page = page.table(caption, &head, &rows);
        }
    }
    Ok(unowned(channel).iter().fold(page, |page, line| page.text(line)))
}

fn of_averages(mut page: Report, channel: &TrainChannel, unit: &str) -> Result<Report> {
    for average in &channel.averages {
        let count = average.samples.len() as f64;
        let points = average
            .samples
            .iter()
            .enumerate()
            .map(|(i, x)| (i as f64 / count * f64::from(average.teeth), f64::from(*x)));
        let series = Series::new(&average.gear, points.collect());
        let drawn = lines(&[series], Axes { x: "tooth pitch", y: &format!("average, {unit}") })?;
        page = page.picture(&drawn, &format!("Average of the {}.", average.gear));
    }
    Ok(page)
}
