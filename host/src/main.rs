//! The `meshband` command: one subcommand per file in `commands/`.

use clap::{Parser, Subcommand};
use std::process::ExitCode;

mod commands;

/// Gear-vibration workbench: simulate, predict, import, run the virtual node, close the loop.
#[derive(Parser)]
#[command(name = "meshband", version)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Which spectral lines are folded mesh harmonics at a given sampling rate.
    Alias(commands::alias::Args),
    /// What the declared machine gives for each run of a record.
    Predict(commands::predict::Args),
    /// A record folder of a simulated machine.
    Simulate(commands::simulate::Args),
}

fn main() -> ExitCode {
    let result = match Cli::parse().command {
        Command::Alias(args) => commands::alias::run(args),
        Command::Predict(args) => commands::predict::run(args),
        Command::Simulate(args) => commands::simulate::run(args),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("meshband: {error}");
            ExitCode::from(2)
        }
    }
}
