//! The answer as a page: a letter with the table of findings, spectra with the lines marked, errors in three stages;
//! evidence and limits behind.

use super::impacts::Impacts;
use super::letter;
use super::outcome::{Effect, Outcome, Picture};
use super::view;
use crate::Result;
use meshband_common::report::Report;
use meshband_common::report::letter::About;
use meshband_common::report::plot::{Axes, Label, Series, spectrum};

/// Channels drawn on the letter, and in all.
const DRAWN_CHANNELS: [usize; 2] = [1, 8];
/// Decibels shown.
const SPAN_DB: f64 = 90.0;
/// Decibels shown of an envelope's spectrum.
const ENVELOPE_DB: f64 = 40.0;

/// The page of a record that `about` describes.
///
/// # Errors
/// A picture that cannot be drawn.
pub fn report(outcome: &Outcome, about: &About) -> Result<Report> {
    let mut page =
        Report::new(&format!("Gear and bearings: {}", outcome.record), "What the record shows beyond its mesh")
            .verdict(letter::sentences(outcome, about))
            .facts(about.facts.clone());
    let caption = format!("Findings; the strongest line in {}.", crate::text::name(&outcome.unit));
    page = table(page.section("Findings"), &caption, letter::findings(outcome, about));
    if outcome.effects.is_empty() {
        page = page.text("None: nothing of the library stands out of this record.");
    }
    for note in &outcome.notes {
        page = page.note(note);
    }
    let strongest = strongest_first(outcome);
    for picture in strongest.iter().take(DRAWN_CHANNELS[0]) {
        page = drawn(page, picture, outcome, about)?;
    }
    for own in &outcome.impacts {
        page = envelope(page, own, outcome)?;
    }
    page = errors(page, outcome);
    page = page.appendix("All figures");
    for picture in strongest.iter().take(DRAWN_CHANNELS[1]).skip(DRAWN_CHANNELS[0]) {
        page = drawn(page, picture, outcome, about)?;
    }
    Ok(details(page, outcome))
}

/// Pictures, the one with the strongest line of the first finding before the others.
fn strongest_first(outcome: &Outcome) -> Vec<&Picture> {
    let mut pictures: Vec<&Picture> = outcome.pictures.iter().collect();
    let place = outcome.effects.iter().find_map(|effect| letter::strongest(outcome, effect)).map(|(own, _)| own.place);
    pictures.sort_by_key(|picture| Some(picture.place) != place);
    pictures
}

/// The three stages, each with what it says.
fn errors(page: Report, outcome: &Outcome) -> Report {
    let held = outcome.held_out;
    let percent = |error: f64| format!("{:.1} %", 100.0 * error);
    let page = page.section("How well the record is described");
    if held.declared.is_nan() {
        return page
            .text("No turns were held out of the fit: the record has too few. Nothing here was tried on others.");
    }
    page.text(&format!(
        "On turns that took no part in the fit, {} of the waveform's RMS stays unexplained with the mesh alone, \
             as declared.",
        percent(held.declared)
    ))
    .text(&format!(
        "With its strengths adjusted to the record {} stay; with the findings above {}; where nothing but noise \
             is left it would be {}.",
        percent(held.calibrated),
        percent(held.corrected),
        percent(held.noise_floor)
    ))
}

fn details(mut page: Report, outcome: &Outcome) -> Report {
    if !outcome.to_raise_the_level.is_empty() {
        page = page.text(&format!(
            "This is signal-based inference: lines, not forces. For model-based inference the record lacks: {}.",
            outcome.to_raise_the_level.join("; ")
        ));
    }
    page = page
        .section("Error in three stages")
        .text(&format!("Split: {}. {}.", outcome.split.kind, outcome.error.metric));
    page = table(page, "", view::errors(outcome));
    page = table(page, "Held-out turns, channel by channel.", view::channels(outcome));
    if !outcome.effects.is_empty() {
        page = page.section("Families found");
    }
    for effect in &outcome.effects {
        page = family(page, effect);
    }
    if !outcome.surrogates.is_empty() {
        page = page.section("Families judged").text(
            "Logarithm of the Bayes factor after the choice, the highest of the \
            same search with the spacing moved by 1 to 6 %, and the probability of such a score by chance in the whole \
            search.",
        );
    }
    page = table(page, "", view::judged(outcome));
    if !outcome.limits.is_empty() {
        page = page.section("What would have been found");
    }
    page = table(
        page,
        "Strength of each line of a family, found in half and in nine of ten places of this record.",
        view::limits(outcome),
    );
    page = page.section("What stays unexplained");
    for left in &outcome.unexplained {
        page = page.text(&format!("{}: {:.2} % of the variance.", left.description, 100.0 * left.variance_share));
    }
    page
}

fn table(page: Report, caption: &str, (head, rows): view::Table) -> Report {
    if rows.is_empty() { page } else { page.table(caption, &head, &rows) }
}

fn drawn(page: Report, picture: &Picture, outcome: &Outcome, about: &About) -> Result<Report> {
    let names = ["record", "residual, calibrated", "residual, corrected"];
    let series: Vec<Series> =
        names.iter().zip(&picture.spectra).map(|(name, points)| Series::new(name, points.clone())).collect();
    let labels = letter::marks(outcome, picture, about.pinion_teeth);
    let y = format!("amplitude, dB re 1 {}", crate::text::name(&outcome.unit));
    let svg = spectrum(&series, &labels, 1.0, SPAN_DB, Axes { x: &format!("order of the {}", about.of()), y: &y })?;
    let (run, channel) = picture.place;
    let caption = format!(
        "Run {run}, channel {channel} ({}), all turns. Marked where they stand here: {}the strongest lines of the \
         findings; no line has two marks.",
        crate::text::name(&picture.name),
        if about.pinion_teeth.is_some() { "mesh harmonics, and " } else { "" }
    );
    Ok(page.picture(&svg, &caption))
}

/// The squared envelope spectrum of the band that shows a comb of impacts best.
fn envelope(page: Report, own: &Impacts, outcome: &Outcome) -> Result<Report> {
    let channel = outcome.split.searched_channels.get(own.place.1).copied().unwrap_or(own.place.1);
    let name = outcome.pictures.iter().find(|picture| picture.place.1 == channel);
    let name = name.map_or_else(String::new, |picture| format!(" ({})", crate::text::name(&picture.name)));
    // The picture takes amplitudes.
    let shown: Vec<(f64, f64)> =
        own.spectrum.iter().filter(|(_, over)| *over > 0.0).map(|(o, over)| (*o, over.sqrt())).collect();
    let labels: Vec<Label> = own.lines().into_iter().map(|(text, x)| Label { x, text }).collect();
    let axes = Axes { x: "order of the pinion", y: "power over its floor, dB" };
    let svg = spectrum(&[Series::new("squared envelope", shown)], &labels, 1.0, ENVELOPE_DB, axes)?;
    let caption = format!(
        "Squared envelope, {:.0} to {:.0} Hz of run {}, channel {channel}{name}; harmonics of order {:.4} marked.",
        own.hz[0], own.hz[1], own.place.0, own.reading.base
    );
    Ok(page.picture(&svg, &caption))
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
