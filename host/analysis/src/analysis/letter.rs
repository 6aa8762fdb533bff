//! The analysis as a letter: what was measured, what stands out of the mesh, what to do next, and the same as one table
//! over all channels.

use super::sidebands::Harmonic;
use super::unexplained::Found;
use super::view::{Table, figure};
use super::{ChannelOutcome, Outcome, RunOutcome};
use crate::data_quality::Kind;
use crate::report::advice;
use crate::report::letter::{About, hertz, list};

/// Orders whose ratio is nearer to 1 than this are one in two channels.
const SAME_ORDER_SHARE: f64 = 0.005;
/// Orders named in the letter.
const MAX_NAMED_ORDERS: usize = 3;
/// Depth of a modulation worth a word, and the greatest that a modulation can have.
const MIN_DEPTH: f64 = 0.1;
const MAX_DEPTH: f64 = 1.0;
/// Share of the loudest channel's RMS, and share of its power locked to the shafts, below which a channel is silent.
const SILENT_SHARE: f64 = 3e-3;
const MAX_SILENT_LOCKED_SHARE: f64 = 0.1;
/// A shaft's line over the strongest mesh line from which it is named, dB.
const MIN_MESH_EXCESS_DB: f64 = 3.0;

/// An order with the channel in which it is strongest.
struct Seen<'a> {
    found: &'a Found,
    channel: &'a ChannelOutcome,
    in_envelope: bool,
    speed_hz: f64,
    channels: usize,
}

impl Seen<'_> {
    /// Whether more than one line of one channel speaks for it.
    fn is_firm(&self) -> bool {
        self.found.family.members.len() > 1 || self.channels > 1 || self.found.in_both
    }
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
                    other.in_envelope == in_envelope
                        && (other.found.family.base_order / base - 1.0).abs() < SAME_ORDER_SHARE
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

/// A few sentences: what was measured, how good the recording is, what stands out, what to do next.
pub fn sentences(outcome: &Outcome, about: &About) -> Vec<String> {
    let mut letter: Vec<String> = Some(about.how.clone()).filter(|how| !how.is_empty()).into_iter().collect();
    letter.extend(super::view::without_mesh(outcome));
    let remarks = || outcome.runs.iter().flat_map(|run| &run.remarks);
    if let Some(doubt) = remarks().find(|remark| remark.kind == Kind::MeshDoubtful) {
        letter.push(format!("Nothing is concluded from this record: {}.", doubt.text));
        letter.extend(recording(outcome));
        letter.push(
            "Next: check the tooth counts and the tachometer's shaft and pulses, and import the recording again with \
             what is right: every order below is counted from them."
                .into(),
        );
        return letter;
    }
    letter.extend(recording(outcome));
    let all = seen(outcome);
    let pattern = pattern(outcome);
    letter.extend(pattern.as_ref().map(|pattern| pattern.sentence.clone()));
    letter.push(found(outcome, &all));
    letter.push(next(&all, pattern.as_ref()));
    letter
}

/// What is wrong with the recording itself, channel by channel; nothing of a good one.
fn recording(outcome: &Outcome) -> Option<String> {
    let of_run = |run: &RunOutcome| {
        let faults = run.remarks.iter().filter_map(|remark| {
            let what = match remark.kind {
                Kind::Clipped => "is clipped",
                Kind::Constant => "stands still",
                Kind::Repeated => "repeats a block of samples",
                _ => return None,
            };
            let channel = remark.channel?;
            let own = run.channels.iter().find(|own| own.channel == channel);
            let name = own.map_or_else(String::new, |own| format!(" ({})", crate::text::name(&own.name)));
            Some(format!("channel {channel}{name} {what}"))
        });
        faults.collect::<Vec<_>>()
    };
    let mut faults: Vec<String> = outcome.runs.iter().flat_map(of_run).collect();
    faults.extend(outcome.runs.iter().flat_map(silent));
    faults.dedup();
    (!faults.is_empty()).then(|| format!("The recording is at fault: {}; figures of it are wrong.", list(&faults)))
}

/// Channels that show next to nothing beside the loudest: far below it, and nothing that turns with the shafts.
fn silent(run: &RunOutcome) -> Vec<String> {
    let loudest = run.channels.iter().map(|channel| channel.rms).fold(0.0, f64::max);
    let is_silent = |channel: &&ChannelOutcome| {
        channel.rms < SILENT_SHARE * loudest && channel.locked_share < MAX_SILENT_LOCKED_SHARE
    };
    let words = |channel: &ChannelOutcome| {
        let below = -20.0 * (channel.rms / loudest).log10();
        let name = crate::text::name(&channel.name);
        format!(
            "channel {} ({name}) is {below:.0} dB below the loudest and holds noise, as without a sensor",
            channel.channel
        )
    };
    run.channels.iter().filter(is_silent).map(words).collect()
}

/// The strongest line of all, where it is of a shaft and no mesh harmonic.
struct Pattern {
    sentence: String,
    shaft: &'static str,
}

/// A line of the teeth's pattern that outshines the mesh: the averages hold it, and no list of foreign orders does.
fn pattern(outcome: &Outcome) -> Option<Pattern> {
    let channels = outcome.runs.iter().flat_map(|run| run.channels.iter().map(move |channel| (run, channel)));
    let over_mesh = |(run, channel): (&RunOutcome, &ChannelOutcome)| {
        let &(order, amplitude) = channel.order_spectrum.strongest.first()?;
        let mesh = channel.mesh.iter().map(|own| own.line.amplitude).fold(0.0, f64::max);
        let db = 20.0 * (amplitude / mesh.max(f64::MIN_POSITIVE)).log10();
        let teeth = outcome.teeth.map(f64::from);
        let gear_order = teeth[0] / teeth[1];
        let near = |of: f64| ((order / of).round(), (order - (order / of).round() * of).abs());
        let width = channel.order_spectrum.resolution_orders;
        if db < MIN_MESH_EXCESS_DB || near(teeth[0]).1 < width {
            return None;
        }
        let [(of_pinion, pinion_off), (of_gear, gear_off)] = [near(1.0), near(gear_order)];
        let (number, shaft) = match (pinion_off < width, gear_off < width) {
            (true, _) => (of_pinion, "pinion"),
            (false, true) => (of_gear, "gear"),
            _ => return None,
        };
        let sentence = format!(
            "The strongest line of all is no mesh harmonic but {number:.0} x the {shaft} ({order:.3} x the pinion, \
             {}), {db:.0} dB over the strongest mesh line in {}: a pattern that turns with the {shaft}.",
            hertz(order * run.speed.mean_hz),
            crate::text::name(&channel.name)
        );
        Some((db, Pattern { sentence, shaft }))
    };
    channels.filter_map(over_mesh).max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, pattern)| pattern)
}

fn found(outcome: &Outcome, all: &[Seen]) -> String {
    let spectra = 2 * outcome.runs.iter().map(|run| run.channels.len()).sum::<usize>();
    let chance = outcome.runs.iter().flat_map(|run| &run.channels).map(|channel| channel.unexplained.false_alarm);
    let chance = 100.0 * chance.fold(0.0, f64::max);
    let odds = format!("in each of the {spectra} spectra noise alone gives one with a chance of {chance:.0} %");
    if all.is_empty() {
        return format!("Beside the orders of mesh and shafts none stands out ({odds}){}.", modulation(outcome));
    }
    let clause = |seen: &Seen| {
        let order = seen.found.family.base_order;
        let name = crate::text::name(&seen.channel.name);
        let at = match seen.found.fixed_frequency_hz {
            Some(hz) => format!("a fixed frequency of {}", hertz(hz)),
            None => format!("{order:.3} x the pinion ({})", hertz(order * seen.speed_hz)),
        };
        let where_seen = if seen.in_envelope { ", in the envelope" } else { "" };
        let weak = if seen.is_firm() { "" } else { ", one weak line" };
        format!("{at}, strongest in {name}{where_seen}{weak}")
    };
    let clauses: Vec<String> = all.iter().take(MAX_NAMED_ORDERS).map(clause).collect();
    let more = if all.len() > MAX_NAMED_ORDERS {
        format!("; and {} more in the table", all.len() - MAX_NAMED_ORDERS)
    } else {
        String::new()
    };
    format!("Neither mesh nor shafts explain {}{more}; {odds}{}.", clauses.join("; "), modulation(outcome))
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
    match deepest.filter(|(depth, _)| *depth > MIN_DEPTH && *depth <= MAX_DEPTH) {
        Some((depth, shaft)) => {
            format!("; the mesh swells once per turn of the {shaft} by {:.0} %, as runout does", 100.0 * depth)
        }
        None => String::new(),
    }
}

fn next(all: &[Seen], pattern: Option<&Pattern>) -> String {
    if let Some(Pattern { shaft, .. }) = pattern {
        let look = advice::for_name("pitch-error");
        return format!(
            "Next, for the {shaft}: {}; {}. `meshband diagnose` says how sure that is.",
            look.look, look.when
        );
    }
    if all.is_empty() {
        return "Next: keep this record as the reference; `meshband diagnose` says what it would have found.".into();
    }
    if !all.iter().any(Seen::is_firm) {
        return "Next: measure again; one weak line is no finding until it comes again. `meshband diagnose` weighs it \
                against chance."
            .into();
    }
    let of_a_bearing = |seen: &Seen| seen.in_envelope && seen.is_firm() && seen.found.family.base_order > 1.0;
    let look = advice::for_name(if all.iter().any(of_a_bearing) { "bearing" } else { "" });
    format!("Next: `meshband diagnose` looks for the cause and says how sure it is; {}; {}.", look.look, look.when)
}

/// One row per order.
pub fn findings(outcome: &Outcome) -> Table {
    let row = |seen: &Seen| {
        let family = &seen.found.family;
        let [strength, unit] = if seen.in_envelope {
            [figure(family.rms), "x the band's mean power".into()]
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
