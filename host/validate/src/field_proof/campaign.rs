//! All records of a plan, those that a log lacks: made, looped, scored, one line each.

use super::bench::Bench;
use super::hidden::{ALL, Hidden};
use super::make::{self, Made};
use super::score::Scored;
use crate::record::Record;
use crate::signal_based::preflight::Preflight;
use crate::signal_based::scene::Scene;
use crate::signal_based::{self, errors};
use crate::terminal::Progress;
use crate::{Error, Result};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use std::collections::BTreeSet;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// What to run.
#[derive(Debug, Clone)]
pub struct Plan {
    /// Records with nothing hidden.
    pub null: usize,
    /// Records with one effect, cycling through effects and strengths.
    pub power: usize,
    /// Strengths, times the record's floor.
    pub levels: Vec<f64>,
    /// Effects to hide, by name; all where none is given.
    pub only: Vec<String>,
    /// Only records whose speed runs up (`true`) or does not (`false`); as drawn where none.
    pub runs_up: Option<bool>,
    /// Seed.
    pub seed: u64,
    /// One JSON line per record; continued where it exists.
    pub log: PathBuf,
}

/// From one record to the next that takes its place.
const RECORD_NUMBER_STEP: u64 = 10_000_000;

/// One record to make.
struct Item {
    id: String,
    number: u64,
    hidden: Option<&'static Hidden>,
    level: f64,
}

fn items(plan: &Plan) -> Vec<Item> {
    let all: Vec<&'static Hidden> =
        ALL.iter().filter(|h| plan.only.is_empty() || plan.only.iter().any(|n| n == h.name)).collect();
    let null = (0..plan.null).map(|n| Item { id: format!("null-{n}"), number: n as u64, hidden: None, level: 0.0 });
    let power = (0..plan.power).map(|n| Item {
        id: format!("{}-{n}", all[n % all.len()].name),
        number: 1_000_000 + n as u64,
        hidden: Some(all[n % all.len()]),
        level: plan.levels[(n / all.len() + n % all.len()) % plan.levels.len()],
    });
    null.chain(power).collect()
}

/// Runs what is missing of the plan and returns all records of its log.
///
/// # Errors
/// An unreadable log, levels or names that make no sense.
pub fn run(plan: &Plan) -> Result<Vec<Scored>> {
    if let Some(name) = plan.only.iter().find(|n| ALL.iter().all(|h| h.name != n.as_str())) {
        let known: Vec<&str> = ALL.iter().map(|h| h.name).collect();
        return Err(Error::invalid("--only", format!("`{name}` is none of {}", known.join(", "))));
    }
    if plan.levels.is_empty() || plan.levels.iter().any(|l| !(l.is_finite() && *l > 0.0)) {
        return Err(Error::invalid("--levels", "positive numbers are needed"));
    }
    let mut scored = read_log(&plan.log)?;
    let done: BTreeSet<String> = scored.iter().map(|s| s.id.clone()).collect();
    let todo: Vec<Item> = items(plan).into_iter().filter(|i| !done.contains(&i.id)).collect();
    let mut log =
        std::fs::OpenOptions::new().create(true).append(true).open(&plan.log).map_err(Error::file(&plan.log))?;
    let bar = Progress::new("records", todo.len() as u64);
    for item in &todo {
        let result = one(plan, item);
        let line = serde_json::to_string(&result).map_err(|e| Error::invalid(&result.id, e))?;
        // In one piece: what ends the program leaves whole lines.
        log.write_all((line + "\n").as_bytes()).map_err(Error::file(&plan.log))?;
        scored.push(result);
        bar.step();
    }
    Ok(scored)
}

/// Records of a log; none where it is not there yet.
///
/// # Errors
/// A line that is none of a campaign.
pub fn read_log(path: &Path) -> Result<Vec<Scored>> {
    if !path.exists() {
        return Ok(Vec::new());
    }
    let text = std::fs::read_to_string(path).map_err(Error::file(path))?;
    let lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    let read = |(i, line): (usize, &str)| {
        serde_json::from_str(line).map_err(|e| Error::invalid(format!("{}: line {}", path.display(), i + 1), e))
    };
    lines.map(read).collect()
}

/// The random stream of a record.
pub(super) fn stream(seed: u64, number: u64) -> ChaCha8Rng {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    random.set_stream(number);
    random
}

fn one(plan: &Plan, item: &Item) -> Scored {
    let mut scored = Scored {
        id: item.id.clone(),
        bench: String::new(),
        hidden: item.hidden.map_or_else(String::new, |h| h.name.to_owned()),
        truth: String::new(),
        level: item.level,
        result: "refused".into(),
        reported: Vec::new(),
        nats: Vec::new(),
        wrong_names: 0,
        additions: 0,
        held_out: [0.0; 5],
        refused: Vec::new(),
        seconds: 0.0,
    };
    if let Err(error) = looped(plan, item, &mut scored) {
        scored.refused.push(error.to_string());
    }
    scored
}

/// The bench of a record, and its stream; where only run-ups or only steady records are asked for, the next one of
/// that kind.
fn drawn(plan: &Plan, number: u64) -> Result<(Bench, ChaCha8Rng)> {
    let mut number = number;
    loop {
        let mut random = stream(plan.seed, number);
        let bench = Bench::drawn(&mut random)?;
        if plan.runs_up.is_none_or(|runs_up| runs_up == bench.runs_up()) {
            return Ok((bench, random));
        }
        number += RECORD_NUMBER_STEP;
    }
}

fn looped(plan: &Plan, item: &Item, scored: &mut Scored) -> Result<()> {
    let (bench, mut random) = drawn(plan, item.number)?;
    scored.bench = bench.words();
    let Made { record, noise, truth } = make::record(&bench, item.hidden.map(|h| (h, item.level)), random.random())?;
    scored.truth = truth;
    let preflight = Preflight::of(&record);
    let started = Instant::now();
    let outcome = signal_based::run(&record, &preflight)?;
    scored.seconds = started.elapsed().as_secs_f64();
    scored.judge(&outcome, item.hidden);
    scored.held_out[4] = true_floor(&record, &noise)?;
    Ok(())
}

/// Share of the held-out turns that the noise put in has, as the loop's errors count it.
fn true_floor(record: &Record, noise: &[Vec<f64>]) -> Result<f64> {
    let teeth = record.declaration.teeth().ok_or_else(|| Error::invalid("record", "has no tooth counts"))?;
    let scene = Scene::of(record, record.require_tach()?, teeth)?;
    Ok(errors::share_of(&scene, noise).sqrt())
}
