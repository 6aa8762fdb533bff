//! What a record shows of a gear train: per stage mesh harmonics and sidebands of every gear, averages of every gear,
//! lines with their owners.
//!
//! Orders are those of the train's input (shaft 0), whichever shaft has the tach. The steps are those of a pair
//! ([`super`]); what differs is who owns a line: [`crate::train`] says so in exact fractions. Cost: a fold over the
//! samples per gear and a few hundred Fourier sums.

use super::angle::{Angle, SpeedRange};
use super::explained::{Explained, Owned};
use super::families::{self, Family, Orders};
use super::lines::OrderLines;
use super::order_spectrum::{self, OrderSpectrum};
use super::search::Level;
use super::sidebands::KnownLine;
use super::train_average::{self, GearAverage};
use super::unexplained;
use super::{Choice, chosen, notes_of, require_tach, variance};
use crate::record::{Record, Run};
use crate::train::{Mesh, Train, lines, phasing};
use crate::{Error, Result};
use rayon::prelude::*;
use serde::Serialize;
use std::sync::Arc;

/// Mesh harmonics of a stage, sidebands of a gear on each side, carrier orders on each side.
const HARMONICS: i64 = 6;
const SIDEBANDS: i64 = 3;
const CARRIER: i64 = 6;
/// Power over the floor's expectation that noise exceeds once in a thousand lines.
const MIN_FLOOR_POWER_RATIO: f64 = 6.9;
/// Steps farther than the nearest owner's at which another one is still said.
const FURTHER_STEPS: f64 = 1.0;
/// Bins within which a peak is an owner's.
const OWNED_BINS: f64 = 2.5;

/// What was found.
#[derive(Debug, Clone, Serialize)]
pub struct TrainOutcome {
    /// Version of this schema.
    pub schema: u32,
    /// Title of the record.
    pub title: String,
    /// Unit of all amplitudes.
    pub unit: String,
    /// Shafts in words, the input first.
    pub shafts: Vec<String>,
    /// Order of each.
    pub orders: Vec<f64>,
    /// Shaft of the tach.
    pub tach_shaft: usize,
    /// What holds of the whole record.
    pub notes: Vec<String>,
    /// The runs.
    pub runs: Vec<TrainRun>,
}

/// A run.
#[derive(Debug, Clone, Serialize)]
pub struct TrainRun {
    /// Index in the record.
    pub run: usize,
    /// Speed of the input.
    pub speed: SpeedRange,
    /// Turns of every shaft.
    pub turns: Vec<f64>,
    /// What was done to the edges.
    pub notes: Vec<String>,
    /// The channels.
    pub channels: Vec<TrainChannel>,
}

/// A channel.
#[derive(Debug, Clone, Serialize)]
pub struct TrainChannel {
    /// Index in the record.
    pub channel: usize,
    /// Name.
    pub name: String,
    /// RMS about the mean.
    pub rms: f64,
    /// Share of the mean square at orders that a part of the train owns.
    pub owned_share: f64,
    /// Order spectrum.
    pub order_spectrum: OrderSpectrum,
    /// Stage by stage.
    pub stages: Vec<StageLines>,
    /// Gear by gear.
    pub averages: Vec<GearAverage>,
    /// The strongest lines with their owners; without one where none has it.
    pub strongest: Vec<OwnedLine>,
    /// Lines that no part owns, in families.
    pub unowned: Vec<Family>,
}

/// A line and whose it is.
#[derive(Debug, Clone, Serialize)]
pub struct OwnedLine {
    /// Order.
    pub order: f64,
    /// Amplitude, record's unit.
    pub amplitude: f64,
    /// Owners in words, the likeliest first.
    pub owners: Vec<String>,
}

/// Mesh lines of a stage.
#[derive(Debug, Clone, Serialize)]
pub struct StageLines {
    /// Stage, from 1.
    pub stage: usize,
    /// Order of its mesh.
    pub mesh_order: f64,
    /// Its harmonics.
    pub harmonics: Vec<StageHarmonic>,
}

/// A mesh harmonic.
#[derive(Debug, Clone, Serialize)]
pub struct StageHarmonic {
    /// Number.
    pub number: i64,
    /// Its line.
    pub line: KnownLine,
    /// At the mean speed, Hz.
    pub frequency_hz: f64,
    /// Sidebands of every gear.
    pub gears: Vec<GearSidebands>,
    /// Lines at whole orders of a turning carrier about it.
    pub carrier: Vec<CarrierLine>,
}

/// Sidebands of one gear about one harmonic.
#[derive(Debug, Clone, Serialize)]
pub struct GearSidebands {
    /// "pinion".
    pub gear: String,
    /// Lower and upper, by number from 1.
    pub pairs: Vec<[KnownLine; 2]>,
    /// Power of all of them over that of the stage's strongest line about this harmonic, dB.
    pub level_db: f64,
}

/// A line of planets passing.
#[derive(Debug, Clone, Serialize)]
pub struct CarrierLine {
    /// Carrier orders above the harmonic.
    pub number: i64,
    /// The line.
    pub line: KnownLine,
    /// Whether a sound set has it.
    pub sound: bool,
}

/// Analyses the chosen runs and channels of a record of a train.
///
/// # Errors
/// As [`super::record`].
pub fn record(record: &Record, train: &Train, choice: Choice) -> Result<TrainOutcome> {
    let tach = require_tach(record)?.clone();
    let acquisition = &record.declaration.acquisition;
    let channels = chosen(choice.channel, acquisition.channels.len(), "channel", record)?;
    let mut notes = notes_of(&tach, acquisition.unit.as_deref());
    let (mut runs, mut refused): (Vec<TrainRun>, Option<Error>) = (Vec::new(), None);
    for index in chosen(choice.run, record.runs.len(), "run", record)? {
        let run = &record.runs[index];
        match Angle::of_train(run, &tach, train, &format!("{} run {index}", record.folder.display())) {
            Ok(angle) => {
                let angle = angle.with_cheap_turns(None).settled(&tach);
                runs.push(of_run(run, index, &angle, train, &channels, &acquisition.channels));
            }
            Err(error) => {
                notes.push(format!("left out: {error}"));
                refused.get_or_insert(error);
            }
        }
    }
    if let (true, Some(error)) = (runs.is_empty(), refused) {
        return Err(error);
    }
    Ok(TrainOutcome {
        schema: 1,
        title: record.declaration.title().to_owned(),
        unit: acquisition.unit.clone().unwrap_or_else(|| "m/s2".into()),
        shafts: (0..train.shafts.len()).map(|shaft| train.shaft_words(shaft)).collect(),
        orders: (0..train.shafts.len()).map(|shaft| train.shaft_order(shaft).value()).collect(),
        tach_shaft: tach.train_shaft().unwrap_or(0),
        notes,
        runs,
    })
}

fn of_run(run: &Run, index: usize, angle: &Angle, train: &Train, channels: &[usize], names: &[String]) -> TrainRun {
    let owned = Arc::new(Owned::of_train(train, angle.highest_order));
    let moves = |c: &&usize| run.moves(**c);
    let of = |c: &usize| of_channel(run, *c, &names[*c], angle, train, &owned);
    let outcomes = channels.par_iter().filter(moves).map(of).collect();
    let mut notes = Vec::new();
    if !angle.repaired.is_empty() {
        notes.push(format!("tach edges repaired: {}", angle.repaired));
    }
    let turns: Vec<f64> =
        (0..train.shafts.len()).map(|shaft| angle.turns as f64 * train.shaft_order(shaft).value()).collect();
    let seldom: Vec<String> = (0..turns.len()).filter(|s| turns[*s] < 12.0).map(|s| s.to_string()).collect();
    if !seldom.is_empty() {
        notes.push(format!(
            "shaft {} turns less than 12 times: its sidebands run into each other, amplitudes are bounds",
            seldom.join(", ")
        ));
    }
    TrainRun { run: index, speed: angle.speed, turns, notes, channels: outcomes }
}

fn of_channel(run: &Run, index: usize, name: &str, angle: &Angle, train: &Train, owned: &Arc<Owned>) -> TrainChannel {
    let (signal, rate_hz) = (run.signal_m_s2(index), run.sample_rate_hz());
    let samples = angle.resampled(&signal, rate_hz);
    let lines = OrderLines::new(&samples, angle.per_turn[0]);
    let order_spectrum = order_spectrum::order_spectrum(&lines, angle);
    let locked = owned.locked_part(&samples, angle.turns);
    let rest: Vec<f64> = samples.iter().zip(&locked).map(|(x, l)| x - l).collect();
    let leading = train.gears.first().map_or(2, |gear| gear.teeth);
    let mut explained = Explained::of_train(owned, leading, angle, angle.highest_order);
    let (levels, found) = unexplained::lines(&rest, angle, &mut explained, leading);
    let orders = Orders {
        teeth: train.meshes.first().map_or(1.0, |mesh| mesh.order.value()),
        gear_order: angle.gear_order,
        lowest: unexplained::lowest_order(angle),
        highest: angle.highest_order,
        mesh: true,
    };
    TrainChannel {
        channel: index,
        name: crate::text::name(name),
        rms: variance(&samples).sqrt(),
        owned_share: 1.0 - variance(&rest) / variance(&samples).max(f64::MIN_POSITIVE),
        stages: train.meshes.iter().filter(|m| m.exact).map(|m| stage(m, train, &lines, &levels[0], angle)).collect(),
        averages: train_average::averages(&samples, angle, train, &lines),
        strongest: strongest(&order_spectrum, train),
        unowned: families::group(&found, &orders, &|order, half| explained.at(order, half)),
        order_spectrum,
    }
}

fn stage(mesh: &Mesh, train: &Train, lines: &OrderLines, floor: &Level, angle: &Angle) -> StageLines {
    let read = |order: f64| {
        let amplitude = lines.at(order).norm();
        let noise = floor.floor_amplitude(order);
        KnownLine { order, amplitude, stands: amplitude * amplitude > MIN_FLOOR_POWER_RATIO * noise * noise }
    };
    let own = mesh.order.value();
    let count = ((angle.highest_order / own - 0.5).max(0.0) as i64).min(HARMONICS);
    let harmonics = (1..=count).map(|number| harmonic(mesh, train, number, angle, &read));
    StageLines { stage: mesh.stage + 1, mesh_order: own, harmonics: harmonics.collect() }
}

fn harmonic(mesh: &Mesh, train: &Train, number: i64, angle: &Angle, read: &dyn Fn(f64) -> KnownLine) -> StageHarmonic {
    let order = number as f64 * mesh.order.value();
    let line = read(order);
    let carrier: Vec<CarrierLine> = match mesh.carrier.as_ref().filter(|carrier| carrier.speed.sign() != 0) {
        None => Vec::new(),
        Some(carrier) => (-CARRIER..=CARRIER)
            .filter(|n| *n != 0)
            .filter_map(|n| {
                let order = phasing::order(mesh, carrier, number, n).ok()?.value();
                Some(CarrierLine { number: n, line: read(order), sound: phasing::stands(carrier, number, n) })
            })
            .collect(),
    };
    let strongest = carrier.iter().map(|c| c.line.amplitude).fold(line.amplitude, f64::max);
    let of_gear = |g: &usize| {
        let gear = &train.gears[*g];
        let rate = gear.rate.magnitude().value();
        let pair = |n: i64| [-1.0, 1.0].map(|side| read(order + side * n as f64 * rate));
        let pairs: Vec<[KnownLine; 2]> = (1..=SIDEBANDS).map(pair).collect();
        let power: f64 = pairs.iter().flatten().map(|line| line.amplitude.powi(2)).sum();
        let level_db = 10.0 * (power / strongest.powi(2).max(f64::MIN_POSITIVE)).log10();
        GearSidebands { gear: gear.role.word(), pairs, level_db }
    };
    let gears = mesh.gears.iter().filter(|g| train.gears[**g].rate.sign() != 0).map(of_gear).collect();
    StageHarmonic { number, line, frequency_hz: order * angle.speed.mean_hz, gears, carrier }
}

fn strongest(spectrum: &OrderSpectrum, train: &Train) -> Vec<OwnedLine> {
    let half = OWNED_BINS * spectrum.bin_orders;
    let table = lines::table(train).unwrap_or_default();
    let faults = crate::train::families::all(train, spectrum.highest_order);
    let of = |(order, amplitude): &(f64, f64)| {
        // With the steps away from what it stands beside: the fewest are the likeliest.
        let mut owners: Vec<(f64, String)> = Vec::new();
        let mut add = |steps: f64, words: String| {
            if owners.iter().all(|(_, other)| *other != words) {
                owners.push((steps, words));
            }
        };
        for mesh in train.meshes.iter().filter(|mesh| mesh.exact) {
            let k = (order / mesh.order.value()).round();
            if k >= 1.0 && (order - k * mesh.order.value()).abs() <= half {
                add(0.0, format!("{k} x mesh of stage {}", mesh.stage + 1));
            }
            let one = Train { meshes: vec![mesh.clone()], ..train.clone() };
            let sound = lines::of_sound_meshes(&one, spectrum.highest_order.min(order + 1.0));
            if mesh.carrier.is_some() && sound.iter().any(|own| (own - order).abs() <= half) {
                add(0.0, format!("planets passing the mesh of stage {}", mesh.stage + 1));
            }
        }
        table.iter().filter(|line| (line.value - order).abs() <= half).for_each(|line| add(0.0, line.what.clone()));
        for shaft in (0..train.shafts.len()).filter(|shaft| train.exact[*shaft]) {
            let own = train.shaft_order(shaft).value();
            let n = (order / own).round();
            if (1.0..20.0).contains(&n) && (order - n * own).abs() <= half {
                add(n, format!("{n} x shaft {shaft}"));
            }
        }
        for family in &faults {
            if let Some(line) = family.lines.iter().find(|line| (line.order - order).abs() <= half) {
                add((line.spacing / family.base).abs().round(), line.label.clone());
            }
        }
        owners.sort_by(|a, b| a.0.total_cmp(&b.0));
        let fewest = owners.first().map_or(0.0, |own| own.0);
        owners.retain(|(steps, _)| *steps <= fewest + FURTHER_STEPS);
        OwnedLine { order: *order, amplitude: *amplitude, owners: owners.into_iter().map(|own| own.1).collect() }
    };
    spectrum.strongest.iter().map(of).collect()
}
