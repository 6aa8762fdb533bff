//! Reading of a record folder (record.toml, runNN.npy, runNN.tach.csv, pair stiffness table) for the closed loop.
//!
//! Only what the loop needs; every value is checked and refused with file, table and key.

use super::pair_curve::PairCurve;
use crate::machine::{Pair, Shafts};
use crate::{Error, Result};
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// One run: two acceleration channels, tachometer edges and the declared operating torque.
#[derive(Debug, Clone)]
pub struct Run {
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
    /// Tachometer pulses per pinion turn.
    pub pulses_per_rev: u32,
    /// Declared one-sigma jitter of an edge, s.
    pub jitter_s: f64,
    /// The runs.
    pub runs: Vec<Run>,
}

#[derive(Deserialize)]
struct Declaration {
    title: String,
    pair: Pair,
    shafts: Shafts,
    acquisition: Acquisition,
    tach: Tach,
    run: Vec<RunEntry>,
}

#[derive(Deserialize)]
struct Acquisition {
    sample_rate_hz: f64,
    full_scale_m_s2: f64,
}

#[derive(Deserialize)]
struct Tach {
    #[serde(default)]
    shaft: Option<String>,
    pulses_per_rev: u32,
    #[serde(default)]
    jitter_s: f64,
}

#[derive(Deserialize)]
struct RunEntry {
    signal: PathBuf,
    tach: PathBuf,
    #[serde(default)]
    first_pulse_index: u32,
    input_torque_n_m: f64,
}

/// Reads the record in `folder`.
///
/// # Errors
/// Missing or malformed files, non-finite or non-physical values, a tachometer on another shaft than the pinion.
pub fn read(folder: &Path) -> Result<Record> {
    let path = folder.join("record.toml");
    let text = std::fs::read_to_string(&path).map_err(Error::file(&path))?;
    let declaration: Declaration = toml::from_str(&text).map_err(|e| Error::invalid(path.display(), e.message()))?;
    let place = |key: &str| format!("{}: {key}", path.display());
    check(&declaration, &place)?;
    let table = declaration.pair.pair_stiffness.clone().ok_or_else(|| {
        Error::invalid(place("pair.pair_stiffness"), "the closed loop needs the pair stiffness table of the record")
    })?;
    let curve = PairCurve::read(&folder.join(table))?;
    let scale = declaration.acquisition.full_scale_m_s2 / 32767.0;
    let runs = declaration.run.iter().map(|entry| read_run(folder, entry, scale)).collect::<Result<Vec<_>>>()?;
    Ok(Record {
        title: declaration.title,
        pair: declaration.pair,
        shafts: declaration.shafts,
        curve,
        sample_rate_hz: declaration.acquisition.sample_rate_hz,
        pulses_per_rev: declaration.tach.pulses_per_rev,
        jitter_s: declaration.tach.jitter_s,
        runs,
    })
}

fn check(declaration: &Declaration, place: &dyn Fn(&str) -> String) -> Result<()> {
    let s = &declaration.shafts;
    let mut positive = vec![
        ("pair.module_m", declaration.pair.module_m),
        ("acquisition.sample_rate_hz", declaration.acquisition.sample_rate_hz),
        ("acquisition.full_scale_m_s2", declaration.acquisition.full_scale_m_s2),
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
    let tau = declaration.pair.mesh_damping_s;
    if !(tau.is_finite() && tau >= 0.0) {
        return Err(Error::invalid(place("pair.mesh_damping_s"), format!("{tau} must be zero or positive")));
    }
    if !(0.0..=1e-3).contains(&declaration.tach.jitter_s) {
        return Err(Error::invalid(place("tach.jitter_s"), "must lie between 0 and 1 ms"));
    }
    if declaration.pair.teeth.iter().any(|z| !(6..=1000).contains(z)) {
        return Err(Error::invalid(place("pair.teeth"), "both numbers of teeth must lie between 6 and 1000"));
    }
    if declaration.tach.pulses_per_rev == 0 {
        return Err(Error::invalid(place("tach.pulses_per_rev"), "must be at least 1"));
    }
    if declaration.tach.shaft.as_deref().is_some_and(|shaft| shaft != "pinion") {
        return Err(Error::invalid(place("tach.shaft"), "the closed loop needs the tachometer on the pinion"));
    }
    if declaration.run.is_empty() {
        return Err(Error::invalid(place("run"), "no runs"));
    }
    for run in &declaration.run {
        if !(run.input_torque_n_m.is_finite() && run.input_torque_n_m > 0.0) {
            return Err(Error::invalid(place("run.input_torque_n_m"), "must be a positive torque"));
        }
    }
    Ok(())
}

fn read_run(folder: &Path, entry: &RunEntry, scale: f64) -> Result<Run> {
    let path = folder.join(&entry.signal);
    let bytes = std::fs::read(&path).map_err(Error::file(&path))?;
    let npy = npyz::NpyFile::new(&bytes[..]).map_err(Error::file(&path))?;
    let shape = npy.shape().to_vec();
    if shape.len() != 2 || shape[1] != 2 {
        return Err(Error::invalid(path.display(), format!("shape {shape:?}, expected samples x 2 channels")));
    }
    let codes: Vec<i16> = npy.into_vec().map_err(Error::file(&path))?;
    let clipped = codes.iter().filter(|c| c.unsigned_abs() >= 32767).count() as f64 / codes.len().max(1) as f64;
    let channel = |c: usize| codes.iter().skip(c).step_by(2).map(|&code| f64::from(code) * scale).collect::<Vec<_>>();
    let tach = folder.join(&entry.tach);
    let text = std::fs::read_to_string(&tach).map_err(Error::file(&tach))?;
    let mut edges_s = Vec::new();
    for (number, line) in text.lines().enumerate().skip(1).filter(|(_, line)| !line.trim().is_empty()) {
        let value: f64 = line.trim().parse().unwrap_or(f64::NAN);
        if !value.is_finite() || edges_s.last().is_some_and(|&last| value <= last) {
            return Err(Error::invalid(
                format!("{}: line {}", tach.display(), number + 1),
                "not an increasing time in s",
            ));
        }
        edges_s.push(value);
    }
    if edges_s.len() < 3 {
        return Err(Error::invalid(tach.display(), "fewer than three edges"));
    }
    Ok(Run {
        channels: [channel(0), channel(1)],
        edges_s,
        first_pulse_index: entry.first_pulse_index,
        input_torque_n_m: entry.input_torque_n_m,
        clipped_share: clipped,
    })
}
