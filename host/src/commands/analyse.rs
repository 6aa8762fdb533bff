//! `meshband analyse`: order spectrum and map, sidebands, averages, envelope and unexplained orders of a record.

use super::part::PartArgs;
use clap::Args as ClapArgs;
use meshband_host::Result;
use meshband_host::analysis::{self, Choice, report, view};
use meshband_host::output::show;
use meshband_host::record::facts;
use meshband_host::results::Results;
use std::path::PathBuf;

/// Arguments of `meshband analyse`.
#[derive(ClapArgs)]
pub struct Args {
    /// Record folder; needs tooth counts and a tach, real or virtual.
    record: PathBuf,
    /// Only this run, from 0.
    #[arg(long, value_name = "N")]
    run: Option<usize>,
    /// Only this channel, from 0.
    #[arg(long, value_name = "N")]
    channel: Option<usize>,
    #[command(flatten)]
    part: PartArgs,
    #[command(flatten)]
    results: Results,
}

/// Analyses, writes the files asked for, then shows the tables.
pub fn run(args: Args) -> Result<()> {
    let mut files = args.results.announce(&mut args.results.outputs([args.record.as_path()]))?;
    let record = args.part.read(&args.record)?;
    if let Some(train) = record.declaration.train()? {
        let outcome = analysis::train::record(&record, &train, Choice { run: args.run, channel: args.channel })?;
        files.write(&outcome, || analysis::train_view::report(&outcome, &facts::about(&record)))?;
        return show(&analysis::train_view::text(&outcome));
    }
    let outcome = analysis::record(&record, Choice { run: args.run, channel: args.channel })?;
    files.write(&outcome, || report::report(&outcome, &facts::about(&record)))?;
    show(&view::text(&outcome))
}
