//! All records of a campaign of trains, those that its log lacks: made, looked at, scored, one line each.

use super::bench::Bench;
use super::signal;
use crate::signal_based::outcome::Outcome;
use crate::signal_based::preflight::Preflight;
use crate::terminal::{Progress, table};
use crate::{Error, Result, signal_based};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::io::Write;
use std::path::PathBuf;
use std::time::Instant;

/// What to run.
#[derive(Debug, Clone)]
pub struct Plan {
    /// Sound trains.
    pub null: usize,
    /// Trains with one fault, cycling through strengths.
    pub power: usize,
    /// Strengths, times the record's floor.
    pub levels: Vec<f64>,
    /// Seed.
    pub seed: u64,
    /// One JSON line per record; continued where it exists.
    pub log: PathBuf,
}

/// One record.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Scored {
    /// `null-number` or `fault-number`.
    pub id: String,
    /// Train, operation, chain.
    pub bench: String,
    /// Kind of train, and whether its speed runs up.
    pub group: String,
    /// What was hidden; empty for nothing.
    pub truth: String,
    /// "pinion of stage 2"; empty for nothing.
    pub seat: String,
    /// Strength over the floor.
    pub level: f64,
    /// Verdict, name of everything reported.
    pub reported: Vec<[String; 2]>,
    /// Lines that stand of everything reported, strongest first.
    #[serde(default)]
    pub lines: Vec<Vec<String>>,
    /// Whether anything was reported at a gear, a shaft or an order.
    pub found: bool,
    /// Whether the right gear and stage are named, alone or among others.
    pub right: bool,
    /// Names given alone that are wrong.
    pub wrong: usize,
    /// Why no answer came; families judged and refused.
    pub refused: Vec<String>,
    /// Seconds of the look.
    pub seconds: f64,
}

impl Scored {
    fn judge(&mut self, outcome: &Outcome) {
        self.reported = outcome.effects.iter().map(|e| [e.verdict.clone(), e.name.clone()]).collect();
        let line = |(label, order): &(String, f64)| format!("{label} at {order:.4}");
        self.lines = outcome.effects.iter().map(|e| e.lines.iter().map(line).collect()).collect();
        self.found = !outcome.effects.is_empty();
        let is_right = |name: &str| !self.seat.is_empty() && name.contains(&self.seat);
        self.right = self.reported.iter().any(|[_, name]| is_right(name));
        self.wrong = self.reported.iter().filter(|[verdict, name]| verdict == "named" && !is_right(name)).count();
        let refused = outcome.surrogates.iter().filter_map(|j| Some((j, j.refused.as_ref()?)));
        self.refused = refused.map(|(j, why)| format!("{} ({:.1}): {why}", j.family, j.ln_bayes)).collect();
        if outcome.headline.starts_with("abstained") {
            self.refused.insert(0, outcome.headline.clone());
        }
    }
}

/// Runs what is missing of the plan and returns all records of its log.
///
/// # Errors
/// An unreadable log, levels that make no sense.
pub fn run(plan: &Plan) -> Result<Vec<Scored>> {
    if plan.levels.is_empty() || plan.levels.iter().any(|l| !(l.is_finite() && *l > 0.0)) {
        return Err(Error::invalid("--levels", "positive numbers are needed"));
    }
    let mut scored: Vec<Scored> = Vec::new();
    if plan.log.exists() {
        let text = std::fs::read_to_string(&plan.log).map_err(Error::file(&plan.log))?;
        for (i, line) in text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty()) {
            let read = serde_json::from_str(line);
            scored.push(read.map_err(|e| Error::invalid(format!("{}: line {}", plan.log.display(), i + 1), e))?);
        }
    }
    let done: BTreeSet<String> = scored.iter().map(|s| s.id.clone()).collect();
    let null = (0..plan.null as u64).map(|n| (format!("null-{n}"), n, None));
    let level = |n: u64| plan.levels[(n / 5 + n % 5) as usize % plan.levels.len()];
    let power = (0..plan.power as u64).map(|n| (format!("fault-{n}"), n, Some(level(n))));
    let todo: Vec<_> = null.chain(power).filter(|(id, _, _)| !done.contains(id)).collect();
    let mut log =
        std::fs::OpenOptions::new().create(true).append(true).open(&plan.log).map_err(Error::file(&plan.log))?;
    let bar = Progress::new("records", todo.len() as u64);
    for (id, number, level) in todo {
        let result = one(plan.seed, id, number, level);
        let line = serde_json::to_string(&result).map_err(|e| Error::invalid(&result.id, e))?;
        log.write_all((line + "\n").as_bytes()).map_err(Error::file(&plan.log))?;
        scored.push(result);
        bar.step();
    }
    Ok(scored)
}

fn one(seed: u64, id: String, number: u64, level: Option<f64>) -> Scored {
    let mut scored = Scored {
        id,
        bench: String::new(),
        group: String::new(),
        truth: String::new(),
        seat: String::new(),
        level: level.unwrap_or(0.0),
        reported: Vec::new(),
        lines: Vec::new(),
        found: false,
        right: false,
        wrong: 0,
        refused: Vec::new(),
        seconds: 0.0,
    };
    if let Err(error) = looked_at(seed, number, level, &mut scored) {
        scored.refused.push(error.to_string());
    }
    scored
}

fn looked_at(seed: u64, number: u64, level: Option<f64>, scored: &mut Scored) -> Result<()> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    random.set_stream(2 * number + u64::from(level.is_some()));
    let bench = Bench::drawn(number, &mut random)?;
    let hidden = level.map(|level| Ok::<_, Error>((bench.hidden(&mut random)?, level))).transpose()?;
    scored.bench = bench.words();
    scored.group = format!("{}{}", bench.kind, if bench.runs_up() { ", run-up" } else { "" });
    scored.seat = hidden.map_or_else(String::new, |(hidden, _)| bench.train.gears[hidden.gear].words());
    let (record, truth) = signal::record(&bench, hidden, random.random())?;
    scored.truth = truth;
    let started = Instant::now();
    let outcome = signal_based::run(&record, &Preflight::of(&record))?;
    scored.seconds = started.elapsed().as_secs_f64();
    scored.judge(&outcome);
    Ok(())
}

/// One group's counts.
#[derive(Debug, Clone, Serialize)]
pub struct Row {
    /// Group.
    pub group: String,
    /// Records.
    pub records: usize,
    /// Share in which anything is reported.
    pub found: f64,
    /// Share of those with the right gear and stage.
    pub right_of_found: f64,
    /// Share of records with a wrong name.
    pub wrong: f64,
    /// Share of records with anything named.
    pub named: f64,
    /// Seconds, mean.
    pub seconds: f64,
}

fn row(group: impl Into<String>, of: &[&Scored]) -> Row {
    let share = |test: &dyn Fn(&&&Scored) -> bool| of.iter().filter(test).count() as f64 / of.len().max(1) as f64;
    let found = share(&|s| s.found);
    Row {
        group: group.into(),
        records: of.len(),
        found,
        right_of_found: if found > 0.0 { share(&|s| s.right) / found } else { 0.0 },
        wrong: share(&|s| s.wrong > 0),
        named: share(&|s| s.reported.iter().any(|[verdict, _]| verdict == "named")),
        seconds: of.iter().map(|s| s.seconds).sum::<f64>() / of.len().max(1) as f64,
    }
}

/// Rows of sound trains, of faults by strength, by kind of train and by seat.
pub fn rows(scored: &[Scored]) -> Vec<Row> {
    let of = |test: &dyn Fn(&&Scored) -> bool| scored.iter().filter(test).collect::<Vec<_>>();
    let mut rows = vec![row("sound", &of(&|s| s.seat.is_empty()))];
    let mut levels: Vec<f64> = scored.iter().filter(|s| !s.seat.is_empty()).map(|s| s.level).collect();
    levels.sort_by(f64::total_cmp);
    levels.dedup();
    rows.extend(
        levels
            .iter()
            .map(|level| row(format!("fault at {level} x floor"), &of(&|s| !s.seat.is_empty() && s.level == *level))),
    );
    let mut groups: Vec<String> = scored.iter().map(|s| s.group.clone()).collect();
    groups.sort();
    groups.dedup();
    for group in groups {
        rows.push(row(format!("sound: {group}"), &of(&|s| s.seat.is_empty() && s.group == group)));
        rows.push(row(format!("fault: {group}"), &of(&|s| !s.seat.is_empty() && s.group == group)));
    }
    for role in ["pinion", "gear", "sun", "planet", "ring"] {
        rows.push(row(format!("fault at a {role}"), &of(&|s| s.seat.starts_with(role))));
    }
    rows.retain(|row| row.records > 0);
    rows
}

/// Heads of the table.
pub const HEAD: [&str; 7] = ["group", "records", "found, %", "right of found, %", "wrong, %", "named, %", "seconds"];

/// Cells of a row.
pub fn cells(row: &Row) -> Vec<String> {
    let percent = |x: f64| format!("{:.1}", 100.0 * x);
    vec![
        row.group.clone(),
        row.records.to_string(),
        percent(row.found),
        percent(row.right_of_found),
        percent(row.wrong),
        percent(row.named),
        format!("{:.1}", row.seconds),
    ]
}

/// As text.
pub fn text(scored: &[Scored]) -> String {
    table(&HEAD, &rows(scored).iter().map(cells).collect::<Vec<_>>())
}
