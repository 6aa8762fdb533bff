//! The corrected machine: declared parameters as adopted, named effects as the simulator's, and its law.
//!
//! Files beside the machine: `NAME.corrected.toml` (a machine file), `NAME.effects.toml` (`[[effect]]` tables with the simulator's
//! names, for named verdicts only, the factor on declared torques, the turns by which runs start later), `NAME.law.toml` (the law of that machine with the effects that
//! every pair carries: wear, relief, profile; shafts' and sensors' effects and single teeth do not touch the engagement edge that it times).
//! How orders, phases and teeth become the simulator's is [`super::carry`]'s.

use super::carry::carry;
use super::outcome::Outcome;
use crate::law::derive::OPERATING_POINTS;
use crate::law::either_edge::by_same_edge;
use crate::law::file::LawFile;
use crate::law::operating::{Bench, Event};
use crate::machine::{Machine, Nominal};
use crate::record::Record;
use crate::{Error, Result, effects, terminal};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Simulator's effects that every pair carries alike, and so the law.
const OF_EVERY_PAIR: [&str; 3] = ["tip-relief", "profile-error", "wear"];

/// What was written.
#[derive(Debug, Clone, Serialize)]
pub struct Applied {
    /// Corrected machine.
    pub machine: PathBuf,
    /// Effects.
    pub effects: PathBuf,
    /// Effects written as tables, as `simulate --effect` takes them.
    pub written: Vec<String>,
    /// What does not carry over, by the loop's name of the effect.
    pub remarks: Vec<String>,
    /// Verdicts without a counterpart in the simulator.
    pub not_written: Vec<String>,
    /// Factor on declared torques.
    pub torque_factor: f64,
    /// Turns of the pinion by which every run starts later than its pulse 0 says, which teeth and phases of the gear hold with.
    pub pinion_turns: Option<Vec<u32>>,
    /// Law of the corrected machine.
    pub law: Option<PathBuf>,
    /// Which edge it times and why, or why there is none.
    pub law_remark: String,
    /// Predicted edge bandwidth at the machine's nominal speed, Hz: declared, corrected.
    pub bandwidth_hz: Option<[f64; 2]>,
    /// Laws of the declared and of the corrected machine, by the same edge.
    #[serde(skip)]
    pub laws: Option<[LawFile; 2]>,
}

/// The corrected machine's parameters.
fn change(machine: &mut Machine, outcome: &Outcome, folder: &Path, stem: &str) -> Result<()> {
    let f = |name: &str| 1.0 + outcome.corrected_parameter_changes.get(name).copied().unwrap_or(0.0);
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
    let mut declared = Machine::read(path)?;
    if declared.nominal.is_none() && path.is_dir() {
        declared.nominal = nominal(&Record::read(path)?);
    }
    let folder = if path.is_dir() { path } else { path.parent().unwrap_or(Path::new(".")) };
    let stem = if path.is_dir() {
        "machine".into()
    } else {
        path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
    };
    let held = &outcome.error.held_out_runs;
    // What does not predict runs it has not seen corrects nothing.
    let better = held.whole_signal[1] <= held.whole_signal[0];
    let (mut list, mut written, mut remarks, mut not_written) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let mut pinion_turns: Option<Vec<u32>> = None;
    if !better {
        remarks.push("held-out error does not fall: the machine stays as declared".into());
    }
    for (i, effect) in outcome.effects.iter().enumerate() {
        let term = outcome.terms.get(i).filter(|t| t.name == effect.name);
        let carried = if effect.verdict == "named" && better { carry(effect, term, &declared) } else { Ok(None) };
        let carried = match carried {
            Ok(Some(carried)) => carried,
            Ok(None) => {
                not_written.push(format!("{}: {}", effect.verdict, effect.name));
                continue;
            }
            Err(why) => {
                not_written.push(format!("{}: {} ({why})", effect.verdict, effect.name));
                continue;
            }
        };
        if let (Some(own), Some(known)) = (&carried.pinion_turns, &pinion_turns)
            && own != known
        {
            remarks.push(format!("{}: its runs start at other turns of the pinion than those written", effect.name));
        }
        pinion_turns = pinion_turns.or(carried.pinion_turns);
        remarks.extend(carried.remark.map(|remark| format!("{}: {remark}", effect.name)));
        for (name, mut table) in carried.tables {
            let keys: Vec<String> = table.iter().map(|(k, v)| format!("{k}={v}")).collect();
            written.push(format!("{name}:{}", keys.join(",")));
            table.insert("name".into(), toml::Value::String(name.into()));
            list.push(table);
        }
    }
    // Parameters moved next to every effect; where one of these stays out they may stand for it.
    let moved = better && not_written.is_empty();
    if better && !moved {
        remarks
            .push("declared parameters stay as declared: they were fitted next to effects that are not written".into());
    }
    let mut corrected = declared.clone();
    if moved {
        change(&mut corrected, outcome, folder, &stem)?;
    }
    let text = toml::to_string(&corrected).map_err(|e| Error::invalid(path.display(), e))?;
    let machine = folder.join(format!("{stem}.corrected.toml"));
    std::fs::write(&machine, text).map_err(Error::file(&machine))?;
    let torque = outcome.corrected_parameter_changes.get("torque").filter(|_| moved);
    let torque_factor = 1.0 + torque.copied().unwrap_or(0.0);
    let mut text = String::from("# Effects found by `meshband loop`, with the simulator's names.\n");
    remarks.iter().for_each(|remark| text += &format!("# {remark}\n"));
    not_written.iter().for_each(|other| text += &format!("# without counterpart: {other}\n"));
    let of_every_pair: Vec<toml::Table> = list.iter().filter(|t| of_every_pair(t)).cloned().collect();
    let list = list.into_iter().map(toml::Value::Table).collect();
    let whole = [("torque_factor", toml::Value::Float(torque_factor)), ("effect", toml::Value::Array(list))];
    let mut whole = toml::Table::from_iter(whole.map(|(key, value)| (key.to_string(), value)));
    if let Some(turns) = &pinion_turns {
        let list = turns.iter().map(|k| toml::Value::Integer(i64::from(*k))).collect();
        whole.insert("pinion_turns".into(), toml::Value::Array(list));
    }
    text += &toml::to_string(&whole).map_err(|e| Error::invalid("effects", e))?;
    let effects = folder.join(format!("{stem}.effects.toml"));
    std::fs::write(&effects, text).map_err(Error::file(&effects))?;
    let mut applied = Applied {
        machine,
        effects,
        written,
        remarks,
        not_written,
        torque_factor,
        pinion_turns,
        law: None,
        law_remark: String::new(),
        bandwidth_hz: None,
        laws: None,
    };
    law(&declared, of_every_pair, &folder.join(format!("{stem}.law.toml")), &mut applied)?;
    Ok(applied)
}

/// The middle of a record's runs, for a machine that declares no operating point.
fn nominal(record: &Record) -> Option<Nominal> {
    let pulses = f64::from(record.require_tach().ok()?.pulses_per_rev);
    let points: Vec<[f64; 2]> = record
        .runs
        .iter()
        .filter_map(|run| {
            let (first, last) = (run.edges_s.first()?, run.edges_s.last()?);
            let speed = (run.edges_s.len() - 1) as f64 / pulses / (last - first);
            Some([speed, run.declaration.input_torque_n_m?])
        })
        .collect();
    let mean = |i: usize| points.iter().map(|p| p[i]).sum::<f64>() / points.len() as f64;
    (!points.is_empty()).then(|| Nominal { speed_hz: mean(0), torque_n_m: mean(1) })
}

fn of_every_pair(table: &toml::Table) -> bool {
    table.get("name").and_then(toml::Value::as_str).is_some_and(|name| OF_EVERY_PAIR.contains(&name))
}

/// Derives the laws of both machines, writes the corrected one's and says what edge they time.
fn law(declared: &Machine, of_every_pair: Vec<toml::Table>, target: &Path, applied: &mut Applied) -> Result<()> {
    let corrected = Machine::read(&applied.machine)?;
    let count = of_every_pair.len();
    let bar = terminal::Progress::new("law", 2 * OPERATING_POINTS);
    let both = || -> Result<_> {
        let before = Bench::new(declared)?;
        let after = Bench::new(&corrected)?.with_effects(move || {
            let made = of_every_pair.iter().map(|table| {
                let mut table = table.clone();
                let name = table.remove("name");
                effects::from_table(name.as_ref().and_then(toml::Value::as_str).unwrap_or_default(), &table)
            });
            // Checked when the file was made.
            made.filter_map(Result::ok).collect()
        });
        by_same_edge(&[(declared, &before), (&corrected, &after)], &|| bar.step())
    };
    let found = both();
    drop(bar);
    let same = match found {
        Ok(same) => same,
        Err(why) => {
            // A machine whose edges cannot be timed has no law; its correction stands all the same.
            applied.law_remark = format!("none: {why}; a node keeps the law it has");
            return Ok(());
        }
    };
    let mut remark = match same.event {
        Event::Exit => "of the edge with which a pair gives off its load".to_string(),
        Event::Entry => "of the edge with which a pair takes up its load".to_string(),
    };
    if let Some(reason) = &same.reason {
        remark += &format!(" (give-off: {reason})");
    }
    if count > 0 {
        remark += ", with the effects that every pair carries, at the machine's nominal torque";
    }
    let laws: [LawFile; 2] = same.laws.try_into().expect("one law per machine");
    let [lowest, highest] = laws[1].domain_hz;
    let speed = corrected.nominal.map_or(15.0, |n| n.speed_hz).clamp(lowest, highest);
    let body: String = laws[1].to_toml().lines().filter(|l| !l.starts_with('#')).map(|l| format!("{l}\n")).collect();
    let text = format!("# Bandwidth law of the corrected machine, B = 0.35 / t_r\n# {remark}.\n{body}");
    std::fs::write(target, text).map_err(Error::file(target))?;
    applied.law = Some(target.to_owned());
    applied.bandwidth_hz = Some(laws.each_ref().map(|l| l.law.bandwidth_hz(speed)));
    applied.law_remark = remark;
    applied.laws = Some(laws);
    Ok(())
}
