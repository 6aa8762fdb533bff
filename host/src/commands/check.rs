//! `meshband check`: what is wrong with a record, before anything is inferred from it.

use clap::Args as ClapArgs;
use meshband_host::model_based::report;
use meshband_host::observation::input;
use meshband_host::output::show;
use meshband_host::report::Report;
use meshband_host::results::Results;
use meshband_host::{Result, check, say};
use std::path::PathBuf;

/// Arguments of `meshband check`.
#[derive(ClapArgs)]
pub struct Args {
    /// Record folder.
    record: PathBuf,
    #[command(flatten)]
    results: Results,
}

/// Writes and prints the findings; a record that the loop would refuse ends with exit code 2.
pub fn run(args: Args) -> Result<()> {
    let mut files = args.results.announce(&mut args.results.outputs([args.record.as_path()]))?;
    let record = input::read(&args.record)?;
    let findings = check::record(&record);
    let verdict = findings.require_usable();
    files.write(&findings, || {
        let headline = verdict.as_ref().err().map_or_else(|| "The record can be used.".to_owned(), ToString::to_string);
        Ok(report::findings(Report::new(&format!("Check: {}", record.title), &headline), &findings))
    })?;
    match findings.list.as_slice() {
        [] => say!("no finding: channels, runs, tach and declaration fit each other")?,
        _ => show(&findings.text())?,
    }
    findings.not_checked.iter().try_for_each(|what| say!("not checked: {what}"))?;
    verdict
}
