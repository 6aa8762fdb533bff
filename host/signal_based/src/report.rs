//! The answer as a page: errors, spectra before and after with the lines marked, families with their evidence, limits.

use super::impacts::Impacts;
use super::outcome::{Effect, Outcome, Picture};
use super::view;
use crate::Result;
use meshband_common::report::Report;
use meshband_common::report::plot::{Axes, Label, Series, spectrum};

/// Channels drawn.
const DRAWN: usize = 8;
/// Lines of one family marked.
const MARKED: usize = 6;
/// Decibels shown.
const SPAN_DB: f64 = 90.0;
/// Decibels shown of an envelope's spectrum.
const ENVELOPE_DB: f64 = 40.0;

/// The page.
///
/// # Errors
/// A picture that cannot be drawn.
pub fn report(outcome: &Outcome) -> Result<Report> {
    let held = outcome.held_out;
    let mut page =
        Report::new(&format!("Closed loop: {}", outcome.record), &format!("Kinematic level. {}", outcome.headline))
            .figure("held-out error, declared", format!("{:.4}", held.declared))
            .figure("calibrated", format!("{:.4}", held.calibrated))
            .figure("corrected", format!("{:.4}", held.corrected))
            .figure("noise floor", format!("{:.4}", held.noise_floor))
            .figure("families", outcome.effects.len());
    for note in &outcome.notes {
        page = page.note(note);
    }
    if !outcome.to_raise_the_level.is_empty() {
        page =
            page.note(&format!("For the dynamic level this record lacks: {}.", outcome.to_raise_the_level.join("; ")));
    }
    page = page
        .section("Error in three stages")
        .text(&format!("Split: {}. {}.", outcome.split.kind, outcome.error.metric));
    page = table(page, "", view::errors(outcome));
    page = table(page, "Held-out turns, channel by channel.", view::channels(outcome));
    page = page.section("Spectra before and after");
    for picture in outcome.pictures.iter().take(DRAWN) {
        page = drawn(page, picture, outcome)?;
    }
    for own in &outcome.impacts {
        page = envelope(page, own)?;
    }
    page = page.section("Families found");
    if outcome.effects.is_empty() {
        page = page.text("None: nothing of the library stands out of this record.");
    }
    for effect in &outcome.effects {
        page = family(page, effect);
    }
    page = page.section("Families judged").text("Logarithm of the Bayes factor after the choice, the highest of the same search with the spacing moved by 1 to 6 %, and the probability of such a score by chance in the whole search.");
    page = table(page, "", view::judged(outcome));
    page = page.section("What would have been found");
    page = table(
        page,
        "Strength of each line of a family, found in half and in nine of ten places of this record.",
        view::limits(outcome),
    );
    page = page.section("What stays unexplained");
    for left in &outcome.unexplained {
        page = page.text(&format!("{}: {:.2} % of the variance.", left.description, 100.0 * left.variance_share));
    }
    Ok(page)
}

fn table(page: Report, caption: &str, (head, rows): view::Table) -> Report {
    if rows.is_empty() { page } else { page.table(caption, &head, &rows) }
}

fn drawn(page: Report, picture: &Picture, outcome: &Outcome) -> Result<Report> {
    let names = ["record", "residual, calibrated", "residual, corrected"];
    let series: Vec<Series> =
        names.iter().zip(&picture.spectra).map(|(name, points)| Series::new(name, points.clone())).collect();
    let top = picture.spectra[0].last().map_or(0.0, |p| p.0);
    let marks = outcome.effects.iter().filter(|e| e.order_of_pinion.is_some()).flat_map(|effect| {
        effect.lines.iter().take(MARKED).map(|(label, order)| Label { x: *order, text: marked(label, effect) })
    });
    let labels: Vec<Label> = marks.filter(|label| label.x < top).collect();
    let y = format!("amplitude, dB re 1 {}", crate::text::name(&outcome.unit));
    let svg = spectrum(&series, &labels, 1.0, SPAN_DB, Axes { x: "order of the pinion", y: &y })?;
    let (run, channel) = picture.place;
    let caption = format!(
        "Run {run}, channel {channel} ({}), all turns; strongest lines of the families marked, those of an order of neither shaft by that order.",
        crate::text::name(&picture.name)
    );
    Ok(page.picture(&svg, &caption))
}

/// The squared envelope spectrum of the band that shows a comb of impacts best.
fn envelope(page: Report, own: &Impacts) -> Result<Report> {
    // The picture takes amplitudes.
    let shown: Vec<(f64, f64)> =
        own.spectrum.iter().filter(|(_, over)| *over > 0.0).map(|(o, over)| (*o, over.sqrt())).collect();
    let labels: Vec<Label> = own.lines().into_iter().map(|(text, x)| Label { x, text }).collect();
    let axes = Axes { x: "order of the pinion", y: "power over its floor, dB" };
    let svg = spectrum(&[Series::new("squared envelope", shown)], &labels, 1.0, ENVELOPE_DB, axes)?;
    let caption = format!(
        "Squared envelope, {:.0} to {:.0} Hz of run {}, channel {} of those searched; harmonics of order {:.4} marked.",
        own.hz[0], own.hz[1], own.place.0, own.place.1, own.reading.base
    );
    Ok(page.picture(&svg, &caption))
}

/// A line's place in words that tell whose it is: with several orders of neither shaft "1 o" would be any of theirs.
fn marked(label: &str, effect: &Effect) -> String {
    let Some(base) = effect.order_of_pinion else { return label.to_owned() };
    let words = label.split(' ').map(|word| if word == "o" { format!("x {base:.3}") } else { word.to_owned() });
    words.collect::<Vec<_>>().join(" ")
}

fn family(page: Report, effect: &Effect) -> Report {
    let v = &effect.evidence;
    let mut rows = vec![
        vec!["family, shaft".to_owned(), format!("{}, {}", effect.family, effect.shaft)],
        vec!["order of the pinion".into(), effect.order_of_pinion.map_or("-".into(), |o| format!("{o:.4}"))],
        vec!["frequency, Hz".into(), effect.frequency_hz.map_or("-".into(), |f| format!("{f:.3}"))],
        vec!["evidence, nats".into(), format!("{:.1}", v.ln_bayes)],
        vec!["chance in the whole search".into(), super::view::chance(v.p_value)],
        vec![
            format!("held-out gain as {}, % of the power", effect.predicts),
            format!("{:.3}", 100.0 * v.held_out_gain),
        ],
        vec!["evidence on the held-out turns, nats".into(), format!("{:.1}", v.held_out_ln_bayes)],
    ];
    for (name, p) in &effect.parameters {
        let name = name.replace('_', " ");
        rows.push(vec![name, format!("{:.4} ({:.4} to {:.4}) {}", p.value, p.ci95[0], p.ci95[1], p.unit)]);
    }
    let lines: Vec<String> = effect.lines.iter().map(|(label, order)| format!("{label} at {order:.3}")).collect();
    rows.push(vec!["lines that stand".into(), lines.join(", ")]);
    let page = page.table(&format!("{}: {}", effect.verdict, effect.name), &["", ""], &rows);
    match &effect.remark {
        Some(remark) => page.note(remark),
        None => page,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_tell_whose_line_it_is() {
        let mut effect = Effect { order_of_pinion: Some(2.384), ..Effect::default() };
        assert_eq!(marked("2 o", &effect), "2 x 2.384");
        assert_eq!(marked("3 mesh + 1 o - 1 pinion", &effect), "3 mesh + 1 x 2.384 - 1 pinion");
        assert_eq!(marked("2 pinion", &effect), "2 pinion");
        effect.order_of_pinion = None;
        assert_eq!(marked("2 f", &effect), "2 f");
    }
}
