//! `meshband check`: what is wrong with a record, before anything is inferred from it.
//!
//! Every record: what its samples and pulses say of themselves. A record that declares a machine and knows its angle
//! 0: the loop's rules on top, against that machine.

use super::part::PartArgs;
use clap::Args as ClapArgs;
use meshband_host::check::Findings;
use meshband_host::data_quality::{self, Kind, Remark};
use meshband_host::model_based::report;
use meshband_host::observation::input;
use meshband_host::output::show;
use meshband_host::record::Record;
use meshband_host::report::Report;
use meshband_host::results::Results;
use meshband_host::{Result, check, say};
use serde::Serialize;
use std::path::PathBuf;

/// Arguments of `meshband check`.
#[derive(ClapArgs)]
pub struct Args {
    /// Record folder.
    record: PathBuf,
    #[command(flatten)]
    part: PartArgs,
    #[command(flatten)]
    results: Results,
}

/// What the command says, as JSON.
#[derive(Serialize)]
struct Outcome {
    #[serde(flatten)]
    findings: Findings,
    /// Of every run, what its recording says of itself.
    recording: Vec<Vec<Remark>>,
}

/// Writes and prints the findings; a record that the loop would refuse ends with exit code 2.
pub fn run(args: Args) -> Result<()> {
    let mut files = args.results.announce(&mut args.results.outputs([args.record.as_path()]))?;
    let record = args.part.read(&args.record)?;
    let outcome = Outcome {
        findings: findings(&record)?,
        recording: record.runs.iter().map(|run| data_quality::of_run(&record, run)).collect(),
    };
    let verdict = outcome.findings.require_usable();
    files.write(&outcome, || {
        let headline = verdict.as_ref().err().map_or_else(|| headline(&outcome), ToString::to_string);
        let report = Report::new(&format!("Check: {}", record.declaration.title()), &headline);
        let report = outcome
            .recording
            .iter()
            .enumerate()
            .fold(report.section("The recording itself"), |report, (run, remarks)| {
                remarks.iter().fold(report, |r, remark| r.note(&line(run, remark)))
            });
        Ok(report::findings(report, &outcome.findings))
    })?;
    for (run, remarks) in outcome.recording.iter().enumerate() {
        remarks.iter().try_for_each(|remark| say!("note: {}", line(run, remark)))?;
    }
    match outcome.findings.list.as_slice() {
        [] if !has_remarks(&outcome) => say!("no finding: {}", headline(&outcome))?,
        _ => show(&outcome.findings.text())?,
    }
    outcome.findings.not_checked.iter().try_for_each(|what| say!("not checked: {what}"))?;
    verdict
}

/// The loop's findings; where the record declares no machine whose angle 0 is known, none, and why.
fn findings(record: &Record) -> Result<Findings> {
    let source = record.declaration.tach.as_ref().map(|tach| tach.source.as_deref());
    let angle_known = matches!(source, Some(None));
    if record.declaration.has_machine() && angle_known {
        return Ok(check::record(&input::view(record)?));
    }
    let why = match source {
        None => "the record has no tach",
        Some(Some(_)) => "where angle 0 lies against the teeth is not known",
        Some(None) => "the record declares no machine",
    };
    let not_checked = vec![format!("samples and pulses against a declared machine: {why}")];
    Ok(Findings { list: Vec::new(), not_checked })
}

fn has_remarks(outcome: &Outcome) -> bool {
    outcome.recording.iter().flatten().any(|remark| remark.kind != Kind::MeshConfirmed)
}

fn headline(outcome: &Outcome) -> String {
    if has_remarks(outcome) {
        "The record can be read; look at the notes.".into()
    } else {
        "channels, runs, tach and declaration fit each other".into()
    }
}

fn line(run: usize, remark: &Remark) -> String {
    format!("run {run}: {}", remark.text)
}
