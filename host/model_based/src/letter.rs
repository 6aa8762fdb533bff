//! The answer as a letter: what was measured, what was found and how sure, what to do next; and the findings as one
//! table.

use super::outcome::{Effect, NextMeasurement, Outcome};
use super::replay::Replay;
use meshband_common::report::advice;
use meshband_common::report::letter::{About, hertz, list};
use meshband_common::report::owners::{Line, line_at};

/// Three sentences.
pub fn sentences(outcome: &Outcome, about: &About) -> Vec<String> {
    let mut letter: Vec<String> = Some(about.how.clone()).filter(|how| !how.is_empty()).into_iter().collect();
    letter.push(found(outcome, about));
    letter.push(next(outcome));
    letter
}

fn found(outcome: &Outcome, about: &About) -> String {
    let held = outcome.error.held_out_runs.shaft_synchronous;
    let errors = format!(
        "on runs that took no part in the fit, {:.1} % of the signal that is locked to the shafts stays \
         unexplained, where noise alone leaves {:.1} %",
        100.0 * held.corrected,
        100.0 * held.noise_floor
    );
    if outcome.effects.is_empty() {
        return format!("The machine as declared explains the record: nothing else was found; {errors}.");
    }
    let clauses: Vec<String> = outcome.effects.iter().map(|effect| clause(effect, about)).collect();
    format!("Found: {}; {errors}.", list(&clauses))
}

fn clause(effect: &Effect, about: &About) -> String {
    let place = match (effect.order_of_pinion, effect.frequency_hz) {
        (Some(order), _) => {
            let hz = about.hz(order).map_or(String::new(), |hz| format!(" ({})", hertz(hz)));
            format!(" at {order:.3} x the pinion{hz}")
        }
        (None, Some(hz)) => format!(" at {}", hertz(hz)),
        (None, None) => String::new(),
    };
    let name = effect.name.replace('-', " ");
    match effect.verdict.as_str() {
        "named" => format!("{name}{place}"),
        "ambiguous" => format!("{name}{place} (this record cannot tell which)"),
        "abstained" => {
            let why = effect.withheld_because.as_deref().unwrap_or("something contradicts it");
            format!("something like {name}{place}, but no name is given: {why}")
        }
        _ => format!("{name}{place} (without a cause that can be named)"),
    }
}

fn next(outcome: &Outcome) -> String {
    let measurement = outcome.effects.iter().find_map(|effect| effect.next_measurement.as_ref());
    if let Some(next) = measurement {
        return format!("Next: {}.", run_to_make(next));
    }
    if let Some(experiment) = outcome.effects.iter().find_map(|effect| effect.deciding_experiment.as_ref()) {
        return format!("Next: {experiment}.");
    }
    match outcome.effects.first() {
        None => "Next: keep this record as the reference; the table of limits says what would have been \
         found."
            .into(),
        Some(first) => {
            let advice = advice::for_name(&first.name);
            format!("Next: {}; {}.", advice.look, advice.when)
        }
    }
}

fn run_to_make(next: &NextMeasurement) -> String {
    let decides = if next.decides { "decides" } else { "tells most" };
    format!(
        "measure {:.0} s at {:.2} Hz ({:.0} rpm) and {:.1} N m: that {decides} between the causes in question ({} \
         among them)",
        next.seconds,
        next.speed_hz,
        60.0 * next.speed_hz,
        next.torque_n_m,
        next.against.replace('-', " ")
    )
}

/// Head and rows of the findings.
pub fn findings(outcome: &Outcome, replay: &Replay, about: &About) -> (Vec<&'static str>, Vec<Vec<String>>) {
    let row = |effect: &Effect| {
        let order = effect.order_of_pinion;
        let hz = effect.frequency_hz.or_else(|| about.hz(order?));
        let (sensor, strength, over) = match hz.and_then(|_| strongest(outcome, replay, effect)) {
            Some((channel, line)) => {
                (format!("channel {channel}"), format!("{:.3}", line.amplitude), format!("{:.0}", line.over_floor_db))
            }
            None => ("-".into(), "-".into(), "-".into()),
        };
        let sure = effect.evidence.chance.as_ref().map_or("-".into(), ToString::to_string);
        vec![
            effect.verdict_and_name().replace('-', " "),
            order.map_or("-".into(), |order| format!("{order:.4}")),
            hz.map_or("-".into(), |hz| format!("{hz:.1}")),
            sensor,
            strength,
            over,
            sure,
            advice::for_name(&effect.name).look.to_owned(),
        ]
    };
    let head = vec![
        "finding",
        "order of the pinion",
        "Hz at this speed",
        "strongest in",
        "line, m/s2",
        "over the noise beside it, dB",
        "chance",
        "look at",
    ];
    (head, outcome.effects.iter().map(row).collect())
}

/// The channel in which the line at an effect's own place is strongest, in what the declared machine leaves of a
/// held-out run.
fn strongest(outcome: &Outcome, replay: &Replay, effect: &Effect) -> Option<(usize, Line)> {
    let &run = outcome.held_out_places().last()?;
    let base = &replay.declared;
    let shaft_hz = base.runs[run].angle.shaft_hz;
    let hz = effect.frequency_hz.or(effect.order_of_pinion.map(|order| order * shaft_hz))?;
    let bin = 1.0 / base.analyser.duration_s();
    let lines = (0..2).filter_map(|channel| {
        let bins = &replay.declared_residual[run][channel];
        let points: Vec<(f64, f64)> = bins.iter().enumerate().map(|(b, x)| (b as f64 * bin, x.norm())).collect();
        Some((channel, line_at(&points, hz)?))
    });
    lines.max_by(|a, b| a.1.amplitude.total_cmp(&b.1.amplitude))
}
