//! Table, text and picture of a learned law.

use super::Learned;
use crate::Result;
use crate::file::Measured;
use crate::forms::Law;
use crate::report::khz;
use crate::terminal;
use meshband_common::report::Report;
use meshband_common::report::plot::{Axes, Series, lines};

/// Head of [`rows`].
pub const HEAD: [&str; 6] =
    ["pinion speed, Hz", "bandwidth, kHz", "standard error", "stretches", "simulated, kHz", "measured over simulated"];

/// One row per knot; `simulated` is the law of the declared machine.
pub fn rows(learned: &Learned, simulated: Option<&Law>) -> Vec<Vec<String>> {
    let row = |k: &super::knots::Knot| {
        let law_hz = simulated.map(|law| law.bandwidth_hz(k.speed_hz));
        vec![
            format!("{:.3}", k.speed_hz),
            khz(Some(k.bandwidth_hz)),
            format!("{:.2} %", 100.0 * k.relative_error),
            k.stretches.to_string(),
            khz(law_hz),
            law_hz.map_or("-".into(), |hz| format!("{:.3}", k.bandwidth_hz / hz)),
        ]
    };
    learned.knots.iter().map(row).collect()
}

/// What the bandwidth is, in words.
fn meaning(measured: Measured) -> &'static str {
    match measured {
        Measured::Edges => "0.35 over the rise time of engagement edges, as in a simulated law",
        Measured::Occupied => {
            "the frequency below which 99 % of the power locked to the shaft lies; a simulated law is of engagement \
             edges"
        }
    }
}

/// The law as text.
pub fn text(learned: &Learned, simulated: Option<&Law>) -> String {
    let mut text = format!(
        "{}, channel {}: {} stretches of nearly constant speed\nbandwidth: {} ({})\n\n{}\n{}\n",
        crate::text::name(&learned.title),
        learned.channel,
        learned.stretches,
        meaning(learned.measured),
        learned.reason,
        terminal::table(&HEAD, &rows(learned, simulated)),
        learned.reliance()
    );
    for note in &learned.notes {
        text += &format!("note: {note}\n");
    }
    text
}

/// The report.
///
/// # Errors
/// A picture that cannot be drawn.
pub fn report(learned: &Learned, simulated: Option<&Law>) -> Result<Report> {
    let points = |of: &dyn Fn(&super::knots::Knot) -> f64| -> Vec<(f64, f64)> {
        learned.knots.iter().map(|k| (k.speed_hz, 1e-3 * of(k))).collect()
    };
    let mut series = vec![Series::new("measured", points(&|k| k.bandwidth_hz))];
    if let Some(law) = simulated {
        series.push(Series::new("simulated edge", points(&|k| law.bandwidth_hz(k.speed_hz))));
    }
    let picture = lines(&series, Axes { x: "pinion speed, Hz", y: "bandwidth, kHz" })?;
    let subtitle = format!("{}, channel {}", crate::text::name(&learned.title), learned.channel);
    let mut report = Report::new("Bandwidth law: learned from a record", &subtitle)
        .text(&format!("Bandwidth: {} ({}).", meaning(learned.measured), learned.reason))
        .picture(&picture, "Bandwidth over the speeds of the record.")
        .table("Knots of the law.", &HEAD, &rows(learned, simulated))
        .text(&learned.reliance());
    for note in &learned.notes {
        report = report.note(note);
    }
    Ok(report)
}
