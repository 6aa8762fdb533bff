//! The corrected machine: declared parameters as adopted, named effects as the simulator's, and its law.
//!
//! Files beside the machine: `NAME.corrected.toml` (a machine file), `NAME.effects.toml` (`[[effect]]` tables with
//! the simulator's names, for named verdicts only, the factor on declared torques, the turns by which runs start
//! later), `NAME.law.toml` (the law of that machine with the effects that every pair carries: wear, relief, profile;
//! shafts' and sensors' effects and single teeth do not touch the engagement edge that it times). They are announced
//! before the loop's work ([`Correction::announce`]) and put into place together. How orders, phases and teeth become
//! the simulator's is [`super::carry`]'s.

use super::carry::carry;
use super::outcome::Outcome;
use crate::dynamics::Effect;
use crate::law::derive::OPERATING_POINTS;
use crate::law::either_edge::by_same_edge;
use crate::law::file::LawFile;
use crate::law::operating::{Bench, Event};
use crate::machine::{Machine, Nominal};
use crate::output::{OutputSet, Outputs};
use crate::record::Record;
use crate::{Error, Result, effects, terminal};
use serde::Serialize;
use std::path::{Path, PathBuf};

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
    /// Turns of the pinion by which every run starts later than its pulse 0 says, which teeth and phases of the gear
    /// hold with.
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

/// A machine to correct, with the files announced beside it.
#[derive(Debug)]
pub struct Correction {
    declared: Machine,
    stem: String,
    files: OutputSet,
}

impl Correction {
    /// Makes sure that `path` (a machine file, or a record folder) holds the machine that `record` declares, and
    /// announces the files.
    ///
    /// # Errors
    /// An unreadable or another machine; files beside it that must not be written.
    pub fn announce(path: &Path, record: &Record, outputs: &mut Outputs) -> Result<Self> {
        let mut declared = Machine::read(path)?;
        if let Some(difference) = difference(&record.declaration.machine()?, &declared)? {
            let what = format!("is not the machine of {}: {difference}", record.folder.display());
            return Err(Error::invalid(path.display(), what));
        }
        let (folder, stem) = if path.is_dir() {
            declared.nominal = declared.nominal.or_else(|| nominal(record));
            (path, "machine".to_string())
        } else {
            let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
            (path.parent().unwrap_or(Path::new("")), stem)
        };
        let table = declared.pair.pair_stiffness.as_ref().map(|_| CORRECTED_TABLE);
        let kinds = [Some(CORRECTED_MACHINE), Some(EFFECTS), Some(LAW), table];
        let names: Vec<String> = kinds.into_iter().flatten().map(|kind| format!("{stem}.{kind}")).collect();
        Ok(Self { declared, stem, files: outputs.set(folder, &names)? })
    }

    fn name(&self, kind: &str) -> String {
        format!("{}.{kind}", self.stem)
    }
}

/// Ends of the files' names, after the machine's.
const CORRECTED_MACHINE: &str = "corrected.toml";
const CORRECTED_TABLE: &str = "corrected.pair_stiffness.csv";
const EFFECTS: &str = "effects.toml";
const LAW: &str = "law.toml";

/// In what two declarations differ that moves the machine: not in its title, its operating point, or where its tables
/// lie.
fn difference(record: &Machine, given: &Machine) -> Result<Option<String>> {
    if record.pair.teeth != given.pair.teeth {
        let [[a, b], [c, d]] = [given.pair.teeth, record.pair.teeth];
        return Ok(Some(format!("{a} and {b} teeth, the record declares {c} and {d}")));
    }
    let content = |machine: &Machine| -> Result<_> {
        let mut bare = machine.clone();
        bare.title.clear();
        bare.nominal = None;
        bare.folder.clear();
        let tables = [bare.pair.pair_stiffness.take(), bare.pair.total_stiffness.take()];
        let read = |table: PathBuf| crate::budget::read(&machine.folder.join(table));
        let [pair, total] = tables.map(|table| table.map(read).transpose());
        Ok((bare, [pair?, total?]))
    };
    let ((record, record_tables), (given, given_tables)) = (content(record)?, content(given)?);
    if record_tables != given_tables {
        return Ok(Some("another stiffness table".into()));
    }
    Ok((record != given)
        .then(|| "the same teeth, but other values; --apply RECORD corrects what the record declares".into()))
}

/// The corrected machine's parameters; the name of its scaled stiffness table and that table's text, where it has one.
fn change(machine: &mut Machine, outcome: &Outcome, name: String) -> Result<Option<(String, String)>> {
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
        return Ok(None);
    };
    let curve = crate::stiffness::pair_curve::PairCurve::read(&machine.folder.join(old))?;
    let mut text = String::from("position_base_pitches,stiffness_n_per_m\n");
    for (u, k) in curve.u.iter().zip(&curve.k) {
        text += &format!("{u:.9},{:.9e}\n", k * stiffness);
    }
    machine.pair.pair_stiffness = Some(PathBuf::from(&name));
    Ok(Some((name, text)))
}

/// What of an outcome carries over to the simulator.
#[derive(Default)]
struct Carried {
    tables: Vec<toml::Table>,
    written: Vec<String>,
    remarks: Vec<String>,
    not_written: Vec<String>,
    pinion_turns: Option<Vec<u32>>,
    /// Whether declared parameters move, too.
    moved: bool,
}

fn carried(outcome: &Outcome, declared: &Machine) -> Carried {
    let held = &outcome.error.held_out_runs;
    // What does not predict runs it has not seen corrects nothing.
    let better = held.whole_signal.corrected <= held.whole_signal.declared;
    let mut all = Carried::default();
    if !better {
        all.remarks.push("held-out error does not fall: the machine stays as declared".into());
    }
    for (i, effect) in outcome.effects.iter().enumerate() {
        let term = outcome.terms.get(i).filter(|t| t.name == effect.name);
        let carried = if effect.verdict == "named" && better { carry(effect, term, declared) } else { Ok(None) };
        let carried = match carried {
            Ok(Some(carried)) => carried,
            Ok(None) => {
                all.not_written.push(format!("{}: {}", effect.verdict, effect.name));
                continue;
            }
            Err(why) => {
                all.not_written.push(format!("{}: {} ({why})", effect.verdict, effect.name));
                continue;
            }
        };
        if let (Some(own), Some(known)) = (&carried.pinion_turns, &all.pinion_turns)
            && own != known
        {
            all.remarks
                .push(format!("{}: its runs start at other turns of the pinion than those written", effect.name));
        }
        all.pinion_turns = all.pinion_turns.or(carried.pinion_turns);
        all.remarks.extend(carried.remark.map(|remark| format!("{}: {remark}", effect.name)));
        for (name, mut table) in carried.tables {
            let keys: Vec<String> = table.iter().map(|(k, v)| format!("{k}={v}")).collect();
            all.written.push(format!("{name}:{}", keys.join(",")));
            table.insert("name".into(), toml::Value::String(name.into()));
            all.tables.push(table);
        }
    }
    // Parameters moved next to every effect; where one of these stays out they may stand for it.
    all.moved = better && all.not_written.is_empty();
    if better && !all.moved {
        let what = "declared parameters stay as declared: they were fitted next to effects that are not written";
        all.remarks.push(what.into());
    }
    all
}

/// The text of the effects' file.
fn effects_text(carried: &Carried, torque_factor: f64) -> Result<String> {
    let mut text = String::from("# Effects found by `meshband loop`, with the simulator's names.\n");
    carried.remarks.iter().for_each(|remark| text += &format!("# {remark}\n"));
    carried.not_written.iter().for_each(|other| text += &format!("# without counterpart: {other}\n"));
    let list = carried.tables.iter().cloned().map(toml::Value::Table).collect();
    let whole = [("torque_factor", toml::Value::Float(torque_factor)), ("effect", toml::Value::Array(list))];
    let mut whole = toml::Table::from_iter(whole.map(|(key, value)| (key.to_string(), value)));
    if let Some(turns) = &carried.pinion_turns {
        let list = turns.iter().map(|k| toml::Value::Integer(i64::from(*k))).collect();
        whole.insert("pinion_turns".into(), toml::Value::Array(list));
    }
    Ok(text + &toml::to_string(&whole).map_err(|e| Error::invalid("effects", e))?)
}

impl Correction {
    /// Writes the corrected machine of `outcome`, its effects and its law: all of them or none.
    ///
    /// # Errors
    /// Files that cannot be written, a law that cannot be derived.
    pub fn write(self, outcome: &Outcome) -> Result<Applied> {
        let carried = carried(outcome, &self.declared);
        let mut corrected = self.declared.clone();
        // Tables are where they were, but for one that is scaled.
        let mut tables = self.declared.folder.as_path();
        if carried.moved
            && let Some((name, text)) = change(&mut corrected, outcome, self.name(CORRECTED_TABLE))?
        {
            self.files.write(&name, text)?;
            tables = self.files.staging();
        }
        let text = toml::to_string(&corrected).map_err(|e| Error::invalid(self.name(CORRECTED_MACHINE), e))?;
        let corrected = Machine::from_toml(&text, &self.name(CORRECTED_MACHINE), tables)?;
        self.files.write(&self.name(CORRECTED_MACHINE), text)?;
        let torque = outcome.corrected_parameter_changes.get("torque").filter(|_| carried.moved);
        let torque_factor = 1.0 + torque.copied().unwrap_or(0.0);
        self.files.write(&self.name(EFFECTS), effects_text(&carried, torque_factor)?)?;
        let place = |kind: &str| self.files.folder().join(self.name(kind));
        let of_every_pair: Vec<toml::Table> = carried.tables.into_iter().filter(of_every_pair).collect();
        let mut applied = Applied {
            machine: place(CORRECTED_MACHINE),
            effects: place(EFFECTS),
            written: carried.written,
            remarks: carried.remarks,
            not_written: carried.not_written,
            torque_factor,
            pinion_turns: carried.pinion_turns,
            law: None,
            law_remark: String::new(),
            bandwidth_hz: None,
            laws: None,
        };
        if let Some(text) = self.law(&corrected, of_every_pair, &mut applied)? {
            self.files.write(&self.name(LAW), text)?;
            applied.law = Some(place(LAW));
        }
        self.files.commit()?;
        Ok(applied)
    }

    /// Derives the laws of both machines and says what edge they time; the text of the corrected one's.
    fn law(
        &self,
        corrected: &Machine,
        of_every_pair: Vec<toml::Table>,
        applied: &mut Applied,
    ) -> Result<Option<String>> {
        let count = of_every_pair.len();
        let bar = terminal::Progress::new("law", 2 * OPERATING_POINTS);
        let both = || -> Result<_> {
            let before = Bench::new(&self.declared)?;
            let after = Bench::new(corrected)?.with_effects(move || made(&of_every_pair));
            by_same_edge(&[(&self.declared, &before), (corrected, &after)], &|| bar.step())
        };
        let found = both();
        drop(bar);
        let same = match found {
            Ok(same) => same,
            Err(why) => {
                // A machine whose edges cannot be timed has no law; its correction stands all the same.
                applied.law_remark = format!("none: {why}; a node keeps the law it has");
                return Ok(None);
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
        let body: String =
            laws[1].to_toml().lines().filter(|l| !l.starts_with('#')).map(|l| format!("{l}\n")).collect();
        let text = format!("# Bandwidth law of the corrected machine, B = 0.35 / t_r\n# {remark}.\n{body}");
        applied.bandwidth_hz = Some(laws.each_ref().map(|l| l.law.bandwidth_hz(speed)));
        applied.law_remark = remark;
        applied.laws = Some(laws);
        Ok(Some(text))
    }
}

/// The simulator's effects of tables that were checked when they were made.
fn made(tables: &[toml::Table]) -> Vec<Box<dyn Effect>> {
    let one = |table: &toml::Table| {
        let mut table = table.clone();
        let name = table.remove("name");
        effects::from_table(name.as_ref().and_then(toml::Value::as_str).unwrap_or_default(), &table)
    };
    tables.iter().map(one).filter_map(Result::ok).collect()
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

/// Whether every pair carries the effect of a table alike, and so the law.
fn of_every_pair(table: &toml::Table) -> bool {
    let entry = table.get("name").and_then(toml::Value::as_str).and_then(|name| effects::entry(name).ok());
    entry.is_some_and(|e| e.hypotheses.iter().flat_map(|h| h.seats).any(|seat| seat.is_of_every_pair()))
}
