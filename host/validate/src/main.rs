//! The `meshband-validate` program: campaigns that prove the workbench, one subcommand per file in `commands/`.

use clap::{Parser, Subcommand};
use meshband_host::program;
use std::process::ExitCode;

mod commands;

/// Proof of the workbench: generated records, injected effects, published measurements, alarm comparison.
#[derive(Parser)]
#[command(name = "meshband-validate", version)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Rolling bearings, measured with labels or generated: found, ring named, wrong names, beside a textbook peer.
    Bearings(commands::bearings::Args),
    /// Known effects put into a measured record: found, rightly named, or not, against the limits that `diagnose`
    /// prints.
    Inject(commands::inject::Args),
    /// Detection and false alarms of departure and absolute alarms over hours of a simulated machine.
    Levels(commands::levels::Args),
    /// Published measurements: lines the model lacks, held-out error before and after.
    Measured(commands::measured::Args),
    /// Campaign of the diagnosis on generated records: null, power, withheld effects, two effects.
    Prove(commands::prove::Args),
}

fn main() -> ExitCode {
    program::execute(|cli: Cli| match cli.command {
        Command::Bearings(args) => commands::bearings::run(args),
        Command::Inject(args) => commands::inject::run(args),
        Command::Levels(args) => commands::levels::run(args),
        Command::Measured(args) => commands::measured::run(args),
        Command::Prove(args) => commands::prove::run(args),
    })
}
