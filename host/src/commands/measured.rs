//! `meshband measured`: published measurements against the model, error before and after on the held-out part.

use clap::{Args as ClapArgs, ValueEnum};
use meshband_host::measured::{adi, gear0, gfd, paderborn, paper};
use meshband_host::report::write_json;
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
    /// Writes the result as JSON.
    #[arg(long)]
    json: Option<PathBuf>,
}

/// Runs the analysis of one data set and prints its tables.
pub fn run(args: Args) -> Result<()> {
    let data = match (args.set, args.data) {
        (Set::Paper, _) => PathBuf::new(),
        (_, Some(data)) => data,
        _ => return Err(Error::invalid("--data", "is needed: the folder that holds gear0, gfd, adi, paderborn")),
    };
    let json = args.json.as_deref();
    match args.set {
        Set::Paper => show(&paper::run()?, paper::Outcome::summary, json),
        Set::Gear0 => show(&gear0::run(&data)?, gear0::Outcome::summary, json),
        Set::Gfd => show(&gfd::run(&data)?, gfd::Outcome::summary, json),
        Set::Adi => show(&adi::run(&data)?, adi::Outcome::summary, json),
        Set::Paderborn => show(&paderborn::run(&data)?, paderborn::Outcome::summary, json),
    }
}

fn show<T: Serialize>(outcome: &T, summary: fn(&T) -> String, json: Option<&std::path::Path>) -> Result<()> {
    print!("{}", summary(outcome));
    json.map_or(Ok(()), |path| write_json(path, outcome))
}
