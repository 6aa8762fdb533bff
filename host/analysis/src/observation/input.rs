//! What the closed loop needs of a record: two channels in m/s2, tachometer edges, torques, the declared machine and
//! its pair stiffness.
//!
//! What is wrong with a record that is complete and readable is [`crate::check`]'s.
//!
//! Files are read and checked by [`crate::record`]; here only what the loop alone asks for is checked, refused with
//! file, table and key.

use crate::dynamics::assembly::{Damping, Model};
use crate::dynamics::{Motion, Rig};
use crate::machine::{Machine, Pair, Shafts};
use crate::record::{self, Tach};
use crate::stiffness::pair_curve::PairCurve;
use crate::{Error, Result};
use std::path::Path;

/// m/s2 in one g.
const STANDARD_GRAVITY: f64 = 9.806_65;

/// One run: two acceleration channels, tachometer edges and the declared operating torque.
#[derive(Debug, Clone)]
pub struct Run {
    /// Name of its signal in the record.
    pub name: String,
    /// Accelerations of pinion and gear body along the line of action, m/s2, one vector per channel.
    pub channels: [Vec<f64>; 2],
    /// Tachometer edge times, s from the first sample.
    pub edges_s: Vec<f64>,
    /// Pulse count of the first edge from shaft angle 0, modulo pulses per turn.
    pub first_pulse_index: u32,
    /// Declared torque at the input, N m.
    pub input_torque_n_m: f64,
    /// Share of samples at the ends of the code range.
    pub clipped_share: f64,
}

/// A record: declared machine, acquisition and runs.
#[derive(Debug, Clone)]
pub struct Record {
    /// Title of the record.
    pub title: String,
    /// Declared gear pair.
    pub pair: Pair,
    /// Declared shafts and bearings.
    pub shafts: Shafts,
    /// Stiffness of one tooth pair along the path of contact.
    pub curve: PairCurve,
    /// Sampling rate, Hz.
    pub sample_rate_hz: f64,
    /// Declared unit of the channels; "g" is converted to m/s2 where the record is viewed.
    pub unit: String,
    /// Frequency above which nothing is compared, where the chain passes less than the loop's own band, Hz.
    pub top_hz: Option<f64>,
    /// Tachometer pulses per pinion turn.
    pub pulses_per_rev: u32,
    /// Declared one-sigma jitter of an edge, s.
    pub jitter_s: f64,
    /// The runs.
    pub runs: Vec<Run>,
}

/// The loop's view of a record in memory.
///
/// # Errors
/// A record without machine, tachometer on the pinion whose angle 0 is known, or torques; other than two channels;
/// non-physical values.
pub fn view(record: &record::Record) -> Result<Record> {
    let path = record.folder.join("record.toml");
    let place = |key: &str| format!("{}: {key}", path.display());
    let tach = record.require_tach()?;
    if tach.is_virtual() {
        return Err(Error::invalid(
            place("tach.source"),
            "the closed loop needs shaft angle 0, which a virtual tach has not",
        ));
    }
    if tach.source.as_deref() == Some("measured") {
        let what = "the closed loop needs shaft angle 0, which an imported tach has not; take the key out where its \
            angle 0 is the machine's";
        return Err(Error::invalid(place("tach.source"), what));
    }
    let machine = record.declaration.machine()?;
    check(&machine, tach, &place)?;
    let rate_hz = record.declaration.acquisition.sample_rate_hz;
    let rig = Rig::new(&machine, Model::BendingTorsional, Damping::Declared)?;
    let steady = Motion::Constant { speed_hz: 1.0, turns_at_zero: 0.0 };
    rig.work(&steady, 1.0).check_against(rate_hz)?;
    let curve = match &machine.pair.pair_stiffness {
        Some(table) => PairCurve::read(&record.folder.join(table))?,
        None => PairCurve::sampled(&machine.pair_stiffness()?),
    };
    if record.declaration.acquisition.channels.len() != 2 {
        return Err(Error::invalid(place("acquisition.channels"), "the closed loop needs the two bodies' channels"));
    }
    let unit = record.declaration.acquisition.unit.clone().unwrap_or_else(|| "m/s2".into());
    let scale = if unit == "g" { STANDARD_GRAVITY } else { 1.0 };
    let runs = record.runs.iter().map(|run| view_run(run, scale, &place)).collect::<Result<Vec<_>>>()?;
    if runs.is_empty() {
        return Err(Error::invalid(place("run"), "no runs"));
    }
    Ok(Record {
        title: machine.title,
        pair: machine.pair,
        shafts: machine.shafts,
        curve,
        sample_rate_hz: record.declaration.acquisition.sample_rate_hz,
        unit,
        top_hz: None,
        pulses_per_rev: tach.pulses_per_rev,
        jitter_s: tach.jitter_s.unwrap_or(0.0),
        runs,
    })
}

/// Reads the record in `folder`.
///
/// # Errors
/// Those of [`record::Record::read`] and [`view`].
pub fn read(folder: &Path) -> Result<Record> {
    view(&record::Record::read(folder)?)
}

fn check(machine: &Machine, tach: &Tach, place: &dyn Fn(&str) -> String) -> Result<()> {
    let s = &machine.shafts;
    let mut positive = vec![
        ("pair.module_m", machine.pair.module_m),
        ("shafts.inertia_motor_kg_m2", s.inertia_motor_kg_m2),
        ("shafts.inertia_pinion_kg_m2", s.inertia_pinion_kg_m2),
        ("shafts.inertia_gear_kg_m2", s.inertia_gear_kg_m2),
        ("shafts.inertia_load_kg_m2", s.inertia_load_kg_m2),
    ];
    for (key, pair) in [
        ("shafts.mass_kg", s.mass_kg),
        ("shafts.coupling_stiffness_n_m_per_rad", s.coupling_stiffness_n_m_per_rad),
        ("shafts.coupling_damping_n_m_s_per_rad", s.coupling_damping_n_m_s_per_rad),
        ("shafts.bearing_stiffness_n_per_m", s.bearing_stiffness_n_per_m),
        ("shafts.bearing_damping_n_s_per_m", s.bearing_damping_n_s_per_m),
    ] {
        positive.extend(pair.map(|value| (key, value)));
    }
    for (key, value) in positive {
        if !(value.is_finite() && value > 0.0) {
            return Err(Error::invalid(place(key), format!("{value} must be a positive number")));
        }
    }
    let tau = machine.pair.mesh_damping_s;
    if !(tau.is_finite() && tau >= 0.0) {
        return Err(Error::invalid(place("pair.mesh_damping_s"), format!("{tau} must be zero or positive")));
    }
    if !tach.jitter_s.is_none_or(|jitter| (0.0..=1e-3).contains(&jitter)) {
        return Err(Error::invalid(place("tach.jitter_s"), "must lie between 0 and 1 ms"));
    }
    if tach.pulses_per_rev == 0 {
        return Err(Error::invalid(place("tach.pulses_per_rev"), "must be at least 1"));
    }
    if tach.shaft != "pinion" {
        return Err(Error::invalid(place("tach.shaft"), "the closed loop needs the tachometer on the pinion"));
    }
    Ok(())
}

fn view_run(run: &record::Run, scale: f64, place: &dyn Fn(&str) -> String) -> Result<Run> {
    let key = |what: &str| place(&format!("[[run]] {}: {what}", run.declaration.signal));
    let torque = run.declaration.input_torque_n_m.unwrap_or(f64::NAN);
    if !(torque.is_finite() && torque > 0.0) {
        return Err(Error::invalid(key("input_torque_n_m"), "must be a positive torque"));
    }
    if run.edges_s.len() < 3 {
        return Err(Error::invalid(key("tach"), "fewer than three edges"));
    }
    let codes = run.codes();
    let clipped = codes.iter().filter(|c| c.unsigned_abs() >= 32767).count();
    let channel = |c: usize| run.signal_m_s2(c).into_iter().map(|x| x * scale).collect();
    Ok(Run {
        name: run.declaration.signal.clone(),
        channels: [channel(0), channel(1)],
        edges_s: run.edges_s.clone(),
        first_pulse_index: run.declaration.first_pulse_index,
        input_torque_n_m: torque,
        clipped_share: clipped as f64 / codes.len().max(1) as f64,
    })
}
