//! `meshband measured`: every case file of a folder through import and loop, and the page of all.

use clap::Args as ClapArgs;
use meshband_host::output::show;
use meshband_host::results::Force;
use meshband_host::{Result, say, signal_based};
use meshband_validate::measured::{Case, cases, page, run as run_case};
use serde::Serialize;
use std::path::PathBuf;

/// Arguments of `meshband measured`.
#[derive(ClapArgs)]
pub struct Args {
    /// Folder of case files.
    cases: PathBuf,
    /// Folder that holds the data sets' folders; the case files say where to get them.
    #[arg(long)]
    data: PathBuf,
    /// Writes all outcomes as one Markdown page.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Writes the results as JSON; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    #[command(flatten)]
    permission: Force,
}

#[derive(Serialize)]
struct Written<'a> {
    case: &'a str,
    #[serde(flatten)]
    outcome: &'a signal_based::outcome::Outcome,
}

/// Runs every case whose data are there; a case without data is said and passed over.
pub fn run(args: Args) -> Result<()> {
    let mut outputs = args.permission.outputs([args.cases.as_path(), args.data.as_path()]);
    let mut json = outputs.optional(args.json.as_deref())?;
    let mut markdown = outputs.optional(args.output.as_deref())?;
    let mut done: Vec<(Case, signal_based::outcome::Outcome)> = Vec::new();
    let mut absent = Vec::new();
    let all = cases(&args.cases)?;
    for case in &all {
        case.paths(&args.data).err().into_iter().for_each(|error| absent.push(format!("{}: {error}", case.name)));
    }
    for case in all.into_iter().filter(|case| case.paths(&args.data).is_ok()) {
        let outcome = run_case(&case, &args.data)?;
        done.push((case, outcome));
    }
    if let Some(file) = &mut json {
        let all: Vec<Written> = done.iter().map(|(case, outcome)| Written { case: &case.name, outcome }).collect();
        file.write_json(&all)?;
    }
    if let Some(file) = &mut markdown {
        file.write(page::page(&done))?;
    }
    for (case, outcome) in &done {
        say!("{}", case.title)?;
        show(&signal_based::view::text(outcome))?;
    }
    absent.iter().try_for_each(|error| say!("left out: {error}"))
}
