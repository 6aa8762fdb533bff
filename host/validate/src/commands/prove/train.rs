//! `meshband prove --train`: the campaign of trains.

use super::Args;
use meshband_host::output::show;
use meshband_host::report::Report;
use meshband_host::{Error, Result};
use meshband_validate::train_proof::campaign::{HEAD, Plan, cells, rows, run as run_plan, text};
use serde_json::json;

/// Runs what is missing of the campaign and prints its table.
pub fn run(args: Args) -> Result<()> {
    let mut outputs = args.results.outputs([]);
    let _log = outputs.appended(&args.log)?;
    let mut files = args.results.announce(&mut outputs)?;
    let plan = Plan { null: args.null, power: args.power, levels: args.levels, seed: args.seed, log: args.log };
    let scored = run_plan(&plan)?;
    if scored.is_empty() {
        return Err(Error::invalid("--null, --power", "both are 0 and the log is empty"));
    }
    let rows = rows(&scored);
    let value = json!({ "seed": plan.seed, "records": scored.len(), "rows": rows });
    files.write(&value, || {
        let cells: Vec<Vec<String>> = rows.iter().map(cells).collect();
        Ok(Report::new("Proof of trains", "generated records").figure("seed", plan.seed).table("", &HEAD, &cells))
    })?;
    show(&text(&scored))
}
