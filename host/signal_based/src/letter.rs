//! The answer as a letter: three sentences and the table of findings, with the lines marked that are theirs and nobody
//! else's.

use super::outcome::{Effect, Outcome, Picture};
use super::view::Table;
use meshband_common::report::advice;
use meshband_common::report::letter::{About, hertz, list, odds};
use meshband_common::report::owners::{Line, Owners, line_at};
use meshband_common::report::plot::Label;

/// Lines of one family marked.
const MAX_MARKED_LINES: usize = 6;
/// Mesh harmonics marked.
const HARMONICS: u32 = 6;
/// Least distance of two marks, share of the picture's width.
const MIN_MARK_SPACING_SHARE: f64 = 1.0 / 60.0;
/// Share of the RMS on the held-out turns that stays, and times the noise's, from which the letter says so.
const MIN_RESIDUAL_SHARE: f64 = 0.3;
const MIN_RESIDUAL_NOISE_RATIO: f64 = 2.0;
/// Height over what lies beside it from which a line is marked, dB.
const MIN_LINE_HEIGHT_DB: f64 = 10.0;
/// Least distance of a family's line from a mesh harmonic, orders.
const MIN_MESH_DISTANCE_ORDERS: f64 = 0.06;

/// What was measured, what was found and how sure that is, what to do next.
pub fn sentences(outcome: &Outcome, about: &About) -> Vec<String> {
    let mut letter = Vec::new();
    if !about.how.is_empty() {
        letter.push(about.how.clone());
    }
    if outcome.headline.starts_with("abstained") {
        let why = outcome.notes.first().cloned().unwrap_or_default();
        let faults: Vec<String> = outcome.effects.iter().map(|effect| plain(&effect.name)).collect();
        let also = if faults.is_empty() { String::new() } else { format!("; beside it: {}", list(&faults)) };
        letter.push(format!("Nothing is concluded from this record: {why}{also}."));
        letter.push(
            "Next: check the tooth counts and the tachometer's shaft and pulses, import the recording again with what \
             is right, and measure again only where the recording itself is at fault; no finding and no absence of one \
             counts until then."
                .into(),
        );
        return letter;
    }
    letter.push(found(outcome, about));
    letter.extend(unexplained(outcome));
    letter.push(next(outcome));
    letter
}

fn found(outcome: &Outcome, about: &About) -> String {
    if outcome.effects.is_empty() {
        let odds = odds(outcome.false_alarm);
        return format!(
            "Nothing was found beyond the lines of sound gears; the search was set to a chance of {odds} of a false \
             finding, and what it would have seen stands under \"What would have been found\"."
        );
    }
    // What has a name first, then what may be one of several, then lines without a cause.
    let grade = |effect: &&Effect| match effect.verdict.as_str() {
        "named" => 0,
        "ambiguous" => 1,
        _ => 2,
    };
    let mut effects: Vec<&Effect> = outcome.effects.iter().collect();
    effects.sort_by_key(grade);
    let clauses: Vec<String> = effects.into_iter().map(|effect| clause(effect, about)).collect();
    let surest = outcome.effects.iter().map(|effect| effect.evidence.p_value).fold(0.0, f64::max);
    format!("Found: {}. The chance that noise alone gives such a finding is {}.", list(&clauses), odds(surest))
}

/// What stays unexplained, where that is most of the vibration and no noise.
fn unexplained(outcome: &Outcome) -> Option<String> {
    let held = outcome.held_out;
    (held.corrected > MIN_RESIDUAL_SHARE && held.corrected > MIN_RESIDUAL_NOISE_RATIO * held.noise_floor).then(|| {
        format!(
            "{:.0} % of the vibration's RMS stays unexplained, where noise would leave {:.0} %: what makes it has no \
             name here; `meshband analyse` lists its strongest lines.",
            100.0 * held.corrected,
            100.0 * held.noise_floor
        )
    })
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
            Some(format!("{order:.3} x the {}{hz}", about.of()))
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
    // What must be done soonest leads; among equals what is named, then what is surest.
    let rank = |effect: &Effect| {
        let is_named = effect.verdict == "named";
        (advice::for_name(&effect.name).urgency, is_named, effect.evidence.ln_bayes)
    };
    let less = |a: &&Effect, b: &&Effect| {
        let (a, b) = (rank(a), rank(b));
        (a.0, a.1).cmp(&(b.0, b.1)).then(a.2.total_cmp(&b.2))
    };
    let Some(first) = outcome.effects.iter().max_by(less) else {
        return "Next: keep this record as the reference, and measure again at the usual interval, at this speed and \
         load."
            .into();
    };
    let advice = advice::for_name(&first.name);
    let others = outcome.effects.len() - 1;
    let rest = if others > 0 { " (for the other findings see the table)" } else { "" };
    let of = if others > 0 { format!(", for the {}", plain(&first.name)) } else { String::new() };
    format!("Next{of}: {}; {}{rest}.", advice.look, advice.when)
}

/// One row per finding.
pub fn findings(outcome: &Outcome, about: &About) -> Table {
    let row = |effect: &Effect| {
        let order = effect.order_of_pinion;
        let hz = effect.frequency_hz.or_else(|| about.hz(order?));
        let strongest = strongest(outcome, effect);
        let (sensor, strength, over) = match strongest {
            Some((picture, line)) => {
                // What the fit says of it, where it does: the picture's line has its neighbours' noise in it.
                let fitted = effect.parameters.get("strongest_line").map_or(line.amplitude, |own| own.value);
                (crate::text::name(&picture.name), format!("{fitted:.4}"), format!("{:.0}", line.over_floor_db))
            }
            None => in_envelope(outcome, effect).unwrap_or_else(|| ("-".to_owned(), "-".into(), "-".into())),
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
        "order",
        "Hz at this speed",
        "strongest in",
        "strongest line",
        "over the noise beside it, dB",
        "chance of noise",
        "look at",
    ];
    (head, outcome.effects.iter().map(row).collect())
}

/// Sensor, depth and band of impacts.
fn in_envelope(outcome: &Outcome, effect: &Effect) -> Option<(String, String, String)> {
    let value = |name: &str| effect.parameters.get(name).map(|own| own.value);
    let channel = value("channel")? as usize;
    let name = outcome.pictures.iter().find(|own| own.place.1 == channel).map(|own| crate::text::name(&own.name));
    let band = format!("envelope, {:.0} to {:.0} Hz", value("band_low")?, value("band_high")?);
    let sensor = format!("{} ({band})", name.unwrap_or_else(|| format!("channel {channel}")));
    Some((sensor, format!("{:.2} of the band's mean power", value("depth")?), "-".into()))
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
    let mut owners = Owners::new((MIN_MARK_SPACING_SHARE * top).max(MIN_MESH_DISTANCE_ORDERS));
    let stands =
        |order: f64| line_at(&picture.spectra[0], order).is_some_and(|line| line.over_floor_db > MIN_LINE_HEIGHT_DB);
    for harmonic in 1..=HARMONICS {
        let order = pinion_teeth.map(|teeth| f64::from(harmonic * teeth));
        if let Some(order) = order.filter(|&order| order < top && stands(order)) {
            owners.claim(order, format!("{harmonic} x mesh"));
        }
    }
    for effect in outcome.effects.iter().filter(|effect| is_in_the_spectrum(effect)) {
        for (label, order) in
            effect.lines.iter().filter(|(_, order)| *order < top && stands(*order)).take(MAX_MARKED_LINES)
        {
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
