//! `meshband loop`: what a record's declared machine lacks, and the held-out error before and after adding it.

use clap::Args as ClapArgs;
use meshband_host::closed_loop::{Options, close_loop, input};
use meshband_host::{Error, Result};
use std::path::PathBuf;

/// Arguments of `meshband loop`.
#[derive(ClapArgs)]
pub struct Args {
    /// Record folder.
    record: PathBuf,
    /// Writes the outcome as JSON.
    #[arg(long)]
    json: Option<PathBuf>,
    /// Seed of the split into fit, selection and held-out runs.
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

/// Runs the loop and prints the outcome.
pub fn run(args: Args) -> Result<()> {
    let record = input::read(&args.record)?;
    let options = Options { seed: args.seed, progress: true, ..Options::default() };
    let mut outcome = close_loop(&record, &options)?;
    if let Some(name) = args.record.file_name() {
        outcome.record = name.to_string_lossy().into_owned();
    }
    print!("{}", outcome.summary());
    if let Some(path) = args.json {
        let text = serde_json::to_string_pretty(&outcome).map_err(|e| Error::invalid("outcome", e))?;
        std::fs::write(&path, text + "\n").map_err(Error::file(&path))?;
    }
    Ok(())
}
