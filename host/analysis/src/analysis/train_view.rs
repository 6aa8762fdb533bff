//! The analysis of a train as text and page.

use super::train::{StageHarmonic, TrainChannel, TrainOutcome, TrainRun};
use crate::Result;
use crate::report::Report;
use crate::report::plot::{Axes, Label, Series, lines, spectrum};
use crate::terminal::table;

/// Harmonics in the table of a stage.
const HARMONICS: usize = 3;
/// Lines, and families of lines without an owner, listed.
const LINES: usize = 12;
const UNOWNED: usize = 6;
/// Decibels shown, and labels put, in a picture.
const SPAN_DB: f64 = 90.0;
const LABELLED: usize = 10;

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
        format!("owned by no part: base {:.4}, rms {:.5}: {}", family.base_order, family.rms, places.join(", "))
    };
    channel.unowned.iter().take(UNOWNED).map(one).collect()
}

/// As page.
///
/// # Errors
/// A picture that cannot be drawn.
pub fn report(outcome: &TrainOutcome) -> Result<Report> {
    let subtitle = format!("orders of the input (shaft 0); tach on shaft {}", outcome.tach_shaft);
    let mut page = Report::new(&format!("Analysis of a train: {}", outcome.title), &subtitle)
        .figure("Shafts", outcome.shafts.len())
        .figure("Runs", outcome.runs.len())
        .figure("Unit", &outcome.unit);
    for note in &outcome.notes {
        page = page.note(note);
    }
    let shafts: Vec<Vec<String>> = outcome
        .shafts
        .iter()
        .zip(&outcome.orders)
        .map(|(words, order)| vec![words.clone(), format!("{order:.6}")])
        .collect();
    page = page.table("Shafts.", &["shaft", "order"], &shafts);
    for run in &outcome.runs {
        for channel in &run.channels {
            let heading = format!("Run {}, channel {} ({})", run.run, channel.channel, channel.name);
            page = page.section(&heading).text(&format!("{}; {}", conditions(run), level(channel, &outcome.unit)));
            page = of_channel(page, channel, &outcome.unit)?;
        }
    }
    Ok(page)
}

fn of_channel(mut page: Report, channel: &TrainChannel, unit: &str) -> Result<Report> {
    let own = &channel.order_spectrum;
    let first = (0.05 / own.bin_orders).ceil() as usize;
    let points =
        (first..own.spectrum.values.len()).map(|i| (own.spectrum.frequency(i), own.spectrum.values[i])).collect();
    let labels: Vec<Label> = channel
        .strongest
        .iter()
        .take(LABELLED)
        .map(|line| Label { x: line.order, text: line.owners.first().cloned().unwrap_or_else(|| "unowned".into()) })
        .collect();
    let caption = format!("amplitude, dB re 1 {unit}");
    let axes = Axes { x: "order of the input", y: &caption };
    let drawn = spectrum(&[Series::new("order spectrum", points)], &labels, 1.0, SPAN_DB, axes)?;
    page = page.picture(&drawn, "Order spectrum; the strongest lines say their owners.");
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
    Ok(unowned(channel).iter().fold(page, |page, line| page.text(line)))
}
