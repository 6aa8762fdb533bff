//! `meshband stiffness`: mesh stiffness over the cycle, its components, and ISO 6336 beside it.

use clap::Args as ClapArgs;
use meshband_host::Result;
use meshband_host::stiffness::report::{Report, html};
use std::path::PathBuf;

/// Arguments of `meshband stiffness`.
#[derive(ClapArgs)]
pub struct Args {
    /// Machine file, or a record folder.
    machine: PathBuf,
    /// Points of the table over the path of contact.
    #[arg(long, default_value_t = 21)]
    points: usize,
    /// Writes everything as JSON here.
    #[arg(long)]
    json: Option<PathBuf>,
    /// Writes a self-contained HTML page with pictures here.
    #[arg(long)]
    report: Option<PathBuf>,
}

/// Prints the table and writes the files asked for.
pub fn run(args: Args) -> Result<()> {
    let machine = meshband_host::machine::Machine::read(&args.machine)?;
    let report = Report::new(&machine, args.points)?;
    print!("{report}");
    for warning in &report.warnings {
        eprintln!("warning: {warning}");
    }
    let write = |path: &PathBuf, text: String| std::fs::write(path, text).map_err(meshband_host::Error::file(path));
    if let Some(path) = &args.json {
        write(path, serde_json::to_string_pretty(&report).expect("plain data"))?;
    }
    if let Some(path) = &args.report {
        write(path, html(&report, &machine)?)?;
    }
    Ok(())
}
