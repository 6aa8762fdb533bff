//! The answer as a letter: three sentences and the table of findings, with the lines marked that are theirs and nobody
//! else's.

use super::outcome::{Effect, Outcome, Picture};
use super::view::Table;
use meshband_common::report::advice;
use meshband_common::report::letter::{About, hertz, list, odds};
use meshband_common::report::owners::{Line, Owners, line_at};
use meshband_common::report::plot::Label;

/// Lines of one family marked.
const MARKED: usize = 6;
/// Mesh harmonics marked.
const HARMONICS: u32 = 6;
/// Least distance of two marks, share of the picture's width.
const APART: f64 = 1.0 / 60.0;
/// Least distance of a family's line from a mesh harmonic, orders.
const OF_THE_MESH: f64 = 0.06;

/// What was measured, what was found and how sure that is, what to do next.
pub fn sentences(outcome: &Outcome, about: &About) -> Vec<String> {
    let mut letter = Vec::new();
    if !about.how.is_empty() {
        letter.push(about.how.clone());
    }
    if outcome.headline.starts_with("abstained") {
        let why = outcome.notes.first().cloned().unwrap_or_default();
        letter.push(format!("Nothing is concluded from this record: {why}."));
        letter.push("Next: mend that and measure again; no finding and no absence of one counts until then.".into());
        return letter;
    }
    letter.push(found(outcome, about));
    letter.push(next(outcome));
    letter
}

fn found(outcome: &Outcome, about: &About) -> String {
    if outcome.effects.is_empty() {
        let odds = odds(outcome.false_alarm);
        return format!(
            "Nothing was found beyond the lines of a sound pair of gears; the search was set to a chance of {odds} \
             of a false finding, and what it would have seen is in the table of limits."
        );
    }
    let clauses: Vec<String> = outcome.effects.iter().map(|effect| clause(effect, about)).collect();
    let surest = outcome.effects.iter().map(|effect| effect.evidence.p_value).fold(0.0, f64::max);
    format!("Found: {}. The chance that noise alone gives such a finding is {}.", list(&clauses), odds(surest))
}

/// One finding in a clause: what, where on the axis, how sure of the name.
fn clause(effect: &Effect, about: &About) -> String {
    let place = place(effect, about).map_or(String::new(), |place| format!(" at {place}"));
    let name = plain(&effect.name);
    match effect.verdict.as_str() {
        "named" => format!("{name}{place}"),
        "ambiguous" => format!("{name}{place} (this record cannot tell which)"),
        _ => format!("{name}{place} (lines that stand, without a cause that can be named)"),
    }
}

fn place(effect: &Effect, about: &About) -> Option<String> {
    match (effect.order_of_pinion, effect.frequency_hz) {
        (Some(order), _) => {
            let hz = about.hz(order).map_or(String::new(), |hz| format!(" ({})", hertz(hz)));
            Some(format!("{order:.3} x the pinion{hz}"))
        }
        (None, Some(hz)) => Some(hertz(hz)),
        (None, None) => None,
    }
}

/// Library names as words.
fn plain(name: &str) -> String {
    name.replace('-', " ")
}

fn next(outcome: &Outcome) -> String {
    let Some(first) = outcome.effects.iter().max_by(|a, b| a.evidence.ln_bayes.total_cmp(&b.evidence.ln_bayes)) else {
        return "Next: keep this record as the reference, and measure again at the usual interval, at this speed and \
         load."
            .into();
    };
    let advice = advice::for_name(&first.name);
    let others = outcome.effects.len() - 1;
    let rest = if others > 0 { " (for the other findings see the table)" } else { "" };
    format!("Next: {}; {}{rest}.", advice.look, advice.when)
}

/// One row per finding.
pub fn findings(outcome: &Outcome, about: &About) -> Table {
    let row = |effect: &Effect| {
        let order = effect.order_of_pinion;
        let hz = effect.frequency_hz.or_else(|| about.hz(order?));
        let strongest = strongest(outcome, effect);
        let (sensor, strength, over) = match strongest {
            Some((picture, line)) => (
                crate::text::name(&picture.name),
                format!("{:.3}", line.amplitude),
                format!("{:.0}", line.over_floor_db),
            ),
            None => ("all, as an envelope".to_owned(), "-".into(), "-".into()),
        };
        let interval = effect.parameters.get("order").map(|p| format!(" ({:.4} to {:.4})", p.ci95[0], p.ci95[1]));
        vec![
            format!("{}: {}", effect.verdict, plain(&effect.name)),
            order.map_or("-".into(), |order| format!("{order:.4}{}", interval.unwrap_or_default())),
            hz.map_or("-".into(), |hz| format!("{hz:.1}")),
            sensor,
            strength,
            over,
            odds(effect.evidence.p_value),
            advice::for_name(&effect.name).look.to_owned(),
        ]
    };
    let head = vec![
        "finding",
        "order of the pinion",
        "Hz at this speed",
        "strongest in",
        "strongest line",
        "over the noise beside it, dB",
        "chance of noise",
        "look at",
    ];
    (head, outcome.effects.iter().map(row).collect())
}

/// Whether a family's lines stand in the plain spectrum over orders.
fn is_in_the_spectrum(effect: &Effect) -> bool {
    matches!(effect.evidence.domain, None | Some("orders")) && effect.order_of_pinion.is_some()
}

/// Where the strongest of a family's lines stands, in what calibration leaves.
pub fn strongest<'a>(outcome: &'a Outcome, effect: &Effect) -> Option<(&'a Picture, Line)> {
    if !is_in_the_spectrum(effect) {
        return None;
    }
    let lines = outcome.pictures.iter().flat_map(|picture| {
        let at = move |(_, order): &(String, f64)| Some((picture, line_at(&picture.spectra[1], *order)?));
        effect.lines.iter().filter_map(at)
    });
    lines.max_by(|a, b| a.1.amplitude.total_cmp(&b.1.amplitude))
}

/// Marks of a picture: mesh harmonics first, then each family's own lines; no line twice, none over another.
pub fn marks(outcome: &Outcome, picture: &Picture, pinion_teeth: Option<u32>) -> Vec<Label> {
    let top = picture.spectra[0].last().map_or(0.0, |point| point.0);
    let mut owners = Owners::new((APART * top).max(OF_THE_MESH));
    for harmonic in 1..=HARMONICS {
        let order = pinion_teeth.map(|teeth| f64::from(harmonic * teeth));
        if let Some(order) = order.filter(|&order| order < top) {
            owners.claim(order, format!("{harmonic} x mesh"));
        }
    }
    for effect in outcome.effects.iter().filter(|effect| is_in_the_spectrum(effect)) {
        for (label, order) in effect.lines.iter().filter(|(_, order)| *order < top).take(MARKED) {
            owners.claim(*order, marked(label, effect));
        }
    }
    owners.labels()
}

/// A line's place in words that tell whose it is: with several orders of neither shaft "1 o" would be any of theirs.
fn marked(label: &str, effect: &Effect) -> String {
    let Some(base) = effect.order_of_pinion else { return label.to_owned() };
    let words = label.split(' ').map(|word| if word == "o" { format!("x {base:.3}") } else { word.to_owned() });
    words.collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::outcome::Evidence;

    #[test]
    fn marks_tell_whose_line_it_is() {
        let mut effect = Effect { order_of_pinion: Some(2.384), ..Effect::default() };
        assert_eq!(marked("2 o", &effect), "2 x 2.384");
        assert_eq!(marked("3 mesh + 1 o - 1 pinion", &effect), "3 mesh + 1 x 2.384 - 1 pinion");
        assert_eq!(marked("2 pinion", &effect), "2 pinion");
        effect.order_of_pinion = None;
        assert_eq!(marked("2 f", &effect), "2 f");
    }

    #[test]
    fn ref_a_finding_is_a_clause_with_its_frequency_and_how_sure_its_name_is() {
        let about = About { speed_hz: Some(24.6), ..About::default() };
        let evidence = Evidence { domain: Some("envelope"), ..Evidence::default() };
        let effect = Effect {
            verdict: "named".into(),
            name: "bearing-impacts".into(),
            order_of_pinion: Some(4.62),
            evidence,
            ..Effect::default()
        };
        assert_eq!(clause(&effect, &about), "bearing impacts at 4.620 x the pinion (113.7 Hz)");
        assert!(!is_in_the_spectrum(&effect), "an envelope's orders are no lines of the spectrum");
    }
}
