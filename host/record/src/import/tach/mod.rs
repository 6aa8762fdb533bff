//! A measured tachometer: from its signal or its edges to pulses that a record can hold.
//!
//! 1. `source`: which channel or file, and its edges (`edges`).
//! 2. Samples per pulse: fewer than three and nothing is believed.
//! 3. [`crate::pulses`]: lost and doubled ones, by the likeliest reading.
//! 4. `missing`: marks that the wheel does not have; `wheel`: the places of those it has, learned and taken out.
//! 5. [`crate::data_quality::mesh`]: whether the mesh line agrees, where teeth are known.
//!
//! The jitter of the edges is estimated from what neighbouring edges do not share: differences of the times of
//! orders two to six remove an ever less smooth course of the speed and keep independent errors; the order that
//! leaves least is taken. A speed that changes faster than the pulses follow counts as jitter, so with one pulse per
//! turn the figure is an upper bound.

mod edge_times;
mod edges;
mod missing;
mod source;
mod speed_trace;
mod wheel;

pub use crate::data_quality::mesh::MeshCheck;
pub use crate::pulses::Place;
pub use edges::Levels;
pub use wheel::Wheel;

use super::Reading;
use super::grouped::Group;
use crate::budget::SHAFT;
use crate::data_quality::mesh;
use crate::data_quality::pulsed::Pulsed;
use crate::pulses::{self, Pulses};
use crate::record::Tach;
use crate::{Error, Result};
use serde::Serialize;
use toml::Table;

/// Share of pulses out of step above which a signal is no tachometer's.
const MAX_IRREGULAR_SHARE: f64 = 0.2;
/// Samples from one pulse to the next below which a short pulse can fall between two of them.
const FEWEST_SAMPLES: f64 = 8.0;
/// Samples from one pulse to the next from which edges are followed: half of that is the limit of sampling.
const SAMPLES_PER_PULSE: f64 = 3.0;
/// Share of the intervals that may be shorter: pulses too many.
const MAX_SHORT_INTERVAL_SHARE: f64 = 0.1;
/// Speed up to which an encoder's folding is a matter, turns/s.
const FASTEST_MACHINE_HZ: f64 = 100.0;
/// Fewest pulses whose intervals can be compared.
const MIN_PULSES: usize = 6;
/// Ratio of speeds below which a shaft given by its ratio is the pinion's or the gear's.
const SAME_SHAFT: f64 = 1e-9;
/// Highest order of differences that the jitter is taken from.
const DIFFERENCES: usize = 6;
/// Turns of the tach's shaft, and share of the run, that may be without pulses at either end.
const BARE_TURNS: f64 = 3.0;
const BARE_SHARE: f64 = 0.05;
/// Places named in a remark.
const MAX_NAMED_PLACES: usize = 5;

/// The shaft that carries the pick-up's marks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shaft {
    /// The pinion's.
    Pinion,
    /// The gear's.
    Gear,
    /// Another one, with its turns per turn of the pinion.
    Ratio(f64),
}

impl Shaft {
    /// Turns per turn of the pinion.
    fn ratio(self, teeth: [u32; 2]) -> f64 {
        match self {
            Shaft::Pinion => 1.0,
            Shaft::Gear => f64::from(teeth[0]) / f64::from(teeth[1]),
            Shaft::Ratio(ratio) => ratio,
        }
    }

    /// For people.
    pub fn name(self) -> String {
        match self {
            Shaft::Pinion => "the pinion".into(),
            Shaft::Gear => "the gear".into(),
            Shaft::Ratio(ratio) => format!("a shaft with {ratio} turns per turn of the pinion"),
        }
    }

    /// The same shaft by its name, where the ratio is that of a named one.
    fn named(self, teeth: Option<[u32; 2]>) -> Self {
        let is = |shaft: Shaft, ratio: f64| {
            let own = teeth.map(|teeth| shaft.ratio(teeth)).or((shaft == Shaft::Pinion).then_some(1.0));
            own.is_some_and(|own| (ratio / own - 1.0).abs() < SAME_SHAFT)
        };
        match self {
            Shaft::Ratio(ratio) if is(Shaft::Pinion, ratio) => Shaft::Pinion,
            Shaft::Ratio(ratio) if is(Shaft::Gear, ratio) => Shaft::Gear,
            other => other,
        }
    }
}

/// What the user says about the tachometer.
#[derive(Debug, Clone, PartialEq)]
pub struct TachOptions {
    /// Number or name of a channel, or a file; several files: one per run.
    pub sources: Vec<String>,
    /// Pulses per turn.
    pub pulses: u32,
    /// Shaft of the marks.
    pub shaft: Shaft,
    /// Whether falling edges count; rising ones where nothing is said.
    pub falling: Option<bool>,
    /// Level at which edges are timed, in the signal's unit; half way between its plateaus where absent.
    pub threshold: Option<f64>,
}

/// Speeds over one run, turns per second.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Speed {
    /// Turns over time.
    pub mean: f64,
    /// Slowest whole turn.
    pub least: f64,
    /// Fastest whole turn.
    pub most: f64,
}

/// What the pulses of one run are like.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TachFigures {
    /// Channel or file.
    pub source: String,
    /// Levels of the signal; absent for edge times.
    pub levels: Option<Levels>,
    /// Pulses written.
    pub pulses: usize,
    /// Mark of the first pulse, counted from the mark at which angle 0 is.
    pub first_pulse_index: u32,
    /// Whether the wheel's marks told which of them that is, against run 0; absent for run 0 and for one pulse per
    /// turn, where the mark is always the same.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub first_pulse_known: Option<bool>,
    /// Speed of the tach's shaft.
    pub shaft_speed_hz: Speed,
    /// Speed of the pinion, where the ratio is known.
    pub pinion_speed_hz: Option<Speed>,
    /// Standard deviation of an edge time, s, after everything that was taken out.
    pub jitter_s: f64,
    /// Pulses put in.
    pub lost: Vec<Place>,
    /// Pulses taken out.
    pub doubled: Vec<Place>,
    /// Pulses out of step, left as they are.
    pub irregular: Vec<Place>,
    /// Whether no pulse can be missing or too many behind those.
    pub count_is_sure: bool,
    /// Marks that the wheel does not have, counted from the run's first pulse; empty for a whole wheel.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub missing_marks: Vec<usize>,
    /// Speed of the tach's shaft at which its pulses would reach half the rate they were sampled at, turns/s; absent
    /// for edge times.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub folds_at_hz: Option<f64>,
    /// Time before the first pulse and behind the last one, s.
    pub bare_s: [f64; 2],
    /// The wheel, with several pulses per turn and enough turns.
    pub wheel: Option<Wheel>,
    /// The mesh line beside the pulses, where teeth are known.
    pub mesh: Option<MeshCheck>,
}

/// One run's pulses.
pub(super) struct MeasuredTach {
    pub edges_s: Vec<f64>,
    pub figures: TachFigures,
}

/// The mesh that the pulses are compared with.
#[derive(Debug, Clone, Copy)]
pub(super) struct Compared {
    /// Tooth counts, its driver's first.
    pub teeth: [u32; 2],
    /// Turns of its driver per turn of the pinion, or of a train's input.
    pub turns: f64,
    /// As [`Pulsed::passes`].
    pub passes: u32,
}

/// Time before the first pulse and behind the last one, s, where nothing is known of the shaft.
fn bare_s(edges_s: &[f64], length_s: f64) -> [f64; 2] {
    match edges_s {
        [first, .., last] => [first.max(0.0), (length_s - last).max(0.0)],
        _ => [0.0; 2],
    }
}

/// Pulses of all runs; takes the tach's channel out of them.
///
/// # Errors
/// Options out of range, a source that cannot be read ([`source`]), and pulses that no shaft makes.
pub(super) fn measured(
    options: &TachOptions,
    runs: &mut [Group],
    rate_hz: f64,
    teeth: Option<[u32; 2]>,
    compared: Option<Compared>,
    reading: &Reading,
) -> Result<Vec<MeasuredTach>> {
    if !(1..=10_000).contains(&options.pulses) {
        return Err(Error::invalid("--pulses", format!("{} is not within 1 to 10000 pulses per turn", options.pulses)));
    }
    if let Shaft::Ratio(ratio) = options.shaft
        && !(0.001..=1000.0).contains(&ratio)
    {
        let what = format!("{ratio} is not within 0.001 to 1000 turns per turn of the pinion");
        return Err(Error::invalid("--tach-shaft", what));
    }
    let shaft = options.shaft.named(teeth);
    let found = source::take(options, runs, rate_hz, reading)?;
    let mut made: Vec<MeasuredTach> = Vec::new();
    for (run, found) in runs.iter().zip(found) {
        let mut tach = one(&run.label, options.pulses, found)?;
        let ratio = if shaft == Shaft::Pinion { Some(1.0) } else { teeth.map(|teeth| shaft.ratio(teeth)) };
        let ratio = if let Shaft::Ratio(ratio) = shaft { Some(ratio) } else { ratio };
        let speed = tach.figures.shaft_speed_hz;
        tach.figures.pinion_speed_hz = ratio.map(|ratio| speed.over(ratio));
        if let Some(first) = made.first().filter(|_| options.pulses > 1) {
            let by_gaps = missing_of(&tach.figures).zip(missing_of(&first.figures));
            let by_gaps = by_gaps.and_then(|(own, first)| own.mark_of(&first, options.pulses as usize));
            let mark = by_gaps.or(tach
                .figures
                .wheel
                .as_ref()
                .zip(first.figures.wheel.as_ref())
                .and_then(|(own, first)| own.mark_of(first)));
            tach.figures.first_pulse_known = Some(mark.is_some());
            tach.figures.first_pulse_index = mark.map_or(0, |mark| mark as u32);
        }
        tach.figures.bare_s = bare_s(&tach.edges_s, run.channels[0].len() as f64 / rate_hz);
        if let Some(Compared { teeth, turns, passes }) = compared {
            let pulsed = Pulsed {
                channels: &run.channels,
                rate_hz,
                edges_s: &tach.edges_s,
                pulses: options.pulses,
                ratio: shaft.ratio(teeth) / turns,
                shaft: shaft.name(),
                teeth,
                passes,
                nominal: false,
                sampled_at_hz: tach.sampled_at_hz,
            };
            tach.figures.mesh = mesh::check(&run.label, &pulsed);
            if let Some(fold) = tach.figures.mesh.as_ref().and_then(|mesh| mesh.folded) {
                return Err(Error::invalid(&run.label, fold.sentence(options.pulses)));
            }
        }
        made.push(MeasuredTach { edges_s: tach.edges_s, figures: tach.figures });
    }
    Ok(made)
}

impl TachOptions {
    /// `[tach]` of a record with these pulses.
    pub(super) fn declaration(&self, teeth: Option<[u32; 2]>, jitter_s: f64) -> Tach {
        let (shaft, turns_per_pinion_turn) = match self.shaft.named(teeth) {
            Shaft::Pinion => ("pinion", None),
            Shaft::Gear => ("gear", None),
            Shaft::Ratio(ratio) => ("other", Some(ratio)),
        };
        Tach {
            shaft: shaft.into(),
            turns_per_pinion_turn,
            pulses_per_rev: self.pulses,
            jitter_s: Some(jitter_s),
            source: Some("measured".into()),
            other: Table::new(),
        }
    }

    /// Pulses per turn and shaft, for people.
    pub(super) fn described(&self) -> String {
        let edges = if self.falling == Some(true) { "falling" } else { "rising" };
        let pulses = plural(self.pulses as usize, "pulse");
        format!("{} {pulses} per turn of {}, {edges} edges", self.pulses, self.shaft.name())
    }
}

impl Speed {
    /// The speed of a shaft that turns once for `ratio` turns of this one.
    fn over(self, ratio: f64) -> Self {
        Self { mean: self.mean / ratio, least: self.least / ratio, most: self.most / ratio }
    }
}

/// One run's pulses before they are compared with anything.
struct Single {
    edges_s: Vec<f64>,
    /// Rate at which the signal was sampled, Hz; absent for edge times.
    sampled_at_hz: Option<f64>,
    figures: TachFigures,
}

/// The missing marks of a run, where it has any.
fn missing_of(figures: &TachFigures) -> Option<missing::Missing> {
    let marks = figures.missing_marks.clone();
    (!marks.is_empty()).then_some(missing::Missing { marks })
}

/// Refuses a signal with fewer than three samples per pulse.
fn check_samples_per_pulse(label: &str, found: &source::Found) -> Result<()> {
    let Some(rate_hz) = found.sampled_at_hz.filter(|_| found.edges_s.len() >= MIN_PULSES) else { return Ok(()) };
    let mut apart: Vec<f64> = found.edges_s.windows(2).map(|w| w[1] - w[0]).collect();
    let at = ((apart.len() - 1) as f64 * MAX_SHORT_INTERVAL_SHARE) as usize;
    let samples = rate_hz * *apart.select_nth_unstable_by(at, f64::total_cmp).1;
    if samples >= SAMPLES_PER_PULSE {
        return Ok(());
    }
    let pulses_hz = rate_hz / samples;
    let what = format!(
        "{} has a pulse every {samples:.2} samples, {pulses_hz:.0} per second at {rate_hz} Hz or a fold of more: \
          its edges cannot be followed; sample it at {:.0} Hz or faster (three samples per pulse), or use fewer marks",
        found.source,
        SAMPLES_PER_PULSE * pulses_hz
    );
    Err(Error::invalid(label, what))
}

fn one(label: &str, per_turn: u32, found: source::Found) -> Result<Single> {
    let edges = found.edges_s.len();
    check_samples_per_pulse(label, &found)?;
    let mut pulses = if edges < MIN_PULSES {
        Pulses { times_s: found.edges_s, measured: vec![true; edges], ..Pulses::default() }
    } else {
        pulses::counted(&found.edges_s)
    };
    if !in_step(&pulses, edges) {
        let (out, source) = (pulses.out_of_step(), &found.source);
        let apart = found.sampled_at_hz.unwrap_or(f64::INFINITY) * pulses.median_interval_s();
        let why = if apart < FEWEST_SAMPLES {
            format!(
                "pulses come every {apart:.1} samples, so short ones fall between two: sample faster or use fewer marks"
            )
        } else {
            "no tachometer's, an encoder's above half the sampling rate, or a threshold in its noise (--threshold)"
                .into()
        };
        let what = format!("{out} of {edges} edges of {source} follow no steady period: {why}");
        return Err(Error::invalid(label, what));
    }
    let marks = per_turn as usize;
    let missing = missing::find(&pulses, marks).map_err(|what| Error::invalid(label, what))?;
    let sure = pulses.longest_stretch();
    let wheel = wheel::learn(&pulses.times_s[sure.clone()], &pulses.measured[sure.clone()], marks, sure.start);
    if let Some(wheel) = wheel.as_ref().filter(|wheel| wheel.removed) {
        let corrected = wheel.corrected(&pulses.times_s[sure.clone()], sure.start);
        pulses.times_s[sure.clone()].copy_from_slice(&corrected);
        pulses::fill(&mut pulses);
    }
    let sure_s = pulses.times_s[sure.clone()].to_vec();
    let speed = speed(&pulses, marks);
    SHAFT.check(label, speed.mean, "check --pulses and the rate")?;
    let lost = missing.as_ref().map(|missing| missing.lost_besides(&pulses, marks));
    let figures = TachFigures {
        source: found.source,
        levels: found.levels,
        pulses: pulses.times_s.len(),
        first_pulse_index: 0,
        first_pulse_known: None,
        shaft_speed_hz: speed,
        pinion_speed_hz: None,
        // At a steady speed the differences do not see what sampling adds.
        jitter_s: jitter_s(&sure_s, &pulses.measured[sure]).max(found.resolution_s),
        lost: lost.unwrap_or(pulses.lost),
        doubled: pulses.doubled,
        irregular: pulses.irregular,
        count_is_sure: pulses.breaks.is_empty(),
        missing_marks: missing.map_or(Vec::new(), |missing| missing.marks),
        folds_at_hz: found.sampled_at_hz.map(|rate_hz| 0.5 * rate_hz / f64::from(per_turn)),
        bare_s: [0.0; 2],
        wheel,
        mesh: None,
    };
    Ok(Single { edges_s: pulses.times_s, sampled_at_hz: found.sampled_at_hz, figures })
}

/// Whether few enough of the edges are out of step for a shaft to have made them.
fn in_step(pulses: &Pulses, edges: usize) -> bool {
    pulses.out_of_step() as f64 <= MAX_IRREGULAR_SHARE * edges as f64
}

/// Mean speed over the stretches whose pulses are counted, and that of their slowest and fastest whole turn; over
/// all pulses where nothing is sure.
fn speed(pulses: &Pulses, marks: usize) -> Speed {
    let times = &pulses.times_s;
    let mut sure = pulses.sure_stretches();
    if sure.is_empty() {
        sure.push(0..times.len());
    }
    let (mut periods, mut seconds) = (0, 0.0);
    let (mut least, mut most) = (f64::INFINITY, 0.0_f64);
    for stretch in sure {
        periods += stretch.len() - 1;
        seconds += times[stretch.end - 1] - times[stretch.start];
        for k in stretch.start..stretch.end.saturating_sub(marks) {
            let turn = 1.0 / (times[k + marks] - times[k]);
            (least, most) = (least.min(turn), most.max(turn));
        }
    }
    let mean = periods as f64 / marks as f64 / seconds;
    if least > most { Speed { mean, least: mean, most: mean } } else { Speed { mean, least, most } }
}

/// Standard deviation of the independent errors of pulse times, s; 0 of too few to tell.
fn jitter_s(times_s: &[f64], measured: &[bool]) -> f64 {
    let mut differences = times_s.to_vec();
    let mut norm = 1.0;
    let mut least = f64::INFINITY;
    for order in 1..=DIFFERENCES {
        differences = differences.windows(2).map(|w| w[1] - w[0]).collect();
        // The sum of the squared binomial coefficients.
        norm *= (4 * order - 2) as f64 / order as f64;
        let whole = |(i, _): &(usize, &f64)| measured[*i..=*i + order].iter().all(|m| *m);
        let mut sizes: Vec<f64> = differences.iter().enumerate().filter(whole).map(|(_, d)| d.abs()).collect();
        if order < 2 || sizes.len() < 8 {
            continue;
        }
        sizes.sort_by(f64::total_cmp);
        // The median of a normal variable's size is 0.6745 standard deviations.
        least = least.min(sizes[sizes.len() / 2] / 0.6745 / f64::sqrt(norm));
    }
    if least.is_finite() { least } else { 0.0 }
}

/// Whether a channel looks like a tachometer's: two levels, and edges in step.
pub(super) fn looks_like_a_tach(signal: &[f64]) -> bool {
    let edges = edges::hinted(signal);
    edges.len() >= MIN_PULSES && in_step(&pulses::counted(&edges), edges.len())
}

/// What the user should know of one run's pulses.
pub(super) fn remarks(label: &str, options: &TachOptions, figures: &TachFigures) -> Vec<String> {
    let mut remarks = Vec::new();
    let mut say = |what: String| remarks.push(format!("{label}: {what}"));
    let odd = if figures.count_is_sure {
        "out of step, left as measured; their count holds"
    } else {
        "out of step, left as measured or counted by the best guess; the angle behind may be off by whole pulses, \
          speeds are of the other stretches"
    };
    if !figures.missing_marks.is_empty() {
        let missing = figures.missing_marks.len();
        say(format!("the wheel is a {}-{missing}: its missing marks are put in at their places", options.pulses));
    }
    for (places, what) in
        [(&figures.lost, "lost, put in"), (&figures.doubled, "doubled, taken out"), (&figures.irregular, odd)]
    {
        let count: usize = places.iter().map(|place| place.pulses).sum();
        if count > 0 {
            say(format!("{count} {} {what} ({})", plural(count, "pulse"), named(places)));
        }
    }
    if options.pulses > 1 {
        say(match &figures.wheel {
            None => {
                let turns = figures.pulses as f64 / f64::from(options.pulses);
                let check = if figures.mesh.is_none() { ", or to check the mesh line" } else { "" };
                format!(
                    "{turns:.1} turns are too few to learn where the wheel's marks are{check}; are {} pulses per turn \
                     right?",
                    options.pulses
                )
            }
            Some(wheel) if wheel.removed => format!(
                "the wheel's marks are uneven by {:.3} % of the pitch (largest {:.3} %); taken out, {:.3} % remain",
                wheel.irregularity_percent, wheel.largest_percent, wheel.remaining_percent
            ),
            Some(wheel) => format!(
                "the wheel's marks are even within {:.3} % of the pitch",
                wheel.remaining_percent.max(wheel.irregularity_percent)
            ),
        });
    }
    if figures.first_pulse_known == Some(false) {
        say("which of the wheel's marks comes first is not known against the first run; angle 0 is another one here"
            .into());
    }
    for (bare_s, place) in figures.bare_s.iter().zip(["before the first pulse", "behind the last pulse"]) {
        let run_s = figures.pulses as f64 / f64::from(options.pulses) / figures.shaft_speed_hz.mean;
        if *bare_s > BARE_TURNS / figures.shaft_speed_hz.mean && *bare_s > BARE_SHARE * run_s {
            say(format!(
                "{bare_s:.3} s {place} have no pulses: nothing is known of the shaft there, and no order is taken"
            ));
        }
    }
    if let Some(mesh) = &figures.mesh {
        say(mesh.sentence.clone());
    }
    let confirmed = figures.mesh.as_ref().is_some_and(|mesh| !mesh.doubtful && mesh.found_over_implied.is_some());
    if let Some(folds_at_hz) = figures.folds_at_hz.filter(|hz| !confirmed && *hz < FASTEST_MACHINE_HZ) {
        say(format!(
            "{} pulses per turn are sampled so that they fold above {folds_at_hz:.2} turns/s; that the shaft stays \
              below, its pulses cannot say",
            options.pulses
        ));
    }
    remarks
}

/// The first places, for a remark.
fn named(places: &[Place]) -> String {
    let one = |place: &Place| match place.pulses {
        1 => format!("{:.3} s", place.time_s),
        n => format!("{n} at {:.3} s", place.time_s),
    };
    let list = places.iter().take(MAX_NAMED_PLACES).map(one).collect::<Vec<_>>().join(", ");
    let more = places.len().saturating_sub(MAX_NAMED_PLACES);
    let more = if more > 0 { format!(" and {more} more places") } else { String::new() };
    format!("after {list}{more}")
}

fn plural(count: usize, what: &str) -> String {
    if count == 1 { what.into() } else { format!("{what}s") }
}
