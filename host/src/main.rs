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
    /// Measurement files (mat, csv, wav, npy, uff58) into a record folder, with a virtual tach.
    Import(commands::import::Args),
    /// Bandwidth law of a machine: the paper's studies, fit, check, constants for the node.
    Law(commands::law::Args),
    /// Mesh stiffness over the cycle: tooth components, pair, total, ISO 6336 beside it.
    Stiffness(commands::stiffness::Args),
    /// The real firmware in QEMU on a run of a record.
    Node(commands::node::Args),
    /// What the declared machine gives for each run of a record.
    Predict(commands::predict::Args),
    /// A record folder of a simulated machine.
    Simulate(commands::simulate::Args),
}

fn main() -> ExitCode {
    let result = match Cli::parse().command {
        Command::Alias(args) => commands::alias::run(args),
        Command::Import(args) => commands::import::run(args),
        Command::Law(args) => commands::law::run(args),
        Command::Stiffness(args) => commands::stiffness::run(args),
        Command::Node(args) => commands::node::run(args),
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
