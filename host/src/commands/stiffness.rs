//! `meshband stiffness`: mesh stiffness over the cycle, its components, and ISO 6336 beside it.

use clap::Args as ClapArgs;
use meshband_host::output::show;
use meshband_host::results::Results;
use meshband_host::stiffness::page::page;
use meshband_host::stiffness::report::Report;
use meshband_host::{Result, remark};
use std::path::PathBuf;

/// Arguments of `meshband stiffness`.
#[derive(ClapArgs)]
pub struct Args {
    /// Machine file, or a record folder.
    machine: PathBuf,
    /// Points of the table over the path of contact.
    #[arg(long, default_value_t = 21)]
    points: usize,
    #[command(flatten)]
    results: Results,
}

/// Writes the files asked for and prints the table.
pub fn run(args: Args) -> Result<()> {
    let mut files = args.results.announce(&mut args.results.outputs([args.machine.as_path()]))?;
    let machine = meshband_host::machine::Machine::read(&args.machine)?;
    let report = Report::new(&machine, args.points)?;
    files.write(&report, || page(&report, &machine))?;
    show(&report.to_string())?;
    report.warnings.iter().for_each(|warning| remark!("warning: {warning}"));
    Ok(())
}
