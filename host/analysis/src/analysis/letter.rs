//! The analysis as a letter: what was measured, what stands out of the mesh, what to do next, and the same as one table
//! over all channels.

use super::sidebands::Harmonic;
use super::unexplained::Found;
use super::view::{Table, figure};
use super::{ChannelOutcome, Outcome};
use crate::report::advice;
use crate::report::letter::{About, hertz, list};

/// Orders whose ratio is nearer to 1 than this are one in two channels.
const SAME: f64 = 0.005;
/// Orders named in the letter.
const NAMED: usize = 3;
/// Depth of a modulation worth a word.
const DEEP: f64 = 0.1;

/// An order with the channel in which it is strongest.
struct Seen<'a> {
    found: &'a Found,
    channel: &'a ChannelOutcome,
    in_envelope: bool,
    speed_hz: f64,
    channels: usize,
}

/// Orders of all channels, each where it is strongest; those of the spectrum first, most energy first.
fn seen(outcome: &Outcome) -> Vec<Seen<'_>> {
    let mut all: Vec<Seen> = Vec::new();
    for run in &outcome.runs {
        for channel in &run.channels {
            let own = &channel.unexplained;
            let both = own.spectrum.iter().map(|f| (f, false)).chain(own.envelope.iter().map(|f| (f, true)));
            for (found, in_envelope) in both {
                let base = found.family.base_order;
                let is_same = |other: &&mut Seen| {
                    other.in_envelope == in_envelope && (other.found.family.base_order / base - 1.0).abs() < SAME
                };
                match all.iter_mut().find(is_same) {
                    Some(other) => {
                        other.channels += 1;
                        if found.family.rms > other.found.family.rms {
                            (other.found, other.channel, other.speed_hz) = (found, channel, run.speed.mean_hz);
                        }
                    }
                    None => all.push(Seen { found, channel, in_envelope, speed_hz: run.speed.mean_hz, channels: 1 }),
                }
            }
        }
    }
    all.sort_by(|a, b| a.in_envelope.cmp(&b.in_envelope).then(b.found.family.rms.total_cmp(&a.found.family.rms)));
    all
}

/// Three sentences.
pub fn sentences(outcome: &Outcome, about: &About) -> Vec<String> {
    let mut letter: Vec<String> = Some(about.how.clone()).filter(|how| !how.is_empty()).into_iter().collect();
    letter.extend(super::view::without_mesh(outcome));
    let all = seen(outcome);
    letter.push(found(outcome, &all));
    letter.push(next(&all));
    letter
}

fn found(outcome: &Outcome, all: &[Seen]) -> String {
    let chance = outcome.runs.iter().flat_map(|run| &run.channels).map(|channel| channel.unexplained.false_alarm);
    let chance = 100.0 * chance.fold(0.0, f64::max);
    if all.is_empty() {
        let modulated = modulation(outcome);
        return format!(
            "Beside the mesh no order stands out (noise alone gives one with {chance:.0} % per spectrum){modulated}."
        );
    }
    let clause = |seen: &Seen| {
        let order = seen.found.family.base_order;
        let where_seen = if seen.in_envelope { ", in the envelope" } else { "" };
        let name = crate::text::name(&seen.channel.name);
        format!("{order:.3} x the pinion ({}{where_seen}, strongest in {name})", hertz(order * seen.speed_hz))
    };
    let clauses: Vec<String> = all.iter().take(NAMED).map(clause).collect();
    let more = if all.len() > NAMED { format!(" and {} more in the table", all.len() - NAMED) } else { String::new() };
    format!(
        "The mesh does not explain {}{more}; noise alone gives any with {chance:.0} % per spectrum{}.",
        list(&clauses),
        modulation(outcome)
    )
}

/// The deepest modulation once per turn, where it is worth a word.
fn modulation(outcome: &Outcome) -> String {
    let harmonics = outcome.runs.iter().flat_map(|run| &run.channels).flat_map(|channel| &channel.mesh);
    let depth = |harmonic: &Harmonic| {
        let of = |pairs: &[super::sidebands::Pair]| pairs.first().and_then(|pair| pair.amplitude_index);
        let both = [(of(&harmonic.pinion), "pinion"), (of(&harmonic.gear), "gear")];
        both.into_iter().filter_map(|(depth, shaft)| Some((depth?, shaft))).max_by(|a, b| a.0.total_cmp(&b.0))
    };
    let deepest = harmonics.filter(|h| h.number == 1).filter_map(depth).max_by(|a, b| a.0.total_cmp(&b.0));
    match deepest.filter(|(depth, _)| *depth > DEEP) {
        Some((depth, shaft)) => {
            format!("; the mesh swells once per turn of the {shaft} by {:.0} %, as runout does", 100.0 * depth)
        }
        None => String::new(),
    }
}

fn next(all: &[Seen]) -> String {
    if all.is_empty() {
        return "Next: keep this record as the reference; `meshband diagnose RECORD` says what it would have \
         found."
            .into();
    }
    let look = if all.iter().any(|seen| seen.in_envelope) { advice::for_name("bearing") } else { advice::for_name("") };
    format!(
        "Next: {}; `meshband diagnose RECORD` looks for causes and says how sure they are; {}.",
        look.look, look.when
    )
}

/// One row per order.
pub fn findings(outcome: &Outcome) -> Table {
    let row = |seen: &Seen| {
        let family = &seen.found.family;
        let [strength, unit] = if seen.in_envelope {
            [format!("{:.1}", 100.0 * family.rms), "% of the band's power".into()]
        } else {
            [figure(family.rms), outcome.unit.clone()]
        };
        vec![
            format!("{:.4}", family.base_order),
            format!("{:.1}", family.base_order * seen.speed_hz),
            if seen.in_envelope { "envelope" } else { "spectrum" }.into(),
            crate::text::name(&seen.channel.name),
            seen.channels.to_string(),
            strength,
            unit,
            family.members.len().to_string(),
        ]
    };
    let head =
        vec!["order", "Hz at this speed", "seen in", "strongest in", "channels", "strength (RMS)", "unit", "lines"];
    (head, seen(outcome).iter().map(row).collect())
}
