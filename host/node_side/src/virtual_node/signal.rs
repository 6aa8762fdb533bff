//! What a virtual node is given: one channel of a record, or of a machine simulated for the purpose, with its tach.

use crate::dynamics::assembly::{Damping, Model};
use crate::dynamics::excitation::Effect;
use crate::dynamics::simulate::{Acquisition, simulate};
use crate::dynamics::{Motion, Rig};
use crate::link::train::FollowedGears;
use crate::machine::Machine;
use crate::record::{Declaration, Record};
use crate::virtual_node::image::{Image, Source};
use crate::{Error, Result};
use meshband::config::{Configuration, TrainGear};
use meshband_train::Train;

/// Unit of the amplitudes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Unit {
    /// m/s2
    Acceleration,
    /// Multiples of standard gravity; the node computes in m/s2.
    Gravity,
    /// What the record says: "V", or that it says nothing.
    Other(String),
}

impl Unit {
    /// The node's m/s2 per this unit.
    pub fn scale(&self) -> f64 {
        if *self == Unit::Gravity { 9.80665 } else { 1.0 }
    }
}

impl std::fmt::Display for Unit {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Unit::Acceleration => f.write_str("m/s2"),
            Unit::Gravity => f.write_str("g"),
            Unit::Other(name) if name == "unknown" => f.write_str("record's unit"),
            Unit::Other(name) => f.write_str(name),
        }
    }
}

/// The channel of a second sensor.
#[derive(Debug, Clone)]
pub struct Second {
    /// Name of the channel.
    pub channel: String,
    /// As many samples as the first one's.
    pub samples: Vec<f64>,
}

/// A channel with its tachometer.
#[derive(Debug, Clone)]
pub struct Signal {
    /// Record or machine.
    pub title: String,
    /// File it comes from, for messages.
    pub place: String,
    /// Name of the channel.
    pub channel: String,
    /// Unit of the samples, taken for m/s2 by the node.
    pub unit: Unit,
    /// Samples from the window's start.
    pub samples: Vec<f64>,
    /// What a second sensor hears at the same instants, where there is one.
    pub second: Option<Second>,
    /// Their rate, Hz.
    pub rate_hz: f64,
    /// Tach edges, s from the first sample, ascending; those before it are negative.
    pub edges_s: Vec<f64>,
    /// Tach pulses per turn of the tach's shaft.
    pub pulses_per_turn: u32,
    /// Turns of the pinion per turn of the tach's shaft.
    pub pinion_per_tach: f64,
    /// Teeth of pinion and gear.
    pub teeth: [u32; 2],
    /// Further gears of a train.
    pub train: Vec<TrainGear>,
    /// Fingerprint of the machine, where one is declared.
    pub machine_hash: Option<u64>,
    /// What a reader should know: window taken, virtual tach.
    pub notes: Vec<String>,
}

/// How a machine is run for the node.
pub struct Operation<'a> {
    /// Pinion speed, Hz.
    pub speed_hz: f64,
    /// Pinion speed at the end, Hz, for a run-up.
    pub final_speed_hz: Option<f64>,
    /// A run-up comes down again and stays at its first speed for so long, s, so that it can be repeated.
    pub back_s: Option<f64>,
    /// Torque at the motor, N m.
    pub torque_n_m: f64,
    /// Effects on top of the declared machine.
    pub effects: &'a [Box<dyn Effect>],
    /// Length and rate of the signal, tach, noise.
    pub acquisition: Acquisition,
    /// 0 for the pinion's bearing, 1 for the gear's.
    pub channel: usize,
    /// The same of a second sensor.
    pub second: Option<usize>,
}

/// The train of a record with the gears that a node follows; none for a pair.
fn followed_gears(record: &Record) -> Result<Option<(Train, FollowedGears)>> {
    let Some(train) = record.declaration.train()? else { return Ok(None) };
    let followed = FollowedGears::of(&train).map_err(|error| Error::invalid(record.folder.display(), error))?;
    Ok(Some((train, followed)))
}

impl Signal {
    /// A channel of a run with, if wanted, a second one, from `start_s` on, for `length_s` or to the end.
    ///
    /// # Errors
    /// A record without tach or tooth counts, no such run or channel, a window outside the run, or one without two
    /// tach edges.
    pub fn of_record(
        record: &Record,
        run: usize,
        (channel, second): (&str, Option<&str>),
        start_s: f64,
        length_s: Option<f64>,
    ) -> Result<Self> {
        let declaration = &record.declaration;
        let place = record.folder.display();
        let tach = record.require_tach()?;
        let run = record.run(run)?;
        let followed = followed_gears(record)?;
        let pair = followed.as_ref().map(|(_, of)| [of.pair.pinion_teeth, of.pair.gear_teeth].map(u32::from));
        let teeth = pair.or(declaration.teeth());
        let teeth = teeth.ok_or_else(|| Error::invalid(place, "[pair] teeth or [[stage]]: missing"))?;
        let (index, name) = find_channel(declaration, channel, "--channel")?;
        let second = second.map(|wanted| find_channel(declaration, wanted, "--second")).transpose()?;
        let (rate_hz, duration_s) = (run.sample_rate_hz(), run.duration_s());
        if !(0.0..duration_s).contains(&start_s) {
            return Err(Error::invalid("--start", format!("{start_s} s is not within the run's {duration_s:.3} s")));
        }
        let length_s = length_s.unwrap_or(duration_s - start_s);
        if !(length_s > 0.0 && length_s <= duration_s - start_s + 1e-9) {
            let what = format!("{length_s} s from {start_s} s on are not within the run's {duration_s:.3} s");
            return Err(Error::invalid("--duration", what));
        }
        let first = (start_s * rate_hz).round() as usize;
        let count = (length_s * rate_hz).round() as usize;
        let window =
            |index: usize| -> Vec<f64> { run.signal_m_s2(index).into_iter().skip(first).take(count).collect() };
        let samples = window(index);
        let second = second.map(|(index, channel)| Second { channel, samples: window(index) });
        let offset_s = first as f64 / rate_hz;
        let edges_s: Vec<f64> = run.edges_s.iter().map(|t| t - offset_s).collect();
        let end_s = count as f64 / rate_hz;
        if edges_s.iter().filter(|&&t| (0.0..end_s).contains(&t)).count() < 2 {
            return Err(Error::invalid("tach", format!("no two edges within the {end_s:.3} s replayed")));
        }
        let mut notes = Vec::new();
        if count < run.samples() {
            notes.push(format!("taken from the run of {duration_s:.2} s: {end_s:.2} s from {offset_s:.2} s on"));
        }
        if tach.is_virtual() {
            notes.push("the tach is virtual: its edges come from the phase of the mesh line".into());
        }
        Ok(Self {
            title: declaration.title().to_owned(),
            place: record.folder.join(&run.declaration.signal).display().to_string(),
            channel: name,
            unit: declaration.acquisition.unit.clone().map_or(Unit::Acceleration, Unit::Other),
            samples,
            second,
            rate_hz,
            edges_s,
            pulses_per_turn: tach.pulses_per_rev,
            pinion_per_tach: match &followed {
                Some((train, followed)) => followed.per_tach(train, tach.train_shaft().unwrap_or(0))?.into(),
                None => tach.turns_per_pinion_turn(Some(teeth)).map_or(1.0, f64::recip),
            },
            teeth,
            train: followed.map_or_else(Vec::new, |(_, followed)| followed.further),
            machine_hash: declaration.machine().ok().map(|machine| machine.hash()),
            notes,
        })
    }

    /// A channel of a simulated machine.
    ///
    /// # Errors
    /// What [`simulate`] refuses.
    pub fn of_machine(machine: &Machine, operation: &Operation<'_>) -> Result<Self> {
        let rig = Rig::new(machine, Model::BendingTorsional, Damping::Declared)?;
        let acquisition = &operation.acquisition;
        let motion = match operation.final_speed_hz {
            None => Motion::Constant { speed_hz: operation.speed_hz, turns_at_zero: 0.0 },
            Some(to_hz) => run_up(operation.speed_hz, to_hz, acquisition.duration_s, operation.back_s),
        };
        let simulated = simulate(&rig, &motion, operation.torque_n_m, operation.effects, acquisition)?;
        let names = ["pinion bearing, line of action", "gear bearing, line of action"];
        let (name, mut channels) = (names[operation.channel], simulated.channels);
        let samples = std::mem::take(&mut channels[operation.channel]);
        let second = operation.second.map(|second| {
            let samples =
                if second == operation.channel { samples.clone() } else { std::mem::take(&mut channels[second]) };
            Second { channel: names[second].into(), samples }
        });
        Ok(Self {
            title: machine.title.clone(),
            place: machine.title.clone(),
            channel: name.into(),
            unit: Unit::Acceleration,
            samples,
            second,
            rate_hz: acquisition.rate_hz,
            edges_s: simulated.edges_s,
            pulses_per_turn: acquisition.pulses_per_turn,
            pinion_per_tach: 1.0,
            teeth: machine.pair.teeth,
            train: Vec::new(),
            machine_hash: Some(machine.hash()),
            notes: vec![format!("simulated: bending-torsional model at {:.4} N m", operation.torque_n_m)],
        })
    }

    /// Length, s.
    pub fn duration_s(&self) -> f64 {
        self.samples.len() as f64 / self.rate_hz
    }

    /// The replay image of this signal.
    ///
    /// # Errors
    /// Those of [`Image::new`], with the file they concern.
    pub fn image(&self, config: &Configuration) -> Result<Image> {
        Image::new(self.source(), config, |header| header).map_err(|error| match error {
            Error::Invalid { what, .. } => Error::invalid(format!("{}, channel {}", self.place, self.channel), what),
            other => other,
        })
    }

    /// For the replay image.
    pub fn source(&self) -> Source<'_> {
        Source { samples: &self.samples, rate_hz: self.rate_hz, edges_s: &self.edges_s }
    }
}

/// Steady for the first fifth, so that the tach can lock, then rising by the same share every second, steady for the
/// last tenth; with `back_s` up to the middle, down again likewise, and steady for the last `back_s`.
fn run_up(from_hz: f64, to_hz: f64, duration_s: f64, back_s: Option<f64>) -> Motion {
    let moving_s = duration_s - back_s.unwrap_or(0.0);
    let (start, end) = match back_s {
        None => (0.2 * moving_s, 0.9 * moving_s),
        Some(_) => (0.1 * moving_s, 0.5 * moving_s),
    };
    let growth = (to_hz / from_hz).ln() / (end - start);
    let rise = |held: f64| if growth == 0.0 { from_hz * held } else { from_hz * (growth * held).exp_m1() / growth };
    let turns_up = rise(end - start);
    // Turns since the rise began, by seconds held in it, and the speed.
    let at = |t: f64| {
        let up = t.min(end).max(start) - start;
        let speed = from_hz * (growth * up).exp();
        let (mut turns, mut speed) = (from_hz * t.min(start) + rise(up), speed);
        if back_s.is_none() {
            turns += to_hz * (t - end).max(0.0);
        } else if t > end {
            let left = (end - start - (t - end)).max(0.0);
            turns += turns_up - rise(left) + from_hz * (t - end - (end - start)).max(0.0);
            speed = from_hz * (growth * left).exp();
        }
        (turns, speed)
    };
    // Cubic pieces between so many knots follow the exponential to 1e-7 of a turn.
    let last = if back_s.is_some() { 2.0 * end - start } else { end };
    let count = if back_s.is_some() { 280 } else { 140 };
    let moving = (0..=count).map(|i| start + (last - start) * f64::from(i) / f64::from(count));
    let times_s: Vec<f64> = std::iter::once(0.0).chain(moving).chain([duration_s]).collect();
    let (turns, speeds_hz) = times_s.iter().map(|&t| at(t)).unzip();
    Motion::Knots { times_s, turns, speeds_hz }
}

/// A channel by its number, its name, or a part that only one name has.
fn find_channel(declaration: &Declaration, wanted: &str, option: &str) -> Result<(usize, String)> {
    let names = &declaration.acquisition.channels;
    let refuse = |what: &str| Err(Error::invalid(option, format!("'{wanted}' {what}: {}", names.join(", "))));
    if let Ok(index) = wanted.parse::<usize>() {
        return match names.get(index) {
            Some(name) => Ok((index, name.clone())),
            None => Err(Error::invalid(
                option,
                format!("{index}: the record has {} channels, numbered from 0", names.len()),
            )),
        };
    }
    if let Some(index) = names.iter().position(|name| name == wanted) {
        return Ok((index, wanted.into()));
    }
    let mut hits = names.iter().enumerate().filter(|(_, name)| name.contains(wanted));
    match (hits.next(), hits.next()) {
        (Some((index, name)), None) => Ok((index, name.clone())),
        (Some(_), Some(_)) => refuse("fits more than one channel of"),
        _ => refuse("is none of the channels"),
    }
}
