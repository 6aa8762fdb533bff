//! `meshband prove --field`: the campaign of signal-based inference on generated records of the measured kind.

use super::{Args, Motion};
use meshband_host::output::show;
use meshband_host::report::Report;
use meshband_host::{Error, Result};
use meshband_validate::field_proof::campaign::{Plan, run as run_plan};
use meshband_validate::field_proof::edges;
use meshband_validate::field_proof::score::{HEAD, Scored, cells, markdown, tables, text};
use serde_json::json;

/// Runs what is missing of the campaign and prints its tables.
pub fn run(args: Args) -> Result<()> {
    let refused = [("--leave-one-out", args.leave_one_out), ("--two", args.two)];
    if let Some((option, _)) = refused.into_iter().find(|(_, count)| *count > 0) {
        return Err(Error::invalid(option, "is no part of the campaign with --field"));
    }
    let mut outputs = args.results.outputs([]);
    let _log = outputs.appended(&args.log)?;
    let mut files = args.results.announce(&mut outputs)?;
    let document = outputs.optional(args.markdown.as_deref())?;
    let plan = Plan {
        null: args.null,
        power: args.power,
        levels: args.levels,
        only: args.only,
        runs_up: args.motion.map(|motion| motion == Motion::RunUp),
        seed: args.seed,
        log: args.log,
    };
    let scored = run_plan(&plan)?;
    if scored.is_empty() {
        return Err(Error::invalid("--null, --power", "both are 0 and the log is empty"));
    }
    let all = tables(&scored);
    let value = json!({ "seed": plan.seed, "records": scored.len(), "tables": all });
    files.write(&value, || Ok(report(&scored, plan.seed)))?;
    if let Some(mut file) = document {
        file.write(markdown(&scored))?;
    }
    show(&text(&scored))
}

/// Sharp and smooth tachometer edges; the pairs go to the log, one JSON line each.
pub fn edges(args: Args) -> Result<()> {
    let mut outputs = args.results.outputs([]);
    let mut log = outputs.optional(Some(&args.log))?;
    let pairs = edges::pairs(args.edges, args.seed)?;
    let lines = pairs.iter().map(|pair| serde_json::to_string(pair).map_err(|e| Error::invalid("pair", e)));
    if let Some(file) = &mut log {
        file.write(lines.collect::<Result<Vec<_>>>()?.join("\n") + "\n")?;
    }
    show(&edges::text(&pairs, args.seed))
}

fn report(scored: &[Scored], seed: u64) -> Report {
    let mut report = Report::new("Proof of signal-based inference", "generated records of the measured kind")
        .figure("records", scored.len())
        .figure("seed", seed);
    for (title, rows) in tables(scored) {
        let rows: Vec<Vec<String>> = rows.iter().filter(|r| r.records > 0).map(cells).collect();
        if !rows.is_empty() {
            report = report.section(&title).table("", &HEAD, &rows);
        }
    }
    report
}
