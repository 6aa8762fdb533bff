//! `meshband prove`: the loop's proof campaign on generated records.

mod field;
mod train;

use clap::Args as ClapArgs;
use meshband_host::output::show;
use meshband_host::report::Report;
use meshband_host::results::Results;
use meshband_host::{Error, Result};
use meshband_validate::campaign::{HEAD, Plan, Summary, cells, ladder, run as run_plan, summarise};
use std::path::PathBuf;

/// Arguments of `meshband prove`.
#[derive(ClapArgs)]
pub struct Args {
    /// Record folders whose declared machines are used; without any, every record has a machine and a layout drawn at
    /// random.
    #[arg(long = "machine", conflicts_with = "field")]
    machines: Vec<PathBuf>,
    /// The campaign of signal-based inference: machines, operation and measuring chains drawn at random (--null,
    /// --power, --levels, --only).
    #[arg(long)]
    field: bool,
    /// With --field: so many machines recorded twice, with sharp and with smooth tachometer edges (--seed).
    #[arg(long, value_name = "PAIRS", default_value_t = 0, requires = "field")]
    edges: usize,
    /// The campaign of gear trains by signal-based inference: trains, operation and faults drawn at random (--null,
    /// --power, --levels).
    #[arg(long, conflicts_with_all = ["field", "machines"])]
    train: bool,
    /// Records with nothing hidden.
    #[arg(long, default_value_t = 0)]
    null: usize,
    /// Bootstrap records by which every record with nothing hidden is asked for its own probability of a false alarm.
    #[arg(long, value_name = "N", default_value_t = 0, conflicts_with = "field")]
    bootstrap: usize,
    /// Records with one effect, cycling through effects, then `--levels`.
    #[arg(long, default_value_t = 0)]
    power: usize,
    /// Records with the true effect withheld from the library.
    #[arg(long, default_value_t = 0)]
    leave_one_out: usize,
    /// Records with two effects at the largest of `--levels`, and as many with an effect and a wrong declared
    /// parameter.
    #[arg(long, default_value_t = 0)]
    two: usize,
    /// Records whose limits are tried: the record without any effect is looped, and an effect put in at one of the
    /// limits that it states, and at twice it.
    #[arg(long, default_value_t = 0)]
    limits: usize,
    /// The noise ladder: every effect at one strength on this many machines, with ever less noise (--only, --seconds,
    /// --seed).
    #[arg(long, value_name = "MACHINES", default_value_t = 0, conflicts_with = "field")]
    ladder: usize,
    /// Strengths of that one effect, times its detection floor.
    #[arg(long, value_delimiter = ',', default_value = "2,20,1")]
    levels: Vec<f64>,
    /// Effects to hide, by name; all where none is given.
    #[arg(long, value_delimiter = ',')]
    only: Vec<String>,
    /// Length of every run, s.
    #[arg(long, default_value_t = 2.0)]
    seconds: f64,
    /// With --field: only records whose speed is steady, or only run-ups.
    #[arg(long, value_enum, requires = "field")]
    motion: Option<Motion>,
    /// Seed of the campaign.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// One JSON line per record; an existing file is continued.
    #[arg(long)]
    log: PathBuf,
    /// Prints what the loop does with every record.
    #[arg(long)]
    verbose: bool,
    /// Writes the tables as Markdown.
    #[arg(long)]
    markdown: Option<PathBuf>,
    #[command(flatten)]
    results: Results,
}

/// Which records of the campaign at signal-based inference.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Motion {
    /// Speed that only wanders.
    Steady,
    /// Speed that runs up.
    RunUp,
}

/// Runs what is missing of the campaign and prints its tables.
pub fn run(args: Args) -> Result<()> {
    if args.train {
        return train::run(args);
    }
    if args.edges > 0 {
        return field::edges(args);
    }
    if args.field {
        return field::run(args);
    }
    if args.ladder > 0 {
        return climb(args);
    }
    let mut outputs = args.results.outputs(args.machines.iter().map(PathBuf::as_path));
    let _log = outputs.appended(&args.log)?;
    let mut files = args.results.announce(&mut outputs)?;
    let markdown = outputs.optional(args.markdown.as_deref())?;
    let plan = Plan {
        machines: args.machines,
        null: args.null,
        bootstrap: args.bootstrap,
        power: args.power,
        leave_one_out: args.leave_one_out,
        two: args.two,
        limits: args.limits,
        levels: args.levels,
        only: args.only,
        duration_s: args.seconds,
        seed: args.seed,
        log: args.log,
        verbose: args.verbose,
    };
    let scored = run_plan(&plan)?;
    if scored.is_empty() {
        return Err(Error::invalid(
            "--null, --power, --leave-one-out, --two, --limits",
            "all are 0 and the log is empty",
        ));
    }
    let summary = summarise(&scored);
    files.write(&summary, || Ok(report(&summary, scored.len(), plan.seed)))?;
    if let Some(mut file) = markdown {
        file.write(summary.markdown())?;
    }
    show(&summary.text())
}

/// Noise of the rungs, m/s2.
const RUNGS_M_S2: [f64; 4] = [0.1, 0.01, 0.001, 0.0];

/// Climbs the noise ladder; its rungs go to the log, one JSON line each.
fn climb(args: Args) -> Result<()> {
    let mut outputs = args.results.outputs(std::iter::empty());
    let mut log = outputs.optional(Some(&args.log))?;
    let rungs = ladder::climb(&ladder::Ladder {
        machines: args.ladder,
        noise_m_s2: RUNGS_M_S2.to_vec(),
        only: args.only,
        duration_s: args.seconds,
        seed: args.seed,
        verbose: args.verbose,
    })?;
    let lines = rungs.iter().map(|r| serde_json::to_string(r).map_err(|e| Error::invalid("rung", e)));
    if let Some(file) = &mut log {
        file.write(lines.collect::<Result<Vec<_>>>()?.join("\n"))?;
    }
    show(&ladder::text(&rungs))
}

fn report(summary: &Summary, records: usize, seed: u64) -> Report {
    let mut report = Report::new("Proof of the closed loop", "generated records, nothing tuned on them")
        .figure("records", records)
        .figure("seed", seed)
        .figure("false terms", format!("{:.1} %", 100.0 * summary.null.last().map_or(0.0, |r| r.found)))
        .figure("intervals covering", format!("{:.1} % of {}", 100.0 * summary.coverage.0, summary.coverage.1));
    for (title, rows) in summary.tables() {
        let rows: Vec<Vec<String>> = rows.iter().filter(|r| r.records > 0).map(cells).collect();
        if !rows.is_empty() {
            report = report.section(title).table("", &HEAD, &rows);
        }
    }
    report
}
