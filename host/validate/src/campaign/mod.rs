//! Proof of the loop on generated records: nothing hidden, one effect at levels over its detection floor, the true
//! effect withheld, two at once.
//!
//! A campaign is a list of numbered records; everything of a record (machine, noise, effect, phases, parameters)
//! follows from the campaign's seed and its number, so a record can be repeated alone, and a campaign stopped and
//! resumed: each scored record is one JSON line, and lines already there are not done again. Cost: about 10 s per
//! record on two cores.

mod floor;
#[cfg(test)]
mod generated_records;
pub mod ladder;
mod limit;
mod score;
mod uniform;

pub use score::{HEAD, Row, Scored, Summary, cells, summarise};

use crate::drawn;
use crate::effects;
use crate::effects::hypothesis::{Draw, Hidden};
use crate::generate::{self, Scenario};
use crate::model_based::base_fit::TOLERANCES;
use crate::model_based::{Options, close_loop};
use crate::observation::input::{self, Record};
use crate::terminal::Progress;
use crate::{Error, Result};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::collections::BTreeSet;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// How many records of each part.
#[derive(Debug, Clone)]
pub struct Plan {
    /// Declared machines: record folders whose declaration is used; none: every record has a machine and a layout
    /// drawn at random.
    pub machines: Vec<PathBuf>,
    /// Records with nothing hidden.
    pub null: usize,
    /// Bootstrap records by which every record with nothing hidden is asked for its own probability of a false alarm;
    /// 0: it is not.
    pub bootstrap: usize,
    /// Records with one effect; cycles through effects, then levels.
    pub power: usize,
    /// Records with the true effect withheld from the library.
    pub leave_one_out: usize,
    /// Records with two effects, and as many with an effect and a wrong parameter, at the largest of `levels`.
    pub two: usize,
    /// Records without any effect whose limits are tried: one effect at a stated limit, and at twice it.
    pub limits: usize,
    /// Levels over the detection floor of the power part, in the order they are taken.
    pub levels: Vec<f64>,
    /// Names of [`hidden`](crate::effects::hidden) to use; empty for all.
    pub only: Vec<String>,
    /// Length of a run, s.
    pub duration_s: f64,
    /// Seed of everything.
    pub seed: u64,
    /// JSON lines, appended.
    pub log: PathBuf,
    /// Progress of the loop on every record.
    pub verbose: bool,
}

/// Machines drawn for a record at most, besides the last.
const MAX_DRAWN_MACHINES: u64 = 20;

struct Item {
    part: &'static str,
    number: usize,
    hidden: Vec<&'static Hidden>,
    level: f64,
}

impl Item {
    fn id(&self) -> String {
        format!("{}-{}", self.part, self.number)
    }

    /// Whether its record, or the last of its records, is among those done.
    fn is_done(&self, done: &BTreeSet<String>) -> bool {
        match self.part {
            limit::PART => limit::LAST_PARTS.iter().any(|part| done.contains(&format!("{part}-{}", self.number))),
            _ => done.contains(&self.id()),
        }
    }
}

fn items(plan: &Plan) -> Vec<Item> {
    let wanted = |h: &&Hidden| plan.only.is_empty() || plan.only.iter().any(|n| n == h.name);
    let all: Vec<&'static Hidden> = effects::hidden().filter(wanted).collect();
    let count = all.len();
    let named: Vec<&'static Hidden> = all.iter().copied().filter(|h| !h.right_names.is_empty()).collect();
    let mut items: Vec<Item> =
        (0..plan.null).map(|number| Item { part: "null", number, hidden: vec![], level: 0.0 }).collect();
    items.extend((0..plan.power).map(|number| {
        let level = plan.levels[number / count % plan.levels.len()];
        Item { part: "power", number, hidden: vec![all[number % count]], level }
    }));
    items.extend((0..plan.leave_one_out).map(|number| Item {
        part: "leave-one-out",
        number,
        hidden: vec![named[number % named.len()]],
        level: 4.0,
    }));
    items.extend((0..plan.limits).map(|number| Item { part: limit::PART, number, hidden: vec![], level: 0.0 }));
    let strongest = plan.levels.iter().copied().fold(0.0, f64::max);
    for number in 0..plan.two {
        let first = named[number % named.len()];
        let second = named[(number + 1 + number / named.len() * 3 + 4) % named.len()];
        let second = if second.name == first.name { named[(number + 1) % named.len()] } else { second };
        items.push(Item { part: "two", number, hidden: vec![first, second], level: strongest });
        items.push(Item { part: "parameter", number, hidden: vec![first], level: strongest });
    }
    items
}

/// Declared parameters off by a uniform share of their tolerance.
fn off(scenario: &mut Scenario, rng: &mut ChaCha8Rng, only: Option<usize>, share: f64) {
    for (index, (name, tolerance)) in TOLERANCES.iter().enumerate() {
        let uniform = 2.0 * rng.random::<f64>() - 1.0;
        if only.is_some_and(|o| o != index) {
            continue;
        }
        let size = if only.is_some() { uniform.signum() } else { uniform };
        let f = 1.0 + share * tolerance * size;
        let s = &mut scenario.actual;
        match *name {
            "mesh stiffness" => scenario.stiffness_factor *= f,
            "mesh damping" => scenario.damping_factor *= f,
            "pinion bearing stiffness" => s.bearing_stiffness_n_per_m[0] *= f,
            "gear bearing stiffness" => s.bearing_stiffness_n_per_m[1] *= f,
            "pinion bearing damping" => s.bearing_damping_n_s_per_m[0] *= f,
            "gear bearing damping" => s.bearing_damping_n_s_per_m[1] *= f,
            "input coupling stiffness" => s.coupling_stiffness_n_m_per_rad[0] *= f,
            "output coupling stiffness" => s.coupling_stiffness_n_m_per_rad[1] *= f,
            "pinion inertia" => s.inertia_pinion_kg_m2 *= f,
            "gear inertia" => s.inertia_gear_kg_m2 *= f,
            "pinion mass" => s.mass_kg[0] *= f,
            "gear mass" => s.mass_kg[1] *= f,
            "input coupling damping" => s.coupling_damping_n_m_s_per_rad[0] *= f,
            "output coupling damping" => s.coupling_damping_n_m_s_per_rad[1] *= f,
            // Torque is declared per run and taken as it is.
            _ => {}
        }
    }
}

/// Runs what is missing of the plan and returns all records of its log.
///
/// # Errors
/// Unreadable machines or log, a record that the loop refuses.
pub fn run(plan: &Plan) -> Result<Vec<Scored>> {
    let machines = plan.machines.iter().map(|p| input::read(p)).collect::<Result<Vec<_>>>()?;
    if let Some(name) = plan.only.iter().find(|n| effects::hidden().all(|h| h.name != n.as_str())) {
        let known: Vec<&str> = effects::hidden().map(|h| h.name).collect();
        return Err(Error::invalid("--only", format!("`{name}` is none of {}", known.join(", "))));
    }
    if plan.levels.is_empty() || plan.levels.iter().any(|l| !(l.is_finite() && *l > 0.0)) {
        return Err(Error::invalid("--levels", "positive numbers are needed"));
    }
    if !(0.5..=60.0).contains(&plan.duration_s) {
        return Err(Error::invalid("--seconds", "a run must last 0.5 to 60 s"));
    }
    let mut scored = read_log(&plan.log)?;
    let done: BTreeSet<String> = scored.iter().map(|s| s.id.clone()).collect();
    let todo: Vec<Item> = items(plan).into_iter().filter(|i| !i.is_done(&done)).collect();
    let mut log =
        std::fs::OpenOptions::new().create(true).append(true).open(&plan.log).map_err(Error::file(&plan.log))?;
    let bar = Progress::new("records", todo.len() as u64);
    for item in &todo {
        let results = one(plan, item, &machines, 0)?;
        let lines = results.iter().map(|result| {
            serde_json::to_string(result).map(|line| line + "\n").map_err(|e| Error::invalid(&result.id, e))
        });
        // In one piece: what ends the program leaves whole lines.
        let lines = lines.collect::<Result<String>>()?;
        log.write_all(lines.as_bytes()).map_err(Error::file(&plan.log))?;
        scored.extend(results);
        bar.step();
    }
    Ok(scored)
}

fn read_log(path: &Path) -> Result<Vec<Scored>> {
    if !path.exists() {
        return Ok(Vec::new());
    }
    let text = std::fs::read_to_string(path).map_err(Error::file(path))?;
    text.lines()
        .enumerate()
        .filter(|(_, line)| !line.trim().is_empty())
        .map(|(i, line)| {
            serde_json::from_str(line).map_err(|e| Error::invalid(format!("{}: line {}", path.display(), i + 1), e))
        })
        .collect()
}

/// RMS acceleration of the quieter channel of the first run, m/s2.
fn loudness(declared: &Record, scenario: &Scenario) -> Result<f64> {
    let quiet = Scenario {
        noise_rms: 0.0,
        duration_s: 0.5,
        speeds_hz: scenario.speeds_hz[..1].to_vec(),
        torques_n_m: scenario.torques_n_m[..1].to_vec(),
        ..scenario.clone()
    };
    let run = generate::record(&declared.pair, &declared.shafts, &declared.curve, &quiet)?.runs.remove(0);
    let rms = |x: &Vec<f64>| (x.iter().map(|v| v * v).sum::<f64>() / x.len() as f64).sqrt();
    Ok(run.channels.iter().map(rms).fold(f64::INFINITY, f64::min))
}

/// A record to be made, and what is known of it.
struct Made<'a> {
    declared: &'a Record,
    scenario: Scenario,
    coloured: bool,
    parameters_off: bool,
    started: Instant,
}

/// One record; another machine is drawn where an effect would have to be stronger on it than the simulator takes, and
/// none made where machines are given.
fn one(plan: &Plan, item: &Item, machines: &[Record], drawn_before: u64) -> Result<Vec<Scored>> {
    let started = Instant::now();
    let stream = item.part.bytes().fold(item.number as u64, |h, b| h.wrapping_mul(31).wrapping_add(u64::from(b)));
    let stream = stream.wrapping_add(drawn_before << 48);
    let mut rng = ChaCha8Rng::seed_from_u64(plan.seed.wrapping_mul(0x9E37_79B9).wrapping_add(stream));
    let cycle =
        if item.hidden.is_empty() { item.number } else { item.number / effects::hidden().count() + item.number };
    let coloured = cycle / machines.len().max(1) % 2 == 1;
    let drawn = if machines.is_empty() { Some(drawn::machine(&mut rng)?) } else { None };
    let declared = drawn.as_ref().unwrap_or_else(|| &machines[cycle % machines.len()]);
    let mut scenario = Scenario::null(&declared.shafts, rng.random());
    scenario.duration_s = plan.duration_s;
    scenario.noise_colour = if coloured { 0.9 } else { 0.0 };
    if drawn.is_some() {
        drawn::layout(declared, &mut scenario, &mut rng);
        scenario.noise_rms = (0.004 + 0.02 * rng.random::<f64>()) * loudness(declared, &scenario)?;
    } else {
        let scale = 0.9 + 0.2 * rng.random::<f64>();
        scenario.speeds_hz.iter_mut().for_each(|f| *f *= scale);
    }
    let mut hidden: Vec<(&'static Hidden, f64)> = Vec::new();
    for &kind in &item.hidden {
        // The floor is this record's own: of the same order, phase or frequency, at its speeds and in its noise.
        let (floor, peak_m_s2) = floor::strength(declared, &scenario, kind, &mut rng.clone())?;
        let size = if kind.has_floor { item.level * floor } else { floor };
        let mut draw = Draw { teeth: declared.pair.teeth, peak_m_s2, random: &mut rng };
        scenario.effects.extend((kind.draw)(size, &mut draw));
        hidden.push((kind, size));
    }
    if let Some(why) = scenario.effects.iter().find_map(|text| effects::parse(text).err()) {
        if machines.is_empty() && drawn_before < MAX_DRAWN_MACHINES {
            return one(plan, item, machines, drawn_before + 1);
        }
        crate::remark!("{} left out on {}: {why}", item.id(), declared.title);
        return Ok(Vec::new());
    }
    let parameters_off = item.part == "parameter" || item.number % 4 != 3;
    match item.part {
        "parameter" => {
            let which = (rng.random::<u32>() as usize) % (TOLERANCES.len() - 1);
            off(&mut scenario, &mut rng, Some(which), 2.0);
        }
        _ if parameters_off => off(&mut scenario, &mut rng, None, 1.0),
        _ => {}
    }
    let withheld = match item.part {
        "leave-one-out" => hidden[0].0.right_names.iter().map(|n| (*n).to_string()).collect(),
        _ => Vec::new(),
    };
    let null_records = if item.part == "null" { plan.bootstrap } else { 0 };
    let options = Options { seed: rng.random(), withheld, null_records, progress: plan.verbose, ..Options::default() };
    let made = Made { declared, scenario, coloured, parameters_off, started };
    if item.part == limit::PART {
        return limit::at_limits(&made, item.number, &options, &plan.only, &mut rng);
    }
    Ok(made.scored(item, &hidden, &options)?.map(|(scored, _)| scored).into_iter().collect())
}

impl Made<'_> {
    /// Makes the record, runs the loop on it and scores what it says; with the outcome. None, and said, where the
    /// loop refuses the record.
    fn scored(
        &self,
        item: &Item,
        hidden: &[(&'static Hidden, f64)],
        options: &Options,
    ) -> Result<Option<(Scored, crate::model_based::Outcome)>> {
        let Self { declared, scenario, .. } = self;
        let record = generate::record(&declared.pair, &declared.shafts, &declared.curve, scenario)?;
        let outcome = match close_loop(&record, options) {
            Ok(outcome) => outcome,
            Err(why) => {
                crate::remark!("{} left out, refused by the loop: {why}", item.id());
                return Ok(None);
            }
        };
        let (result, wrong_names) = score::judge(&outcome, hidden);
        let strength = match hidden {
            [(kind, truth)] => score::strength(&outcome, kind, *truth),
            _ => None,
        };
        let held = &outcome.error.held_out_runs;
        let true_floor = floor::true_floor(&record, scenario, &outcome.split[2]);
        let held = [held.shaft_synchronous, held.whole_signal];
        let scored = Scored {
            id: item.id(),
            part: item.part.into(),
            machine: declared.title.clone(),
            runs: record.runs.len(),
            duration_s: scenario.duration_s,
            coloured: self.coloured,
            parameters_off: self.parameters_off,
            hidden: hidden.iter().map(|(k, _)| k.name.to_string()).collect(),
            truth: scenario.effects.join(" "),
            level: item.level,
            reported: outcome.effects.iter().map(|e| [e.verdict.clone(), e.name.clone(), e.family.clone()]).collect(),
            result,
            wrong_names,
            surplus: outcome.effects.len().saturating_sub(hidden.len()),
            covered: strength.map(|s| s.0),
            estimate_over_truth: strength.map(|s| s.1),
            held_out: held.map(|s| [s.declared, s.corrected, s.noise_floor]),
            calibrated: Some(held.map(|s| s.calibrated)),
            true_floor: Some(true_floor),
            bootstrap: outcome.null_records.map(|n| [n.at_least, n.records]),
            seconds: self.started.elapsed().as_secs_f64(),
        };
        Ok(Some((scored, outcome)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Records of `prove --null 40 --seconds 1 --seed 901` in which the check, by the declared parameters alone,
    /// takes detuned modes for a lag of the tach of 5 and 14 us.
    #[test]
    fn loop_takes_no_detuned_mode_for_a_lag_of_the_tach() {
        let plan = Plan {
            machines: vec![],
            null: 40,
            bootstrap: 0,
            power: 0,
            leave_one_out: 0,
            two: 0,
            limits: 0,
            levels: vec![2.0],
            only: vec![],
            duration_s: 1.0,
            seed: 901,
            log: PathBuf::new(),
            verbose: false,
        };
        for number in [4, 16] {
            let item = Item { part: "null", number, hidden: vec![], level: 0.0 };
            let scored = one(&plan, &item, &[], 0).unwrap().remove(0);
            assert!(scored.reported.is_empty(), "{}: {:?}", scored.id, scored.reported);
            let calibrated = scored.calibrated.unwrap()[1];
            assert!(calibrated < 0.02 * scored.held_out[1][0], "{}: {calibrated} of {:?}", scored.id, scored.held_out);
        }
    }
}
