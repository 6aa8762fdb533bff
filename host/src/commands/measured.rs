//! `meshband measured`: published measurements against the model, error before and after on the held-out part.

use super::results::Force;
use clap::{Args as ClapArgs, ValueEnum};
use meshband_host::measured::{adi, gear0, gfd, paderborn, paper};
use meshband_host::output::{OutputFile, show};
use meshband_host::{Error, Result};
use serde::Serialize;
use std::path::PathBuf;

/// Data sets.
#[derive(Clone, Copy, ValueEnum)]
enum Set {
    /// The paper's quoted lines (needs no data).
    Paper,
    /// One pair, synchronous accelerometers.
    Gear0,
    /// Two-stage box at ten loads.
    Gfd,
    /// Rotor rig: imbalance.
    Adi,
    /// Bearing rig: ring damage.
    Paderborn,
}

/// Arguments of `meshband measured`.
#[derive(ClapArgs)]
pub struct Args {
    /// Data set.
    set: Set,
    /// Folder that holds the data sets' folders; see docs/measured.md for where to get them.
    #[arg(long)]
    data: Option<PathBuf>,
    /// Writes the result as JSON; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    #[command(flatten)]
    permission: Force,
}

/// Runs the analysis of one data set and prints its tables.
pub fn run(args: Args) -> Result<()> {
    let data = match (args.set, args.data) {
        (Set::Paper, _) => PathBuf::new(),
        (_, Some(data)) => data,
        _ => return Err(Error::invalid("--data", "is needed: the folder that holds gear0, gfd, adi, paderborn")),
    };
    let json = args.permission.outputs([data.as_path()]).optional(args.json.as_deref())?;
    match args.set {
        Set::Paper => finish(&paper::run()?, paper::Outcome::summary, json),
        Set::Gear0 => finish(&gear0::run(&data)?, gear0::Outcome::summary, json),
        Set::Gfd => finish(&gfd::run(&data)?, gfd::Outcome::summary, json),
        Set::Adi => finish(&adi::run(&data)?, adi::Outcome::summary, json),
        Set::Paderborn => finish(&paderborn::run(&data)?, paderborn::Outcome::summary, json),
    }
}

fn finish<T: Serialize>(outcome: &T, summary: fn(&T) -> String, json: Option<OutputFile>) -> Result<()> {
    if let Some(mut file) = json {
        file.write_json(outcome)?;
    }
    show(&summary(outcome))
}
