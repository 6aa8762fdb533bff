//! The corrected machine: declared parameters as adopted, named effects as the simulator's, law refitted where it must be.
//!
//! Three files beside the machine: `NAME.corrected.toml` (a machine file), `NAME.effects.toml` (`[[effect]]` tables with the simulator's
//! names, for named verdicts only) and `NAME.law.toml` where pair stiffness, mesh damping or the ramp changed: the law times the
//! engagement edge, which shafts' and sensors' effects do not touch. Phases follow the simulator's `cos(order angle + phase)`.

use super::outcome::{Effect, Outcome};
use crate::law::derive::{check, derive, edge_bandwidth_hz, study_torque};
use crate::law::operating::Bench;
use crate::machine::Machine;
use crate::{Error, Result, effects};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Loop name, simulator name, gear (0 pinion, 1 gear) and keys: outcome parameter prefix to simulator key.
type Mapping = (&'static str, &'static str, Option<f64>, &'static [(&'static str, &'static str)]);

/// How named effects go into the simulator; names not listed have no one-to-one counterpart and are only written as comments.
pub const MAPPING: &[Mapping] = &[
    ("pinion-eccentricity", "eccentricity", Some(0.0), &[("amplitude", "amplitude")]),
    ("gear-eccentricity", "eccentricity", Some(1.0), &[("amplitude", "amplitude")]),
    ("pinion-imbalance", "imbalance", Some(0.0), &[("unbalance", "moment")]),
    ("gear-imbalance", "imbalance", Some(1.0), &[("unbalance", "moment")]),
    ("pinion-pitch-error", "pitch-error", Some(0.0), &[("single_tooth_offset", "single")]),
    ("gear-pitch-error", "pitch-error", Some(1.0), &[("single_tooth_offset", "single")]),
    ("pinion-tooth-crack", "tooth-crack", Some(0.0), &[("stiffness_loss", "loss")]),
    ("gear-tooth-crack", "tooth-crack", Some(1.0), &[("stiffness_loss", "loss")]),
    ("wear", "wear", None, &[("depth", "depth")]),
    ("friction", "friction", None, &[("coefficient", "coefficient")]),
    ("ghost-order", "ghost-order", None, &[("amplitude", "amplitude")]),
    ("torque-ripple", "torque-ripple", None, &[("share_of_torque", "depth")]),
    ("load-fluctuation", "load-fluctuation", None, &[("share_of_torque", "depth")]),
    ("coupling-misalignment", "coupling-misalignment", None, &[("radial_force", "force")]),
    ("bearing-stiffness-modulation", "bearing-stiffness-modulation", None, &[("share_of_stiffness", "share")]),
    ("mains-hum", "mains-hum", None, &[("acceleration", "first")]),
    ("thermal-drift", "thermal-drift", None, &[("share", "share"), ("gain_change", "share")]),
    ("sensor-nonlinearity", "sensor-nonlinearity", None, &[("quadratic", "quadratic")]),
    ("transfer-path-resonance", "transfer-path-resonance", None, &[("gain", "gain"), ("frequency", "frequency")]),
];

/// Effects that change the pair's stiffness or ramp, and so the law.
const OF_THE_PAIR: [&str; 4] = ["tip-relief", "profile-error", "wear", "tooth-crack"];

/// What was written.
#[derive(Debug, Clone, Serialize)]
pub struct Applied {
    /// Corrected machine.
    pub machine: PathBuf,
    /// Effects.
    pub effects: PathBuf,
    /// Effects written as tables, as `simulate --effect` takes them.
    pub written: Vec<String>,
    /// Verdicts without a counterpart in the simulator.
    pub not_written: Vec<String>,
    /// Law, where it was fitted again.
    pub law: Option<PathBuf>,
    /// Predicted edge bandwidth at the machine's nominal speed, Hz: declared, corrected.
    pub bandwidth_hz: Option<[f64; 2]>,
    /// Why the law was fitted again or not.
    pub law_remark: String,
}

fn table(effect: &Effect) -> Option<(String, toml::Table)> {
    let (_, name, gear, keys) = MAPPING.iter().find(|m| m.0 == effect.name)?;
    let mut table = toml::Table::new();
    let mut put = |key: &str, value: f64| table.insert(key.into(), toml::Value::Float(value));
    let entry = effects::entry(name).ok()?;
    let known = |key: &str| entry.parameters.iter().any(|p| p.name == key);
    let mut any = false;
    for (prefix, key) in *keys {
        if let Some((label, value)) =
            effect.parameters.iter().find(|(n, _)| n.starts_with(prefix) && !n.contains("phase"))
        {
            put(key, value.value);
            any = true;
            if let Some(tooth) = label.rsplit("tooth ").next().and_then(|t| t.parse::<f64>().ok()) {
                put("tooth", tooth);
            }
        }
    }
    if let Some(gear) = gear.or(match effect.shaft.as_str() {
        "gear" => Some(1.0),
        "pinion" => Some(0.0),
        _ => None,
    }) && known("gear")
    {
        put("gear", gear);
    }
    if let Some((_, phase)) = effect.parameters.iter().find(|(n, _)| n.contains("phase"))
        && known("phase")
    {
        put("phase", phase.value);
    }
    if let Some(order) = effect.order_of_pinion.filter(|_| known("order")) {
        put("order", order);
    }
    if let Some(hz) = effect.frequency_hz.filter(|_| known("frequency")) {
        put("frequency", hz);
    }
    any.then(|| ((*name).to_string(), table))
}

/// The corrected machine's parameters.
fn change(machine: &mut Machine, outcome: &Outcome, folder: &Path, stem: &str) -> Result<()> {
    let f = |name: &str| 1.0 + outcome.declared_parameter_changes.get(name).copied().unwrap_or(0.0);
    let s = &mut machine.shafts;
    for (side, body) in ["pinion", "gear"].into_iter().enumerate() {
        s.bearing_stiffness_n_per_m[side] *= f(&format!("{body} bearing stiffness"));
        s.bearing_damping_n_s_per_m[side] *= f(&format!("{body} bearing damping"));
        s.mass_kg[side] *= f(&format!("{body} mass"));
        let coupling = ["input", "output"][side];
        s.coupling_stiffness_n_m_per_rad[side] *= f(&format!("{coupling} coupling stiffness"));
        s.coupling_damping_n_m_s_per_rad[side] *= f(&format!("{coupling} coupling damping"));
    }
    s.inertia_pinion_kg_m2 *= f("pinion inertia");
    s.inertia_gear_kg_m2 *= f("gear inertia");
    machine.pair.mesh_damping_s *= f("mesh damping");
    machine.pair.mesh_damping_ratio = None;
    let stiffness = f("mesh stiffness");
    let Some(old) = machine.pair.pair_stiffness.clone() else {
        // Every part of the pair's stiffness is proportional to Young's modulus.
        machine.pair.youngs_modulus_pa *= stiffness;
        return Ok(());
    };
    let curve = super::pair_curve::PairCurve::read(&machine.folder.join(old))?;
    let name = PathBuf::from(format!("{stem}.corrected.pair_stiffness.csv"));
    let mut text = String::from("position_base_pitches,stiffness_n_per_m\n");
    for (u, k) in curve.u.iter().zip(&curve.k) {
        text += &format!("{u:.9},{:.9e}\n", k * stiffness);
    }
    let path = folder.join(&name);
    std::fs::write(&path, text).map_err(Error::file(&path))?;
    machine.pair.pair_stiffness = Some(name);
    Ok(())
}

/// Writes the corrected machine of `outcome` beside `path` (a machine file, or a record folder).
///
/// # Errors
/// An unreadable machine, files that cannot be written, a law that cannot be derived.
pub fn apply(path: &Path, outcome: &Outcome) -> Result<Applied> {
    let declared = Machine::read(path)?;
    let folder = if path.is_dir() { path } else { path.parent().unwrap_or(Path::new(".")) };
    let stem = if path.is_dir() {
        "machine".into()
    } else {
        path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
    };
    let mut corrected = declared.clone();
    change(&mut corrected, outcome, folder, &stem)?;
    let text = toml::to_string(&corrected).map_err(|e| Error::invalid(path.display(), e))?;
    let machine = folder.join(format!("{stem}.corrected.toml"));
    std::fs::write(&machine, text).map_err(Error::file(&machine))?;
    let (mut list, mut written, mut not_written) = (Vec::new(), Vec::new(), Vec::new());
    for effect in &outcome.effects {
        match table(effect).filter(|_| effect.verdict == "named") {
            Some((name, mut table)) => {
                effects::from_table(&name, &table)?;
                let keys: Vec<String> = table.iter().map(|(k, v)| format!("{k}={v}")).collect();
                written.push(format!("{name}:{}", keys.join(",")));
                table.insert("name".into(), toml::Value::String(name));
                list.push(toml::Value::Table(table));
            }
            None => not_written.push(format!("{}: {}", effect.verdict, effect.name)),
        }
    }
    let mut text = String::from("# Effects found by `meshband loop`, with the simulator's names.\n");
    for other in &not_written {
        text += &format!("# without counterpart: {other}\n");
    }
    let whole = toml::Table::from_iter([("effect".to_string(), toml::Value::Array(list))]);
    text += &toml::to_string(&whole).map_err(|e| Error::invalid("effects", e))?;
    let effects = folder.join(format!("{stem}.effects.toml"));
    std::fs::write(&effects, text).map_err(Error::file(&effects))?;
    let (law, bandwidth_hz, law_remark) = law(&declared, &machine, outcome, &folder.join(format!("{stem}.law.toml")))?;
    Ok(Applied { machine, effects, written, not_written, law, bandwidth_hz, law_remark })
}

type LawResult = (Option<PathBuf>, Option<[f64; 2]>, String);

fn law(declared: &Machine, corrected: &Path, outcome: &Outcome, target: &Path) -> Result<LawResult> {
    let of_pair = outcome.effects.iter().any(|e| OF_THE_PAIR.iter().any(|n| e.name.contains(n)));
    let changed = ["mesh stiffness", "mesh damping"]
        .iter()
        .any(|n| outcome.declared_parameter_changes.get(*n).is_some_and(|c| c.abs() > 0.005));
    if !of_pair && !changed {
        return Ok((None, None, "unchanged: no effect on the pair or its ramp".into()));
    }
    let corrected = Machine::read(corrected)?;
    let Ok(torque) = study_torque(&corrected) else {
        return Ok((None, None, "not fitted: the machine declares no nominal torque".into()));
    };
    let speed = corrected.nominal.map_or(15.0, |n| n.speed_hz);
    let fitted = || -> Result<([f64; 2], String)> {
        let (before, after) = (Bench::new(declared)?, Bench::new(&corrected)?);
        let bandwidth = [edge_bandwidth_hz(&before, speed, torque)?, edge_bandwidth_hz(&after, speed, torque)?];
        let bar = crate::terminal::Progress::new("law", crate::law::derive::OPERATING_POINTS);
        let laws = derive(&corrected, &after, &|| bar.step())?;
        let uncertainty = check(&laws, &after, &|| bar.step())?.relative_uncertainty();
        Ok((bandwidth, laws.file(uncertainty).to_toml()))
    };
    let (bandwidth, text) = match fitted() {
        Ok(law) => law,
        // A machine whose edges cannot be timed has no law; its correction stands all the same.
        Err(why) => return Ok((None, None, format!("not fitted: {why}"))),
    };
    std::fs::write(target, text).map_err(Error::file(target))?;
    let remark = format!("fitted again: pair, mesh damping or ramp changed; edge bandwidth at {speed} Hz as given");
    Ok((Some(target.to_owned()), Some(bandwidth), remark))
}
