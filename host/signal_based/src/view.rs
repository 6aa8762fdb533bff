//! The answer in words: level and headline first, then errors, families, limits, what is left.

use super::accept::LEAST_CHANCE;
use super::limits;
use super::outcome::{Effect, Outcome};
use crate::terminal;

/// Lines shown of a family, limits shown.
const LINES: usize = 8;

/// Head and rows of a table.
pub type Table = (Vec<&'static str>, Vec<Vec<String>>);

/// The whole answer.
pub fn text(outcome: &Outcome) -> String {
    let mut out = format!("signal-based inference: {}\n", outcome.headline);
    if !outcome.to_raise_the_level.is_empty() {
        out += &format!("for model-based inference: {}\n", outcome.to_raise_the_level.join("; "));
    }
    for note in &outcome.notes {
        out += &format!("note: {note}\n");
    }
    out += &format!("split: {}\n", outcome.split.kind);
    out += &shown(errors(outcome));
    if outcome.error.errors.per_channel.len() > 1 {
        out += &shown(channels(outcome));
    }
    for effect in &outcome.effects {
        out += &of_effect(effect);
    }
    if let Some(bearing) = &outcome.bearing {
        let parts: Vec<String> = bearing.parts.iter().map(|(order, part)| format!("{order:.4} {part}")).collect();
        out += &format!(
            "bearing on the {}'s shaft: {} elements, ratio {:.4}; {}; worst distance {:.2} %\n",
            bearing.shaft,
            bearing.elements,
            bearing.ratio,
            parts.join(", "),
            100.0 * bearing.worst
        );
    }
    if let Some(law) = &outcome.slip {
        out += &format!("{}\n", law.sentence());
        out += &shown(law.table());
    }
    out += &format!(
        "search: {} candidates; probability of any false family {:.2}\n",
        outcome.candidates_tried, outcome.false_alarm
    );
    out += &shown(judged(outcome));
    out += &shown(limits(outcome));
    for left in &outcome.unexplained {
        out += &format!("unexplained: {} ({:.2} % of the variance)\n", left.description, 100.0 * left.variance_share);
    }
    out
}

fn shown((head, rows): Table) -> String {
    if rows.is_empty() { String::new() } else { terminal::table(&head, &rows) }
}

/// An error; a dash where there is none.
fn figure(x: f64) -> String {
    if x.is_nan() { "-".into() } else { format!("{x:.4}") }
}

/// Errors in three stages.
pub fn errors(outcome: &Outcome) -> Table {
    let e = &outcome.error.errors;
    let row = |name: &str, s: &super::errors::Stages| {
        let figures = [s.declared, s.calibrated, s.corrected, s.noise_floor].map(figure);
        [vec![name.to_owned()], figures.to_vec()].concat()
    };
    let rows = vec![
        row("waveform, fitted", &e.fit),
        row("waveform, held out", &e.held_out),
        row("share of power, held out", &e.held_out_power),
    ];
    (vec!["error", "declared", "calibrated", "corrected", "noise floor"], rows)
}

/// Channel by channel.
pub fn channels(outcome: &Outcome) -> Table {
    let row = |c: &super::errors::ChannelError| {
        let w = c.waveform;
        let own = outcome.pictures.iter().find(|picture| picture.place.1 == c.channel);
        let name = own.map_or_else(String::new, |own| format!(" {}", crate::text::name(&own.name)));
        let mut row = vec![format!("{}{name}", c.channel), if c.searched { "searched" } else { "held out" }.to_owned()];
        row.extend([w.declared, w.calibrated, w.corrected, w.noise_floor, c.unexplained_share].map(figure));
        row.push(format!("{:.4} / {:.4}", c.control[0], c.control[1]));
        let named = c.named_lines;
        row.push(format!("{:.4}", named.outside));
        row.push(format!("{:.4} / {:.4}", named.control[0], named.control[1]));
        row
    };
    let rows = outcome.error.errors.per_channel.iter().map(row).collect();
    (
        vec![
            "channel",
            "",
            "declared",
            "calibrated",
            "corrected",
            "noise floor",
            "unexplained share of power",
            "surrogates take, median / most",
            "outside the named lines",
            "surrogates of the lines take, median / most",
        ],
        rows,
    )
}

/// A probability, never as zero.
pub fn chance(p: f64) -> String {
    if p <= LEAST_CHANCE { format!("below {LEAST_CHANCE:e}") } else { format!("{p:.1e}") }
}

fn of_effect(effect: &Effect) -> String {
    let seat = match (effect.order_of_pinion, effect.frequency_hz) {
        (Some(order), _) => format!("order {order:.4}"),
        (_, Some(hz)) => format!("{hz:.3} Hz"),
        _ => String::new(),
    };
    let v = &effect.evidence;
    let mut out = format!("{}: {} [{}, {}] {seat}\n", effect.verdict, effect.name, effect.family, effect.shaft);
    out += &format!(
        "    evidence {:.1} nats, chance {}, held out {:.1} nats and {:.2} % of the power as {}\n",
        v.ln_bayes,
        chance(v.p_value),
        v.held_out_ln_bayes,
        100.0 * v.held_out_gain + 0.0,
        effect.predicts
    );
    for (name, value) in &effect.parameters {
        let name = name.replace('_', " ");
        out +=
            &format!("    {name} {:.4} ({:.4} to {:.4}) {}\n", value.value, value.ci95[0], value.ci95[1], value.unit);
    }
    let lines: Vec<String> =
        effect.lines.iter().take(LINES).map(|(label, order)| format!("{label} at {order:.3}")).collect();
    out += &format!("    {} lines: {}\n", effect.lines.len(), lines.join(", "));
    for sidebands in &effect.carries {
        out += &format!("    {sidebands}\n");
    }
    if let Some(remark) = &effect.remark {
        out += &format!("    {remark}\n");
    }
    out
}

/// Families judged, with why they were refused.
pub fn judged(outcome: &Outcome) -> Table {
    let row = |j: &super::outcome::Judged| {
        vec![
            j.family.clone(),
            format!("{:.1}", j.ln_bayes),
            format!("{:.1}", j.surrogates.highest),
            chance(j.surrogates.false_alarm),
            j.refused.clone().unwrap_or_else(|| "adopted".into()),
        ]
    };
    let rows = outcome.surrogates.iter().map(row).collect();
    (vec!["family judged", "nats", "best surrogate", "chance", "verdict"], rows)
}

/// What would have been found.
pub fn limits(outcome: &Outcome) -> Table {
    let percent = |x: Option<f64>| match x {
        None => "not tried: a finding has these lines, or even 6.5 times is not seen".into(),
        Some(x) if x <= limits::MIN_STRENGTH => format!("{:.3} % or less", 100.0 * limits::MIN_STRENGTH),
        Some(x) => format!("{:.3} %", 100.0 * x),
    };
    let row = |l: &super::outcome::Limit| {
        vec![l.family.clone(), percent(l.found_in_half), percent(l.found_in_90_percent), l.unit.clone()]
    };
    let rows = outcome.limits.iter().map(row).collect();
    (
        vec![
            "not found; would have been, from",
            "in half of all places",
            "in 90 % of all places",
            "strength of each line",
        ],
        rows,
    )
}
