//! What a record shows of a gear pair from one channel, tooth counts and a tach: `meshband analyse`.
//!
//! Per run: the angle (`angle`). Per channel: order spectrum and map, mesh harmonics with sidebands (`sidebands`),
//! averages of both shafts with the node's indicators (`average`), the envelope of the rest (`envelope`), and lines
//! that the pair does not explain (`search`, `explained`, `families`, `unexplained`). `view` and `report` show it.
//! Nothing needs torque, stiffness or calibration; amplitudes are in the record's unit. Cost: a channel of a million
//! samples takes a few seconds and 300 MB.

pub mod angle;
pub mod average;
pub mod bearing_lines;
pub mod coherence;
pub mod envelope;
pub mod explained;
pub mod families;
pub mod jitter;
pub mod letter;
pub mod lines;
pub mod mesh_phase;
pub mod order_map;
pub mod order_spectrum;
pub mod report;
pub mod search;
pub mod sidebands;
pub mod single_mark;
pub mod skirts;
pub mod train;
pub mod train_average;
pub mod train_view;
pub mod unexplained;
pub mod view;
pub mod whole_turns;

use crate::data_quality::{self, Remark};
use crate::machine::Hunting;
use crate::record::{Record, Run, Tach};
use crate::{Error, Result};
use angle::{Angle, SpeedRange};
use average::Average;
use coherence::Coherence;
use envelope::Envelope;
use explained::Explained;
use lines::OrderLines;
use meshband::indicators::RunEnsemble;
use order_map::OrderMap;
use order_spectrum::OrderSpectrum;
use rayon::prelude::*;
use serde::Serialize;
use sidebands::Harmonic;
use unexplained::Unexplained;

/// Mesh harmonics that the order map reaches to.
const MAP_HARMONICS: f64 = 6.0;
/// Torque and speed by which a run may depart from the first of a series for NA4.
const SAME_CONDITIONS: f64 = 0.1;

/// Which runs and channels; `None` is all.
#[derive(Debug, Clone, Copy, Default)]
pub struct Choice {
    /// Index of the run, from 0.
    pub run: Option<usize>,
    /// Index of the channel, from 0.
    pub channel: Option<usize>,
}

/// What was found in a record.
#[derive(Debug, Clone, Serialize)]
pub struct Outcome {
    /// Version of this schema; book/src/explanation/analysis.md.
    pub schema: u32,
    /// Title of the record.
    pub title: String,
    /// Unit of all amplitudes.
    pub unit: String,
    /// Teeth of pinion and gear.
    pub teeth: [u32; 2],
    /// Pinion turns after which the same teeth meet.
    pub hunting_turns: usize,
    /// Shaft of the tach, its pulses per turn, whether it is virtual.
    pub tach: TachUsed,
    /// What holds of the whole record, in sentences.
    pub notes: Vec<String>,
    /// The runs.
    pub runs: Vec<RunOutcome>,
}

/// The tach as declared.
#[derive(Debug, Clone, Serialize)]
pub struct TachUsed {
    /// "pinion" or "gear".
    pub shaft: String,
    /// Pulses per turn of that shaft.
    pub pulses_per_rev: u32,
    /// Whether its edges were made from the mesh line.
    pub virtual_source: bool,
}

/// A run.
#[derive(Debug, Clone, Serialize)]
pub struct RunOutcome {
    /// Index in the record.
    pub run: usize,
    /// Declared torque, N m.
    pub input_torque_n_m: Option<f64>,
    /// Speed of the pinion.
    pub speed: SpeedRange,
    /// Whole turns of the pinion that were used, and of the gear.
    pub turns: [f64; 2],
    /// First of these turns from the pinion's angle 0 nearest before the record.
    pub first_turn: f64,
    /// Samples per turn of the pinion on the grid of equal angles.
    pub samples_per_turn: usize,
    /// What holds of this run, in sentences.
    pub notes: Vec<String>,
    /// What the recording says of itself; the first of it stands in the notes too.
    #[serde(skip)]
    pub remarks: Vec<Remark>,
    /// The channels.
    pub channels: Vec<ChannelOutcome>,
}

/// A channel of a run.
#[derive(Debug, Clone, Serialize)]
pub struct ChannelOutcome {
    /// Index in the record.
    pub channel: usize,
    /// Name.
    pub name: String,
    /// RMS about the mean over the turns used.
    pub rms: f64,
    /// Shares of the mean square: locked to either shaft, the rest.
    pub locked_share: f64,
    /// Order spectrum.
    pub order_spectrum: OrderSpectrum,
    /// Mesh harmonics with sidebands.
    pub mesh: Vec<Harmonic>,
    /// Averages of pinion and gear.
    pub averages: [Average; 2],
    /// Envelope.
    pub envelope: Envelope,
    /// How much every band swells at every order, for the picture.
    #[serde(skip)]
    pub coherence: Coherence,
    /// Passages of the declared bearings in it.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub bearing_lines: Vec<bearing_lines::BearingLine>,
    /// Orders that the pair does not explain.
    pub unexplained: Unexplained,
    /// Order map, for the picture.
    #[serde(skip)]
    pub map: OrderMap,
}

/// Analyses the chosen runs and channels.
///
/// # Errors
/// A record without tach or tooth counts, no such run or channel, no run with enough turns, more points than the
/// budget.
pub fn record(record: &Record, choice: Choice) -> Result<Outcome> {
    let place = record.folder.join("record.toml");
    let tach = require_tach(record)?.clone();
    let teeth = record.declaration.teeth().ok_or_else(|| {
        Error::invalid(place.display(), "has no [pair] teeth = [pinion, gear]; the mesh order is unknown without them")
    })?;
    let acquisition = &record.declaration.acquisition;
    let channels = chosen(choice.channel, acquisition.channels.len(), "channel", record)?;
    let runs = chosen(choice.run, record.runs.len(), "run", record)?;
    let mut notes = notes_of(&tach, acquisition.unit.as_deref());
    let passages = bearing_lines::passages(record, f64::from(teeth[0]) / f64::from(teeth[1]))?;
    let mut runs = run_outcomes(record, &runs, &channels, teeth, &tach, &mut notes)?;
    for channel in runs.iter_mut().flat_map(|run| &mut run.channels) {
        channel.bearing_lines = bearing_lines::read(&channel.envelope, &passages);
    }
    Ok(Outcome {
        schema: 1,
        title: record.declaration.title().to_owned(),
        unit: acquisition.unit.clone().unwrap_or_else(|| "m/s2".into()),
        teeth,
        hunting_turns: Hunting::of(teeth).turns as usize,
        tach: TachUsed { virtual_source: tach.is_virtual(), shaft: tach.shaft, pulses_per_rev: tach.pulses_per_rev },
        notes,
        runs,
    })
}

/// The runs that can be analysed; the others are said in the notes, and an error where there is none.
fn run_outcomes(
    record: &Record,
    runs: &[usize],
    channels: &[usize],
    teeth: [u32; 2],
    tach: &Tach,
    notes: &mut Vec<String>,
) -> Result<Vec<RunOutcome>> {
    let mut outcomes = Vec::new();
    let mut ensembles = vec![[RunEnsemble::default(); 2]; channels.len()];
    let mut conditions = None;
    let mut refused = None;
    for &index in runs {
        let run = &record.runs[index];
        let place = format!("{} run {index}", record.folder.display());
        let angle = match Angle::of(run, tach, teeth, &place) {
            Ok(angle) => {
                let angle = angle.with_cheap_turns(Some(Hunting::of(teeth).turns as usize)).settled(tach);
                mesh_phase::followed(angle, run, tach, f64::from(teeth[0]))
            }
            Err(error) => {
                notes.push(format!("left out: {error}"));
                refused.get_or_insert(error);
                continue;
            }
        };
        if changed(&mut conditions, run, &angle) {
            ensembles.iter_mut().for_each(|e| *e = [RunEnsemble::default(); 2]);
        }
        let names = &record.declaration.acquisition.channels;
        let mut outcome = analysed(run, index, &angle, teeth, channels, names, &mut ensembles);
        outcome.remarks = data_quality::of_run(record, run);
        outcome.notes.extend(data_quality::first_lines(&outcome.remarks));
        outcomes.push(outcome);
    }
    match (outcomes.is_empty(), refused) {
        (true, Some(error)) => Err(error),
        _ => Ok(outcomes),
    }
}

pub(crate) fn require_tach(record: &Record) -> Result<&Tach> {
    record.require_tach().map_err(|error| match error {
        Error::Invalid { place, what } => {
            Error::invalid(place, what + "; `meshband import --teeth` makes a virtual tach from the mesh line")
        }
        other => other,
    })
}

pub(crate) fn chosen(index: Option<usize>, count: usize, what: &str, record: &Record) -> Result<Vec<usize>> {
    let refuse = |text: String| Err(Error::invalid(record.folder.display(), text));
    match index {
        _ if count == 0 => refuse(format!("has no {what}")),
        Some(index) if index >= count => refuse(format!("has no {what} {index}; they are 0 to {}", count - 1)),
        Some(index) => Ok(vec![index]),
        None => Ok((0..count).collect()),
    }
}

pub(crate) fn notes_of(tach: &Tach, unit: Option<&str>) -> Vec<String> {
    let mut notes = Vec::new();
    if tach.is_virtual() {
        notes.push(
            "the tach is virtual: angle 0 is arbitrary (tooth numbers count from it), and phase swings of the mesh \
             line have gone into the angle"
                .into(),
        );
    }
    match unit {
        None | Some("m/s2" | "g") => {}
        Some(unit) => {
            notes.push(format!("amplitudes are in the record's unit ({}), no acceleration", crate::text::name(unit)))
        }
    }
    notes
}

/// Whether a run begins a new series for NA4; remembers its torque and speed.
fn changed(conditions: &mut Option<(f64, f64)>, run: &Run, angle: &Angle) -> bool {
    let own = (run.declaration.input_torque_n_m.unwrap_or(0.0), angle.speed.mean_hz);
    let differs = |a: f64, b: f64| (a - b).abs() > SAME_CONDITIONS * a.abs().max(b.abs());
    let new = conditions.is_none_or(|before| differs(before.0, own.0) || differs(before.1, own.1));
    if new {
        *conditions = Some(own);
    }
    new
}

fn analysed(
    run: &Run,
    index: usize,
    angle: &Angle,
    teeth: [u32; 2],
    channels: &[usize],
    names: &[String],
    ensembles: &mut [[RunEnsemble; 2]],
) -> RunOutcome {
    let moves = |c: usize| run.moves(c);
    let outcomes = channels
        .par_iter()
        .zip(ensembles)
        .filter(|(c, _)| moves(**c))
        .map(|(&c, ensembles)| channel(run, c, &names[c], angle, teeth, ensembles))
        .collect();
    let mut notes = run_notes(run, angle, teeth);
    let still = channels.iter().filter(|c| !moves(**c));
    notes.extend(
        still.map(|&c| format!("channel {c} ({}) does not move and is left out", crate::text::name(&names[c]))),
    );
    RunOutcome {
        run: index,
        input_torque_n_m: run.declaration.input_torque_n_m,
        speed: angle.speed,
        turns: [angle.turns as f64, angle.turns as f64 * angle.gear_order],
        first_turn: angle.from_turn,
        samples_per_turn: angle.per_turn[0],
        notes,
        remarks: Vec::new(),
        channels: outcomes,
    }
}

fn run_notes(run: &Run, angle: &Angle, teeth: [u32; 2]) -> Vec<String> {
    let mut notes = Vec::new();
    if let Some(part) = run.declaration.part() {
        notes.push(format!("part of a longer recording: {}", crate::text::name(part)));
    }
    if !angle.repaired.is_empty() {
        notes.push(format!("tach edges repaired: {}", angle.repaired));
    }
    let hunting = Hunting::of(teeth).turns as usize;
    if angle.turns < hunting {
        notes.push(format!(
            "{} turns are less than the hunting period of {hunting}: each average holds a remainder of the other gear",
            angle.turns
        ));
    }
    let spacing = angle.slower_order() * angle.turns as f64;
    if spacing < 2.0 * lines::LOBE_BINS {
        notes.push(format!(
            "{:.1} turns of the slower shaft: sidebands closer than {:.0} bins run into each other, their amplitudes \
             are bounds",
            spacing,
            2.0 * lines::LOBE_BINS
        ));
    }
    if angle.highest_order < f64::from(teeth[0]) {
        notes.push(format!(
            "the sampling rate of {} Hz holds orders up to {:.1} only: no mesh harmonic",
            run.sample_rate_hz(),
            angle.highest_order
        ));
    }
    if angle.speed.fastest_hz > 1.3 * angle.speed.slowest_hz {
        notes.push(
            "the speed changes by more than 30 %: lines through resonances are averages of many amplitudes".into(),
        );
    }
    notes
}

fn channel(
    run: &Run,
    index: usize,
    name: &str,
    angle: &Angle,
    teeth: [u32; 2],
    ensembles: &mut [RunEnsemble; 2],
) -> ChannelOutcome {
    let (signal, rate_hz) = (run.signal_m_s2(index), run.sample_rate_hz());
    let samples = angle.resampled(&signal, rate_hz);
    let order_lines = OrderLines::new(&samples, angle.per_turn[0]);
    let order_spectrum = order_spectrum::order_spectrum(&order_lines, angle);
    let residual = average::not_locked_part(&samples, angle);
    let mut explained = Explained::new(teeth[0], angle, angle.highest_order);
    let (levels, lines) = unexplained::lines(&residual, angle, &mut explained, teeth[0]);
    let locked_share = 1.0 - variance(&residual) / variance(&samples).max(f64::MIN_POSITIVE);
    let mut known = explained.skirts.removed(residual, angle.per_turn[0]);
    known.iter_mut().zip(&samples).for_each(|(free, x)| *free = x - *free);
    let rest = envelope::not_locked(&signal, rate_hz, &known, angle);
    drop(known);
    let (envelope, coherence) = envelope::envelope(&rest, rate_hz, angle);
    let seen = unexplained::Channel {
        rest: &rest,
        rate_hz,
        order_spectrum: &order_spectrum,
        lines: &lines,
        envelope: &envelope,
        band_rms: envelope::band_rms(&signal, rate_hz, angle, &envelope.band),
    };
    let found = unexplained::unexplained(&seen, angle, &explained, teeth[0]);
    let top = angle.highest_order.min(MAP_HARMONICS * f64::from(teeth[0]));
    ChannelOutcome {
        channel: index,
        name: crate::text::name(name),
        rms: variance(&samples).sqrt(),
        locked_share,
        mesh: sidebands::harmonics(&order_lines, &levels[0], angle, teeth[0]),
        averages: average::averages(&samples, angle, teeth, ensembles),
        map: order_map::order_map(&samples, angle, top),
        unexplained: found,
        order_spectrum,
        envelope,
        coherence,
        bearing_lines: Vec::new(),
    }
}

pub(crate) fn variance(samples: &[f64]) -> f64 {
    let count = samples.len().max(1) as f64;
    let mean = samples.iter().sum::<f64>() / count;
    samples.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / count
}
